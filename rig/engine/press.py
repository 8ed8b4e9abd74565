"""Reach a depth or a force past the skin and hold it, by moves in contact."""

import math
import statistics
from collections import deque
from itertools import pairwise

from rig.data.events import HoldEndEvent, HoldStartEvent
from rig.engine.contact_moves import ContactMoves
from rig.engine.engine import Engine
from rig.engine.limits import RampBound
from rig.engine.sync_pulse import pulse
from rig.engine.verbs import safe_point
from rig.errors import LimitError
from rig.records import ContactFit, Hold, PressId, Target, force_tolerance_gwt

_MAX_SEEK_MOVES = 400
# A step across a gap wider than this share of the target closes only part of it, so that no step overshoots.
_WIDE_GAP, _CLOSED_AT_ONCE = 0.05, 0.75
_MOST_AVERAGED = 25
_HIGHEST_AIM = 1.02  # Share of the target in a hold; with noise the force must stay below 1.05.
# Share of its force that tissue keeps in a hold; it responds to a fast move as if it still had all of it.
_RELAXED_TO = 0.6


class Press(ContactMoves):
    """Press of one indentation, from its touch-off on."""

    def __init__(self, engine: Engine, press: PressId, touch: ContactFit, speed_mm_s: float) -> None:
        super().__init__(engine, press, touch, speed_mm_s)
        self.reached: tuple[float, float] | None = None  # depth (mm) and force (gwt) by increments, before the hold

    def hold_at(self, target: Target, *, hold: int, hold_s: float) -> Hold:
        """Press to the target by increments, hold, and journal the hold as delivered."""
        if target.kind == "doi_mm":
            self.reach_doi(target.value)
        else:
            self._seek_force(target.value)
            self.reached = self.doi_mm, self.force_gwt
        return self._hold(target, hold, hold_s)

    def ramp_and_hold(self, doi_mm: float, bound: RampBound, hold_s: float) -> Hold:
        """Move to a depth at constant speed from above the skin, hold, and journal the hold as delivered."""
        self.ramp_to(doi_mm, bound)
        return self._hold(Target("doi_mm", doi_mm), 1, hold_s)

    def reach_doi(self, doi_mm: float) -> tuple[float, float]:
        """Press to within half a step of the stage; return depth (mm) and force (gwt) as reached.

        Raises LimitError if a compliant rig never gets there.
        """
        for _ in range(_MAX_SEEK_MOVES):
            if abs(doi_mm - self.doi_mm) <= 0.5 * self.smallest_mm:
                self.reached = self.doi_mm, self.force_gwt
                return self.reached
            self.press_by(doi_mm - self.doi_mm)
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
            error = abs(self.force_gwt - target_gwt)
            if error <= 0.5 * tolerance:
                return
            step = self._step_towards(target_gwt)
            if abs(step) >= self.smallest_mm:
                smallest_before = 0.0
            elif error <= tolerance:
                return
            else:
                step = math.copysign(self.smallest_mm, step)
                if step * smallest_before < 0:
                    raise LimitError(
                        f"force {target_gwt:g} gwt cannot be held within ± {tolerance:.3g} gwt: one step of the "
                        f"stage ({self.smallest_mm:g} mm) changes it by more",
                        "step_too_coarse",
                    )
                smallest_before = step
            self.press_by(step)
        raise LimitError(
            f"force {target_gwt:g} gwt did not settle within {_MAX_SEEK_MOVES} moves; check the force sensor for "
            "noise and drift",
            "force_not_settled",
        )

    def _tolerance_gwt(self, target_gwt: float) -> float:
        return force_tolerance_gwt(target_gwt, self.engine.sensing.resolution_gwt)

    def _averaged(self, to_gwt: float) -> int:
        """Return the number of readings that determine a force to this accuracy (gwt)."""
        return min(max(math.ceil((self.engine.sensing.noise_gwt / to_gwt) ** 2), 1), _MOST_AVERAGED)

    def _average_near(self, target_gwt: float, tolerance_gwt: float) -> None:
        """Average more readings near the target if a single one is too noisy."""
        more = self._averaged(tolerance_gwt / 4) - 1
        if more and abs(self.force_gwt - target_gwt) < 2 * tolerance_gwt:
            readings = [self.read("press") for _ in range(more)]
            self.force_gwt = statistics.fmean([self.force_gwt, *readings])

    def _step_towards(self, target_gwt: float) -> float:
        """Return the step (mm) by the force law, or by the stiffness of the last move if that is higher."""
        gap_gwt = target_gwt - self.force_gwt
        if gap_gwt > _WIDE_GAP * target_gwt:
            gap_gwt *= _CLOSED_AT_ONCE
        step = self.to_force(self.force_gwt + gap_gwt)
        return min(step, gap_gwt / self.stiffness_gwt_mm) if min(gap_gwt, self.stiffness_gwt_mm) > 0 else step

    def _hold(self, target: Target, hold: int, hold_s: float) -> Hold:
        """Carry out and journal a hold."""
        engine, clock = self.engine, self.engine.clock
        pulse(engine, self.id, "hold_start")
        start = clock.monotonic_s()
        ramp_gwt, ramp_s = self.force_gwt - self.ramp_from[0], round(start - self.ramp_from[1], 6)
        begun = HoldStartEvent(self.id.index, hold, target.kind, target.value, round(self.doi_mm, 6), self.force_gwt)
        engine.record(begun, self.id)
        readings, times = self._held_readings(target, hold_s)
        lasted_s = clock.monotonic_s() - start
        pulse(engine, self.id, "hold_end")
        mean, sd = statistics.fmean(readings), statistics.pstdev(readings)
        doi = round(self.doi_mm, 6)
        ended = HoldEndEvent(
            index=self.id.index,
            hold=hold,
            x_mm=engine.x_mm,
            doi_mm=doi,
            doi_sd_mm=round(engine.sensing.doi_sd_mm(self.force_gwt), 6),
            force_gwt=mean,
            force_sd_gwt=sd,
            commanded=target.value,
            peak_gwt=self.peak_gwt,
            ramp_gwt=ramp_gwt,
            ramp_s=ramp_s,
            readings=len(readings),
            asked_s=hold_s,
            hold_s=round(lasted_s, 6),
            interval_sd_s=round(statistics.pstdev([b - a for a, b in pairwise([start, *times])]), 6),
        )
        engine.record(ended, self.id)
        self.ramp_from, self.peak_gwt = (self.force_gwt, clock.monotonic_s()), 0.0
        return Hold(target, doi, mean, sd)

    def _held_readings(self, target: Target, hold_s: float) -> tuple[list[float], list[float]]:
        """Return forces and times of the readings of a hold; small moves correct a force that drifts."""
        engine, clock = self.engine, self.engine.clock
        readings, times = list[float](), list[float]()
        follow = target.kind == "force_gwt"
        few = self._averaged(self._tolerance_gwt(target.value if follow else 0.0) / 4)
        recent: deque[float] = deque(maxlen=few)
        start, aim_gwt, short_gwt = clock.monotonic_s(), self.force_gwt, 0.0
        while not readings or clock.monotonic_s() - start < hold_s:
            safe_point(engine)
            step_mm = 0.0
            if follow and len(recent) == few:
                step_mm, aim_gwt = self._back_to(target.value, short_gwt / len(readings), aim_gwt)
            if step_mm:
                self.press_by(step_mm, "hold")
                recent.clear()
                readings.append(self.force_gwt)
            else:
                readings.append(self.read("hold"))
                recent.append(readings[-1])
                self.force_gwt = statistics.fmean(recent)
            times.append(clock.monotonic_s())
            short_gwt += target.value - readings[-1]
        return readings, times

    def _back_to(self, target_gwt: float, short_gwt: float, aim_gwt: float) -> tuple[float, float]:
        """Return the correcting move (mm) and its aim (gwt) once the force or its mean is off by a quarter tolerance.

        The move compensates the deficit of the mean, and aims higher by half of the force lost since the last aim.
        Zero and the old aim if the move is smaller than a step of the stage.
        """
        force, tolerance = self.force_gwt, self._tolerance_gwt(target_gwt)
        goal = target_gwt + _within(short_gwt, tolerance)
        enough = 0.25 * tolerance
        if max(abs(force - target_gwt), abs(short_gwt)) <= enough or abs(force - goal) <= enough:
            return 0.0, aim_gwt
        lost = _within(aim_gwt - force, tolerance)
        aim = min(goal + 0.5 * lost, _HIGHEST_AIM * target_gwt)
        step = _RELAXED_TO * self.to_force(aim)
        return (step, aim) if abs(step) >= self.smallest_mm else (0.0, aim_gwt)


def _within(value: float, most: float) -> float:
    return max(min(value, most), -most)
