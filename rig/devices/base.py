"""Interfaces of stages and force sensors, and their errors."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from rig.errors import RigError

Axis = Literal["x", "y", "z"]

LOOK_S = 0.1
"""Interval between statuses during a motion (s); a shorter motion is checked at its end."""


class StageError(RigError):
    """The stage did not carry out a command; trust its position only if the driver does."""

    default_code = "stage_failed"


class MoveError(RigError, ValueError):
    """Invalid move; nothing was sent."""

    default_code = "bad_move"


class StageAlarm(StageError):  # noqa: N818
    """The controller locked itself; `number` is the maker's alarm number."""

    default_code = "alarm"

    def __init__(self, number: int, meaning: str, **fields: Any) -> None:
        super().__init__("stage alarm {number}: {meaning}", number=number, meaning=meaning, **fields)
        self.number = number
        self.meaning = meaning


class StageReset(StageError):  # noqa: N818
    """The controller restarted: its queue is gone and its position is not trusted."""

    default_code = "was_reset"


class StageTimeout(StageError):  # noqa: N818
    """No answer, or no arrival, within the time allowed."""

    default_code = "timeout"


class StageNotHomed(StageError):  # noqa: N818
    """The stage is not homed; nothing was moved."""

    default_code = "not_homed"

    def __init__(self, who: str) -> None:
        super().__init__("{who} must be homed before a move; home the stage first", who=who)


class StageHeld(StageError):  # noqa: N818
    """The stage was held at its controller; commands wait until the hold is released."""

    default_code = "held"

    def __init__(self, state: str, who: str = "") -> None:
        super().__init__(
            "{who}the stage is held at its controller (state {state}); release the hold there", state=state, who=who
        )


class StageOverridden(StageError):  # noqa: N818
    """The speed was changed at the controller; the position is trusted. halt() restores full speed and rest."""

    default_code = "overridden"


class StageRejected(StageError):  # noqa: N818
    """The controller refused a line; `number` is the maker's error number."""

    default_code = "line_refused"

    def __init__(self, number: int, line: str, meaning: str) -> None:
        super().__init__(
            "the stage's controller refused {line!r} with error {number}: {meaning}",
            number=number,
            line=line,
            meaning=meaning,
        )
        self.number = number
        self.line = line
        self.meaning = meaning


def is_held(state: str) -> bool:
    """Return whether the controller is held in this state and continues on release."""
    return state.startswith(("Hold", "Door"))


@dataclass(frozen=True, slots=True)
class StageStatus:
    """State, in the controller's words, and machine coordinates (mm)."""

    state: str
    x_mm: float
    y_mm: float
    z_mm: float


Looks = Iterator[StageStatus | None]
"""Motion in progress: yields a status every LOOK_S and ends on arrival.

Items are None if the controller does not report during motion. The first item starts the motion. A caller that does
not exhaust the iterator must call Stage.halt() or Stage.stop().
"""


