"""Motions of the stage, watched at each status: in the corridor of a known position, or as short jogs from rest.

The corridor is the second layer against a corrupted command and against a stage that does not stop. The first is that
a driver confirms commands before motion; the force is monitored in addition.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from typing import get_args

from rig.clock import Clock
from rig.devices.base import (
    LOOK_S,
    Axis,
    Looks,
    Stage,
    StageError,
    StageHeld,
    StageOverridden,
    StageStatus,
    is_held,
)
from rig.errors import EngineError, RigError
from rig.settings import RigSettings
from rig.transport.wire import TransportError

PRINTED_MM = 0.003
"""Rounding of a controller's reports, and error of a drive's feedback beyond one step (mm)."""

_ATTEMPTS = 5
_JOG_LOOK_S = 0.02
_SLICE_S = 0.2
_STANDS = 5  # A board that rests short of its target in more statuses in a row was stopped at the controller.
_LEAST_MM = 0.0005


class InterruptedMotionError(RigError):
    """A force or a change during a motion that must end it; the stage is at rest again."""

    default_code = "felt"

    def __init__(self, sentence: str = "", code: str | None = None, force_gwt: float | None = None) -> None:
        super().__init__(sentence, code)
        self.force_gwt = force_gwt


class Outcome(Enum):
    """How a watched motion ended; every other ending trips."""

    ARRIVED = "arrived"
    TOUCHED = "touched"
    PAUSED = "paused"  # by the operator, or by the end of the contact time
    LATE = "late"  # A reading came too late.


class EndedMotionError(InterruptedMotionError):
    """End of a motion short of its target that is no fault of the rig."""

    def __init__(self, outcome: Outcome, force_gwt: float) -> None:
        super().__init__(outcome.value, outcome.value, force_gwt)
        self.outcome = outcome


class StrayedError(InterruptedMotionError):
    """Two reports in a row outside the corridor; the stage was stopped and its position is not trusted."""

    default_code = "strayed"

    def __init__(self, sentence: str, at: StageStatus, code: str | None = None) -> None:
        super().__init__(sentence, code)
        self.at = at


def is_where_left(at: StageStatus, left_at_mm: Sequence[float] | None) -> bool:
    """Return whether a stage still stands, homed, where the last command left it, so that its position is trusted."""
    if left_at_mm is None or at.state != "Idle" or not at.referenced:
        return False
    return all(abs(a - b) <= PRINTED_MM for a, b in zip((at.x_mm, at.y_mm, at.z_mm), left_at_mm, strict=True))


# --- corridor ---


@dataclass(frozen=True)
class Corridor:
    """Positions that a stage may report in one motion, in machine mm.

    It is a box, since two axes move together only laterally, at clearance. A report may lie `tolerance_mm` outside,
    and each axis go `overrun_mm` beyond the target in its positive direction: twice its backlash. `begun_s`, when the
    command was sent, is on the clock of `strayed`.
    """

    start_mm: Sequence[float]
    target_mm: Sequence[float]
    speed_mm_s: float
    begun_s: float
    tolerance_mm: float
    overrun_mm: Sequence[float] = (0.0, 0.0, 0.0)

    def strayed(self, at: StageStatus, now_s: float) -> EngineError | None:
        """Return an error if a reported position lies outside the corridor, else None.

        The stage was there when the report arrived, at `now_s`, or earlier.
        """
        gone_mm = 0.0
        ways = zip("xyz", (at.x_mm, at.y_mm, at.z_mm), self.start_mm, self.target_mm, self.overrun_mm, strict=True)
        for axis, is_mm, start_mm, target_mm, overrun_mm in ways:
            lowest_mm = min(start_mm, target_mm) - self.tolerance_mm
            highest_mm = max(start_mm, target_mm + (overrun_mm if target_mm > start_mm else 0.0)) + self.tolerance_mm
            if not lowest_mm <= is_mm <= highest_mm:
                commanded = f"commanded {axis} from {start_mm:.3f} to {target_mm:.3f} mm"
                if math.isclose(start_mm, target_mm, abs_tol=1e-9):
                    commanded = f"commanded no motion of {axis} at {start_mm:.3f} mm"
                return EngineError(f"{commanded}, but the stage reports {axis} = {is_mm:.3f} mm", "off_its_way")
            gone_mm = max(gone_mm, abs(is_mm - start_mm))
        lasted_s = now_s - self.begun_s
        if gone_mm > self.speed_mm_s * lasted_s + self.tolerance_mm:
            return EngineError(
                f"commanded {self.speed_mm_s:g} mm/s, but the stage reports {gone_mm:.3f} mm after {lasted_s:.3f} s",
                "ahead_of_its_speed",
            )
        return None


def refuse_strayed(corridor: Corridor, at: StageStatus, stage: Stage, clock: Clock) -> None:
    """Raise StrayedError if a report and a second one, requested at once, both lie outside the corridor.

    The second request clears a single corrupted digit and delays a true stop by one exchange at most.
    """
    if corridor.strayed(at, clock.monotonic_s()) is None:
        return
    again = stage.status()
    strayed = corridor.strayed(again, clock.monotonic_s())
    if strayed is not None:
        raise StrayedError(str(strayed), again, strayed.code)


# --- motions ---

Check = Callable[[], None]
"""Check made at each status of a motion; if it raises InterruptedMotionError, the stage comes to rest."""


class Motion:
    """Motions of a stage over one finger: x, along and height above the pad's nominal apex (mm); nan if unknown."""

    def __init__(self, settings: RigSettings, stage: Stage, clock: Clock) -> None:
        self._settings, self._stage, self._clock = settings, stage, clock
        self.x_mm, self.along_mm, self.height_mm = math.nan, 0.0, math.nan
        self.begun = False  # whether any motion was ever commanded
        self.strayed = False  # whether the stage was ever stopped because it strayed
        self._floor_mm = math.nan

    def limit_depth(self, height_mm: float) -> None:
        """Set the lowest height that the stage itself allows, if it can; at rest only. Raises StageError."""
        floor_mm = round(max(self._settings.frame.apex_z_mm + height_mm, -self._settings.stage.travel_mm[2]), 6)
        if floor_mm != self._floor_mm:
            self._floor_mm = math.nan
            self._stage.limit_depth(floor_mm)
            self._floor_mm = floor_mm

    def forget_depth(self) -> None:
        """Forget the depth limit of the stage, which may have lost it."""
        self._floor_mm = math.nan

    def home(self, check: Check) -> None:
        """Home the stage. Raises StageError, and the errors of `check`."""
        self.run(self._stage.homing(), check, self._stage.stop)
        self.set_position(self._stage.status())

    def aside(self, x_mm: float, along_mm: float, speed_mm_s: float, check: Check, look_s: float = LOOK_S) -> None:
        """Move laterally at this height, polled every look_s. Raises StageError, and the errors of `check`."""
        x, y, z = self._machine_mm(x_mm, along_mm, self.height_mm)
        looks = self._stage.moving(x_mm=x, y_mm=y, speed_mm_s=speed_mm_s, look_s=look_s)
        self.run(looks, check, self._stage.halt, self._be_over, self._corridor((x, y, z), speed_mm_s))
        self.x_mm, self.along_mm = x_mm, along_mm

    def to_height(self, height_mm: float, speed_mm_s: float, check: Check, look_s: float = LOOK_S) -> None:
        """Move straight up or down, polled every look_s. Raises StageError, and the errors of `check`."""
        x, y, z = self._machine_mm(self.x_mm, self.along_mm, height_mm)
        looks = self._stage.moving(z_mm=z, speed_mm_s=speed_mm_s, look_s=look_s)
        self.run(looks, check, self._stage.halt, self._be_at_height, self._corridor((x, y, z), speed_mm_s))
        self.height_mm = height_mm

    def run(
        self,
        looks: Looks,
        check: Check,
        halt: Callable[[], None],
        seen: Callable[[StageStatus], None] = lambda at: None,
        corridor: Corridor | None = None,
    ) -> None:
        """Run a motion to its end; bring the stage to rest if a check ends it, or an error of this program.

        halt: brings the stage to rest. seen: takes the position from each status. corridor: None where the motion
        watches its own way, or the position is unknown.
        """
        self.begun = True
        try:
            for at in looks:
                if at is not None:
                    seen(at)
                    if is_held(at.state):
                        raise StageHeld(at.state)
                try:
                    if corridor is not None and at is not None:
                        refuse_strayed(corridor, at, self._stage, self._clock)
                    check()
                except StrayedError as strayed:
                    self._stop_strayed(strayed)
                    raise
                except InterruptedMotionError:
                    self._come_to_rest(seen, halt)
                    raise
        except StageOverridden as error:
            self._come_to_rest(seen, self._stage.halt)
            raise InterruptedMotionError(str(error), error.code) from error
        except RigError:
            raise
        except Exception:  # an error in this program or in a driver
            with suppress(RigError):
                self._come_to_rest(seen, halt)
            raise

    def _stop_strayed(self, strayed: StrayedError) -> None:
        """Stop a stage that strayed. Raises StageError if it had lost its position already."""
        trusted = self._stage.homed
        self._stage.stop()  # At once: a halt would first slow down, farther the wrong way.
        self.set_position(strayed.at)
        if not trusted:
            raise StageError(str(strayed), strayed.code) from strayed
        self.strayed = True

    def _come_to_rest(self, seen: Callable[[StageStatus], None], halt: Callable[[], None]) -> None:
        halt()
        if self._stage.homed:
            seen(self._stage.status())

    def set_position(self, at: StageStatus) -> None:
        """Take the position from a status."""
        self._be_over(at)
        self._be_at_height(at)

    def _be_over(self, at: StageStatus) -> None:
        frame = self._settings.frame
        self.x_mm, self.along_mm = at.x_mm - frame.pad_centre_x_mm, at.y_mm - frame.pad_y_mm

    def _be_at_height(self, at: StageStatus) -> None:
        self.height_mm = at.z_mm - self._settings.frame.apex_z_mm

    def _machine_mm(self, x_mm: float, along_mm: float, height_mm: float) -> tuple[float, float, float]:
        frame = self._settings.frame
        return frame.pad_centre_x_mm + x_mm, frame.pad_y_mm + along_mm, frame.apex_z_mm + height_mm

    def _corridor(self, target_mm: Sequence[float], speed_mm_s: float) -> Corridor | None:
        """Return the corridor from the present position, or None if that is unknown."""
        start_mm = self._machine_mm(self.x_mm, self.along_mm, self.height_mm)
        if not all(map(math.isfinite, start_mm)):
            return None
        settings = self._settings
        tolerance_mm = settings.stage.resolution_mm + PRINTED_MM
        overrun_mm = [2 * settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in "xyz"]
        return Corridor(start_mm, target_mm, speed_mm_s, self._clock.monotonic_s(), tolerance_mm, overrun_mm)


