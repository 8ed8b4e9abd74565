"""Stage with two drives that count steps, x lateral and z vertical; one moves at a time, and y is set by hand.

`CountedAxis` has what every such drive shares: units, moves that are watched, homing, a stop that is confirmed, and
what becomes of a fault. A device gives a `Look` at its state, the settings to compare, and what it sends to move, to
stop, to home and to limit its travel.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

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
from rig.devices.drive_link import Link
from rig.settings import SLOWEST_MM_S, BenchSettings
from rig.transport import TransportError

POLL_S, ALARM_S = 0.02, 0.25
"""Poll interval near the end of a motion, and longest time between polls for alarms before that (s)."""
LATE_FACTOR, LATE_S = 1.5, 5.0
"""A move may take this much longer than computed from length, speed and acceleration."""
HOME_S, HOMING_BEGINS_S = 180.0, 1.0
STOP_S, HALT_S = 1.0, 2.0
TOLERANCE_MM = 2.5e-3
_SAME_PLACE_MM = 1e-6


class FaultKind(Enum):
    """What a fault means, in the order in which faults are raised."""

    ALARM = auto()  # The axis is locked, or broken.
    DISABLED = auto()
    DISPLACED = auto()  # An alarm where the position is trusted: the axis is elsewhere than its drive counts.
    LOST = auto()  # The drive no longer counts from its home position.
    HELD = auto()  # An operator has stopped or moved the axis at its controller.
    OVERRIDDEN = auto()  # Another program has moved it.
    HARMLESS = auto()


LOCKED = (FaultKind.ALARM, FaultKind.DISABLED)
UNTRUSTED = (*LOCKED, FaultKind.LOST, FaultKind.DISPLACED)
BEFORE_MOVE = (*UNTRUSTED, FaultKind.HELD)
UNDER_WAY = (*BEFORE_MOVE, FaultKind.OVERRIDDEN)
CLEAR_ALARM = "remove the cause, switch its controller off and on, and start the command again"


@dataclass(frozen=True, slots=True)
class Fault:
    """Fault of an axis; number: in the manual of its controller, or its letters."""

    kind: FaultKind
    number: int | str
    words: str

    def error(self, label: str) -> StageError:
        """Return the error for this fault."""
        match self.kind:
            case FaultKind.ALARM:
                return StageAlarm(self.number, f"{label}: {self.words}; {CLEAR_ALARM}")
            case FaultKind.DISPLACED:
                return StageAlarm(self.number, f"{label}: {self.words}; remove the cause, and home again")
            case FaultKind.DISABLED:
                return StageError(f"{label} {self.words}", "not_enabled")
            case FaultKind.LOST:
                return StageReset(f"{label} {self.words}; home again")
            case FaultKind.HELD:
                return StageHeld(str(self.number), f"{label}: ")
        return StageOverridden(f"{label}: {self.words}")


@dataclass(frozen=True, slots=True)
class Look:
    """State of an axis: position in counts, whether it moves, and its faults.

    position: 0 if the drive reports it apart. at_switch: whether the home switch is active; None if the drive does
    not report it. up_mm_s: speed towards home; None if it follows from the positions.
    """

    position: int
    busy: bool
    faults: tuple[Fault, ...] = ()
    at_switch: bool | None = None
    up_mm_s: float | None = None


class Destination(NamedTuple):
    """Destination of a motion in counts; by: distance from rest, for a motion at a position that is not known."""

    position: int
    by: int | None = None


class Setting(NamedTuple):
    """Setting of a drive, with its value and the expected one."""

    name: str
    found: object
    expected: object


def travel_s(mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Return the duration of a move from rest to rest; an infinite acceleration is that of no ramp."""
    ramp_s = speed_mm_s / acceleration_mm_s2
    if mm <= speed_mm_s * ramp_s:
        return 2 * math.sqrt(mm / acceleration_mm_s2)
    return mm / speed_mm_s + ramp_s


