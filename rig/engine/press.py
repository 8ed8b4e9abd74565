"""Press past the skin to a depth or a force and hold it; detect a frozen reading; pulse the sync output."""

import math
import statistics
from collections import deque
from itertools import pairwise

from rig.data.events import HoldEndEvent, HoldStartEvent, RampEvent, SyncEvent
from rig.devices.base import ForceReading
from rig.engine.engine import Engine
from rig.engine.limits import (
    CONTACT_EXPONENT,
    RELAXED_TO,
    TRIP_MARGIN,
    UNREAD_S,
    RampBound,
    SampleAge,
)
from rig.engine.motion import PRINTED_MM, InterruptedMotionError
from rig.engine.verbs import safe_point
from rig.engine.watch import OnReading
from rig.errors import LimitError, TripError
from rig.records import ContactFit, Hold, Phase, PressId, Target, force_tolerance_gwt
from rig.units import GWT_N

_MOVES, _STEPS, _SHARE = 3, 5, 0.1


class FrozenReading:
    """Detector of a reading that stays the same although the finger must push harder, or less.

    least_moved: motion, in the unit of `stays`, before which a reading may still be on its way; moves by default.
    """

    def __init__(self, resolution_gwt: float, least_moved: float = _MOVES) -> None:
        self._resolution_gwt, self._least_moved = resolution_gwt, least_moved
        self._changed_gwt = math.nan  # reading at the last change
        self._moved = self._expected_gwt = 0.0  # since then

    def stays(self, force_gwt: float, expected_gwt: float, moved: float, before_gwt: float | None = None) -> bool:
        """Return whether the reading has stayed for too long.

        expected_gwt, moved: change of the force expected since the last call, and the motion since. before_gwt:
        reading to compare with, by default that of the last change.
        """
        compared_gwt = self._changed_gwt if before_gwt is None else before_gwt
        if not abs(force_gwt - compared_gwt) <= 0.5 * self._resolution_gwt:
            self._changed_gwt, self._moved, self._expected_gwt = force_gwt, 0.0, 0.0
            return False
        self._moved += moved
        self._expected_gwt += expected_gwt
        enough_gwt = max(_STEPS * self._resolution_gwt, _SHARE * force_gwt)
        return self._moved >= self._least_moved and self._expected_gwt > enough_gwt


def pulse(engine: Engine, press: PressId, at: str) -> None:
    """Pulse the sync output, if configured, for presses that are data.

    The journal gets rise_s, when the device had confirmed the rise, and uncertainty_s, by how much earlier it may be.
    """
    sync, clock, stage = engine.settings.sync, engine.clock, engine.bench.stage
    if sync.output == "off" or press.purpose != "data":
        return
    requested_s = clock.monotonic_s()
    engine.guarded(lambda: stage.set_output(True))
    rise_s = clock.monotonic_s()
    clock.wait_s(sync.width_s)
    engine.guarded(lambda: stage.set_output(False))
    width_s = clock.monotonic_s() - rise_s
    run_s, uncertainty_s = round(clock.run_s(rise_s), 6), round(rise_s - requested_s, 6)
    engine.record(SyncEvent(press.index, at, run_s, uncertainty_s, round(width_s, 6)), press)


_MAX_SEEK_MOVES = 400
# Share of the touch threshold: less force one increment below the touch means that the finger is gone.
_LOST_SHARE = 0.5
# A step across a gap wider than this share of the target closes only part of it, so that no step overshoots.
_WIDE_GAP, _CLOSED_AT_ONCE = 0.05, 0.75
_MOST_AVERAGED = 25
_HIGHEST_AIM = 1.02  # Share of the target in a hold; with noise the force must stay below 1.05.