class Stage(Protocol):
    """Three axes in machine coordinates (mm): x lateral, y axial, z vertical, + up.

    An unhomed stage raises StageNotHomed before any byte is sent. A hold or override at the controller raises
    StageHeld or StageOverridden at the next status, unless the driver reports the hold in the status itself.
    """

    @property
    @abstractmethod
    def homed(self) -> bool:
        """Whether the position is trusted: homed, and no alarm, reset, timeout or stop since."""
        ...

    @abstractmethod
    def connect(self) -> str:
        """Connect and return the controller's identification. Raises StageError."""
        ...

    @abstractmethod
    def homing(self) -> Looks:
        """Home the stage; afterwards the position is trusted. Raises StageError."""
        ...

    @abstractmethod
    def moving(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
        look_s: float = LOOK_S,
    ) -> Looks:
        """Move in a straight line, with a status every look_s.

        Raises StageError; MoveError, StageNotHomed before any byte.
        """
        ...

    @abstractmethod
    def halt(self) -> None:
        """Abort the motion and return at rest; whether the position is trusted does not change.

        Speed overrides are reset as well. Raises StageError, TransportError.
        """
        ...

    def home(self) -> None:
        """Home and return when done. Raises StageError."""
        arrive(self.homing())

    def move_to(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
    ) -> None:
        """Move and return on arrival. Raises StageError; MoveError, StageNotHomed before any byte."""
        arrive(self.moving(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm, speed_mm_s=speed_mm_s, look_s=math.inf))

    @abstractmethod
    def status(self) -> StageStatus:
        """State and position now. Raises StageError."""
        ...

    @abstractmethod
    def look(self) -> StageStatus:
        """Return the status without connecting; changes nothing. Raises StageError."""
        ...

    @abstractmethod
    def steps_per_mm(self, axis: Axis) -> float:
        """Steps per mm set in the controller, negative if the motor runs against the axis."""
        ...

    @abstractmethod
    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """Jog by a distance and no farther, even if communication ends; return at once. Raises StageError."""
        ...

    @abstractmethod
    def end_jog(self) -> None:
        """Stop jogging and return at rest; the position stays trusted. Raises StageError."""
        ...

    @abstractmethod
    def set_output(self, on: bool) -> None:
        """Switch the sync output and return when done. Raises StageError."""
        ...

    @abstractmethod
    def stop(self) -> None:
        """Stop at once, past every queue and wait; a driver may then confirm the stop for up to 1 s.

        The position is not trusted afterwards. Raises StageError, TransportError.
        """
        ...

    def limit_depth(self, lowest_z_mm: float) -> None:
        """Make the controller refuse targets below a height, if it has a volatile limit.

        The default does nothing.

        Parameters
        ----------
        lowest_z_mm : float
            Lowest allowed position of the vertical axis, in machine mm.

        Raises
        ------
        StageError
            If the controller does not confirm the limit.
        """
        return

    def active_inputs(self) -> frozenset[str]:
        """Return the names of the controller's stop inputs that are active now.

        Returns
        -------
        frozenset of str
            For example ``{"door"}``. Empty by default: not every controller has inputs that it can report.

        Raises
        ------
        StageError
            If the controller does not answer.
        """
        return frozenset()

    @abstractmethod
    def unlock(self) -> None:
        """Clear an alarm without homing; the position stays untrusted. Raises StageError."""
        ...

    @abstractmethod
    def close(self) -> None:
        """Give the port back."""
        ...


def next_look_s(last_s: float, over_s: float, look_s: float) -> float:
    """Return the time of the next status of a motion due at over_s: not shortly before or after that."""
    due_s = last_s + look_s
    in_time = last_s >= over_s or over_s - due_s >= look_s / 2
    return due_s if in_time else max(due_s, over_s + look_s)


def arrive(looks: Looks) -> None:
    """Exhaust a motion."""
    for _ in looks:
        pass


@runtime_checkable
class DeadManStage(Protocol):
    """Stage whose controller stops by itself when communication ends."""

    def jog_while(self, axis: Axis, sign: int, held: Callable[[], bool], speed_mm_s: float) -> None:
        """Jog in one direction while held() is true, and return at rest. Raises StageError."""
        ...


class ForceError(RigError):
    """No force reading is available; pressing must stop."""

    default_code = "no_force"


class ForceOverload(ForceError):  # noqa: N818
    """The force exceeds the range of the instrument."""

    default_code = "overload"


class ForceUnderload(ForceError):  # noqa: N818
    """The force is below the range of the instrument: lifted off its support, or broken."""

    default_code = "underload"


class ForceBusy(ForceError):  # noqa: N818
    """The instrument is busy or found no stable value in time."""

    default_code = "busy"


class ForceBroken(ForceError):  # noqa: N818
    """The load cell, its converter or its cable is broken."""

    default_code = "broken"


class ForceTimeout(ForceError):  # noqa: N818
    """No answer within the time allowed."""

    default_code = "no_reply"


@dataclass(frozen=True, slots=True)
class ForceReading:
    """Force (N), whether the instrument reports it as stable, and its arrival on the host's monotonic clock (s)."""

    force_n: float
    stable: bool
    t_s: float


class ForceSensor(Protocol):
    """Single-axis force sensor (N); pressing is positive."""

    @property
    def sample_period_s(self) -> float:
        """Time between values that share no samples (s)."""
        ...

    @property
    def resolution_gwt(self) -> float:
        """Smallest step of the reading (gwt)."""
        ...

    def connect(self) -> str:
        """Connect and return the instrument's identification. Raises ForceError."""
        ...

    def identify(self) -> str:
        """Return the identification of an instrument that may be in use; changes nothing. Raises ForceError."""
        ...

    def read(self) -> ForceReading:
        """The latest value, stable or not. Raises ForceError."""
        ...

    def zero(self) -> None:
        """Zero the sensor at the present load. Raises ForceError."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


@runtime_checkable
class HasSetPoint(Protocol):
    """Sensor whose instrument switches a relay at a force that it reports."""

    def set_point_gwt(self, register: int) -> float:
        """Return the force at which the relay switches (gwt). Raises ForceError."""
        ...
