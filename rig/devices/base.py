"""The contracts of a stage and of a force sensor, and how each fails."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from rig.errors import RigError

Axis = Literal["x", "y", "z"]

LOOK_S = 0.1
"""A motion is looked at so often while it lasts; one that is over sooner, when it is over."""


class StageError(RigError):
    """The stage did not do what it was told; position is to be trusted only if the driver says so."""

    default_code = "stage_failed"


class MoveError(RigError, ValueError):
    """A move that no stage could make, or not this one: nothing was sent."""

    default_code = "bad_move"


class StageAlarm(StageError):  # noqa: N818
    """The controller locked itself; number is the maker's."""

    default_code = "alarm"

    def __init__(self, number: int, meaning: str, **fields: Any) -> None:
        super().__init__("stage alarm {number}: {meaning}", number=number, meaning=meaning, **fields)
        self.number = number
        self.meaning = meaning


class StageReset(StageError):  # noqa: N818
    """The controller started anew: its queue is gone and its position is no longer to be trusted."""

    default_code = "was_reset"


class StageTimeout(StageError):  # noqa: N818
    """No answer, or no arrival, within the time allowed."""

    default_code = "timeout"


class StageNotHomed(StageError):  # noqa: N818
    """Nothing was moved: where the stage is would not be known."""

    default_code = "not_homed"

    def __init__(self, who: str) -> None:
        super().__init__("{who} must be homed before a move; home the stage first", who=who)


class StageHeld(StageError):  # noqa: N818
    """Somebody stopped it at the controller: whatever it was told waits for them, and is not to be waited for."""

    default_code = "held"

    def __init__(self, state: str, who: str = "") -> None:
        super().__init__(
            "{who}the stage is held at its controller (state {state}); release the hold there", state=state, who=who
        )


class StageOverridden(StageError):  # noqa: N818
    """Somebody changed how fast it goes; its position is trusted. halt() brings it to rest at full speed again."""

    default_code = "overridden"


class StageRejected(StageError):  # noqa: N818
    """The controller refused one line; number is the maker's."""

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
    """Whether a controller of this state was stopped by somebody, and goes on when they let go."""
    return state.startswith(("Hold", "Door"))


@dataclass(frozen=True, slots=True)
class StageStatus:
    """State as the controller names it; machine coordinates in mm."""

    state: str
    x_mm: float
    y_mm: float
    z_mm: float


Looks = Iterator[StageStatus | None]
"""A motion under way: each item is a look at the stage, LOOK_S after the last one; it ends on arrival.

None where the controller says nothing while it moves. The first look begins the motion. Whoever does not go to the
end of it calls Stage.halt() or Stage.stop().
"""


class Stage(Protocol):
    """Three axes in machine coordinates (mm): x lateral, y axial, z vertical, + up.

    No move is accepted unhomed: StageNotHomed before any byte. Moves and jogs that somebody interferes with raise
    StageHeld or StageOverridden at the next look; a driver whose status names a hold need not.
    """

    @property
    @abstractmethod
    def homed(self) -> bool:
        """Whether the position is to be trusted: homed, and no alarm, reset, timeout or stop since."""
        ...

    @abstractmethod
    def connect(self) -> str:
        """Make contact; returns the controller's identity. Raises StageError."""
        ...

    @abstractmethod
    def homing(self) -> Looks:
        """Find the home switches; afterwards the position is trusted. Raises StageError."""
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
        """Move in a straight line, looked at each look_s.

        Raises StageError; MoveError, StageNotHomed before any byte.
        """
        ...

    @abstractmethod
    def halt(self) -> None:
        """Give up the motion under way and return at rest; the position stays as trusted as it was.

        What somebody changed of its speed is ended, too. Raises StageError, TransportError.
        """
        ...

    def home(self) -> None:
        """Home and return when it is over. Raises StageError."""
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
        """Where a stage is that has not been spoken to; changes nothing. Raises StageError."""
        ...

    @abstractmethod
    def steps_per_mm(self, axis: Axis) -> float:
        """What the controller takes for a millimetre, negative where the motor runs against the axis."""
        ...

    @abstractmethod
    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """Go on by so much and no farther, even if nothing is heard again; returns at once. Raises StageError."""
        ...

    @abstractmethod
    def end_jog(self) -> None:
        """Stop jogging and return at rest; the position stays trusted. Raises StageError."""
        ...

    @abstractmethod
    def set_output(self, on: bool) -> None:
        """Raise or lower the output that tells a recording amplifier; returns when it is done. Raises StageError."""
        ...

    @abstractmethod
    def stop(self) -> None:
        """Stop now, past every queue and every wait; a driver may then make sure of it, for a second at most.

        The position is not trusted afterwards. Raises StageError, TransportError.
        """
        ...

    def limit_depth(self, lowest_z_mm: float) -> None:
        """Have the controller itself refuse any target below a height, where it can do so without wearing out.

        The default does nothing: not every controller has a volatile limit.

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
    """When a motion that should be over at over_s is looked at again: not just before that, nor just after it."""
    due_s = last_s + look_s
    in_time = last_s >= over_s or over_s - due_s >= look_s / 2
    return due_s if in_time else max(due_s, over_s + look_s)


def arrive(looks: Looks) -> None:
    """Go to the end of a motion."""
    for _ in looks:
        pass


@runtime_checkable
class DeadManStage(Protocol):
    """A stage whose controller stops by itself as soon as nothing is heard."""

    def jog_while(self, axis: Axis, sign: int, held: Callable[[], bool], speed_mm_s: float) -> None:
        """Run one way as long as held() says so, and return at rest. Raises StageError."""
        ...


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
