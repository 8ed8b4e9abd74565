"""Manual control, one motion at a time: the force is monitored and limits downward motions."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from rig.clock import Clock
from rig.devices.base import Axis, Stage, StageError, StageOverridden, StageStatus
from rig.engine.contact import FRESH_S, KnownContact, contact_at
from rig.engine.dead_man import DOWN, SLICE_S, UP, Direction, dead_man_jog, jog_up_from_rest
from rig.engine.limits import AT_MM, late_reading_s, park_height_mm
from rig.engine.motion import InterruptedMotionError, StrayedError, insist
from rig.errors import LimitError, RigError
from rig.manual.guard import Guard
from rig.records import ContactKind
from rig.settings import RigSettings
from rig.transport.wire import TransportError

Held = Callable[[], Direction | None]
Show = Callable[[StageStatus, float | None], None]
"""Display of the position and the force (gwt; None: no reading)."""

_TINY_MM = 1e-6


@dataclass(frozen=True)
class Moved:
    """Position at the end of a motion, last force (gwt), and the error that ended it early, if any."""

    at: StageStatus
    force_gwt: float | None
    problem: RigError | None = None

    @property
    def ended_by(self) -> str | None:
        """Reason of an early end, in words."""
        return None if self.problem is None else str(self.problem)


class ByHand:
    """Manual jogs over a finger at an unknown position.

    A lateral motion begins only where no touch is measured at rest; a touch ends it, and the indentor is lifted off.
    The dead man's switch halts it if a force reading is late. An upward motion is made in slices from rest until a
    lift is measured, and then continues until the force ends it. A downward motion is made in steps with a reading
    at rest after each: habits.descent_step_mm above clearance, habits.increment_mm below it or if the height is
    unknown. It ends at the first touch; a new motion continues from there, up to the soft trip.
    """

    def __init__(
        self, settings: RigSettings, stage: Stage, clock: Clock, guard: Guard | None, show: Show, *, placed: bool
    ) -> None:
        """Prepare to move by hand. guard: None moves without force. placed: whether the stage is homed, so that
        heights are known.
        """
        self._settings, self._stage, self._clock = settings, stage, clock
        self._guard, self._show, self.placed = guard, show, placed
        self.keep_contact: Callable[[KnownContact], None] = lambda known: None  # for the next command
        self.may_touch = True  # until a measurement at rest of this process shows otherwise
        self._known: KnownContact | None = None  # measured since the last motion
        self._measured_s = -math.inf

    def set_placed(self, *, placed: bool) -> None:
        """Record that the stage was homed or has lost its position; earlier touches are forgotten."""
        if self.placed and not placed:
            self.may_touch = True  # The carriage may have been moved, too.
        self.placed = placed
        if self._guard is not None:
            self._guard.forget()

    def go(self, held: Held, speed_mm_s: float, by_mm: float | None = None) -> Moved:
        """Move while held() returns its first direction, by at most by_mm.

        Raises LimitError before the motion if it ends too deep in the known finger, if the stage does not have this
        speed, or if the sensor does not respond (upwards it may be out of range). Raises StageError.
        """
        direction, at = held(), self._stage.status()
        if self.placed and not at.referenced:
            self.set_placed(placed=False)
        if direction is None:
            return Moved(at, None)
        if direction == DOWN and by_mm is not None:
            self._refuse_depth(at, by_mm)

        def same() -> Direction | None:
            return direction if held() == direction else None  # Another direction is another motion.

        self._begin(same, direction, at)
        try:
            return self._go(same, direction, at, speed_mm_s, by_mm)
        finally:
            self._remember_contact()

    def _begin(self, held: Held, direction: Direction, at: StageStatus) -> None:
        """Measure the force before a motion, sideways contact as well. Raises LimitError."""
        if self._guard is not None:
            try:
                self._guard.begin(up=direction == UP, down=direction == DOWN)
                if direction.axis != "z":
                    self._guard.refuse_contact(lambda seconds: held())
            except LimitError:
                if self._guard.from_air_gwt is not None:
                    self._found(self._contact(at, self._guard.from_air_gwt))
                raise
            self.may_touch = self.may_touch or self._guard.may_be_a_touch
        self._known = None

    def _go(self, held: Held, direction: Direction, at: StageStatus, speed_mm_s: float, by_mm: float | None) -> Moved:
        if direction == DOWN:
            self._below_clearance(at, by_mm)
        try:
            if direction == DOWN:
                end = self._down(held, speed_mm_s, by_mm)
            elif direction == UP and self.may_touch:
                end = self._off_the_finger(held, speed_mm_s, by_mm)
            elif direction == UP:
                end = self._at_once(held, speed_mm_s, by_mm)
            else:
                end = self._aside(held, speed_mm_s, by_mm)
        except StrayedError as strayed:
            self.set_placed(placed=False)  # The stage was stopped.
            return Moved(strayed.at, self._force_gwt, strayed)
        except InterruptedMotionError as interruption:
            return self._ended(direction, at, interruption)
        except StageOverridden as error:
            self._stage.halt()
            return self._ended(direction, at, InterruptedMotionError(str(error), error.code))
        except ValueError as error:
            raise LimitError(f"{error}; nothing was moved", "refused_by_the_stage") from error
        return Moved(end, self._force_gwt)

    def _below_clearance(self, at: StageStatus, by_mm: float | None) -> None:
        """Record a possible contact before a motion that may end below clearance."""
        height_mm, far_mm = self._height_mm(at), math.inf if by_mm is None else by_mm
        stays_clear = height_mm is not None and height_mm - far_mm >= self._settings.habits.clearance_mm - AT_MM
        if not stays_clear:
            self.may_touch = True
            self.keep_contact(self._contact(at, self._force_gwt, "unknown"))

    def _remember_contact(self) -> None:
        """Record the state of contact at rest, if contact was possible."""
        if self.may_touch:
            with suppress(StageError, TransportError):  # The error that ended the motion is reported.
                self.measured_contact()

    def measured_contact(self) -> KnownContact:
        """Return the state of contact at rest, measured since the last motion, at most `FRESH_S` ago.

        Raises StageError, TransportError.
        """
        if self._known is None or self._clock.monotonic_s() - self._measured_s > FRESH_S:
            return self._found(self._judged(self._stage.status(), lambda seconds: None))
        return self._known

    def _found(self, known: KnownContact) -> KnownContact:
        """Record a state of contact just measured."""
        self._known, self._measured_s = known, self._clock.monotonic_s()
        self.may_touch = known.may_touch
        self.keep_contact(known)
        return known

    def _judged(self, at: StageStatus, meanwhile: Callable[[float], object]) -> KnownContact:
        """Return the state of contact at rest."""
        if self._guard is not None and self._is_clear(at):
            self._guard.read_at_rest(meanwhile)
        elif self._guard is not None:
            self._guard.look()
        return self._contact(at, None if self._guard is None else self._guard.from_air_gwt)

    def _is_clear(self, at: StageStatus) -> bool:
        """Return whether the height is known and at clearance or higher."""
        height_mm = self._height_mm(at)
        return height_mm is not None and height_mm >= self._settings.habits.clearance_mm - AT_MM

    def _contact(self, at: StageStatus, force_gwt: float | None, kind: ContactKind | None = None) -> KnownContact:
        touch_gwt = math.inf if self._guard is None else self._guard.touch_gwt
        return contact_at(
            self._settings, at, placed=self.placed, force_gwt=force_gwt, touch_gwt=touch_gwt,
            unix_s=self._clock.unix_s(), kind=kind,
        )  # fmt: skip

    def steps_per_mm(self, axis: Axis) -> float:
        """Return the controller's steps per mm. Raises StageError."""
        return self._stage.steps_per_mm(axis)

    def look(self) -> Moved:
        """Return position and force without a motion. Raises StageError."""
        at = self._stage.status()
        if self._guard is not None:
            self._guard.look()
        self._show(at, self._force_gwt)
        return Moved(at, self._force_gwt)

    @property
    def _force_gwt(self) -> float | None:
        return None if self._guard is None else self._guard.force_gwt

    def _aside(self, held: Held, speed_mm_s: float, by_mm: float | None) -> StageStatus:
        """Move sideways so slowly that a touch ends the motion below half the soft trip.

        Two slices last as long as a reading may be late. Without a reading none is sent, and the stage halts.
        """
        if self._guard is None:
            return self._at_once(held, speed_mm_s, by_mm)
        slice_s = min(SLICE_S, late_reading_s(self._settings) / 2)
        return self._at_once(held, min(speed_mm_s, self._guard.sideways_mm_s), by_mm, slice_s)

    def _at_once(self, held: Held, speed_mm_s: float, by_mm: float | None, slice_s: float = SLICE_S) -> StageStatus:
        """Move in one motion, monitored by the guard or left to the controller's dead man's switch."""
        glance = None if self._guard is None else self._glance
        return dead_man_jog(self._stage, self._clock, held, speed_mm_s, by_mm, glance, slice_s=slice_s)

    def _glance(self, at: StageStatus) -> None:
        if self._guard is not None:
            self._guard.glance(at.z_mm)
        self._show(at, self._force_gwt)

    def _off_the_finger(self, held: Held, speed_mm_s: float, by_mm: float | None) -> StageStatus:
        """Move up in slices from rest until lifted, then in one motion.

        A stage confirms each slice from rest before it moves, so that none goes sideways while contact is possible.
        """
        at, whole_mm = self._stage.status(), math.inf if by_mm is None else by_mm
        for at, left_mm in jog_up_from_rest(self._stage, self._clock, held, speed_mm_s, whole_mm, self._glance):
            if left_mm > _TINY_MM and held() == UP and self._is_clear(at) and self._lifted(at, held):
                return self._at_once(held, speed_mm_s, None if by_mm is None else left_mm)
        return at

    def _lifted(self, at: StageStatus, held: Held) -> bool:
        """Return whether the indentor is lifted; poll held() meanwhile, so that a release counts."""
        return not self._judged(at, lambda seconds: held()).may_touch

    def _down(self, held: Held, speed_mm_s: float, by_mm: float | None) -> StageStatus:
        """Move down in steps, each from a reading at rest."""
        speed_mm_s = min(speed_mm_s, self._settings.limits.max_press_speed_mm_s)
        at, left_mm = self._stage.status(), math.inf if by_mm is None else by_mm
        while held() == DOWN and left_mm > _TINY_MM:
            step_mm = self._step_mm(at, left_mm)
            end = dead_man_jog(self._stage, self._clock, held, speed_mm_s, step_mm, self._glance)
            left_mm -= step_mm
            if self._guard is not None:
                self._guard.rest(end.z_mm, at.z_mm - end.z_mm)
            self._show(end, self._force_gwt)
            at = end
        return at

    def _step_mm(self, at: StageStatus, left_mm: float) -> float:
        """Return the next step down (mm). Raises InterruptedMotionError if none is allowed."""
        habits, height_mm = self._settings.habits, self._height_mm(at)
        step_mm = min(habits.increment_mm, left_mm)
        if height_mm is not None:
            above_mm = height_mm - habits.clearance_mm
            if above_mm > _TINY_MM:
                step_mm = min(habits.descent_step_mm, left_mm, above_mm)
            if height_mm - step_mm < self._lowest_mm - _TINY_MM:
                deep = self._too_deep(height_mm - step_mm)
                raise InterruptedMotionError(str(deep), deep.code)
        room_mm = math.inf if self._guard is None else self._guard.room_mm
        if room_mm < self._settings.stage.resolution_mm:
            raise InterruptedMotionError("the next step down would pass the soft trip", "next_step_past_soft_trip")
        return min(step_mm, room_mm)

    def _up_to(self, z_mm: float) -> None:
        """Lift, even if an operator changes the speed meanwhile."""
        speed_mm_s = self._settings.habits.travel_speed_mm_s
        insist(lambda: self._lift(z_mm, speed_mm_s))

    def _lift(self, z_mm: float, speed_mm_s: float) -> None:
        by_mm = z_mm - self._stage.status().z_mm
        try:
            for _ in jog_up_from_rest(self._stage, self._clock, lambda: UP, speed_mm_s, by_mm):
                pass
        except StageOverridden as error:
            self._stage.halt()
            raise InterruptedMotionError(str(error), error.code) from error

    def _height_mm(self, at: StageStatus) -> float | None:
        """Return the height above the nominal apex (mm), or None if unknown."""
        return at.z_mm - self._settings.frame.apex_z_mm if self.placed else None

    @property
    def _lowest_mm(self) -> float:
        return -self._settings.limits.max_doi_mm

    def _refuse_depth(self, at: StageStatus, by_mm: float) -> None:
        height_mm = self._height_mm(at)
        if height_mm is not None and height_mm - by_mm < self._lowest_mm - _TINY_MM:
            deep = self._too_deep(height_mm - by_mm)
            raise LimitError(f"{deep}; nothing was moved", deep.code)

    def _too_deep(self, height_mm: float) -> LimitError:
        return LimitError(
            f"{-height_mm:.2f} mm below the nominal apex is deeper than limits.max_doi_mm = "
            f"{self._settings.limits.max_doi_mm:g} mm; check frame.apex_z_mm = {self._settings.frame.apex_z_mm:g}",
            "too_deep",
        )

    def _ended(self, direction: Direction, start: StageStatus, interruption: InterruptedMotionError) -> Moved:
        """End a motion: lift off a touch that ended one sideways; above a trip, lift back to where it began."""
        at, above, words = self._stage.status(), None, str(interruption)
        if self._guard is not None and direction != UP:
            self._guard.look()  # The stage moved on a little after the cause.
            above = self._guard.above_trip
        if above is not None and str(above) not in str(interruption):
            words += f"; then {above}"
        lifted_mm = 0.0
        if self._settings.limits.on_trip != "stop":
            lifted_mm = self._lift_back(start, at, above) if direction.axis == "z" else self._lift_off(at)
        if lifted_mm > _TINY_MM:
            at = self._stage.status()
            words += f"; lifted by {lifted_mm:.2f} mm"
        self._show(at, self._force_gwt)
        return Moved(at, self._force_gwt, InterruptedMotionError(words, interruption.code, interruption.force_gwt))

    def _lift_back(self, start: StageStatus, at: StageStatus, above: RigError | None) -> float:
        """Lift above a trip to where the motion began, or by clearance if that is less; return how far (mm)."""
        back_mm = min(start.z_mm - at.z_mm, self._settings.habits.clearance_mm)
        if above is None or back_mm <= _TINY_MM:
            return 0.0
        self._up_to(at.z_mm + back_mm)
        return back_mm

    def _lift_off(self, at: StageStatus) -> float:
        """Lift straight up by clearances while a touch remains, to the park height at most; return how far (mm).

        A height that is unknown counts as clearance.
        """
        if self._guard is None or not self._guard.may_be_a_touch:
            return 0.0
        self.may_touch = True
        self.keep_contact(self._contact(at, self._guard.from_air_gwt))
        step_mm, height_mm = self._settings.habits.clearance_mm, self._height_mm(at)
        from_mm = step_mm if height_mm is None else height_mm
        room_mm, lifted_mm = park_height_mm(self._settings, from_mm) - from_mm, 0.0
        while self._guard.may_be_a_touch and room_mm - lifted_mm > _TINY_MM:
            lifted_mm += min(step_mm, room_mm - lifted_mm)
            self._up_to(at.z_mm + lifted_mm)
            self._guard.look()
        self._guard.forget()
        return lifted_mm


FASTEST_MM_S = 10.0
"""Highest speed of manual control (mm/s), in any direction; the finger's own limit applies downwards as well."""


class HeldDirection:
    """Direction of the last button signal, valid for counts_s after the signal."""

    def __init__(self, clock: Clock, counts_s: float) -> None:
        self._clock, self._counts_s = clock, counts_s
        self._last: tuple[Direction, float] | None = None  # direction, and the time until which it is valid (s)

    def say(self, direction: Direction | None, ago_s: float = 0.0) -> None:
        """Record the direction held ago_s ago, None for a release; an older signal does not shorten a newer one."""
        until_s = self._clock.monotonic_s() + self._counts_s - ago_s
        if self._last is not None and self._last[0] == direction:
            until_s = max(until_s, self._last[1])
        self._last = None if direction is None else (direction, until_s)

    def __call__(self) -> Direction | None:
        if self._last is None:
            return None
        direction, until_s = self._last
        return direction if self._clock.monotonic_s() < until_s else None
