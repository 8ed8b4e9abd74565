"""The descent of one indentation: touch off, press to a depth or a force, hold it there."""

import math
import statistics
from collections import deque
from itertools import pairwise

from rig.run.engine import Engine
from rig.run.errors import LimitError
from rig.run.records import Hold, Target, Touch
from rig.run.touch import CONTACT_EXPONENT, fit_contact

_MAX_SEEK_MOVES = 400
_FORCE_TOLERANCE_GWT, _FORCE_TOLERANCE = 0.05, 0.01
_TRIP_MARGIN = 0.9
_FROZEN_MOVES, _FROZEN_STEPS, _FROZEN_SHARE = 3, 5, 0.1
# Of a gap in force wider than this share of the target, a step closes only so much: no step lands beyond it.
_WIDE_GAP, _CLOSED_AT_ONCE = 0.05, 0.75
_MOST_AVERAGED = 25
# What has relaxed under a held force answers a move more stiffly than the force it has left says: by 1 / 0.6, say.
_FOLLOWED = 0.6


class Press:
    """The descent of one indentation."""

    def __init__(self, engine: Engine, index: int, speed_mm_s: float, lowest_mm: float, highest_mm: float) -> None:
        self._engine, self.index, self._speed = engine, index, speed_mm_s
        self._lowest_mm, self._highest_mm = lowest_mm, highest_mm
        self._ramp_from = (0.0, engine.clock.monotonic_s())  # force in gwt and time of contact or of the last hold
        self._peak_gwt = 0.0  # highest reading since then
        self._unanswered = 0  # moves since the reading last changed
        self._unanswered_gwt = 0.0  # change of force that was expected since the reading last changed
        self._habits = engine.settings.habits
        self._smallest_mm = engine.settings.stage.resolution_mm
        self._contact_mm: float | None = None
        self._force_gwt = 0.0

    @property
    def _doi_mm(self) -> float:
        assert self._contact_mm is not None
        return self._engine.doi_mm(self._contact_mm, self._force_gwt)

    def touch_off(self) -> None:
        """Find contact coarsely, back off, and find it again in fine increments."""
        habits = self._habits
        self._descend(habits.increment_mm, "approach")
        self._back_off()
        readings = self._descend(habits.touch_increment_mm, "touch")
        touch = fit_contact(readings, self._engine.touch_gwt, self._engine.least_gwt)
        self._contact_mm, self._force_gwt = touch.contact_height_mm, readings[-1][1]
        self._ramp_from = (self._force_gwt, self._engine.clock.monotonic_s())
        self._engine.pulse(self.index, "touch")
        self._record_touch(touch)

    def _back_off(self) -> None:
        """Up by whole increments until no force shows or clearance is reached, and one more."""
        engine, habits = self._engine, self._habits
        force = math.inf
        while force > 0.5 * engine.least_gwt and engine.height_mm < habits.clearance_mm:
            engine.go_to_height(engine.height_mm + habits.increment_mm, habits.approach_speed_mm_s)
            force = engine.read_force_gwt(self.index, "back off")
        engine.go_to_height(engine.height_mm + habits.increment_mm, habits.approach_speed_mm_s)

    def _descend(self, step_mm: float, phase: str) -> list[tuple[float, float]]:
        """(height, force) readings down to the touch threshold."""
        engine = self._engine
        readings: list[tuple[float, float]] = []
        while True:
            engine.safe_point()
            below = engine.height_mm - step_mm
            if below < self._lowest_mm - 1e-9:
                engine.trip(
                    f"no contact at x = {engine.x_mm:g} mm down to {self._lowest_mm:.3f} mm from the nominal apex: "
                    "is the sensor alive, the finger in place, frame.apex_z_mm right?"
                )
            engine.go_to_height(below, self._habits.approach_speed_mm_s)
            force = engine.read_force_gwt(self.index, phase)
            readings.append((engine.height_mm, force))
            if force <= -engine.touch_gwt:
                engine.trip(f"{force:.2f} gwt while descending: does the sensor read backwards?", force)
            if force >= engine.touch_gwt:
                self._refuse_contact_too_high()
                return readings

    def _refuse_contact_too_high(self) -> None:
        engine = self._engine
        if engine.height_mm > self._highest_mm:
            engine.trip(
                f"contact at x = {engine.x_mm:g} mm already {engine.height_mm:.3f} mm above the nominal apex: "
                f"expected below {self._highest_mm:.3f} mm"
            )

    def _record_touch(self, touch: Touch) -> None:
        data = {
            "index": self.index,
            "threshold_gwt": touch.threshold_gwt,
            "height_at_threshold_mm": round(touch.height_at_threshold_mm, 6),
            "contact_height_mm": round(touch.contact_height_mm, 6),
            "fit_points": touch.fit_points,
            "doi_bias_mm": round(touch.doi_bias_mm, 6),
        }
        true = self._engine.operator.true_pose()
        if true is not None:
            data["true_doi_bias_mm"] = round(true[1] - self._doi_mm, 6)
        self._engine.record("touch", data)

    def hold_at(self, target: Target, *, hold: int, hold_s: float) -> Hold:
        """Press to the target, hold, and journal the hold as delivered."""
        if target.kind == "doi_mm":
            self._press_to_doi(target.value)
        else:
            self._seek_force(target.value)
        return self._hold(target, hold, hold_s)

    def _press_to_doi(self, doi_mm: float) -> None:
        while abs(doi_mm - self._doi_mm) > 0.5 * self._smallest_mm:
            self._press_by(doi_mm - self._doi_mm)

    def _seek_force(self, target_gwt: float) -> None:
        """Steps along F ∝ d^1.5 through the present force, until within half the tolerance.

        Where one step of the stage is more than that, the full tolerance will do; LimitError if it cannot be met.
        """
        tolerance = self._tolerance_gwt(target_gwt)
        smallest_before = 0.0
        for _ in range(_MAX_SEEK_MOVES):
            self._look_closer(target_gwt, tolerance)
            error = abs(self._force_gwt - target_gwt)
            if error <= 0.5 * tolerance:
                return
            step = self._step_towards(target_gwt)
            if abs(step) < self._smallest_mm:
                if error <= tolerance:
                    return
                step = math.copysign(self._smallest_mm, step)
                if step * smallest_before < 0:
                    raise LimitError(
                        f"force {target_gwt:g} gwt: one step of the stage, {self._smallest_mm:g} mm, "
                        f"passes over the tolerance of ± {tolerance:.3g} gwt"
                    )
                smallest_before = step
            self._press_by(step)
        raise LimitError(f"force {target_gwt:g} gwt not settled within {_MAX_SEEK_MOVES} moves")

    def _tolerance_gwt(self, target_gwt: float) -> float:
        return max(_FORCE_TOLERANCE_GWT, _FORCE_TOLERANCE * target_gwt, self._engine.resolution_gwt)

    def _averaged(self, to_gwt: float) -> int:
        """How many readings it takes to know a force to so much."""
        return min(max(math.ceil((self._engine.noise_gwt / to_gwt) ** 2), 1), _MOST_AVERAGED)

    def _look_closer(self, target_gwt: float, tolerance_gwt: float) -> None:
        """Near the target a noisy reading is not enough: the mean of as many as it takes."""
        more = self._averaged(tolerance_gwt / 4) - 1
        if more and abs(self._force_gwt - target_gwt) < 2 * tolerance_gwt:
            readings = [self._read("press") for _ in range(more)]
            self._force_gwt = statistics.fmean([self._force_gwt, *readings])

    def _step_towards(self, target_gwt: float) -> float:
        gap_gwt = target_gwt - self._force_gwt
        if gap_gwt > _WIDE_GAP * target_gwt:
            return self._to_force(self._force_gwt + _CLOSED_AT_ONCE * gap_gwt)
        return self._to_force(target_gwt)

    def _read(self, phase: str) -> float:
        force = self._engine.read_force_gwt(self.index, phase, self._contact_mm)
        self._peak_gwt = max(self._peak_gwt, force)
        return force

    def _to_force(self, force_gwt: float) -> float:
        """Move in mm that would reach a force on F ∝ d^1.5 through the present reading."""
        present = max(self._force_gwt, 0.5 * self._habits.touch_force_gwt)
        return max(self._doi_mm, self._smallest_mm) * ((force_gwt / present) ** (1 / CONTACT_EXPONENT) - 1)

    def _press_by(self, step_mm: float, phase: str = "press") -> None:
        """One safe move in contact: at most an increment, and not past the soft trip at the present stiffness."""
        engine = self._engine
        engine.safe_point()
        room = _TRIP_MARGIN * self._to_force(engine.trip_gwt)
        if room < min(step_mm, self._smallest_mm):
            raise LimitError(
                f"the next move at x = {engine.x_mm:g} mm would pass the {engine.which_trip}, "
                f"{engine.trip_gwt:.2f} gwt"
            )
        step = max(min(step_mm, self._habits.increment_mm, room), -self._habits.increment_mm)
        deepest = engine.settings.limits.max_doi_mm
        if self._doi_mm + step > deepest + 1e-9:
            raise LimitError(
                f"DOI {self._doi_mm + step:.3f} mm at x = {engine.x_mm:g} mm would pass "
                f"limits.max_doi_mm = {deepest:g}"
            )
        expected, before = abs(self._force_after(step) - self._force_gwt), self._force_gwt
        engine.go_to_height(engine.height_mm - step, self._speed)
        self._force_gwt = self._read(phase)
        self._notice_a_frozen_reading(before, expected)

    def _force_after(self, step_mm: float) -> float:
        """The force that F ∝ d^1.5 through the present reading expects after a step."""
        doi = max(self._doi_mm, self._smallest_mm)
        return self._force_gwt * (max(doi + step_mm, 0.0) / doi) ** CONTACT_EXPONENT

    def _notice_a_frozen_reading(self, before_gwt: float, expected_gwt: float) -> None:
        """Trip where the force has not answered the stage by any step of the sensor for far too long."""
        resolution = self._engine.resolution_gwt
        if abs(self._force_gwt - before_gwt) > 0.5 * resolution:
            self._unanswered_gwt, self._unanswered = 0.0, 0
            return
        self._unanswered_gwt += expected_gwt
        self._unanswered += 1
        if self._unanswered >= _FROZEN_MOVES and self._unanswered_gwt > max(
            _FROZEN_STEPS * resolution, _FROZEN_SHARE * self._force_gwt
        ):
            self._engine.trip(
                f"the force stays at {self._force_gwt:.2f} gwt while the stage moves: "
                "a frozen reading, or a motor that does not turn",
                self._force_gwt,
            )

    def _hold(self, target: Target, hold: int, hold_s: float) -> Hold:
        engine, clock = self._engine, self._engine.clock
        about = {"index": self.index, "hold": hold}
        engine.pulse(self.index, "hold_start")
        start = clock.monotonic_s()
        ramp = {
            "ramp_gwt": round(self._force_gwt - self._ramp_from[0], 6),
            "ramp_s": round(start - self._ramp_from[1], 6),
        }
        begin = {"doi_mm": round(self._doi_mm, 6), "force_gwt": self._force_gwt}
        engine.record("hold_start", {**about, "target": target.kind, "commanded": target.value, **begin})
        readings, times = self._held_readings(target, hold_s)
        lasted_s = clock.monotonic_s() - start
        engine.pulse(self.index, "hold_end")
        mean, sd, doi = statistics.fmean(readings), statistics.pstdev(readings), round(self._doi_mm, 6)
        data = {
            **about,
            **ramp,
            "x_mm": engine.x_mm,
            "doi_mm": doi,
            "commanded": target.value,
            "force_gwt": round(mean, 6),
            "force_sd_gwt": round(sd, 6),
            "peak_gwt": round(self._peak_gwt, 6),
            "readings": len(readings),
            "asked_s": hold_s,
            "hold_s": round(lasted_s, 6),
            "interval_sd_s": round(statistics.pstdev([b - a for a, b in pairwise([start, *times])]), 6),
        }
        true = engine.operator.true_pose()
        if true is not None:
            data |= {"true_x_mm": round(true[0], 9), "true_doi_mm": round(true[1], 9)}
        engine.record("hold_end", data)
        self._ramp_from, self._peak_gwt = (self._force_gwt, clock.monotonic_s()), 0.0
        return Hold(target, doi, mean, sd)

    def _held_readings(self, target: Target, hold_s: float) -> tuple[list[float], list[float]]:
        """Forces and times of the readings of a hold; a force that drifts is followed by small moves."""
        engine, clock = self._engine, self._engine.clock
        start = clock.monotonic_s()
        readings: list[float] = []
        times: list[float] = []
        recent: deque[float] = deque(maxlen=self._averaged(self._tolerance_gwt(target.value) / 4))
        aim_gwt = self._force_gwt
        while not readings or clock.monotonic_s() - start < hold_s:
            engine.safe_point()
            readings.append(self._read("hold"))
            times.append(clock.monotonic_s())
            recent.append(readings[-1])
            if target.kind == "force_gwt" and len(recent) == recent.maxlen:
                aim_gwt = self._follow(target.value, aim_gwt, recent)
        return readings, times

    def _follow(self, target_gwt: float, aim_gwt: float, recent: deque[float]) -> float:
        """Where the force has left a quarter of its tolerance: one move back, if the stage can make one so small.

        It aims beyond the target by half of what the force has lost since the last aim, so that the mean is the
        target. Returns what is aimed at now.
        """
        force, tolerance = statistics.fmean(recent), self._tolerance_gwt(target_gwt)
        if abs(force - target_gwt) <= 0.25 * tolerance:
            return aim_gwt
        self._force_gwt = force
        lost = max(min(aim_gwt - force, tolerance), -tolerance)
        step = _FOLLOWED * self._to_force(target_gwt + 0.5 * lost)
        if abs(step) < self._smallest_mm:
            return aim_gwt
        self._press_by(step, "hold")
        recent.clear()
        return target_gwt + 0.5 * lost
