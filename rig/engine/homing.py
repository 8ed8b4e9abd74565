"""Homing monitored by force: first steps, and each growth of the force, show an axis that runs the wrong way.

A reversed motor plug does not show in the position that the controller reports. Only the force shows it.
"""

import math
import statistics
from dataclasses import dataclass
from typing import Literal, NoReturn

from rig.data.events import AlarmEvent
from rig.devices.base import StageAlarm, StageError, StageRejected
from rig.engine.engine import Engine
from rig.engine.motion import DOWN, UP, Check, Direction, InterruptedMotionError, StrayedError, jog
from rig.engine.sensing import AT_REST_S, NOISE_WIDTH, NoReadingError, zero_readings_gwt
from rig.engine.watch import Watch
from rig.errors import TripError
from rig.units import GWT_N

STEP_MM, STEPS = 0.05, 6
"""First steps of homing. In contact the first step shows the direction, or the first one past the lost motion of the
screw (0.2 mm if it is worn). A finger farther away than all steps is met by homing, which halts in time because the
force then begins at zero."""

_FASTEST_MM_S = 10.0  # No stage homes faster.
_TINY_MM = 1e-6
_EXAMINATIONS = 3  # A finger that moves may contradict the first one.
_UNEXPLAINED = 3  # Halts of one homing by a force that the height does not explain.
_NOISIEST_GWT = 0.5  # A finger that moves changes the force by more than noise and a shaking stage do.
_STEADY = 0.02  # Share of a steady force by which two readings may differ.

Cause = Literal["finger", "not the finger"]


@dataclass
class _Watch:
    """Force at rest during one homing (gwt), and what counts as growth.

    before_gwt: before the present motion; infinite if the sensor is out of range. offset_gwt: subtracted from each
    reading where no zero was taken in the air. shakes_gwt: force of the stage's own motion.
    """

    engine: Engine
    before_gwt: float = math.inf
    offset_gwt: float = 0.0
    growth_gwt: float = 0.0
    shakes_gwt: float = 0.0

    def read_gwt(self) -> float:
        """Return the force at rest: its size from a zero taken in the air, else its change; infinite out of range.

        Trip without a reading.
        """
        engine, sensing = self.engine, self.engine.sensing
        engine.beat(sensing.wait_s)
        if problem := engine.stop_inputs(engine, at_rest=True):
            engine.trip(problem)
        try:
            force_gwt = sensing.settled().force_n / GWT_N - self.offset_gwt
        except NoReadingError as error:
            if error.out_of_range:
                return math.inf
            engine.trip(TripError(str(error), error.code))
        return abs(force_gwt) if sensing.absolute else force_gwt

    def steady_gwt(self) -> float:
        """Return the force at rest once two readings agree, or after AT_REST_S."""
        clock, force_gwt = self.engine.clock, self.read_gwt()
        until_s = clock.monotonic_s() + AT_REST_S
        while clock.monotonic_s() < until_s:
            last_gwt, force_gwt = force_gwt, self.read_gwt()
            if abs(force_gwt - last_gwt) <= max(self.growth_gwt, _STEADY * abs(force_gwt)):
                break
        return force_gwt

    def has_grown(self, force_gwt: float) -> bool:
        """Return whether a force has grown by the touch threshold."""
        return force_gwt > self.before_gwt + self.growth_gwt

    @property
    def least_gwt(self) -> float:
        """Smallest change that counts as the effect of a step."""
        return self.growth_gwt / 2


def home_watched(engine: Engine) -> None:
    """Home the stage with the force monitored; begin with steps away from the finger.

    If the force grows by the touch threshold, the stage halts, and a step up and down shows the cause. If the finger
    came up, or the force does not depend on the height, the stage homes again. If the axis runs the wrong way, it is
    moved back by at most the distance made, and homing trips.

    Without force readings the stage homes only if its sensor is out of range, or does not respond after a zero:
    homing is the way out of a trip.
    """
    engine.motion.x_mm = engine.motion.height_mm = math.nan
    watch = _begin(engine)
    if math.isfinite(watch.before_gwt):
        _take_first_steps(watch)
    _home(watch)


