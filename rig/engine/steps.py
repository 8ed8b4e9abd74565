"""Steps of manual control: one bounded motion at a time through the engine, ended by a touch.

Where the stage is homed, a step is a motion of the engine as in a script. Where it is not, the height is unknown: a
step is made of short jogs from rest, and down of single increments, as below clearance.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial

from rig.clock import Clock
from rig.devices.base import MoveError, Stage, StageError, StageHeld, StageOverridden, is_held
from rig.engine.bench import EngineMemory
from rig.engine.bench_memory import LastKnown
from rig.engine.contact import KnownContact
from rig.engine.contact_moves import FrozenReading, pull_in_descent
from rig.engine.engine import Engine, State
from rig.engine.limits import AT_MM, TRIP_MARGIN, ContactTime, ContactTimeError, park_height_mm, refuse_travel
from rig.engine.motion import (
    DOWN,
    UP,
    Check,
    Direction,
    InterruptedMotionError,
    Outcome,
    insist,
    jog,
    jogging,
    lift_from_rest,
    slices,
)
from rig.engine.sensing import ForceZero, NoReadingError, Sensing, zero_readings_gwt
from rig.engine.verbs import (
    LIFTED_READINGS,
    go_sideways,
    guarded_sideways,
    zero_in_contact_error,
    zero_noise_error,
    zero_sensor,
)
from rig.engine.watch import Watch
from rig.errors import LimitError, NotReadyError, RigError, TripError
from rig.records import NO_PRESS
from rig.settings import ZERO_LIFT_MM, RigSettings
from rig.transport.wire import TransportError
from rig.units import GWT_N

MOST_MM = 5.0
"""Longest step (mm)."""

_TINY_MM = 1e-6
_LOST_INCREMENTS = 2.0  # Farther below a touch, a force must still be there.


@dataclass(frozen=True)
class StepEnd:
    """State of contact after a step, last force (gwt; None: no reading), and what ended the step early."""

    known: KnownContact
    force_gwt: float | None
    ended_by: RigError | None = None


@dataclass
class _Descent:
    """Way down in consecutive steps: what a touch, a lost finger and a frozen reading are judged from.

    A touch counts from the force in the air, so that a drift of an old zero does not hide it.
    """

    engine: Engine
    air_gwt: float
    rest_gwt: float  # at the last rest
    made_mm: float = 0.0
    touched_mm: float | None = None  # way down to the touch
    stiffness_gwt_mm: float = 0.0  # of the last increment
    frozen: FrozenReading = field(init=False)

    def __post_init__(self) -> None:
        self.frozen = FrozenReading(self.engine.sensing.resolution_gwt)

    @property
    def room_mm(self) -> float:
        """Way down (mm) to nine tenths of the soft trip, at the stiffness of the last increment."""
        increment_mm = self.engine.settings.habits.increment_mm
        if self.stiffness_gwt_mm <= 0:
            return increment_mm
        left_gwt = max(TRIP_MARGIN * self.engine.trips.lowest_gwt - self.rest_gwt, 0.0)
        return min(left_gwt / self.stiffness_gwt_mm, increment_mm)

    def touched(self, force_gwt: float) -> InterruptedMotionError | None:
        """Return the first touch of this way down, else None."""
        grown_gwt = force_gwt - self.air_gwt
        if self.touched_mm is not None or grown_gwt < self.engine.sensing.touch_gwt:
            return None
        self.touched_mm = self.made_mm
        return InterruptedMotionError(
            f"touched, {grown_gwt:.2f} gwt more than before; step down again to continue", "touched", force_gwt
        )

    def judge_increment(self, force_gwt: float, by_mm: float) -> InterruptedMotionError | None:
        """Judge the force at rest after an increment; return the first touch. Trips for a reading of no finger."""
        before_gwt, self.rest_gwt = self.rest_gwt, force_gwt
        self.made_mm += by_mm
        if refused := self._no_finger(before_gwt, force_gwt, by_mm):
            self.engine.trip(refused, force_gwt)
        if force_gwt - before_gwt > 0.5 * self.engine.sensing.resolution_gwt:
            self.stiffness_gwt_mm = (force_gwt - before_gwt) / by_mm
        return self.touched(force_gwt)

    def _no_finger(self, before_gwt: float, force_gwt: float, by_mm: float) -> TripError | None:
        """Return the trip of a pull, and of a sensor that showed a touch and no longer answers to it."""
        touch_gwt, increment_mm = self.engine.sensing.touch_gwt, self.engine.settings.habits.increment_mm
        if force_gwt <= self.air_gwt - touch_gwt:
            return pull_in_descent(force_gwt)
        if self.touched_mm is None:
            return None
        below_mm = self.made_mm - self.touched_mm
        if below_mm > _LOST_INCREMENTS * increment_mm + _TINY_MM and force_gwt - self.air_gwt < touch_gwt:
            words = f"{force_gwt:.2f} gwt, {below_mm:.2f} mm below a touch; check for a frozen reading"
            return TripError(words, "lost_finger")
        # A touch found in a longer motion has no stiffness yet; it is at least the touch force per increment.
        stiffness_gwt_mm = self.stiffness_gwt_mm or touch_gwt / increment_mm
        if self.frozen.stays(force_gwt, stiffness_gwt_mm * by_mm, 1, before_gwt):
            words = f"the force stays at {force_gwt:.2f} gwt while the stage moves; check for a frozen reading"
            return TripError(words, "frozen")
        return None


def resume_position(engine: Engine) -> None:
    """Begin at the position of a stage that an earlier process homed. Raises StageError, TransportError."""
    engine.motion.set_position(engine.bench.stage.status())
    limits = engine.settings.limits
    engine.state = State.READY
    if engine.contact.may_touch or engine.height_mm < engine.settings.habits.clearance_mm - AT_MM:
        engine.state, engine.contact = State.IN_CONTACT, replace(engine.contact, may_touch=True)
    engine.limit_depth(-limits.search_mm - limits.max_doi_mm)


class Steps:
    """Steps of one engine.

    Up is free, unless the force grows. Down ends at the first touch; the next step goes on from there, up to the soft
    trip. Sideways begins only where a measurement at rest shows no touch; a touch trips, which lifts.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine, self._stage = engine, engine.bench.stage
        self._descent: _Descent | None = None

    def forget(self) -> None:
        """Forget the last touch, since the zero has changed."""
        self._descent = None

    def make(self, direction: Direction, by_mm: float, speed_mm_s: float) -> StepEnd:
        """Make a step at up to a speed; return what ended it early, a trip included.

        Raises LimitError or NotReadyError if nothing was moved, StageError, TransportError.
        """
        force_gwt = self._force_before(up=direction == UP)
        if direction == UP:
            self._descent = None
            return self._run(lambda: self._up(by_mm, speed_mm_s))
        assert force_gwt is not None
        if direction == DOWN:
            if self._stage.homed:
                settings = self._engine.settings
                check = f"check frame.apex_z_mm = {settings.frame.apex_z_mm:g}; "
                _refuse_depth(settings, self._engine.height_mm - by_mm, check)
            return self._run(lambda: self._down(by_mm, speed_mm_s, force_gwt))
        self._descent = None
        self._refuse_contact()
        return self._run(lambda: self._aside(direction, by_mm, speed_mm_s))

    def park(self, speed_mm_s: float) -> StepEnd:
        """Lift to the park height. Raises as `make`."""
        engine = self._engine
        self._force_before(up=True)
        if not self._stage.homed:
            raise NotReadyError("park: heights are unknown; home first", "not_homed")
        self._descent = None
        left_mm = engine.settings.habits.park_height_mm - engine.height_mm
        return self._run(lambda: self._up(left_mm, speed_mm_s) if left_mm > AT_MM else None)

    def zero(self, before: LastKnown, speed_mm_s: float) -> tuple[str, ForceZero]:
        """Zero the sensor, lift by `ZERO_LIFT_MM` and stay there; return the sensor's identity and the zero.

        Raises NotReadyError after a trip; LimitError without readings, if they scatter, or if the last recorded zero
        or the lift shows a contact; StageError if the stage did not lift; ForceError, TransportError.
        """
        engine, sensing = self._engine, self._engine.sensing
        if engine.state is State.TRIPPED:
            raise NotReadyError("zero: not allowed after a trip; home first", "tripped")
        self.forget()
        if before.zero is not None:
            sensing.zero = before.zero
        _refuse_zero_in_contact(sensing, before)
        z_mm = self._stage.status().z_mm
        if (
            self._stage.homed and z_mm + ZERO_LIFT_MM + AT_MM > 0
        ):  # The top of the travel leaves no room for the lift.
            self._move_for_zero(DOWN, z_mm + ZERO_LIFT_MM + AT_MM, speed_mm_s)
        name, zero = take_zero(sensing, engine.memory)
        try:
            if self._move_for_zero(UP, ZERO_LIFT_MM, speed_mm_s).known.force_gwt is None:
                raise LimitError("no steady force after the lift; zero the sensor again", "no_reading")
            try:
                lifted_gwt = [sensing.settled().force_n / GWT_N for _ in range(LIFTED_READINGS)]
            except NoReadingError as error:
                raise LimitError(f"{error}; zero the sensor again", error.code) from error
            if touched := zero_in_contact_error(LimitError, sensing, lifted_gwt):
                raise touched
        except BaseException:
            sensing.zero = None
            raise
        return name, zero

    def _move_for_zero(self, direction: Direction, by_mm: float, speed_mm_s: float) -> StepEnd:
        """Move straight by a distance. Raises LimitError if a force ended it, StageError if it was not covered."""
        at = self._stage.status()
        if is_held(at.state):
            raise StageHeld(at.state)  # A command would reset a board that somebody holds on purpose.
        if math.isfinite(self._engine.motion.height_mm) and not self._stage.homed:
            raise StageError("the stage has lost its position", "lost_position")
        from_mm = at.z_mm
        found = self.make(direction, by_mm, speed_mm_s)
        if found.ended_by is not None:
            raise LimitError(f"{found.ended_by}; nothing was zeroed; keep the finger away", found.ended_by.code)
        if abs(self._stage.status().z_mm - from_mm) < by_mm - AT_MM:
            raise StageError("the stage did not move", "did_not_move")
        return found

    def contact(self) -> StepEnd:
        """Measure the state of contact at rest. Raises StageError, TransportError."""
        engine, sensing = self._engine, self._engine.sensing
        if engine.at_clearance and sensing.absolute and (engine.contact.may_touch or not engine.is_lifted):
            known = engine.measure_contact()
            force_gwt = known.force_gwt
        else:
            force_gwt = None
            with suppress(NoReadingError):
                force_gwt = sensing.settled().force_n / GWT_N
            # Changes from a provisional zero are no forces.
            known = engine.record_contact(force_gwt if sensing.absolute else None)
        if not known.may_touch and engine.state is State.IN_CONTACT:
            engine.enter_clearance()
            self._end_contact_time()
        if not self._stage.homed and force_gwt is not None:
            self._count_contact(force_gwt)
        return StepEnd(known, force_gwt)

    def _count_contact(self, force_gwt: float) -> None:
        """Count the contact time at an unknown height, where only the force shows a contact."""
        if abs(force_gwt) >= self._engine.sensing.touch_gwt:
            self._engine.contact_time.begin()
        else:
            self._end_contact_time()

    def _end_contact_time(self) -> None:
        """Begin the contact time anew: under manual control the limit is that of one contact."""
        self._engine.contact_time = ContactTime(self._engine.clock, self._engine.settings.limits)

    def _run(self, motion: Callable[[], RigError | None]) -> StepEnd:
        engine = self._engine
        try:
            ended_by: RigError | None = motion()
        except TripError as trip:
            ended_by = trip
        except ContactTimeError as limit:
            ended_by, self._descent = limit, None
            try:
                engine.lift()
            except TripError as trip:
                ended_by = trip
        except MoveError as error:
            raise LimitError(f"{error}; nothing was moved", "refused_by_the_stage") from error
        finally:
            engine.heartbeat.rest()  # Nothing is due between two steps.
        found = self.contact()
        return StepEnd(found.known, found.force_gwt, ended_by)

    # --- before a step ---

    def _force_before(self, *, up: bool) -> float | None:
        """Return the force at rest (gwt), counted from itself before the first zero; up it may be out of range."""
        engine, sensing = self._engine, self._engine.sensing
        if engine.state is State.TRIPPED:
            raise NotReadyError(f"step: not allowed after a trip ({engine.problem}); home first", "tripped")
        try:
            if not sensing.zeroed:
                sensing.take_zero(zero_readings_gwt(sensing.raw), provisional=True)
            force_gwt = sensing.settled().force_n / GWT_N
        except NoReadingError as error:
            if up and error.out_of_range:
                return None
            words = f"{error}; nothing was moved; to move without force, use --without-force"
            raise LimitError(words, error.code) from error
        if up:
            return force_gwt
        try:
            engine.contact_time.refuse_more()
        except ContactTimeError as over:
            raise LimitError(f"{over}; nothing was moved: move up first", over.code) from over
        if passed := engine.trips.passed_any(force_gwt):
            raise LimitError(f"{passed}; nothing was moved: move up first, or run `rig zero`", passed.code)
        return force_gwt

    def _refuse_contact(self) -> None:
        """Refuse a step sideways unless a measurement at rest shows no touch, and at clearance where it is known."""
        engine, sensing = self._engine, self._engine.sensing
        if not sensing.absolute:
            raise LimitError(
                "the force sensor has no zero, so a touch cannot be measured; nothing was moved: use `rig zero` "
                "while nothing touches the indentor; to move without force, use --without-force",
                "not_zeroed",
            )
        remedy = (
            "no step sideways: move up first, or use `rig zero --anyway` if nothing touches the indentor; nothing "
            "was moved"
        )
        try:
            force_gwt = sensing.at_rest_gwt()
        except NoReadingError as error:
            raise LimitError(f"{error}; {remedy}", error.code) from error
        known = engine.record_contact(force_gwt)
        if abs(force_gwt) >= sensing.touch_gwt:
            raise LimitError(f"the sensor reads {force_gwt:.2f} gwt; {remedy}", "touches_still")
        if not self._stage.homed:
            return
        if known.may_touch:
            clearance_mm = engine.settings.habits.clearance_mm
            raise LimitError(
                f"{engine.height_mm:.2f} mm above the nominal apex is below habits.clearance_mm = "
                f"{clearance_mm:g} mm; no step sideways: move up first; nothing was moved",
                "below_clearance",
            )
        engine.enter_clearance()

    # --- motions ---

    def _up(self, by_mm: float, speed_mm_s: float) -> None:
        engine = self._engine
        if self._stage.homed:
            top_mm = -engine.settings.frame.apex_z_mm
            if engine.height_mm < top_mm - _TINY_MM:
                engine.go_to_height(min(engine.height_mm + by_mm, top_mm), speed_mm_s)
            return
        for slice_mm in slices(by_mm, engine.settings.habits.descent_step_mm):
            self._jog(UP, slice_mm, speed_mm_s, Watch(away=True))

    def _down(self, by_mm: float, speed_mm_s: float, force_gwt: float) -> RigError | None:
        """Go down to clearance in one slow motion, and below it, or where a force is read, by increments."""
        engine, habits = self._engine, self._engine.settings.habits
        descent = self._descent = self._descent or _Descent(engine, force_gwt, force_gwt)
        if descent.touched_mm is None:  # What fell between two steps is a drift, and no pull.
            descent.air_gwt = min(descent.air_gwt, force_gwt)
        descent.rest_gwt, left_mm = force_gwt, by_mm
        if problem := descent.touched(force_gwt):  # The finger came up since.
            return problem
        above_mm = engine.height_mm - habits.clearance_mm if self._stage.homed else -math.inf
        if above_mm > AT_MM and abs(force_gwt) < engine.sensing.touch_gwt:
            from_mm, to_mm = engine.height_mm, engine.height_mm - min(by_mm, above_mm)
            engine.go_to_height(to_mm, min(speed_mm_s, habits.descent_speed_mm_s), touch_ends_it=True)
            force_gwt, made_mm = engine.read_force_gwt(NO_PRESS, "approach"), from_mm - engine.height_mm
            left_mm -= made_mm
            descent.made_mm, descent.rest_gwt = descent.made_mm + made_mm, force_gwt
            if problem := descent.touched(force_gwt):
                return problem
        while left_mm > _TINY_MM:
            step_mm = min(left_mm, descent.room_mm)
            if step_mm < min(left_mm, engine.settings.stage.resolution_mm):
                return InterruptedMotionError(
                    "the next step down would pass the soft trip", "next_step_past_soft_trip"
                )
            force_gwt = self._increment(descent, step_mm, speed_mm_s)
            left_mm -= step_mm
            if problem := descent.judge_increment(force_gwt, step_mm):
                return problem
        return None

    def _increment(self, descent: _Descent, by_mm: float, speed_mm_s: float) -> float:
        """Go down by an increment at most, and return the force at rest (gwt)."""
        engine = self._engine
        speed_mm_s = min(speed_mm_s, engine.settings.limits.max_press_speed_mm_s)
        if self._stage.homed:
            engine.go_to_height(engine.height_mm - by_mm, speed_mm_s)
            return engine.read_force_gwt(NO_PRESS, "approach")
        self._record_may_touch()
        try:
            self._jog(DOWN, by_mm, speed_mm_s, Watch())
            return engine.read_force_gwt(NO_PRESS, "approach")
        except (TripError, ContactTimeError) as problem:
            made_mm = descent.made_mm + by_mm
            raise self._lifted(problem, min(made_mm, engine.settings.habits.clearance_mm)) from None

    def _aside(self, direction: Direction, by_mm: float, speed_mm_s: float) -> RigError | None:
        """Go sideways so slowly that a touch ends the motion below half the soft trip."""
        engine, settings = self._engine, self._engine.settings
        if self._stage.homed:
            x_mm = engine.x_mm + direction.sign * by_mm * (direction.axis == "x")
            along_mm = engine.along_mm + direction.sign * by_mm * (direction.axis == "y")
            to_mm = {"x": settings.frame.pad_centre_x_mm + x_mm, "y": settings.frame.pad_y_mm + along_mm}
            try:
                refuse_travel(LimitError, settings, direction.axis, to_mm[direction.axis])
            except LimitError as beyond:
                raise LimitError(f"{beyond}; nothing was moved", beyond.code) from beyond
            go_sideways(engine, x_mm, along_mm, speed_mm_s)
            return None
        limit, watch = guarded_sideways(engine)
        self._record_may_touch()
        try:
            outcome = self._jog(direction, by_mm, min(speed_mm_s, limit.speed_mm_s), watch)
            force_gwt = engine.read_force_gwt(NO_PRESS, "moving")
            if abs(force_gwt) >= engine.sensing.touch_gwt:
                touched = TripError(f"the sensor reads {force_gwt:.2f} gwt after a step sideways", "touched")
                engine.trip(touched, force_gwt)
        except (TripError, ContactTimeError) as problem:
            raise self._lifted(problem, settings.habits.clearance_mm) from None
        if outcome is Outcome.ARRIVED:
            return None
        words = "a late reading, or a touch that vanished at rest, ended the step; step again to continue"
        return InterruptedMotionError(words, "late_reading")

    # --- at an unknown height ---

    def _jog(self, direction: Direction, by_mm: float, speed_mm_s: float, watch: Watch) -> Outcome:
        engine, stage = self._engine, self._stage

        def motion(check: Check) -> None:
            looks = jogging(stage, engine.clock, direction, by_mm, speed_mm_s)
            engine.motion.run(looks, check, stage.end_jog)

        return engine.run_watched(motion, replace(watch, lasts_s=by_mm / speed_mm_s))

    def _record_may_touch(self) -> None:
        """Record a possible contact before a motion at an unknown height."""
        engine = self._engine
        if not engine.contact.may_touch:
            engine.contact = replace(engine.contact, may_touch=True)
            engine.memory.touched(KnownContact(unix_s=engine.clock.unix_s()))

    def _lifted(self, problem: TripError | ContactTimeError, first_mm: float) -> TripError | ContactTimeError:
        """Lift after a trip or a contact time that is over, which the engine cannot where heights are unknown.

        The lift takes back the way down, or by clearance sideways, and goes on by clearances while a force falls.
        Returns the error with what was done.
        """
        engine, stage, settings = self._engine, self._stage, self._engine.settings
        if isinstance(problem, TripError) and (stage.homed or not engine.trip_lifts):
            return problem
        clearance_mm, lifted_mm, by_mm = settings.habits.clearance_mm, 0.0, first_mm
        most_mm = max(park_height_mm(settings, clearance_mm) - clearance_mm, first_mm)

        def lift(to_mm: float) -> None:
            left_mm = to_mm - stage.status().z_mm
            try:
                lift_from_rest(stage, engine.clock, left_mm, settings.habits.travel_speed_mm_s)
            except StageOverridden as error:
                stage.halt()
                raise InterruptedMotionError(str(error), error.code) from error

        try:
            force_gwt = math.inf
            while by_mm > 0.0:
                insist(partial(lift, stage.status().z_mm + by_mm))
                lifted_mm += by_mm
                before_gwt, force_gwt = force_gwt, abs(engine.sensing.settled().force_n / GWT_N)
                falls = engine.sensing.touch_gwt <= force_gwt < before_gwt
                by_mm = min(clearance_mm, most_mm - lifted_mm) if falls else 0.0
        except NoReadingError:
            pass
        except (StageError, TransportError, InterruptedMotionError) as error:
            return type(problem)(
                f"{problem}; lifted by {lifted_mm:.2f} mm, then the lift failed: {error}", problem.code
            )
        finally:
            engine.sensing.moved = True
        return type(problem)(f"{problem}; lifted by {lifted_mm:.2f} mm", problem.code)


