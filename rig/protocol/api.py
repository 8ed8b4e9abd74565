"""What a protocol script sees: typed parameters and the verbs of a bench notebook."""

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
    """What becomes of a step once it is checked: foreseen, carried out, answered from a journal, or rehearsed."""

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """The step's answer to the script."""


class Rig:
    """The verbs. A script is run twice: once to be checked, nothing moving, and once for real.

    Each verb is made a step, checked on the walk, and handed to the handler.
    """

    def __init__(self, parameters: ProtocolParameters, walk: Walk, handler: Handler) -> None:
        self._parameters, self._walk, self._handler = parameters, walk, handler
        self._marks: dict[str, Any] = {}

    @property
    def parameters(self) -> Any:
        """The script's own `Parameters`, with what `--set` changed."""
        return self._parameters

    def mark(self, marks: Mapping[str, Any]) -> None:
        """From here on steps are marked so: block, repeat and condition, as a schedule knows them."""
        self._marks = dict(marks)

    def _do(self, step: Step[E, A]) -> A:
        marked = replace(step, **self._marks)
        return self._handler.handle(marked, marked.check(self._walk))

    def mount(self, indentor: str) -> None:
        """Have an indentor put on, e.g. "bar:3.0", "cylinder:9", "step:1"."""
        self._do(Mount(indentor=indentor))

    def home(self) -> None:
        """Find the home switches; nothing moves before."""
        self._do(Home())

    def zero(self) -> None:
        """Zero the force sensor, the indentor in the air."""
        self._do(Zero())

    def move_to(self, *, x_mm: float, along_mm: float = 0.0) -> None:
        """Step sideways at clearance, to x from the centre of the finger pad; along from the receptor plane."""
        self._do(MoveTo(x_mm=x_mm, along_mm=along_mm))

    def touch(self) -> float:
        """Touch off at the present place and lift; returns the height of contact from the nominal apex, mm."""
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
        """Touch off, press to a depth or a force in equal increments, hold after each, lift to clearance."""
        return self._do(
            Indent(doi_mm=doi_mm, force_gwt=force_gwt, increments=increments, speed_mm_s=speed_mm_s, hold_s=hold_s)
        )

    def precondition(
        self, *, presses: int, doi_mm: float | None = None, force_gwt: float | None = None, hold_s: float = 1.0
    ) -> None:
        """Press so many times at the present place to settle the skin: journalled, and no data."""
        self._do(Precondition(presses=presses, doi_mm=doi_mm, force_gwt=force_gwt, hold_s=hold_s))

    def reference(self, *, x_mm: float, doi_mm: float, increments: int = 2, hold_s: float = 0.5) -> None:
        """Go there and press, no data: an alarm where force at depth is not what it was the first time."""
        self._do(Reference(x_mm=x_mm, doi_mm=doi_mm, increments=increments, hold_s=hold_s))

    def retract(self) -> None:
        """Lift to clearance."""
        self._do(Retract())

    def rest(self, seconds: float) -> None:
        """Let the finger be, at clearance."""
        self._do(Rest(seconds=seconds))

    def checkpoint(self, name: str) -> None:
        """Journal that the script has come to here; a name of its own for each."""
        self._do(Checkpoint(name=name))

    def note(self, text: str) -> None:
        """Write a line into the journal."""
        self._do(Note(text=text))
