"""One indentation: approach, touch off, press, hold, lift."""

import statistics

from rig.run.engine import Engine
from rig.run.errors import LimitError
from rig.run.records import Hold, Indentation, Target, Touch
from rig.run.touch import fit_contact

_BACK_OFF_INCREMENTS = 2
_SEARCH_BELOW_APEX_MM = 3.0
_MAX_SEEK_MOVES = 400
_FORCE_TOLERANCE_GWT, _FORCE_TOLERANCE = 0.05, 0.01
_SMALLEST_MOVE_MM = 0.0025
_EXPONENT = 1.5


def indent(
    engine: Engine,
    target: Target,
    *,
    increments: int = 1,
    speed_mm_s: float | None = None,
    hold_s: float = 1.0,
) -> Indentation:
    """Touch off at the present x, press in equal increments with a hold after each, end lifted to clearance.

    Raises LimitError when the target is not reached within the deepest DOI allowed; the indentor is then lifted.
    """
    engine.ready_to_indent()
    engine.safe_point()
    index, start_s = engine.indentations, engine.clock.monotonic_s()
    engine.record(
        "indentation_start",
        {
            "index": index,
            "indentor": engine.indentor,
            "x_mm": engine.x_mm,
            "target": target.kind,
            "value": target.value,
            "increments": increments,
        },
    )
    speed = engine.settings.habits.press_speed_mm_s if speed_mm_s is None else speed_mm_s
    press = _Press(engine, index, speed)
    try:
        press.touch_off()
        holds = tuple(
            press.hold_at(target.part(k, increments), hold=k, hold_s=hold_s) for k in range(1, increments + 1)
        )
    except LimitError:
        engine.retract()
        raise
    engine.retract()
    engine.indentations += 1
    duration = engine.clock.monotonic_s() - start_s
    engine.record("indentation_end", {"index": index, "duration_s": round(duration, 6)})
    return Indentation(index, engine.x_mm, holds)


class _Press:
    """The descent of one indentation."""

    def __init__(self, engine: Engine, index: int, speed_mm_s: float) -> None:
        self._engine, self._index, self._speed = engine, index, speed_mm_s
        self._habits = engine.settings.habits
        self._contact_mm: float | None = None
        self._force_gwt = 0.0

    @property
    def _doi_mm(self) -> float:
        assert self._contact_mm is not None
        return self._contact_mm - self._engine.height_mm

    def touch_off(self) -> None:
        """Find contact coarsely, back off, and find it again in fine increments."""
        habits, engine = self._habits, self._engine
        self._descend(habits.increment_mm, "approach")
        up = engine.height_mm + _BACK_OFF_INCREMENTS * habits.increment_mm
        engine.go_to_height(up, habits.approach_speed_mm_s)
        readings = self._descend(habits.touch_increment_mm, "touch")
        touch = fit_contact(readings, habits.touch_force_gwt)
        self._contact_mm, self._force_gwt = touch.contact_height_mm, readings[-1][1]
        self._record_touch(touch)

    def _descend(self, step_mm: float, phase: str) -> list[tuple[float, float]]:
        """(height, force) readings down to the touch threshold."""
        engine = self._engine
        readings: list[tuple[float, float]] = []
        while True:
            engine.safe_point()
            below = engine.height_mm - step_mm
            if below < -_SEARCH_BELOW_APEX_MM:
                raise LimitError(
                    f"no contact down to {_SEARCH_BELOW_APEX_MM:g} mm below the pad's nominal apex at "
                    f"x = {engine.x_mm:g} mm; is the finger in place and frame.apex_z_mm right?"
                )
            engine.go_to_height(below, self._habits.approach_speed_mm_s)
            force = engine.read_force_gwt(self._index, phase)
            readings.append((engine.height_mm, force))
            if force >= self._habits.touch_force_gwt:
                return readings

    def _record_touch(self, touch: Touch) -> None:
        data = {
            "index": self._index,
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
        while doi_mm - self._doi_mm > 0.5 * _SMALLEST_MOVE_MM:
            self._press_by(doi_mm - self._doi_mm)

    def _seek_force(self, target_gwt: float) -> None:
        """Steps along F ∝ d^1.5 through the present reading, until within half the tolerance."""
        tolerance = max(_FORCE_TOLERANCE_GWT, _FORCE_TOLERANCE * target_gwt)
        for _ in range(_MAX_SEEK_MOVES):
            if abs(self._force_gwt - target_gwt) <= 0.5 * tolerance:
                return
            force = max(self._force_gwt, 0.5 * self._habits.touch_force_gwt)
            depth = max(self._doi_mm, _SMALLEST_MOVE_MM)
            step = depth * ((target_gwt / force) ** (1 / _EXPONENT) - 1)
            if abs(step) < _SMALLEST_MOVE_MM:
                step = _SMALLEST_MOVE_MM if step > 0 else -_SMALLEST_MOVE_MM
            self._press_by(step)
        raise LimitError(f"force {target_gwt:g} gwt not settled within {_MAX_SEEK_MOVES} moves")

    def _press_by(self, step_mm: float) -> None:
        """One safe move in contact: at most an increment, and not past the soft trip at the present stiffness."""
        engine = self._engine
        engine.safe_point()
        stiffness = _EXPONENT * max(self._force_gwt, 1e-3) / max(self._doi_mm, _SMALLEST_MOVE_MM)
        room = max((engine.soft_trip_gwt - self._force_gwt) / stiffness, _SMALLEST_MOVE_MM)
        step = min(step_mm, self._habits.increment_mm, room)
        deepest = engine.settings.limits.max_doi_mm
        if self._doi_mm + step > deepest + 1e-9:
            raise LimitError(
                f"DOI {self._doi_mm + step:.3f} mm at x = {engine.x_mm:g} mm would pass "
                f"limits.max_doi_mm = {deepest:g}"
            )
        engine.go_to_height(engine.height_mm - step, self._speed)
        self._force_gwt = engine.read_force_gwt(self._index, "press", self._contact_mm)

    def _hold(self, target: Target, hold: int, hold_s: float) -> Hold:
        engine, clock = self._engine, self._engine.clock
        about = {"index": self._index, "hold": hold}
        doi = round(self._doi_mm, 6)
        engine.record(
            "hold_start",
            {
                **about,
                "target": target.kind,
                "commanded": target.value,
                "doi_mm": doi,
                "force_gwt": self._force_gwt,
            },
        )
        start = clock.monotonic_s()
        readings: list[float] = []
        while not readings or clock.monotonic_s() - start < hold_s:
            readings.append(engine.read_force_gwt(self._index, "hold", self._contact_mm))
        mean, sd = statistics.fmean(readings), statistics.pstdev(readings)
        data = {
            **about,
            "x_mm": engine.x_mm,
            "doi_mm": doi,
            "force_gwt": round(mean, 6),
            "force_sd_gwt": round(sd, 6),
            "readings": len(readings),
            "hold_s": round(clock.monotonic_s() - start, 6),
        }
        true = engine.operator.true_pose()
        if true is not None:
            data |= {"true_x_mm": round(true[0], 9), "true_doi_mm": round(true[1], 9)}
        engine.record("hold_end", data)
        return Hold(target, doi, mean, sd)