class Press:
    """Press of one indentation, from its touch-off on."""

    def __init__(self, engine: Engine, press: PressId, touch: ContactFit, speed_mm_s: float) -> None:
        self._engine, self.id, self._speed = engine, press, speed_mm_s
        self._habits = engine.settings.habits
        self._smallest_mm = engine.settings.stage.resolution_mm
        self._touch = touch
        self._contact_mm, self._force_gwt = touch.contact_height_mm, touch.force_gwt
        # at contact, or at the end of the last hold
        self._ramp_from = (touch.force_gwt, engine.clock.monotonic_s())
        self._stiffness_gwt_mm = 0.0  # of the last move
        self._peak_gwt = 0.0  # highest reading since the last hold
        self.reached: tuple[float, float] | None = None  # depth (mm) and force (gwt) by increments, before the hold
        self._frozen = FrozenReading(engine.sensing.resolution_gwt)

    @property
    def _doi_mm(self) -> float:
        return self._engine.doi_mm(self._contact_mm, self._force_gwt)

    def hold_at(self, target: Target, *, hold: int, hold_s: float) -> Hold:
        """Press to the target, hold, and journal the hold as delivered."""
        self.reach(target)
        return self._hold(target, hold, hold_s)

    def reach_doi(self, doi_mm: float) -> tuple[float, float]:
        """Press to a depth by increments and return depth (mm) and force (gwt) as reached."""
        self._press_to_doi(doi_mm)
        self.reached = self._doi_mm, self._force_gwt
        return self.reached

    def ramp_and_hold(self, doi_mm: float, bound: RampBound, hold_s: float) -> Hold:
        """Move to a depth at constant speed from above the skin, hold, and journal the hold as delivered.

        Each reading is compared with the trip of the ramp as it arrives, then journalled. A ramp also trips if the
        stage covers more than it may without a reading, and at a reading that is too small for a finger.
        """
        engine = self._engine
        self._refuse_too_deep(doi_mm)
        safe_point(engine)
        to_mm = self._contact_mm - doi_mm - engine.sensing.deflection_mm(bound.force_gwt)
        engine.limit_depth(to_mm - self._habits.increment_mm)
        engine.trips.ramp_at(bound.trip_gwt)
        start = RampEvent(
            index=self.id.index,
            speed_mm_s=bound.speed_mm_s,
            measured_gwt=bound.force_gwt,
            trip_gwt=bound.trip_gwt,
            bound_gwt=bound.bound_gwt,
            stop_mm=round(bound.stop_mm, 6),
        )
        engine.record(start, self.id)
        self._peak_gwt = 0.0
        self._ramp_from = (0.0, engine.clock.monotonic_s())
        engine.go_to_height(to_mm, bound.speed_mm_s, ramp=self._ramp_reader(doi_mm, bound))
        safe_point(engine)  # A pause ends the ramp.
        self._force_gwt = self._read("ramp")
        return self._hold(Target("doi_mm", doi_mm), 1, hold_s)

    def _ramp_reader(self, doi_mm: float, bound: RampBound) -> OnReading:
        engine, settings, speed_mm_s = self._engine, self._engine.settings, bound.speed_mm_s
        unread_mm = speed_mm_s * UNREAD_S + self._smallest_mm + PRINTED_MM
        late_mm = speed_mm_s * SampleAge.of(settings).wait_s
        before_mm, before_gwt = engine.height_mm, 0.0
        frozen = FrozenReading(engine.sensing.resolution_gwt, late_mm)

        def on_reading(reading: ForceReading) -> None:
            nonlocal before_mm, before_gwt
            force = round(reading.force_n / GWT_N, 6)
            gone_mm, before_mm = before_mm - engine.height_mm, engine.height_mm
            self._peak_gwt = max(self._peak_gwt, force)
            here_mm = engine.doi_mm(self._contact_mm, force)
            engine.record_in_motion(self.id, "ramp", reading, here_mm)
            if gone_mm > unread_mm:
                raise InterruptedMotionError(
                    f"the stage moved by {gone_mm:.3f} mm without a force reading, farther than the "
                    f"{unread_mm:.3f} mm that a ramp may",
                    "ramp_unread",
                    force,
                )
            if lost := self._lost_finger(force, late_mm):
                raise InterruptedMotionError(str(lost), lost.code, force)
            expected_gwt = bound.force_gwt * (max(here_mm, 0.0) / doi_mm) ** CONTACT_EXPONENT
            risen_gwt, before_gwt = expected_gwt - before_gwt, expected_gwt
            feels = force >= _LOST_SHARE * self._touch.threshold_gwt  # Below, the finger is lost, or not yet reached.
            if feels and frozen.stays(force, risen_gwt, gone_mm):
                stays = _stays(force)
                raise InterruptedMotionError(str(stays), stays.code, force)

        return on_reading

    def reach(self, target: Target) -> tuple[float, float]:
        """Press to a depth or a force by increments and return depth (mm) and force (gwt) as reached."""
        if target.kind == "doi_mm":
            return self.reach_doi(target.value)
        self._seek_force(target.value)
        self.reached = self._doi_mm, self._force_gwt
        return self.reached

    def _press_to_doi(self, doi_mm: float) -> None:
        """Press to within half a step of the stage. Raises LimitError if a compliant rig never gets there."""
        for _ in range(_MAX_SEEK_MOVES):
            if abs(doi_mm - self._doi_mm) <= 0.5 * self._smallest_mm:
                return
            self._press_by(doi_mm - self._doi_mm)
        raise LimitError(
            f"DOI {doi_mm:g} mm was not reached within {_MAX_SEEK_MOVES} moves; check "
            "calibration.compliance_mm_per_n",
            "doi_not_reached",
        )

    def _seek_force(self, target_gwt: float) -> None:
        """Step along F ∝ d^1.5 through the present force, until within half the tolerance.

        If one step of the stage changes the force by more, the full tolerance applies. Raises LimitError if it cannot
        be reached.
        """
        tolerance = self._tolerance_gwt(target_gwt)
        smallest_before = 0.0
        for _ in range(_MAX_SEEK_MOVES):
            self._average_near(target_gwt, tolerance)
            error = abs(self._force_gwt - target_gwt)
            if error <= 0.5 * tolerance:
                return
            step = self._step_towards(target_gwt)
            if abs(step) >= self._smallest_mm:
                smallest_before = 0.0
            elif error <= tolerance:
                return
            else:
                step = math.copysign(self._smallest_mm, step)
                self._refuse_to_and_fro(step, smallest_before, target_gwt)
                smallest_before = step
            self._press_by(step)
        raise LimitError(
            f"force {target_gwt:g} gwt did not settle within {_MAX_SEEK_MOVES} moves; check the force sensor for "
            "noise and drift",
            "force_not_settled",
        )

    def _refuse_to_and_fro(self, step_mm: float, before_mm: float, target_gwt: float) -> None:
        if step_mm * before_mm < 0:
            raise LimitError(
                f"force {target_gwt:g} gwt cannot be held within ± {self._tolerance_gwt(target_gwt):.3g} gwt: one "
                f"step of the stage ({self._smallest_mm:g} mm) changes it by more",
                "step_too_coarse",
            )

    def _tolerance_gwt(self, target_gwt: float) -> float:
        return force_tolerance_gwt(target_gwt, self._engine.sensing.resolution_gwt)

    def _averaged(self, to_gwt: float) -> int:
        """Return the number of readings that determine a force to this accuracy (gwt)."""
        return min(max(math.ceil((self._engine.sensing.noise_gwt / to_gwt) ** 2), 1), _MOST_AVERAGED)

    def _average_near(self, target_gwt: float, tolerance_gwt: float) -> None:
        """Average more readings near the target if a single one is too noisy."""
        more = self._averaged(tolerance_gwt / 4) - 1
        if more and abs(self._force_gwt - target_gwt) < 2 * tolerance_gwt:
            readings = [self._read("press") for _ in range(more)]
            self._force_gwt = statistics.fmean([self._force_gwt, *readings])

    def _step_towards(self, target_gwt: float) -> float:
        """Return the step (mm) by the force law, or by the stiffness of the last move if that is higher."""
        gap_gwt = target_gwt - self._force_gwt
        if gap_gwt > _WIDE_GAP * target_gwt:
            gap_gwt *= _CLOSED_AT_ONCE
        step = self._to_force(self._force_gwt + gap_gwt)
        return min(step, gap_gwt / self._stiffness_gwt_mm) if min(gap_gwt, self._stiffness_gwt_mm) > 0 else step

    def _read(self, phase: Phase) -> float:
        force = self._engine.read_force_gwt(self.id, phase, self._contact_mm)
        self._peak_gwt = max(self._peak_gwt, force)
        if lost := self._lost_finger(force):
            self._engine.trip(lost, force)
        return force

    def _lost_finger(self, force_gwt: float, late_mm: float = 0.0) -> TripError | None:
        """Return the trip of a force below the touch that is too small for a finger, or a pull, else None.

        late_mm: distance that the stage covers while a reading ages.
        """
        least_gwt = _LOST_SHARE * self._touch.threshold_gwt
        below_mm = self._touch.height_at_threshold_mm - self._engine.height_mm
        if force_gwt >= least_gwt or below_mm < self._habits.increment_mm + late_mm - 1e-9:
            return None
        return TripError(
            f"the sensor reads {force_gwt:.2f} gwt {below_mm:.2f} mm below the touch; check its cable and sign, "
            "and whether the finger has moved away",
            "lost_finger",
        )

    def _to_force(self, force_gwt: float) -> float:
        """Return the move (mm) that reaches a force on F ∝ d^1.5 through the present reading."""
        present = max(self._force_gwt, 0.5 * self._habits.touch_force_gwt)
        return max(self._doi_mm, self._smallest_mm) * ((force_gwt / present) ** (1 / CONTACT_EXPONENT) - 1)

    def _press_by(self, step_mm: float, phase: Phase = "press") -> None:
        """Make one move in contact: at most an increment, and not past the soft trip at the present stiffness."""
        engine = self._engine
        safe_point(engine)
        room = TRIP_MARGIN * self._to_force(engine.trip_gwt)
        if room < min(step_mm, self._smallest_mm):
            raise LimitError(
                f"the next move at x = {engine.x_mm:g} mm would exceed the {engine.trips.lowest} of "
                f"{engine.trip_gwt:.2f} gwt",
                f"next_move_past_{engine.trips.lowest_code}",
            )
        step = max(min(step_mm, self._habits.increment_mm, room), -self._habits.increment_mm)
        self._refuse_too_deep(self._doi_mm + step)
        expected, before = abs(self._force_after(step) - self._force_gwt), self._force_gwt
        engine.go_to_height(engine.height_mm - step, self._speed)
        self._force_gwt = self._read(phase)
        if abs(step) >= self._smallest_mm:
            self._stiffness_gwt_mm = (self._force_gwt - before) / step
        if self._frozen.stays(self._force_gwt, expected, 1, before):
            engine.trip(_stays(self._force_gwt), self._force_gwt)

    def _refuse_too_deep(self, doi_mm: float) -> None:
        deepest = self._engine.settings.limits.max_doi_mm
        if doi_mm > deepest + 1e-9:
            raise LimitError(
                f"DOI {doi_mm:.3f} mm at x = {self._engine.x_mm:g} mm would exceed limits.max_doi_mm = "
                f"{deepest:g} mm",
                "too_deep",
            )

    def _force_after(self, step_mm: float) -> float:
        """Return the force expected after a step, on F ∝ d^1.5 through the present reading."""
        doi = max(self._doi_mm, self._smallest_mm)
        return self._force_gwt * (max(doi + step_mm, 0.0) / doi) ** CONTACT_EXPONENT

    def _hold(self, target: Target, hold: int, hold_s: float) -> Hold:
        """Carry out and journal a hold."""
        engine, clock = self._engine, self._engine.clock
        pulse(engine, self.id, "hold_start")
        start = clock.monotonic_s()
        ramp_gwt, ramp_s = self._force_gwt - self._ramp_from[0], round(start - self._ramp_from[1], 6)
        begun = HoldStartEvent(
            self.id.index, hold, target.kind, target.value, round(self._doi_mm, 6), self._force_gwt
        )
        engine.record(begun, self.id)
        readings, times = self._held_readings(target, hold_s)
        lasted_s = clock.monotonic_s() - start
        pulse(engine, self.id, "hold_end")
        mean, sd = statistics.fmean(readings), statistics.pstdev(readings)
        doi = round(self._doi_mm, 6)
        ended = HoldEndEvent(
            index=self.id.index,
            hold=hold,
            x_mm=engine.x_mm,
            doi_mm=doi,
            doi_sd_mm=round(engine.sensing.doi_sd_mm(self._force_gwt), 6),
            force_gwt=mean,
            force_sd_gwt=sd,
            commanded=target.value,
            peak_gwt=self._peak_gwt,
            ramp_gwt=ramp_gwt,
            ramp_s=ramp_s,
            readings=len(readings),
            asked_s=hold_s,
            hold_s=round(lasted_s, 6),
            interval_sd_s=round(statistics.pstdev([b - a for a, b in pairwise([start, *times])]), 6),
        )
        engine.record(ended, self.id)
        self._ramp_from, self._peak_gwt = (self._force_gwt, clock.monotonic_s()), 0.0
        return Hold(target, doi, mean, sd)

    def _held_readings(self, target: Target, hold_s: float) -> tuple[list[float], list[float]]:
        """Return forces and times of the readings of a hold; small moves correct a force that drifts."""
        engine, clock = self._engine, self._engine.clock
        readings, times = list[float](), list[float]()
        follow = target.kind == "force_gwt"
        few = self._averaged(self._tolerance_gwt(target.value if follow else 0.0) / 4)
        recent: deque[float] = deque(maxlen=few)
        start, aim_gwt, short_gwt = clock.monotonic_s(), self._force_gwt, 0.0
        while not readings or clock.monotonic_s() - start < hold_s:
            safe_point(engine)
            step_mm = 0.0
            if follow and len(recent) == few:
                step_mm, aim_gwt = self._back_to(target.value, short_gwt / len(readings), aim_gwt)
            if step_mm:
                self._press_by(step_mm, "hold")
                recent.clear()
                readings.append(self._force_gwt)
            else:
                readings.append(self._read("hold"))
                recent.append(readings[-1])
                self._force_gwt = statistics.fmean(recent)
            times.append(clock.monotonic_s())
            short_gwt += target.value - readings[-1]
        return readings, times

    def _back_to(self, target_gwt: float, short_gwt: float, aim_gwt: float) -> tuple[float, float]:
        """Return the correcting move (mm) and its aim (gwt) once the force or its mean is off by a quarter tolerance.

        The move compensates the deficit of the mean, and aims higher by half of the force lost since the last aim.
        Zero and the old aim if the move is smaller than a step of the stage.
        """
        force, tolerance = self._force_gwt, self._tolerance_gwt(target_gwt)
        goal = target_gwt + _within(short_gwt, tolerance)
        enough = 0.25 * tolerance
        if max(abs(force - target_gwt), abs(short_gwt)) <= enough or abs(force - goal) <= enough:
            return 0.0, aim_gwt
        lost = _within(aim_gwt - force, tolerance)
        aim = min(goal + 0.5 * lost, _HIGHEST_AIM * target_gwt)
        step = RELAXED_TO * self._to_force(aim)
        return (step, aim) if abs(step) >= self._smallest_mm else (0.0, aim_gwt)


def _stays(force_gwt: float) -> TripError:
    return TripError(
        f"the force stays at {force_gwt:.2f} gwt while the stage moves; check for a frozen reading or a stalled "
        "motor",
        "frozen",
    )


def _within(value: float, most: float) -> float:
    return max(min(value, most), -most)
