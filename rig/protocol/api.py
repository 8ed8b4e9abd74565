"""What a protocol script uses: typed parameters, and `Rig` with its verbs."""

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
    Reference,
    Rest,
    Retract,
    Step,
    Touch,
    Zero,
)
from rig.records import Indentation

E = TypeVar("E")
A = TypeVar("A")


class ProtocolParameters(BaseModel):
    """Base of a script's `Parameters`: typed, with defaults; unknown keys and NaN are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


class Handler(Protocol):
    """What happens to a checked step: it is planned, executed, answered from a journal, or rehearsed."""

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """Return the step's answer to the script."""


class Rig:
    """The verbs of a script, which runs more than once: to be checked, while nothing moves, and for real.

    Each verb makes a step, checks it, and passes it to the handler. What cannot be done raises BadInputError.
    """

    def __init__(self, parameters: ProtocolParameters, walk: Walk, handler: Handler) -> None:
        self._parameters, self._walk, self._handler = parameters, walk, handler
        self._marks: dict[str, Any] = {}

    @property
    def parameters(self) -> Any:
        """The script's own `Parameters`, with the values of `--set`."""
        return self._parameters

    def mark(self, marks: Mapping[str, Any]) -> None:
        """Set the block, repeat and condition of the steps that follow. Schedules call this."""
        self._marks = dict(marks)

    def _do(self, step: Step[E, A]) -> A:
        marked = replace(step, **self._marks)
        return self._handler.handle(marked, marked.check(self._walk))

    def mount(self, indentor: str) -> None:
        """Ask the operator to mount an indentor, e.g. "bar:3.0", "cylinder:9", "step:1"."""
        self._do(Mount(indentor=indentor))

    def home(self) -> None:
        """Find the home switches; no other motion is allowed before."""
        self._do(Home())

    def zero(self) -> None:
        """Zero the force sensor, with the indentor in the air."""
        self._do(Zero())

    def move_to(self, *, x_mm: float, along_mm: float = 0.0) -> None:
        """Move sideways at clearance.

        Parameters
        ----------
        x_mm : float
            Lateral position from the center of the finger pad.
        along_mm : float
            Position along the finger from the receptor plane, where the stage has that axis.
        """
        self._do(MoveTo(x_mm=x_mm, along_mm=along_mm))

    def touch(self) -> float:
        """Find contact at the present place and lift.

        Returns
        -------
        float
            Height of contact above the nominal apex (mm).
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
        doi_mm : float
            Depth of the last increment past contact. Pass either a depth or a force.
        force_gwt : float
            Force of the last increment.
        increments : int
            Number of equal increments to the target, each with a hold.
        speed_mm_s : float, optional
            Speed past contact. Default: habits.press_speed_mm_s.
        hold_s : float
            Duration of each hold.

        Returns
        -------
        Indentation
            Mean depth and force of each hold.
        """
        return self._do(
            Indent(doi_mm=doi_mm, force_gwt=force_gwt, increments=increments, speed_mm_s=speed_mm_s, hold_s=hold_s)
        )

    def precondition(
        self, *, presses: int, doi_mm: float | None = None, force_gwt: float | None = None, hold_s: float = 1.0
    ) -> None:
        """Press several times at the present place, to settle the skin.

        The journal keeps these presses apart from data.

        Parameters
        ----------
        presses : int
        doi_mm, force_gwt : float
            Depth or force of each press, one of them.
        hold_s : float
            Duration of each hold.
        """
        self._do(Precondition(presses=presses, doi_mm=doi_mm, force_gwt=force_gwt, hold_s=hold_s))

    def reference(self, *, x_mm: float, doi_mm: float, increments: int = 2, hold_s: float = 0.5) -> None:
        """Press at a fixed place, and raise an alarm where the force differs from that of the first such press.

        The journal keeps these presses apart from data. The band is limits.reference_band.

        Parameters
        ----------
        x_mm : float
            Lateral position from the center of the finger pad.
        doi_mm : float
            Depth of the last increment past contact.
        increments : int
            Number of equal increments, each with a hold.
        hold_s : float
            Duration of each hold.
        """
        self._do(Reference(x_mm=x_mm, doi_mm=doi_mm, increments=increments, hold_s=hold_s))

    def retract(self) -> None:
        """Lift to clearance."""
        self._do(Retract())

    def rest(self, seconds: float) -> None:
        """Wait at clearance."""
        self._do(Rest(seconds=seconds))

    def checkpoint(self, name: str) -> None:
        """Journal that the script has reached this place; each name may be used once."""
        self._do(Checkpoint(name=name))

    def note(self, text: str) -> None:
        """Write a line of text into the journal."""
        self._do(Note(text=text))