def refuse_numbers(target: Mapping[str, float | None], speed_mm_s: float) -> None:
    """Raise MoveError for a number that is not finite, and for a speed below the slowest."""
    for name, value in {**target, "speed_mm_s": speed_mm_s}.items():
        if value is not None and not math.isfinite(value):
            raise MoveError(f"{name} must be a finite number, got {value}", "not_finite")
    if speed_mm_s < SLOWEST_MM_S:
        raise MoveError(f"speed_mm_s must be at least {SLOWEST_MM_S:.4f}, got {speed_mm_s}", "too_slow")


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


@dataclass(frozen=True, slots=True)
class AxisSpec:
    """Configuration of an axis.

    counts_per_mm: negative where the drive counts against the axis. least_acceleration_mm_s2: what `connect`
    requires.
    """

    name: str
    counts_per_mm: float
    travel_mm: float
    least_acceleration_mm_s2: float = 0.0

    @classmethod
    def of(cls, settings: BenchSettings, name: str, nominal: float) -> "AxisSpec":
        """Return the configuration of an axis; nominal: signed counts for each mm, unless they were measured."""
        measured = settings.calibration.value(f"{name}_steps_per_mm", nominal)
        return cls(
            name,
            math.copysign(measured, nominal),
            settings.stage.travel_mm["xyz".index(name)],
            settings.stage.acceleration_mm_s2 if name == "z" else 0.0,
        )


L = TypeVar("L", bound=Look)


