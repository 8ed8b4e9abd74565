"""Stage whose axes cannot keep a straight line together: one axis moves at a time, y is set by hand."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Generic, Protocol, TypeVar

from rig.clock import Clock
from rig.devices.base import (
    LOOK_S,
    Axis,
    Looks,
    MoveError,
    Stage,
    StageAlarm,
    StageError,
    StageHeld,
    StageNotHomed,
    StageOverridden,
    StageReset,
    StageStatus,
    StageTimeout,
    next_look_s,
)
from rig.settings import SLOWEST_MM_S, BenchSettings

_SAME_PLACE_MM = 1e-6
POLL_S, ALARM_S = 0.02, 0.25
"""Poll interval near the end of a motion, and longest time between polls for alarms before that (s)."""


def one_axis(
    x_mm: float | None, y_mm: float | None, z_mm: float | None, speed_mm_s: float, set_y_mm: float
) -> tuple[str | None, float]:
    """Return the axis that moves and its target (machine mm); no axis for a move to the y that is set by hand.

    Raises MoveError for two axes at once, another y, a speed below the slowest, and numbers that are not finite.
    """
    for name, value in (("x_mm", x_mm), ("y_mm", y_mm), ("z_mm", z_mm), ("speed_mm_s", speed_mm_s)):
        if value is not None:
            refuse_not_finite(name, value)
    if speed_mm_s < SLOWEST_MM_S:
        raise MoveError(f"speed_mm_s must be at least {SLOWEST_MM_S:.4f}, got {speed_mm_s}", "too_slow")
    if y_mm is not None and abs(y_mm - set_y_mm) > _SAME_PLACE_MM:
        raise MoveError(f"y_mm must be {set_y_mm:g}, the position set by hand, got {y_mm:g}", "set_by_hand")
    moves = {axis: mm for axis, mm in (("x", x_mm), ("z", z_mm)) if mm is not None}
    if len(moves) > 1 or not (moves or y_mm is not None):
        raise MoveError(
            "a move needs exactly one of x_mm and z_mm: two drives cannot keep a straight line", "not_one_axis"
        )
    return next(iter(moves.items()), (None, set_y_mm))


def refuse_not_finite(name: str, value: float) -> None:
    """Raise MoveError for a number that is not finite."""
    if not math.isfinite(value):
        raise MoveError(f"{name} must be a finite number, got {value}", "not_finite")


class _Look(Protocol):
    @property
    def busy(self) -> bool:
        """Whether the axis moves."""
        ...


Look = TypeVar("Look", bound=_Look)


def travel_s(mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Return the duration of a move from rest to rest; an infinite acceleration is that of no ramp."""
    ramp_s = speed_mm_s / acceleration_mm_s2
    if mm <= speed_mm_s * ramp_s:
        return 2 * math.sqrt(mm / acceleration_mm_s2)
    return mm / speed_mm_s + ramp_s


class WayHome:
    """Way of an axis that searches its home switch: towards home, and back from the switch by a little."""

    BEFORE_MM, TOWARDS_MM, AFTER_MM = 1.0, 0.1, 10.0
    """Longest way away from home before the axis went so far towards it or reached the switch, and after that."""

    def __init__(self) -> None:
        self._up_mm = self._highest_mm = 0.0
        self._most_mm = self.BEFORE_MM

    def is_wrong(self, up_mm: float, *, at_switch: bool) -> bool:
        """Return whether the axis is too far on its way away from home.

        up_mm: distance since the last look, positive towards home. at_switch: whether the home switch is active.
        """
        self._up_mm += up_mm
        self._highest_mm = max(self._highest_mm, self._up_mm)
        if at_switch or self._highest_mm >= self.TOWARDS_MM:
            self._most_mm = self.AFTER_MM
        return self._highest_mm - self._up_mm > self._most_mm


class DrivenAxis(Protocol[Look]):
    """Axis of a `TwoAxisStage`: one drive, in machine mm. `Look` is the type of its status reply."""

    @property
    def steps_per_mm(self) -> float:
        """Native steps per mm."""
        ...

    def connect(self) -> str:
        """Compare the drive with the configuration and return its identification. Raises StageError."""
        ...

    def native_speed(self, speed_mm_s: float) -> int:
        """Return the speed in the drive's unit. Raises MoveError."""
        ...

    def look(self) -> Look:
        """Ask the drive. Raises StageError."""
        ...

    def mm(self, look: Look) -> float:
        """Return the position (mm)."""
        ...

    def moving(self, to_mm: float, speed_mm_s: float, keep_on: Callable[[], bool], look_s: float) -> Iterator[Look]:
        """Move to a position. Raises StageError."""
        ...

    def jog(self, by_mm: float, speed_mm_s: float, keep_on: Callable[[], bool]) -> None:
        """Move by a distance from rest, and return at once. Raises StageError."""
        ...

    def halt(self) -> None:
        """Stop and return at rest; steps are not lost. Raises StageError."""
        ...

    def confirm_stopped(self) -> None:
        """Return once the axis rests after a stop. Raises StageError."""
        ...