def take_zero(sensing: Sensing, memory: EngineMemory) -> tuple[str, ForceZero]:
    """Zero a sensor at its present load; return its identity and the zero, which the caller records.

    Raises LimitError without readings or if they scatter, ForceError, TransportError.
    """
    name = sensing.connect()
    zero_sensor(sensing, memory)
    try:
        zero = sensing.take_zero(zero_readings_gwt(sensing.raw))
        if refused := zero_noise_error(LimitError, sensing, zero):
            raise refused
    except NoReadingError as error:
        sensing.zero = None
        raise LimitError(f"{error}; zero the sensor again", "no_reading") from error
    except BaseException:
        sensing.zero = None
        raise
    return name, zero


def _refuse_zero_in_contact(sensing: Sensing, last: LastKnown) -> None:
    """Raise LimitError if the force from the last zero, or without one the record of contact, may be a contact."""
    if last.zero is None:
        if last.contact is not None and last.contact.kind not in ("lifted", "raised"):
            raise LimitError(
                f"there is no zero on record, and the indentor is {last.contact.words}, so nothing was zeroed; "
                "free the finger and home, or, if nothing touches the indentor, use --anyway",
                "maybe_touched",
            )
        return
    try:
        force_gwt = sensing.at_rest_gwt()
    except NoReadingError as error:
        remedy = "let the sensor settle, or use --anyway if nothing touches the indentor"
        raise LimitError(f"{error}; nothing was zeroed; {remedy}", error.code) from error
    if abs(force_gwt) >= sensing.touch_gwt:
        taken = datetime.fromtimestamp(last.zero_unix_s).isoformat(" ", "minutes")
        raise LimitError(
            f"the sensor reads {force_gwt:.2f} gwt from the last recorded zero ({taken}), more than "
            f"{sensing.touch_gwt:.2f} gwt, so nothing was zeroed; if nothing touches the indentor, use --anyway",
            "maybe_touched",
        )