class CountedAxis(ABC, Generic[L]):
    """Axis with a drive that counts steps; positions and speeds are in machine mm.

    speed_unit, acceleration_unit: native speed and acceleration for one count per s and s².
    """

    stopped_after: ClassVar[tuple[type[StageError], ...]] = (StageReset,)
    """Errors under way at which the driver stops the axis; at others its caller halts it, and it stays trusted."""
    unhomed_refuses: ClassVar[tuple[FaultKind, ...]] = (*LOCKED, FaultKind.HELD)
    """Faults at which a jog is refused where the position is not trusted; a limit switch there may be active."""
    halt_again_s, stop_again_s = math.inf, 0.0
    """After this time a halt, or a stop, that does not take effect is sent again (s)."""
    zero_acceleration_mm_s2 = math.inf
    """Acceleration that a drive means by 0 (mm/s²)."""

    def __init__(
        self,
        link: Link,
        clock: Clock,
        spec: AxisSpec,
        *,
        speed_unit: float = 1.0,
        acceleration_unit: float = 1.0,
    ) -> None:
        self.link, self.name = link, spec.name
        self.steps_per_mm, self.travel_mm = spec.counts_per_mm, spec.travel_mm
        self._clock = clock
        self._least_acceleration_mm_s2 = spec.least_acceleration_mm_s2
        self.acceleration_mm_s2 = math.inf
        self.speed_unit = abs(spec.counts_per_mm) * speed_unit
        self._acceleration_unit = abs(spec.counts_per_mm) * acceleration_unit
        self._homes_from = 0

    # --- what a device gives ---

    @abstractmethod
    def look(self) -> L:
        """Ask the drive for its state. Raises StageError."""
        ...

    @abstractmethod
    def identify(self) -> str:
        """Ask the drive who it is, and return its name and firmware. Raises StageError."""
        ...

    @abstractmethod
    def settings(self) -> Iterable[Setting]:
        """Ask for the settings that must be as configured, one after another. Raises StageError."""
        ...

    def aim(self, target: Destination, speed: int) -> None:
        """Send what precedes a motion and starts nothing."""

    @abstractmethod
    def go(self, target: Destination, speed: int) -> None:
        """Start a motion; nothing is asked before the command that starts it."""
        ...

    def has_arrived(self, found: L, target: int) -> bool:
        """Return whether an axis at rest is at its target."""
        return abs(self.position(found) - target) <= self.tolerance

    def is_over(self, found: L, target: int) -> bool:
        """Return whether a motion has ended."""
        return not found.busy

    def finish_move(self) -> None:
        """Send what follows an arrival."""

    @abstractmethod
    def send_stop(self, after_s: float, *, halting: bool) -> None:
        """Send a halt, or a stop again, this long after the first one."""
        ...

    @abstractmethod
    def rests(self) -> bool:
        """Ask whether the axis rests. Raises StageError."""
        ...

    @abstractmethod
    def stop_now(self) -> None:
        """Send a stop without waiting. Raises TransportError."""
        ...

    def before_homing(self) -> None:
        """Send what precedes homing of all axes."""

    def aim_home(self) -> None:
        """Send what precedes the search of this axis and starts nothing."""

    @abstractmethod
    def go_home(self) -> None:
        """Start the search for the home position."""
        ...

    def end_search(self) -> None:
        """End a search that a stop does not end. Raises StageError."""

    def refuse_moving(self) -> None:
        """Refuse an axis that moves while another one homes. Raises StageError."""

    def homes(self, found: L) -> bool:
        """Return whether a search has begun."""
        return True

    def has_homed(self, found: L) -> bool:
        """Return whether a search has ended."""
        return not found.busy

    @abstractmethod
    def not_home(self, found: L) -> str | None:
        """Return why an axis at rest is not at home after a search, or None."""
        ...

    def finish_homing(self) -> None:
        """Set zero and the limits of the travel. Raises StageError if the drive does not confirm them."""

    @abstractmethod
    def clear(self) -> None:
        """Clear the alarms of the drive, and those stored here. Raises StageError."""
        ...

    # --- units ---

    @property
    def label(self) -> str:
        """Port and axis, the beginning of every error of this axis."""
        return f"{self.link.name}: {self.name} axis"

    @property
    def tolerance(self) -> float:
        """Largest distance from a target on arrival, in counts."""
        return max(TOLERANCE_MM * abs(self.steps_per_mm), 1.0)

    def position(self, found: L) -> int:
        """Return the position in counts; a drive that reports it apart is asked now. Raises StageError."""
        return found.position

    def mm(self, found: L) -> float:
        """Return the position (mm). Raises StageError."""
        return self.position(found) / self.steps_per_mm + 0.0

    def counts(self, mm: float) -> int:
        """Return a position or a distance in counts."""
        return round(mm * self.steps_per_mm)

    def native_speed(self, speed_mm_s: float) -> int:
        """Return the speed in whole units of the drive, rounded down. Raises MoveError below 1."""
        native = math.floor(speed_mm_s * self.speed_unit + 1e-9)
        if native < 1:
            raise MoveError(f"speed_mm_s must be at least {1 / self.speed_unit:.4f}, got {speed_mm_s}", "too_slow")
        return native

    def accelerations(self, native: Mapping[str, float]) -> Iterator[Setting]:
        """Take the accelerations of the drive; yield them as settings to compare."""
        found_mm_s2 = {
            name: value / self._acceleration_unit or self.zero_acceleration_mm_s2 for name, value in native.items()
        }
        self.acceleration_mm_s2 = min(found_mm_s2.values()) or math.inf
        least = math.ceil(self._least_acceleration_mm_s2 * self._acceleration_unit)
        for name, mm_s2 in found_mm_s2.items():
            enough = mm_s2 >= self._least_acceleration_mm_s2
            expected = native[name] if enough else f"at least {least} (stage.acceleration_mm_s2)"
            yield Setting(name, native[name], expected)

    # --- settings, faults ---

    def connect(self) -> str:
        """Compare the drive with the configuration and return its identification. Raises StageError."""
        who = self.identify()
        for setting in self.settings():
            self.compare(setting)
        return f"{self.name}: {who}"

    def compare(self, setting: Setting) -> None:
        """Refuse a setting that is not as expected. Raises StageError."""
        if setting.found != setting.expected:
            raise StageError(
                f"{self.label}: {setting.name} is {setting.found}, expected {setting.expected}", "not_as_configured"
            )

    def refuse(self, found: L, kinds: Iterable[FaultKind]) -> None:
        """Raise the first fault of some kinds."""
        for kind in FaultKind:
            for fault in found.faults:
                if fault.kind is kind and kind in kinds:
                    raise fault.error(self.label)

    def unlock(self) -> None:
        """Clear an alarm. Raises StageAlarm if it is still there."""
        self.clear()
        self.refuse(self.look(), LOCKED)

    # --- motion ---

    def moving(self, to_mm: float, speed_mm_s: float, keep_on: Callable[[], bool], look_s: float) -> Iterator[L]:
        """Move to a position at a speed; yield each look, until arrival.

        keep_on: whether the motion was not stopped meanwhile. A motion that strays is stopped. Raises StageError;
        MoveError before any byte.
        """
        speed, target = self.native_speed(speed_mm_s), self.counts(to_mm)
        start = self.position(self._at_rest(BEFORE_MOVE))
        begun_s = self._begin(Destination(target), speed, keep_on)
        stood_at: int | None = None

        def look() -> tuple[L, bool]:
            nonlocal stood_at
            found = self.look()
            self._go_on(keep_on)
            try:
                self.refuse(found, UNDER_WAY)
            except self.stopped_after:
                self.stop_now()
                raise
            if (problem := self.strayed(found, start, target, speed_mm_s, begun_s)) is not None:
                self.stop_now()
                raise problem
            if not self.is_over(found, target):
                stood_at = None
                return found, False
            if self.has_arrived(found, target):
                return found, True
            before, stood_at = stood_at, self.position(found)
            if before == stood_at:  # One look alone may be an old reply.
                raise self._not_there(stood_at, target)
            return found, False

        expected_s = travel_s(
            abs((target - start) / self.steps_per_mm), speed / self.speed_unit, self.acceleration_mm_s2
        )
        what = f"the move to {to_mm:g} mm"
        yield from self._until(look, LATE_FACTOR * expected_s + LATE_S, expected_s, what, look_s)
        self.finish_move()

    def jog(self, by_mm: float, speed_mm_s: float, keep_on: Callable[[], bool], *, trusted: bool) -> None:
        """Move by a distance from rest, and return at once. Raises StageError."""
        speed, by = self.native_speed(speed_mm_s), self.counts(by_mm)
        found = self._at_rest(BEFORE_MOVE if trusted else self.unhomed_refuses)
        self._begin(Destination(self.count_at_rest(found) + by, by), speed, keep_on)

    def count_at_rest(self, found: L) -> int:
        """Return the count from which a distance is counted."""
        return found.position

    def strayed(self, found: L, start: int, target: int, speed_mm_s: float, begun_s: float) -> StageError | None:
        """Return an error for an axis that is not between start and target, or is there too early (begun_s)."""
        low, high = sorted((start, target))
        if not low - self.tolerance <= found.position <= high + self.tolerance:
            return self._not_there(found.position, target)
        return None

    def _begin(self, target: Destination, speed: int, keep_on: Callable[[], bool]) -> float:
        """Start a motion, unless it was stopped; return when."""
        self.aim(target, speed)
        self._go_on(keep_on)
        begun_s = self._clock.monotonic_s()
        self.go(target, speed)
        return begun_s

    def _at_rest(self, kinds: Iterable[FaultKind]) -> L:
        """Return a look at an axis at rest, without faults of some kinds."""
        found = self.look()
        self.refuse(found, {*kinds} - {FaultKind.LOST})
        if found.busy:
            raise StageOverridden(f"{self.label} moves already; another program moves it")
        self.refuse(found, kinds)
        return found

    # --- homing ---

    def prepare_homing(self) -> None:
        """Refuse an alarm, and end a motion that an earlier program left. Raises StageError."""
        found = self.look()
        self.refuse(found, LOCKED)
        if found.busy:
            self.halt()
            found = self.look()
        self._homes_from = found.position

    def homing(self, keep_on: Callable[[], bool], other: "CountedAxis[Any]") -> Iterator[L]:
        """Find the home position, which is 0 from then on; yield at each look.

        other: the axis that does not move meanwhile. Raises StageError.
        """
        self.aim_home()
        self._go_on(keep_on)
        self.go_home()
        other.refuse_moving()
        begun, before, before_s = False, self._homes_from, self._clock.monotonic_s()
        begins_by_s, way = before_s + HOMING_BEGINS_S, WayHome()

        def look() -> tuple[L, bool]:
            nonlocal begun, before, before_s
            found, now_s = self.look(), self._clock.monotonic_s()
            self._go_on(keep_on)
            self.refuse(found, LOCKED)
            up_mm = (found.position - before) / self.steps_per_mm
            if found.up_mm_s is not None:
                up_mm = found.up_mm_s * (now_s - before_s)
            before, before_s = found.position, now_s
            if found.at_switch is not None and way.is_wrong(up_mm, at_switch=found.at_switch):
                raise StageError(
                    f"{self.label} moves away from home while homing; check the settings of the controller, and its "
                    "limit switches",
                    "homes_the_wrong_way",
                )
            begun = begun or self.homes(found)
            if not begun and now_s >= begins_by_s:
                raise self.did_not_home(f"it did not begin to, and is at {self.position(found)}")
            return found, begun and self.has_homed(found)

        yield from self._until(look, HOME_S, 0.0, "homing")
        found = self.look()
        if (why := "it moves again" if found.busy else self.not_home(found)) is not None:
            raise self.did_not_home(why)
        self._go_on(keep_on)
        self.finish_homing()

    def did_not_home(self, why: str) -> StageError:
        """Return the error of an axis that did not home."""
        return StageError(f"{self.label} did not home: {why}; home again", "did_not_home")

    # --- stop ---

    def halt(self) -> None:
        """Slow down to rest; steps are not lost. Raises StageError."""
        self._come_to_rest(HALT_S, halting=True)

    def confirm_stopped(self) -> None:
        """Return once the axis rests after a stop, which is repeated. Raises StageError."""
        self._come_to_rest(STOP_S, halting=False)

    def sends_again(self, after_s: float, since_s: float, *, halting: bool) -> bool:
        """Return whether a stop is due this long after the first one, and after the last one. Raises StageError."""
        return since_s >= (self.halt_again_s if halting else self.stop_again_s)

    def _come_to_rest(self, most_s: float, *, halting: bool) -> None:
        begun_s = self._clock.monotonic_s()
        sent_s = None if halting else begun_s
        problem: StageError | None = None
        while (now_s := self._clock.monotonic_s()) < begun_s + most_s:
            try:
                if sent_s is None or self.sends_again(now_s - begun_s, now_s - sent_s, halting=halting):
                    sent_s = None
                    self.send_stop(now_s - begun_s, halting=halting)
                    sent_s = now_s
                if self.rests():
                    return
                problem = None
            except StageError as error:
                problem = error
                if not halting:  # The first stop was not confirmed; a halt was, unless it failed itself.
                    sent_s = None
            self._clock.wait_s(POLL_S)
        raise problem or StageTimeout(
            f"{self.label} still moves {most_s:g} s after a stop; use the emergency stop", "still_runs"
        )

    # --- helpers ---

    def _until(
        self, look: Callable[[], tuple[L, bool]], most_s: float, first_s: float, what: str, look_s: float = LOOK_S
    ) -> Iterator[L]:
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
            if self._clock.monotonic_s() >= begun_s + most_s:
                raise StageTimeout(f"{self.label}: {what} takes longer than {most_s:.1f} s", "not_over")
            if self._clock.monotonic_s() >= due_s:
                yield found
                due_s = next_look_s(self._clock.monotonic_s(), over_s, look_s)

    def _go_on(self, keep_on: Callable[[], bool]) -> None:
        if not keep_on():
            raise StageError(f"{self.label} was stopped", "stopped")

    def _not_there(self, position: int, target: int) -> StageError:
        at_mm, target_mm = position / self.steps_per_mm, target / self.steps_per_mm
        return StageError(f"{self.label} is at {at_mm:.4f} mm instead of {target_mm:.4f} mm", "not_there")