class WatchedAxis(Generic[Look]):
    """Base class of an axis whose drive is polled for the end of a motion."""

    name: str
    _clock: Clock

    @property
    @abstractmethod
    def _label(self) -> str:
        """Port and axis, the beginning of every error of this axis."""
        ...

    def _until(
        self,
        look: Callable[[], tuple[Look, bool]],
        most_s: float,
        first_s: float,
        what: str,
        look_s: float = LOOK_S,
    ) -> Iterator[Look]:
        """Look until look() returns that the motion is over; yield a look every look_s.

        During the first first_s the axis is looked at seldom, for alarms, and steadily afterwards.
        """
        begun_s = self._clock.monotonic_s()
        over_s, due_s = begun_s + first_s, next_look_s(begun_s, begun_s + first_s, look_s)
        while True:
            now_s = self._clock.monotonic_s()
            self._clock.wait_s(min(over_s - now_s, due_s - now_s, ALARM_S) if over_s > now_s else POLL_S)
            found, over = look()
            if over:
                return
            self._refuse_late(begun_s + most_s, what, most_s)
            if self._clock.monotonic_s() >= due_s:
                yield found
                due_s = next_look_s(self._clock.monotonic_s(), over_s, look_s)

    def _refuse_late(self, deadline_s: float, what: str, most_s: float) -> None:
        if self._clock.monotonic_s() >= deadline_s:
            raise StageTimeout(f"{self._label}: {what} takes longer than {most_s:.1f} s", "not_over")

    def _homes_the_wrong_way(self) -> StageError:
        return StageError(
            f"{self._label} moves away from home while homing; check the settings of the controller, and its limit "
            "switches",
            "homes_the_wrong_way",
        )

    def _stopped(self) -> StageError:
        return StageError(f"{self._label} was stopped", "stopped")


def whole_speed(speed_mm_s: float, unit: float) -> int:
    """Return a speed as a whole number of a drive's units, `unit` of them for 1 mm/s. Raises MoveError below 1."""
    native = math.floor(speed_mm_s * unit + 1e-9)
    if native < 1:
        raise MoveError(f"speed_mm_s must be at least {1 / unit:.4f}, got {speed_mm_s}", "too_slow")
    return native


AnAxis = TypeVar("AnAxis", bound=DrivenAxis[Any])