def _begin(engine: Engine) -> _Watch:
    """Read the force at rest, before the first zero also its noise; trip if homing needs a reading and has none."""
    sensing, watch, noise_gwt = engine.sensing, _Watch(engine), 0.0
    try:
        if sensing.zeroed:
            force_gwt = sensing.settled().force_n / GWT_N
        else:
            readings_gwt = zero_readings_gwt(sensing.raw)
            force_gwt, noise_gwt = statistics.fmean(readings_gwt), statistics.pstdev(readings_gwt)
        watch.before_gwt = abs(force_gwt) if sensing.absolute else 0.0
        watch.offset_gwt = 0.0 if sensing.absolute else force_gwt
    except NoReadingError as error:
        if not (sensing.zeroed or error.out_of_range):
            engine.trip(TripError(str(error), error.code))
    watch.shakes_gwt = max(min(NOISE_WIDTH * noise_gwt, _NOISIEST_GWT) - sensing.touch_gwt, 0.0)
    watch.growth_gwt = sensing.touch_gwt + watch.shakes_gwt
    return watch


def _take_first_steps(watch: _Watch) -> None:
    """Step up as far as the stage can go, with the force read after each step; trip if it runs the wrong way."""
    if not _can_jog(watch.engine):
        return
    for number in range(1, STEPS + 1):
        made = _step(watch.engine, UP)
        if watch.has_grown(watch.read_gwt()) and _find_cause(watch, number * STEP_MM) == "finger":
            return
        if not made:
            return


def _home(watch: _Watch) -> None:
    """Home; again once after a finger came up, and a few times after a force that the height does not explain."""
    engine, came_up, unexplained = watch.engine, False, 0
    while True:
        if math.isfinite(watch.before_gwt):
            watch.before_gwt = watch.read_gwt()
        from_mm, begun_s = engine.guarded(engine.bench.stage.status).z_mm, engine.clock.monotonic_s()
        grown_gwt = _home_until_growth(watch)
        if grown_gwt is None:
            return
        cause: Cause = "not the finger"
        if _can_jog(engine):
            # A GRBL board counts from the beginning of its homing, so the positions alone may tell too much.
            most_mm = _FASTEST_MM_S * (engine.clock.monotonic_s() - begun_s)
            way_mm = min(abs(engine.guarded(engine.bench.stage.status).z_mm - from_mm), most_mm)
            cause = _find_cause(watch, way_mm)
        if cause == "finger":
            if came_up:
                _refuse_finger(watch)
            came_up = True
            continue
        unexplained += 1
        if unexplained > _UNEXPLAINED:
            _refuse_disturbance(engine, grown_gwt)
        # The motion itself may shake the sensor: only more than it counts from now on.
        watch.shakes_gwt += min(abs(grown_gwt), _NOISIEST_GWT)


def _home_until_growth(watch: _Watch) -> float | None:
    """Home; return the force (gwt) whose growth halted the stage, or None on arrival."""
    engine, halted_by = watch.engine, list[float]()

    def home(check: Check) -> None:
        try:
            engine.motion.home(check)
        except InterruptedMotionError as growth:
            if growth.force_gwt is None:
                raise
            halted_by.append(growth.force_gwt)

    engine.run_watched(home, Watch(away=True, touch_ends_it=True, shakes_gwt=watch.shakes_gwt))
    return halted_by[0] if halted_by else None


def _find_cause(watch: _Watch, way_mm: float) -> Cause:
    """Find out at rest why the force grew; if the axis runs the wrong way, move it back by at most way_mm, and trip.

    A step up and a step down change the force of a finger. Their difference leaves out drift and relaxation.
    """
    engine = watch.engine
    for _ in range(_EXAMINATIONS):
        force_gwt = watch.steady_gwt()
        if not watch.has_grown(force_gwt) or not _step(engine, UP):
            return _report(engine, "not the finger", force_gwt)
        up_gwt = watch.read_gwt()
        _step(engine, DOWN)
        effect_gwt = up_gwt - (force_gwt + watch.read_gwt()) / 2
        if abs(effect_gwt) < watch.least_gwt:
            if passed := engine.trips.passed_any(force_gwt):
                words = f"{passed} while homing, and does not depend on the height"
                engine.trip(TripError(words, passed.code), force_gwt)
            return _report(engine, "not the finger", force_gwt)
        if effect_gwt < 0:
            return _report(engine, "finger", force_gwt)
        if (back_mm := _move_back(watch, way_mm)) is not None:
            _refuse_wrong_way(watch, force_gwt, back_mm)
    return _refuse_disturbance(engine, watch.read_gwt())


def _report(engine: Engine, cause: Cause, force_gwt: float) -> Cause:
    """Journal the cause of a growth that does not end homing."""
    why = "a finger came up" if cause == "finger" else "it vanished at rest, or does not depend on the height"
    engine.record(AlarmEvent(f"the force grew while homing, to {_words(force_gwt)} at rest: {why}"))
    return cause