A = TypeVar("A", bound=CountedAxis[Any])


class TwoAxisStage(Stage, Generic[A]):
    """Base class of a stage with drives for x and z, which move one at a time.

    The position along the finger is set by hand. An axis with backlash always arrives in its negative direction
    (down, for z): an opposite move overruns by twice the backlash and returns.
    """

    def __init__(self, x: A, z: A, settings: BenchSettings) -> None:
        self._axes = {"x": x, "z": z}
        self._overrun_mm = {axis: 2 * settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in "xz"}
        self._y_mm = settings.frame.pad_y_mm
        self._trusted = False
        self._moved = "z"  # in the present motion, or the last one
        self._times_stopped = 0  # counted from any thread

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

    def homing(self) -> Looks:
        """Home z, then x. An alarm is not cleared; if homing fails, both axes are stopped. Raises StageError."""
        self._trusted = False
        keep_on = self._until_stopped()
        z, x = self._up_first()
        for axis in (z, x):
            axis.prepare_homing()
        for axis in (z, x):
            axis.before_homing()
        for axis, other in ((z, x), (x, z)):
            self._moved = axis.name
            try:
                for _ in axis.homing(keep_on, other):
                    yield None
            except (StageError, TransportError):
                with suppress(StageError, TransportError):
                    axis.end_search()
                with suppress(TransportError):
                    self._send_stop()
                self._confirm_idle(other)
                raise
        self._moved, self._trusted = "z", keep_on()

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
        name, target_mm = _one_axis(x_mm, y_mm, z_mm, speed_mm_s, self._y_mm)
        if name is None:
            return
        axis = self._axes[name]
        axis.native_speed(speed_mm_s)
        if not self._trusted:
            raise self._not_homed()

        def looks() -> Iterator[Look]:
            self._moved = axis.name
            self._prepare_motion()
            for stop_mm in self._stops(name, target_mm):
                yield from axis.moving(stop_mm, speed_mm_s, lambda: self._trusted, look_s)

        try:
            for look in looks():
                yield self._status({name: look})
        except (StageHeld, StageOverridden):
            raise
        except (StageError, TransportError):
            self._trusted = False
            raise

    def halt(self) -> None:
        """Stop each axis at its acceleration; no step is lost. Raises StageError, TransportError."""
        self._at_each(lambda axis: axis.halt())

    def steps_per_mm(self, axis: Axis) -> float:
        """Return the native steps per mm. Raises StageError for y."""
        return self._axis(axis).steps_per_mm

    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """Move by a distance from rest; the position stays trusted unless the axis shows an alarm or a reset.

        Raises StageError; MoveError before any byte.
        """
        moves, keep_on = self._axis(axis), self._until_stopped()
        refuse_numbers({"by_mm": by_mm}, speed_mm_s)
        moves.native_speed(speed_mm_s)
        self._moved = axis
        self._prepare_motion()
        try:
            moves.jog(by_mm, speed_mm_s, keep_on, trusted=self._trusted)
        except (StageAlarm, StageReset):
            self._trusted = False
            raise

    def stop(self) -> None:
        """Stop both axes at once, past every wait, and confirm it.

        The stop is verified, and repeated, for up to 1 s an axis. Raises StageError if an axis does not come to rest,
        TransportError.
        """
        self._times_stopped += 1
        self._trusted = False
        try:
            self._send_stop()
        finally:
            self._at_each(lambda axis: axis.confirm_stopped())

    def unlock(self) -> None:
        """Clear the alarms of both axes; the position stays untrusted. Raises StageError."""
        self._trusted = False
        for axis in self._up_first():
            axis.unlock()

    def set_output(self, on: bool) -> None:
        """Refuse: there is no output. Raises StageError."""
        raise StageError("this stage has no output for pulses; set sync.output to off", "no_output")

    def close(self) -> None:
        for link in dict.fromkeys(axis.link for axis in self._up_first()):
            link.close()

    def _send_stop(self) -> None:
        """Send a stop to both drives past every wait. Raises TransportError."""
        self._at_each(lambda axis: axis.stop_now())

    def _at_each(self, act: Callable[[A], None]) -> None:
        """Call a function for both axes, first for the one that moves; raise the first error after both calls."""
        problems = list[StageError | TransportError]()
        for axis in sorted(self._axes.values(), key=lambda axis: axis.name != self._moved):
            try:
                act(axis)
            except (StageError, TransportError) as problem:
                problems.append(problem)
        if problems:
            raise problems[0]

    def _confirm_idle(self, axis: A) -> None:
        """Confirm the stop of the axis that did not home, where a bit error may have started it."""

    def _prepare_motion(self) -> None:
        """Send what precedes a move or a jog. Raises StageError."""

    def _status(self, known: Mapping[str, Look]) -> StageStatus:
        """Return the status. known: looks that were already checked, by axis."""
        looks = {name: known.get(name) or axis.look() for name, axis in self._axes.items()}
        if self._trusted:
            try:
                for name, axis in self._axes.items():
                    axis.refuse(looks[name], () if name in known else UNTRUSTED)
            except StageError:
                self._trusted = False
                raise
        kinds = {fault.kind for look in looks.values() for fault in look.faults}
        busy = any(look.busy for look in looks.values())
        state = "Alarm" if kinds & {*LOCKED} else "Run" if busy else "Idle"
        x_mm, z_mm = (axis.mm(looks[name]) for name, axis in self._axes.items())
        return StageStatus(state, x_mm, self._y_mm, z_mm, FaultKind.LOST not in kinds)

    def _until_stopped(self) -> Callable[[], bool]:
        times = self._times_stopped
        return lambda: self._times_stopped == times

    def _not_homed(self) -> StageNotHomed:
        return StageNotHomed(f"{self._axes['z'].link.name}: the stage")

    def _axis(self, name: Axis) -> A:
        if name not in self._axes:
            raise StageError(f"the stage has no drive for the {name} axis; set it by hand", "no_drive")
        return self._axes[name]

    def _up_first(self) -> tuple[A, A]:
        return self._axes["z"], self._axes["x"]

    def _stops(self, name: str, to_mm: float) -> list[float]:
        """Return the successive targets: one, or two to take up backlash."""
        axis, overrun_mm = self._axes[name], self._overrun_mm[name]
        if not (overrun_mm and to_mm > axis.mm(axis.look())):
            return [to_mm]
        return [min(to_mm + overrun_mm, 0.0), to_mm]


def _one_axis(
    x_mm: float | None, y_mm: float | None, z_mm: float | None, speed_mm_s: float, set_y_mm: float
) -> tuple[str | None, float]:
    """Return the axis that moves and its target (machine mm); no axis for a move to the y that is set by hand.

    Raises MoveError for two axes at once, another y, a speed below the slowest, and numbers that are not finite.
    """
    refuse_numbers({"x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm}, speed_mm_s)
    if y_mm is not None and abs(y_mm - set_y_mm) > _SAME_PLACE_MM:
        raise MoveError(f"y_mm must be {set_y_mm:g}, the position set by hand, got {y_mm:g}", "set_by_hand")
    moves = {axis: mm for axis, mm in (("x", x_mm), ("z", z_mm)) if mm is not None}
    if len(moves) > 1 or not (moves or y_mm is not None):
        raise MoveError(
            "a move needs exactly one of x_mm and z_mm: two drives cannot keep a straight line", "not_one_axis"
        )
    return next(iter(moves.items()), (None, set_y_mm))