def insist(lift: Callable[[], None]) -> None:
    """Lift after a trip, and try again at full speed if an operator changes the speed meanwhile."""
    for _ in range(_ATTEMPTS - 1):
        with suppress(InterruptedMotionError):
            return lift()
    return lift()


# --- jogs: the first steps of homing, manual control before homing, and the lift of a stage that strayed ---


@dataclass(frozen=True)
class Direction:
    """Direction along an axis."""

    axis: Axis
    sign: int


DOWN, UP = Direction("z", -1), Direction("z", +1)


def jogging(stage: Stage, clock: Clock, direction: Direction, by_mm: float, speed_mm_s: float) -> Looks:
    """Jog by a distance from rest, where a stage confirms the jog before it moves; yield every status.

    It ends at rest at the target. If this process dies or the cable is cut, the stage stops there, too. Raises
    StageError, MoveError, and StrayedError once the stage is stopped. Code that does not run it to its end calls
    Stage.end_jog() or Stage.stop().
    """
    by_mm = round(by_mm, 4)  # as in the command
    if by_mm < _LEAST_MM:
        return
    # A corrupted digit in a single report would put the corridor elsewhere.
    before, start = stage.status(), stage.status()
    if is_held(start.state):
        raise StageHeld(start.state)
    if max(_gone_mm(start, before, axis) for axis in get_args(Axis)) > PRINTED_MM:
        raise StageError("jog: the stage reports different positions at rest; nothing was moved", "not_at_rest")
    step_mm = 1 / abs(stage.steps_per_mm(direction.axis))
    start_mm = (start.x_mm, start.y_mm, start.z_mm)
    target_mm = [
        mm + direction.sign * by_mm * (axis == direction.axis) for axis, mm in zip("xyz", start_mm, strict=True)
    ]
    corridor = Corridor(start_mm, target_mm, speed_mm_s, clock.monotonic_s(), step_mm + PRINTED_MM)
    stage.jog(direction.axis, direction.sign * by_mm, speed_mm_s)
    stood = 0
    while True:
        clock.wait_s(_JOG_LOOK_S)
        now = stage.status()
        if is_held(now.state):
            raise StageHeld(now.state)
        try:
            refuse_strayed(corridor, now, stage, clock)
        except StrayedError:
            stage.stop()
            raise
        ahead_mm = by_mm - _gone_mm(now, start, direction.axis)
        if now.state == "Idle" and ahead_mm <= step_mm + PRINTED_MM:
            return
        stood = stood + 1 if now.state == "Idle" else 0
        if stood > _STANDS:
            raise StageError(
                f"jog: the stage stopped {ahead_mm:.3f} mm short of its target; release the hold at the controller, "
                "then jog again",
                "jog_cut_short",
            )
        yield now


