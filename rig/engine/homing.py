"""Homing monitored by force: first steps, and each growth of the force, show an axis that runs the wrong way.

A reversed motor plug does not show in the position that the controller reports. Only the force shows it.
"""

import math
import statistics
from typing import NoReturn

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


def home_watched(engine: Engine) -> None:
    """Home the stage with the force monitored; begin with steps away from the finger.

    If the force grows by the touch threshold, the stage halts, and a step up and down shows the cause. If the finger
    came up, or the force does not depend on the height, the stage homes again. If the axis runs the wrong way, it is
    moved back by at most the distance made, and homing trips.

    Without force readings the stage homes only if its sensor is out of range, or does not respond after a zero:
    homing is the way out of a trip.
    """
    engine.motion.x_mm = engine.motion.height_mm = math.nan
    homing = _Homing(engine)
    if math.isfinite(homing.before_gwt):
        homing.take_first_steps()
    homing.home()


class _Homing:
    """One homing: the force at rest before the present motion, and what counts as growth (gwt).

    before_gwt: infinite if the sensor is out of range. offset_gwt: subtracted from each reading where no zero was
    taken in the air. shakes_gwt: force of the stage's own motion. least_gwt: smallest effect of a step.
    """

    def __init__(self, engine: Engine) -> None:
        """Read the force at rest, before the first zero also its noise; trip if a reading is needed and missing."""
        self._engine, self._stage, sensing = engine, engine.bench.stage, engine.sensing
        self.before_gwt, self._offset_gwt, noise_gwt = math.inf, 0.0, 0.0
        try:
            if sensing.zeroed:
                force_gwt = sensing.settled().force_n / GWT_N
            else:
                readings_gwt = zero_readings_gwt(sensing.raw)
                force_gwt, noise_gwt = statistics.fmean(readings_gwt), statistics.pstdev(readings_gwt)
            self.before_gwt = abs(force_gwt) if sensing.absolute else 0.0
            self._offset_gwt = 0.0 if sensing.absolute else force_gwt
        except NoReadingError as error:
            if not (sensing.zeroed or error.out_of_range):
                engine.trip(TripError(str(error), error.code))
        self._shakes_gwt = max(min(NOISE_WIDTH * noise_gwt, _NOISIEST_GWT) - sensing.touch_gwt, 0.0)
        self._growth_gwt = sensing.touch_gwt + self._shakes_gwt
        self._least_gwt = self._growth_gwt / 2

    def take_first_steps(self) -> None:
        """Step up as far as the stage can go, with the force read after each step; trip if it runs the wrong way."""
        if not self._can_jog():
            return
        for number in range(1, STEPS + 1):
            made = self._step(UP)
            if self._has_grown(self._read_gwt()) and self._finger_came_up(number * STEP_MM):
                return
            if not made:
                return

    def home(self) -> None:
        """Home; again once after a finger came up, and a few times after a force that the height does not explain."""
        engine, came_up, unexplained = self._engine, False, 0
        while True:
            if math.isfinite(self.before_gwt):
                self.before_gwt = self._read_gwt()
            from_mm, begun_s = engine.guarded(self._stage.status).z_mm, engine.clock.monotonic_s()
            grown_gwt = self._home_until_growth()
            if grown_gwt is None:
                return
            is_finger = False
            if self._can_jog():
                # A GRBL board counts from the beginning of its homing, so the positions alone may tell too much.
                most_mm = _FASTEST_MM_S * (engine.clock.monotonic_s() - begun_s)
                is_finger = self._finger_came_up(min(abs(engine.guarded(self._stage.status).z_mm - from_mm), most_mm))
            if is_finger:
                if came_up:
                    self._lift_and_trip()
                came_up = True
                continue
            unexplained += 1
            if unexplained > _UNEXPLAINED:
                self._refuse_disturbance(grown_gwt)
            # The motion itself may shake the sensor: only more than it counts from now on.
            self._shakes_gwt += min(abs(grown_gwt), _NOISIEST_GWT)

    def _home_until_growth(self) -> float | None:
        """Home; return the force (gwt) whose growth halted the stage, or None on arrival."""
        halted_by: float | None = None

        def home(check: Check) -> None:
            nonlocal halted_by
            try:
                self._engine.motion.home(check)
            except InterruptedMotionError as growth:
                if growth.force_gwt is None:
                    raise
                halted_by = growth.force_gwt

        self._engine.run_watched(home, Watch(away=True, touch_ends_it=True, shakes_gwt=self._shakes_gwt))
        return halted_by

    def _finger_came_up(self, way_mm: float) -> bool:
        """Find out at rest whether a finger that came up explains a growth of the force, and journal it.

        A step up and a step down change the force of a finger. Their difference leaves out drift and relaxation. If
        the axis runs the wrong way, it is moved back by at most way_mm, and homing trips.
        """
        engine = self._engine
        for _ in range(_EXAMINATIONS):
            force_gwt = self._steady_gwt()
            if not self._has_grown(force_gwt) or not self._step(UP):
                return self._note_growth(force_gwt, is_finger=False)
            up_gwt = self._read_gwt()
            self._step(DOWN)
            effect_gwt = up_gwt - (force_gwt + self._read_gwt()) / 2
            if abs(effect_gwt) < self._least_gwt:
                if passed := engine.trips.passed_any(force_gwt):
                    words = f"{passed} while homing, and does not depend on the height"
                    engine.trip(TripError(words, passed.code), force_gwt)
                return self._note_growth(force_gwt, is_finger=False)
            if effect_gwt < 0:
                return self._note_growth(force_gwt, is_finger=True)
            if (back_mm := self._move_back(way_mm)) is not None:
                before_gwt = self.before_gwt if engine.sensing.absolute else 0.0
                wrong = TripError(
                    "the z axis runs the wrong way: homing moves up, but the force grew from "
                    f"{before_gwt:.2f} gwt to {_words(force_gwt)}, and fell on the way down; the stage was moved "
                    f"back by {back_mm:.2f} mm; check the motor plug and the direction setting of the axis",
                    "homing_wrong_way",
                )
                engine.trip(wrong, _finite(force_gwt))
        return self._refuse_disturbance(self._read_gwt())

    def _note_growth(self, force_gwt: float, *, is_finger: bool) -> bool:
        why = "a finger came up" if is_finger else "it vanished at rest, or does not depend on the height"
        self._engine.record(AlarmEvent(f"the force grew while homing, to {_words(force_gwt)} at rest: {why}"))
        return is_finger

    def _move_back(self, way_mm: float) -> float | None:
        """Step down, which is up on a reversed axis, until the touch ends or the force grows, by at most way_mm.

        Return the distance (mm); None if the force did not fall.
        """
        start_gwt = lowest_gwt = self._read_gwt()
        steps = 0
        while (steps + 1) * STEP_MM <= way_mm + _TINY_MM and lowest_gwt >= self._growth_gwt:
            if not self._step(DOWN):
                break
            force_gwt = self._read_gwt()
            if force_gwt > lowest_gwt + self._least_gwt:
                self._step(UP)
                break
            steps, lowest_gwt = steps + 1, min(lowest_gwt, force_gwt)
        return steps * STEP_MM if start_gwt - lowest_gwt >= self._least_gwt else None

    def _lift_and_trip(self) -> NoReturn:
        """Step up until the touch ends, the force grows or the stage can go no farther, and trip."""
        settings, force_gwt = self._engine.settings, self._steady_gwt()
        step_mm, left_mm = settings.habits.descent_step_mm, settings.stage.travel_mm[2]
        while left_mm > 0 and force_gwt >= self._growth_gwt and self._step(UP, step_mm):
            before_gwt, force_gwt, left_mm = force_gwt, self._steady_gwt(), left_mm - step_mm
            if force_gwt > before_gwt + self._least_gwt:
                break
        moves = TripError(
            "the finger came up twice while the stage homed; the stage lifted as far as possible, to "
            f"{_words(force_gwt)}; keep the finger still, then home again",
            "finger_moves",
        )
        self._engine.trip(moves, _finite(force_gwt))

    def _refuse_disturbance(self, force_gwt: float) -> NoReturn:
        disturbed = TripError(
            f"homing was halted several times by a force that the height does not explain, last {_words(force_gwt)}; "
            "keep the finger still, check the sensor and its mounting, then home again",
            "homing_disturbed",
        )
        self._engine.trip(disturbed, _finite(force_gwt))

    def _has_grown(self, force_gwt: float) -> bool:
        return force_gwt > self.before_gwt + self._growth_gwt

    def _read_gwt(self) -> float:
        """Return the force at rest: its size from a zero taken in the air, else its change; infinite out of range.

        Trip for a stop input, or without a reading.
        """
        engine, sensing = self._engine, self._engine.sensing
        if problem := engine.stop_inputs(engine, at_rest=True):
            engine.trip(problem)
        try:
            force_gwt = sensing.settled(engine.beat).force_n / GWT_N - self._offset_gwt
        except NoReadingError as error:
            if error.out_of_range:
                return math.inf
            engine.trip(TripError(str(error), error.code))
        return abs(force_gwt) if sensing.absolute else force_gwt

    def _steady_gwt(self) -> float:
        """Return the force at rest once two readings agree, or after AT_REST_S."""
        clock, force_gwt = self._engine.clock, self._read_gwt()
        until_s = clock.monotonic_s() + AT_REST_S
        while clock.monotonic_s() < until_s:
            last_gwt, force_gwt = force_gwt, self._read_gwt()
            if abs(force_gwt - last_gwt) <= max(self._growth_gwt, _STEADY * abs(force_gwt)):
                break
        return force_gwt

    def _can_jog(self) -> bool:
        """Prepare for steps; return False if the controller refuses them, or has an alarm, which homing refuses.

        A motion that an earlier program left ends here.
        """
        engine, refused = self._engine, False

        def prepare() -> None:
            nonlocal refused
            try:
                self._stage.allow_unhomed_jogs()
            except StageRejected:
                refused = True

        engine.guarded(prepare)
        state = engine.guarded(self._stage.status).state
        if state == "Run":
            engine.guarded(self._stage.halt)
        return not refused and state != "Alarm"

    def _step(self, direction: Direction, by_mm: float = STEP_MM) -> bool:
        """Step up or down at the speed of an approach; return False if the stage ended short, as at its upper end."""
        engine, ended_by = self._engine, list[StageError]()

        def jogged() -> None:
            try:
                jog(self._stage, engine.clock, direction, by_mm, engine.settings.habits.approach_speed_mm_s)
            except StrayedError as strayed:
                raise StageError(str(strayed), strayed.code) from strayed
            except StageAlarm as alarm:  # There was none before the step.
                ended_by.append(alarm)
                self._stage.unlock()
            except StageError as error:
                ended_by.append(error)
                if not isinstance(error, StageRejected) and error.code != "jog_cut_short":
                    raise

        engine.sensing.moved = engine.motion.begun = True
        engine.guarded(jogged)
        if ended_by:
            engine.record(AlarmEvent(f"a step of homing ended short: {ended_by[0]}"))
        return not ended_by


def _words(force_gwt: float) -> str:
    return f"{force_gwt:.2f} gwt" if math.isfinite(force_gwt) else "beyond the range of the sensor"


def _finite(force_gwt: float) -> float | None:
    return force_gwt if math.isfinite(force_gwt) else None
