"""What the engine needs of a force sensor, and how it fails."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from rig.errors import RigError


class ForceError(RigError):
    """There is no force to be had: whoever presses must stop."""

    default_code = "no_force"


class ForceOverload(ForceError):  # noqa: N818
    """More than the instrument can measure."""

    default_code = "overload"


class ForceUnderload(ForceError):  # noqa: N818
    """Less than the instrument can measure: lifted off its support, or broken."""

    default_code = "underload"


class ForceBusy(ForceError):  # noqa: N818
    """The instrument does something else, or found no stable value in its own time."""

    default_code = "busy"


class ForceBroken(ForceError):  # noqa: N818
    """The cell or its converter is broken, or its cable."""

    default_code = "broken"


class ForceTimeout(ForceError):  # noqa: N818
    """No answer within the time allowed."""

    default_code = "no_reply"


@dataclass(frozen=True, slots=True)
class ForceReading:
    """A force in N, whether the instrument calls it stable, and the host's monotonic time when it came in."""

    force_n: float
    stable: bool
    t_s: float


class ForceSensor(Protocol):
    """One axis of force, N; press on the sensor is positive."""

    @property
    def sample_period_s(self) -> float:
        """How often the instrument has a value that is made of new samples only."""
        ...

    @property
    def resolution_gwt(self) -> float:
        """One step of what the instrument shows, gwt: less than that it cannot tell from nothing."""
        ...

    def connect(self) -> str:
        """Make contact; returns the instrument's identity. Raises ForceError."""
        ...

    def identify(self) -> str:
        """The identity of an instrument that somebody else may be using: changes nothing. Raises ForceError."""
        ...

    def read(self) -> ForceReading:
        """The latest value, stable or not. Raises ForceError."""
        ...

    def zero(self) -> None:
        """Take the present load for zero. Raises ForceError."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


@runtime_checkable
class HasSetPoint(Protocol):
    """A sensor whose instrument switches a relay at a force, and says at which."""

    def set_point_gwt(self, register: int) -> float:
        """Return the force at which the relay switches (gwt). Raises ForceError."""
        ...