class TwoAxisStage(Stage, Generic[AnAxis, Look]):
    """Base class of a stage with drives for x and z, which move one at a time.

    name: what a stage that is not homed is called. The position along the finger is set by hand. An axis with
    backlash always arrives in its negative direction (down, for z): an opposite move overruns by twice the backlash
    and returns.
    """

    def __init__(self, x: AnAxis, z: AnAxis, *, name: str, settings: BenchSettings) -> None:
        self._axes = {"x": x, "z": z}
        self._overrun_mm = {axis: 2 * settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in "xz"}
        self._name, self._y_mm = name, settings.frame.pad_y_mm
        self._trusted = False
        self._times_stopped = 0  # counted from any thread

    @abstractmethod
    def _send_stop(self) -> None:
        """Send a stop to both drives past every wait. Raises TransportError."""
        ...

    @abstractmethod
    def _refuse_alarm(self, axis: AnAxis, look: Look) -> None:
        """Raise StageAlarm or StageReset for an alarm; for a trusted position, also for what ends the trust."""
        ...

    @abstractmethod
    def _is_referenced(self, axis: AnAxis, look: Look) -> bool:
        """Return whether a drive at rest still counts from its home position; called after `_refuse_alarm`."""
        ...

    @property
    def homed(self) -> bool:
        """Whether the position is trusted: homed, and no alarm, reset, timeout or stop since."""
        return self._trusted

    def connect(self) -> str:
        """Compare both axes with the configuration and return their identification. Raises StageError."""
        self._trusted = False
        return "; ".join(axis.connect() for axis in self._axes.values())

    def trust_position(self) -> None:
        self._trusted = True

    def status(self) -> StageStatus:
        """Return the state and position of both axes.

        Raises StageError, also for the first alarm or reset while the position is trusted.
        """
        return self._status({})

    def look(self) -> StageStatus:
        return self.status()

    def moving(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
        look_s: float = LOOK_S,
    ) -> Looks:
        """Move straight to a position (machine mm).

        Raises StageError; MoveError, StageNotHomed before any byte: for two axes at once, another y, or a speed out
        of range.
        """
        name, target_mm = one_axis(x_mm, y_mm, z_mm, speed_mm_s, self._y_mm)
        if name is None:
            return
        axis = self._axes[name]
        axis.native_speed(speed_mm_s)
        if not self._trusted:
            raise StageNotHomed(self._name)

        def looks() -> Iterator[Look]:
            for stop_mm in self._stops(name, target_mm):
                yield from axis.moving(stop_mm, speed_mm_s, lambda: self._trusted, look_s)

        yield from self._watched(name, looks())

    def _watched(self, name: str, looks: Iterator[Look]) -> Looks:
        """Yield the status at each look of a motion of an axis; an error ends the trust in the position."""
        try:
            for look in looks:
                yield self._status({name: look})
        except (StageHeld, StageOverridden):
            raise
        except StageError:
            self._trusted = False
            raise

    def halt(self) -> None:
        """Stop each axis at its acceleration; no step is lost. Raises StageError."""
        for axis in self._up_first():
            axis.halt()

    def steps_per_mm(self, axis: Axis) -> float:
        """Return the native steps per mm. Raises StageError for y."""
        return self._axis(axis).steps_per_mm

    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """Move by a distance from rest; whether the position is trusted does not change.

        Raises StageError; MoveError before any byte.
        """
        moves = self._axis(axis)
        moves.native_speed(speed_mm_s)
        refuse_not_finite("by_mm", by_mm)
        moves.jog(by_mm, speed_mm_s, self._until_stopped())

    def stop(self) -> None:
        """Stop both axes at once, past every wait, and confirm it.

        The stop is verified, and repeated, for up to 1 s. Raises StageError if an axis does not come to rest,
        TransportError.
        """
        self._times_stopped += 1
        self._trusted = False
        self._send_stop()
        problems = [problem for axis in self._up_first() if (problem := _unconfirmed(axis))]
        if problems:
            raise problems[0]

    def _status(self, known: Mapping[str, Look]) -> StageStatus:
        """Return the status. known: status replies that were already checked, by axis."""
        busy, alarm, referenced, at_mm = False, False, True, {}
        for name, axis in self._axes.items():
            look = known[name] if name in known else axis.look()
            if name not in known:
                alarm |= self._has_alarm(axis, look)
                referenced &= self._is_referenced(axis, look)
            busy |= look.busy
            at_mm[name] = axis.mm(look)
        state = "Alarm" if alarm else "Run" if busy else "Idle"
        return StageStatus(state, at_mm["x"], self._y_mm, at_mm["z"], referenced)

    def _has_alarm(self, axis: AnAxis, look: Look) -> bool:
        """Return whether an axis has an alarm; raise if it has one since the position is trusted."""
        try:
            self._refuse_alarm(axis, look)
        except (StageAlarm, StageReset):
            if self._trusted:
                self._trusted = False
                raise
            return True
        return False

    def _until_stopped(self) -> Callable[[], bool]:
        times = self._times_stopped
        return lambda: self._times_stopped == times

    def _axis(self, name: Axis) -> AnAxis:
        if name not in self._axes:
            raise StageError(f"the stage has no drive for the {name} axis; set it by hand", "no_drive")
        return self._axes[name]

    def _up_first(self) -> tuple[AnAxis, AnAxis]:
        return self._axes["z"], self._axes["x"]

    def _stops(self, name: str, to_mm: float) -> list[float]:
        """Return the successive targets: one, or two to take up backlash."""
        axis, overrun_mm = self._axes[name], self._overrun_mm[name]
        if not (overrun_mm and to_mm > axis.mm(axis.look())):
            return [to_mm]
        return [min(to_mm + overrun_mm, 0.0), to_mm]


def _unconfirmed(axis: DrivenAxis[Any]) -> StageError | None:
    try:
        axis.confirm_stopped()
    except StageError as problem:
        return problem
    return None