def _move_back(watch: _Watch, way_mm: float) -> float | None:
    """Step down, which is up on a reversed axis, until the touch ends or the force grows, by at most way_mm.

    Return the distance (mm); None if the force did not fall.
    """
    start_gwt = lowest_gwt = watch.read_gwt()
    steps = 0
    while (steps + 1) * STEP_MM <= way_mm + _TINY_MM and lowest_gwt >= watch.growth_gwt:
        if not _step(watch.engine, DOWN):
            break
        force_gwt = watch.read_gwt()
        if force_gwt > lowest_gwt + watch.least_gwt:
            _step(watch.engine, UP)
            break
        steps, lowest_gwt = steps + 1, min(lowest_gwt, force_gwt)
    return steps * STEP_MM if start_gwt - lowest_gwt >= watch.least_gwt else None


def _lift(watch: _Watch) -> float:
    """Step up until the touch ends, the force grows or the stage can go no farther; return the force (gwt)."""
    settings = watch.engine.settings
    step_mm, left_mm, force_gwt = settings.habits.descent_step_mm, settings.stage.travel_mm[2], watch.steady_gwt()
    while left_mm > 0 and force_gwt >= watch.growth_gwt and _step(watch.engine, UP, step_mm):
        before_gwt, force_gwt, left_mm = force_gwt, watch.steady_gwt(), left_mm - step_mm
        if force_gwt > before_gwt + watch.least_gwt:
            break
    return force_gwt


def _refuse_wrong_way(watch: _Watch, force_gwt: float, back_mm: float) -> NoReturn:
    before_gwt = watch.before_gwt if watch.engine.sensing.absolute else 0.0
    wrong = TripError(
        f"the z axis runs the wrong way: homing moves up, but the force grew from {before_gwt:.2f} gwt to "
        f"{_words(force_gwt)}, and fell on the way down; the stage was moved back by {back_mm:.2f} mm; check the "
        "motor plug and the direction setting of the axis",
        "homing_wrong_way",
    )
    watch.engine.trip(wrong, _known(force_gwt))


def _refuse_finger(watch: _Watch) -> NoReturn:
    force_gwt = _lift(watch)
    moves = TripError(
        "the finger came up twice while the stage homed; the stage lifted as far as possible, to "
        f"{_words(force_gwt)}; keep the finger still, then home again",
        "finger_moves",
    )
    watch.engine.trip(moves, _known(force_gwt))


def _refuse_disturbance(engine: Engine, force_gwt: float) -> NoReturn:
    disturbed = TripError(
        f"homing was halted several times by a force that the height does not explain, last {_words(force_gwt)}; "
        "keep the finger still, check the sensor and its mounting, then home again",
        "homing_disturbed",
    )
    engine.trip(disturbed, _known(force_gwt))


def _words(force_gwt: float) -> str:
    return f"{force_gwt:.2f} gwt" if math.isfinite(force_gwt) else "beyond the range of the sensor"


def _known(force_gwt: float) -> float | None:
    return force_gwt if math.isfinite(force_gwt) else None


# --- steps at an unknown position ---


def _can_jog(engine: Engine) -> bool:
    """Prepare for steps; return False if the controller refuses them, or has an alarm, which homing refuses.

    A motion that an earlier program left ends here.
    """
    stage, refused = engine.bench.stage, False

    def prepare() -> None:
        nonlocal refused
        try:
            stage.allow_unhomed_jogs()
        except StageRejected:
            refused = True

    engine.guarded(prepare)
    state = engine.guarded(stage.status).state
    if state == "Run":
        engine.guarded(stage.halt)
    return not refused and state != "Alarm"


def _step(engine: Engine, direction: Direction, by_mm: float = STEP_MM) -> bool:
    """Step up or down at the speed of an approach; return False if the stage ended short, as at its upper end."""
    stage, speed_mm_s = engine.bench.stage, engine.settings.habits.approach_speed_mm_s
    ended_by: StageError | None = None

    def jogged() -> None:
        nonlocal ended_by
        try:
            jog(stage, engine.clock, direction, by_mm, speed_mm_s)
        except StrayedError as strayed:
            raise StageError(str(strayed), strayed.code) from strayed
        except StageAlarm as alarm:  # There was none before the step.
            ended_by = alarm
            stage.unlock()
        except StageError as error:
            ended_by = error
            if not isinstance(error, StageRejected) and error.code != "jog_cut_short":
                raise

    engine.sensing.moved = engine.motion.begun = True
    engine.guarded(jogged)
    if ended_by is not None:
        engine.record(AlarmEvent(f"a step of homing ended short: {ended_by}"))
    return ended_by is None
