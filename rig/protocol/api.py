"""What a protocol script sees: typed parameters and the verbs of a bench notebook."""

from typing import Any, Protocol

from pydantic import BaseModel, ConfigDict

from rig.engine.records import Indentation


class ProtocolParameters(BaseModel):
    """Base of a script's `Parameters`: typed, with defaults; unknown keys and NaN are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


class Rig(Protocol):
    """The verbs. A script is run twice: once to be checked, nothing moving, and once for real."""

    @property
    def parameters(self) -> Any:
        """The script's own `Parameters`, with what `--set` changed."""

    def mount(self, indentor: str) -> None:
        """Have an indentor put on, e.g. "bar:3.0", "cylinder:9", "step:1"."""

    def home(self) -> None:
        """Find the home switches; nothing moves before."""

    def zero(self) -> None:
        """Zero the force sensor, the indentor in the air."""

    def move_to(self, *, x_mm: float, along_mm: float = 0.0) -> None:
        """Step sideways at clearance, to x from the centre of the finger pad; along from the receptor plane."""

    def touch(self) -> float:
        """Touch off at the present place and lift; returns the height of contact from the nominal apex, mm."""

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

    def precondition(
        self, *, presses: int, doi_mm: float | None = None, force_gwt: float | None = None, hold_s: float = 1.0
    ) -> None:
        """Press so many times at the present place to settle the skin: journalled, and no data."""

    def reference(self, *, x_mm: float, doi_mm: float, increments: int = 2, hold_s: float = 0.5) -> None:
        """Go there and press, no data: an alarm where force at depth is not what it was the first time."""

    def retract(self) -> None:
        """Lift to clearance."""

    def rest(self, seconds: float) -> None:
        """Let the finger be, at clearance."""

    def checkpoint(self, name: str) -> None:
        """Journal that the script has come to here; a name of its own for each."""

    def note(self, text: str) -> None:
        """Write a line into the journal."""