def jog(stage: Stage, clock: Clock, direction: Direction, by_mm: float, speed_mm_s: float) -> StageStatus:
    """Jog by a distance from rest; return the status at rest. Raises as `jogging`, at rest."""
    try:
        for _ in jogging(stage, clock, direction, by_mm, speed_mm_s):
            pass
        return stage.status()
    except StrayedError:
        raise
    except BaseException:
        with suppress(StageError, TransportError):  # The caller reports the first error.
            try:
                stage.end_jog()
            except StageError:
                stage.stop()
        raise


def lift_from_rest(stage: Stage, clock: Clock, by_mm: float, speed_mm_s: float) -> None:
    """Jog up in slices that each begin at rest, so that no corrupted command goes sideways in contact."""
    for slice_mm in slices(by_mm, speed_mm_s * _SLICE_S):
        jog(stage, clock, UP, slice_mm, speed_mm_s)


def slices(whole_mm: float, most_mm: float) -> Iterator[float]:
    """Yield parts of a distance (mm), each at most so long."""
    while whole_mm > _LEAST_MM:
        yield min(most_mm, whole_mm)
        whole_mm -= most_mm


def _gone_mm(now: StageStatus, start: StageStatus, axis: Axis) -> float:
    return abs(float(getattr(now, f"{axis}_mm")) - float(getattr(start, f"{axis}_mm")))