def step_without_force(
    settings: RigSettings,
    stage: Stage,
    clock: Clock,
    memory: EngineMemory,
    direction: Direction,
    by_mm: float,
    speed_mm_s: float,
) -> None:
    """Jog by a distance that nothing ends at a finger: down by increments, or above clearance by short steps.

    Raises LimitError if it ends too deep in the known finger, StageError.
    """
    habits, left_mm = settings.habits, by_mm
    if direction == DOWN:
        speed_mm_s = min(speed_mm_s, settings.limits.max_press_speed_mm_s)
        height_mm = stage.status().z_mm - by_mm - settings.frame.apex_z_mm
        if stage.homed:
            _refuse_depth(settings, height_mm)
    if direction != UP:
        memory.touched(KnownContact(unix_s=clock.unix_s()))
    while left_mm > _TINY_MM:
        most_mm = math.inf
        if direction == DOWN:
            height_mm = stage.status().z_mm - settings.frame.apex_z_mm
            above_mm = height_mm - habits.clearance_mm if stage.homed else 0.0
            most_mm = min(habits.descent_step_mm, above_mm) if above_mm > _TINY_MM else habits.increment_mm
        jog(stage, clock, direction, min(left_mm, most_mm), speed_mm_s)
        left_mm -= most_mm


def _refuse_depth(settings: RigSettings, height_mm: float, check: str = "") -> None:
    """Raise LimitError for a step to a height that is too deep in the known finger."""
    deepest_mm = settings.limits.max_doi_mm
    if height_mm < -deepest_mm - _TINY_MM:
        raise LimitError(
            f"{-height_mm:.2f} mm below the nominal apex is deeper than limits.max_doi_mm = {deepest_mm:g} mm; "
            f"{check}nothing was moved",
            "too_deep",
        )
