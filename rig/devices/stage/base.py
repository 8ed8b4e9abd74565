"""What the engine needs of a stage, and how a stage fails."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

Axis = Literal["x", "y", "z"]


class StageError(Exception):
    """The stage did not do what it was told; position is to be trusted only if the driver says so."""


class StageAlarm(StageError):  # noqa: N818
    """The controller locked itself; code is the maker's number."""

    def __init__(self, code: int, meaning: str) -> None:
        super().__init__(f"stage alarm {code}: {meaning}")
        self.code = code
        self.meaning = meaning


class StageReset(StageError):  # noqa: N818
    """The controller started anew: its queue is gone and its position is no longer to be trusted."""


class StageTimeout(StageError):  # noqa: N818
    """No answer, or no arrival, within the time allowed."""


class StageRejected(StageError):  # noqa: N818
    """The controller refused one line; code is the maker's number."""

    def __init__(self, code: int, line: str, meaning: str) -> None:
        super().__init__(f"stage refused {line!r} with error {code}: {meaning}")
        self.code = code
        self.line = line
        self.meaning = meaning


@dataclass(frozen=True, slots=True)
class StageStatus:
    """State as the controller names it; machine coordinates in mm."""

    state: str
    x_mm: float
    y_mm: float
    z_mm: float


class Stage(Protocol):
    """Three axes in machine coordinates (mm): x lateral, y axial, z vertical, + up."""

    def connect(self) -> str:
        """Make contact; returns the controller's identity. Raises StageError."""
        ...

    def home(self) -> None:
        """Find the home switches; afterwards the position is trusted. Raises StageError."""
        ...

    def move_to(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
    ) -> None:
        """Move in a straight line and return on arrival. Raises StageError, ValueError before any byte."""
        ...

    def status(self) -> StageStatus:
        """State and position now. Raises StageError."""
        ...

    def look(self) -> StageStatus:
        """Where a stage is that has not been spoken to; changes nothing. Raises StageError."""
        ...

    def steps_per_mm(self, axis: Axis) -> float:
        """What the controller takes for a millimetre, negative where the motor runs against the axis."""
        ...

    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """Go on by so much and no farther, even if nothing is heard again; returns at once. Raises StageError."""
        ...

    def end_jog(self) -> None:
        """Stop jogging and return at rest; the position stays trusted. Raises StageError."""
        ...

    def set_output(self, on: bool) -> None:
        """Raise or lower the output that tells a recording amplifier; returns when it is done. Raises StageError."""
        ...

    def stop(self) -> None:
        """Stop now, past every queue and every wait; a driver may then make sure of it, for a second at most.

        The position is not trusted afterwards. Raises StageError, TransportError.
        """
        ...

    def unlock(self) -> None:
        """Clear an alarm without homing; the position stays untrusted. Raises StageError."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


@runtime_checkable
class DeadManStage(Protocol):
    """A stage whose controller stops by itself as soon as nothing is heard."""

    def jog_while(self, axis: Axis, sign: int, held: Callable[[], bool], speed_mm_s: float) -> None:
        """Run one way as long as held() says so, and return at rest. Raises StageError."""
        ...
