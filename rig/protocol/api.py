"""Names of a protocol script: typed parameters, and `Rig` with its verbs."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict

from rig.protocol.check import Spot, Walk
from rig.protocol.steps import (
    Checkpoint,
    Home,
    Indent,
    Mount,
    MoveTo,
    Note,
    Precondition,
    Ramp,
    Reference,
    Rest,
    Retract,
    Step,
    Touch,
    Zero,
)
from rig.protocol.turns import Turns
from rig.records import Indentation

E = TypeVar("E")
A = TypeVar("A")


class ProtocolParameters(BaseModel):
    """Base class of a script's `Parameters`: typed, with defaults.

    Unknown keys and NaN are errors. A subclass adds fields with `rig.protocol.Field`.

    Examples
    --------
    >>> from rig.protocol import Field, ProtocolParameters
    >>> class Parameters(ProtocolParameters):
    ...     force_gwt: float = Field(2.33, gt=0, le=50, description="target force")
    >>> Parameters(force_gwt=8.0).force_gwt
    8.0
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


class Handler(Protocol):
    """Receiver of checked steps, which plans, executes or rehearses them, or answers from a journal."""

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """Return the step's answer to the script."""


class Rig:
    """Verbs of a protocol script.

    The program runs a script several times: to check it while nothing moves, and to carry it out. Each verb makes a
    step, checks it, and passes it to a handler. A script receives its `Rig` from the program.

    Parameters
    ----------
    parameters : ProtocolParameters
        The script's own `Parameters`.
    walk : Walk
        State of the script while it is checked.
    handler : Handler
        What receives the checked steps.

    Examples
    --------
    >>> from rig.protocol import ProtocolParameters, Rig
    >>> class Parameters(ProtocolParameters):
    ...     force_gwt: float = 2.33
    >>> def run(rig: Rig) -> None:
    ...     rig.mount("bar:3.0")
    ...     rig.home()
    ...     rig.zero()
    ...     rig.move_to(x_mm=0.5)
    ...     rig.indent(force_gwt=rig.parameters.force_gwt, hold_s=1.0)
    """

    def __init__(self, parameters: ProtocolParameters, walk: Walk, handler: Handler) -> None:
        self._parameters, self._walk, self._handler = parameters, walk, handler
        self._marks: dict[str, Any] = {}
        self._turns = Turns()

    @property
    def parameters(self) -> Any:
        """Parameters of the script, with the values of `--set`."""
        return self._parameters

    def mark(self, marks: Mapping[str, Any]) -> None:
        """Set the block, repeat and condition of the steps that follow.

        Schedules call this method; a script need not.

        Parameters
        ----------
        marks : mapping of str to object
            Values of `block`, `repeat` and `condition`; those that are left out are cleared.
        """
        self._marks = dict(marks)

    def _do(self, step: Step[E, A]) -> A:
        marked = replace(step, **self._marks)
        with self._turns.verb(step.verb):
            return self._handler.handle(marked, marked.check(self._walk))

    def mount(self, indentor: str) -> None:
        """Ask the operator to mount an indentor.

        Parameters
        ----------
        indentor : str
            Name of the indentor, for example ``"bar:3.0"``, ``"cylinder:9"`` or ``"step:1"`` (dimensions in mm).

        Raises
        ------
        BadInputError
            If there is no such indentor.
        """
        self._do(Mount(indentor=indentor))

    def home(self) -> None:
        """Home the stage; no other motion is allowed before."""
        self._do(Home())

    def zero(self) -> None:
        """Zero the force sensor while the indentor is in the air.

        Raises
        ------
        BadInputError
            If the stage is not homed.
        """
        self._do(Zero())

    def move_to(self, *, x_mm: float, along_mm: float = 0.0) -> None:
        """Move sideways at clearance.

        Parameters
        ----------
        x_mm : float
            Lateral position from the center of the finger pad (mm).
        along_mm : float, optional
            Position along the finger from the receptor plane (mm), where the stage has that axis.

        Raises
        ------
        BadInputError
            If the stage is not homed, or the position is outside the limits.
        """
        self._do(MoveTo(x_mm=x_mm, along_mm=along_mm))

    def touch(self) -> float:
        """Find contact at the present position, and lift.

        Returns
        -------
        float
            Height of contact above the nominal apex (mm).

        Raises
        ------
        BadInputError
            If a step that must come first is missing, or contact would be outside the travel of the stage.
        """
        return self._do(Touch())

    def indent(
        self,
        *,
        doi_mm: float | None = None,
        force_gwt: float | None = None,
        increments: int = 1,
        speed_mm_s: float | None = None,
        hold_s: float = 1.0,
    ) -> Indentation:
        """Find contact, press to a depth or a force, and lift to clearance.

        Parameters
        ----------
        doi_mm : float, optional
            Depth of the last increment past contact (mm). Pass either a depth or a force.
        force_gwt : float, optional
            Force of the last increment (gwt).
        increments : int, optional
            Number of equal increments to the target, each with a hold.
        speed_mm_s : float, optional
            Speed past contact (mm/s). Default: `habits.press_speed_mm_s`.
        hold_s : float, optional
            Duration of each hold (s).

        Returns
        -------
        Indentation
            Mean depth (mm) and mean force (gwt) of each hold.

        Raises
        ------
        BadInputError
            If a step that must come first is missing, an argument is out of range, or the finger model predicts a
            depth or a force beyond a limit.
        """
        return self._do(
            Indent(doi_mm=doi_mm, force_gwt=force_gwt, increments=increments, speed_mm_s=speed_mm_s, hold_s=hold_s)
        )

    def ramp(self, *, doi_mm: float, speed_mm_s: float, hold_s: float = 1.0) -> Indentation:
        """Find contact, move from above the skin to a depth at constant speed, hold, and lift to clearance.

        The first ramp at a place, and a deeper one, begins with a press by increments to the same depth, which
        measures the stiffness. A ramp trips at a force below the soft trip, such that it comes to rest within the
        trip and the overshoot of a press.

        Parameters
        ----------
        doi_mm : float
            Depth past contact (mm).
        speed_mm_s : float
            Speed (mm/s).
        hold_s : float, optional
            Duration of the hold (s).

        Returns
        -------
        Indentation
            Mean depth (mm) and mean force (gwt) of the hold.

        Raises
        ------
        BadInputError
            As `indent`; if the stage cannot ramp, or the ramp is too fast for the stiffness that the finger model
            predicts.
        """
        return self._do(Ramp(doi_mm=doi_mm, speed_mm_s=speed_mm_s, hold_s=hold_s))

    def precondition(
        self, *, presses: int, doi_mm: float | None = None, force_gwt: float | None = None, hold_s: float = 1.0
    ) -> None:
        """Press several times at the present position, to settle the skin.

        The journal stores these presses apart from data.

        Parameters
        ----------
        presses : int
            Number of presses.
        doi_mm : float, optional
            Depth of each press past contact (mm). Pass either a depth or a force.
        force_gwt : float, optional
            Force of each press (gwt).
        hold_s : float, optional
            Duration of each hold (s).

        Raises
        ------
        BadInputError
            As `indent`.
        """
        self._do(Precondition(presses=presses, doi_mm=doi_mm, force_gwt=force_gwt, hold_s=hold_s))

    def reference(self, *, x_mm: float, doi_mm: float, increments: int = 2, hold_s: float = 0.5) -> None:
        """Press at a fixed position to monitor the skin.

        An alarm is raised where the force differs from that of the first such press by more than
        `limits.reference_band`. The journal stores these presses apart from data.

        Parameters
        ----------
        x_mm : float
            Lateral position from the center of the finger pad (mm).
        doi_mm : float
            Depth of the last increment past contact (mm).
        increments : int, optional
            Number of equal increments, each with a hold.
        hold_s : float, optional
            Duration of each hold (s).

        Raises
        ------
        BadInputError
            As `indent`.
        """
        self._do(Reference(x_mm=x_mm, doi_mm=doi_mm, increments=increments, hold_s=hold_s))

    def retract(self) -> None:
        """Lift to clearance.

        Raises
        ------
        BadInputError
            If the stage is not homed.
        """
        self._do(Retract())

    def rest(self, seconds: float) -> None:
        """Wait at clearance.

        Parameters
        ----------
        seconds : float
            Duration (s).

        Raises
        ------
        BadInputError
            If the duration is out of range.
        """
        self._do(Rest(seconds=seconds))

    def checkpoint(self, name: str) -> None:
        """Write into the journal that the script has reached this point.

        Parameters
        ----------
        name : str
            Name of the checkpoint; a script uses each name once.

        Raises
        ------
        BadInputError
            If the name is no text, or is used already.
        """
        self._do(Checkpoint(name=name))

    def note(self, text: str) -> None:
        """Write a line of text into the journal.

        Parameters
        ----------
        text : str
            The line.

        Raises
        ------
        BadInputError
            If it is no text.
        """
        self._do(Note(text=text))
