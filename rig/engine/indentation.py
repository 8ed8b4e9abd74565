"""One indentation: approach, touch off, press, hold, lift."""

import math
import statistics
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeGuard

from rig.data.events import AlarmEvent, FindEvent, IndentationEndEvent, IndentationStartEvent, TouchEvent
from rig.engine.contact_fit import fit_contact
from rig.engine.contact_moves import pull_in_descent
from rig.engine.engine import Engine
from rig.engine.limits import AT_MM, CONTACT_EXPONENT, RampBound, TouchedPlace, refuse_no_ramps
from rig.engine.press import Press
from rig.engine.sync_pulse import pulse
from rig.engine.verbs import retract, safe_point, unpaused, wait_at_clearance
from rig.errors import LateReading, LimitError, NotReadyError, TripError
from rig.records import ContactFit, Hold, Indentation, Phase, PressId, Target
from rig.settings import RigSettings

_SHOWN_BY = 4  # readings
_SLOPE = 0.1
"""How much the skin may rise beside a contact, over the finger model (mm per mm)."""
_LATE_RAMPS = 3  # attempts at a ramp
_ABOVE_STEPS = 3
"""Height above a known contact where the fine descent begins, in touch increments."""


@dataclass(frozen=True)
class Approach:
    """Approach from clearance to first touch, expected between two heights above the nominal apex (mm)."""

    engine: Engine
    press: PressId
    lowest_mm: float
    highest_mm: float

    def touch_off(self, lifted_off_s: float | None) -> ContactFit:
        """Find contact, fit its height, and journal it with the rest since the last lift-off; end in contact.

        Where contact is known, the first touch is that of the press. Elsewhere the finger is touched twice. Trips if
        contact is missing or too high, or if the sensor reads a pull.
        """
        engine = self.engine
        engine.limit_depth(self.lowest_mm - engine.settings.limits.max_doi_mm)
        place = self.place
        above, met = self._go_near(place)
        readings = [] if place is None or met else self._touch_again(place, above)
        if not (met or readings):
            self._descend(engine.settings.habits.increment_mm, "approach", self.lowest_mm)
        touched_s = engine.clock.monotonic_s()
        readings = readings or self._touch_finely()
        touch = fit_contact(readings, engine.sensing.touch_gwt, engine.sensing.least_gwt)
        pulse(engine, self.press, "touch")
        self._found(touch, touch.force_gwt, _rested_s(touched_s, lifted_off_s))
        return touch

    def go_above(self, place: TouchedPlace, ramp_mm_s: float, lifted_off_s: float | None) -> ContactFit | None:
        """Go down to where a ramp to a certain contact begins, and journal the contact; None if it is met before."""
        engine, settings = self.engine, self.engine.settings
        engine.limit_depth(self.lowest_mm - settings.limits.max_doi_mm)
        contact_mm = place.contact.contact_height_mm
        way_mm = ramp_mm_s**2 / (2 * settings.stage.acceleration_mm_s2) + settings.habits.increment_mm
        down_mm, readings, met = self._go_down_freely(contact_mm + way_mm)
        if met or engine.height_mm > down_mm + AT_MM or any(self._shows(force_gwt) for _, force_gwt in readings):
            return None
        engine.touched.forget_at(engine.x_mm, engine.along_mm)
        touches_s = engine.clock.monotonic_s() + (engine.height_mm - contact_mm) / ramp_mm_s
        self._found(replace(place.contact, fit_points=0), 0.0, _rested_s(touches_s, lifted_off_s))
        return place.contact

    def _found(self, touch: ContactFit, force_gwt: float, rested_s: float) -> None:
        """Journal contact at the present height and force, and limit the depth of the press to come."""
        engine, settings = self.engine, self.engine.settings
        event = TouchEvent(
            index=self.press.index,
            threshold_gwt=touch.threshold_gwt,
            height_at_threshold_mm=round(touch.height_at_threshold_mm, 6),
            contact_height_mm=round(touch.contact_height_mm, 6),
            fit_points=touch.fit_points,
            doi_bias_mm=round(touch.doi_bias_mm, 6),
            doi_mm=round(engine.doi_mm(touch.contact_height_mm, force_gwt), 6),
            rested_s=round(rested_s, 6) if math.isfinite(rested_s) else None,
        )
        engine.record(event, self.press)
        deepest_mm = settings.limits.max_doi_mm
        at_most_mm = touch.contact_height_mm - deepest_mm - settings.habits.increment_mm
        engine.limit_depth(max(at_most_mm, self.lowest_mm - deepest_mm))

    @property
    def place(self) -> TouchedPlace | None:
        """What is known of contact at the present position."""
        return self.engine.touched.place_at(self.engine.x_mm, self.engine.along_mm)

    def found(self, contact: ContactFit, found_s: float, before: TouchedPlace | None) -> TouchedPlace:
        """Return the contact that was found now, where another one may have been found before."""
        height_mm = contact.contact_height_mm
        drift_mm = None if before is None else height_mm - before.contact.contact_height_mm
        return TouchedPlace(contact, found_s, height_mm - self._predicted_mm, drift_mm)

    @property
    def _predicted_mm(self) -> float:
        return 0.5 * (self.lowest_mm + self.highest_mm)

    @property
    def _expected_below_mm(self) -> float:
        """Highest height of contact: beside a contact of this run less than its limit (mm above the apex)."""
        nearest = self.engine.touched.nearest(self.engine.x_mm, self.engine.along_mm)
        if nearest is None:
            return self.highest_mm
        away_mm, place = nearest
        margin_mm = self.engine.settings.habits.retouch_margin_mm + _SLOPE * away_mm
        return min(self._predicted_mm + place.above_expected_mm + margin_mm, self.highest_mm)

    def rest(self, rest_s: float, *, ramps: bool) -> None:
        """Wait at clearance until the approach touches no earlier than this time after the last lift-off.

        A contact that has come nearer is touched earlier by as much as the way to it is shorter. A ramp may touch
        without the increments of an approach.
        """
        engine, way_s = self.engine, self._shortest_way_s(ramps=ramps)
        while True:
            now_s, lifted_off_s = engine.clock.monotonic_s(), engine.contact.lifted_off_s
            until_s = (now_s if lifted_off_s is None else lifted_off_s) + rest_s - way_s
            if until_s <= now_s:
                return
            wait_at_clearance(engine, until_s)

    def _shortest_way_s(self, *, ramps: bool) -> float:
        """Return the shortest time to the touch: to a known contact, or to the highest expected one (s)."""
        engine, habits, place = self.engine, self.engine.settings.habits, self.place
        speed_mm_s, down_mm = self._free_move()
        if place is None:
            down_mm = max(down_mm, self._expected_below_mm)
        way_s = max(engine.height_mm - down_mm, 0.0) / speed_mm_s
        if place is None or ramps:
            return way_s
        steps = math.ceil((down_mm - self._near_mm(place)) / habits.increment_mm) + _ABOVE_STEPS
        moves_s = (down_mm - place.contact.contact_height_mm) / habits.approach_speed_mm_s
        return way_s + moves_s + steps * engine.sensing.settle_s

    def _near_mm(self, place: TouchedPlace) -> float:
        """Return the height above a known contact where the fine descent begins (mm)."""
        fine_mm = _ABOVE_STEPS * self.engine.settings.habits.touch_increment_mm
        return max(place.contact.contact_height_mm + fine_mm, self.lowest_mm)

    def _free_move(self) -> tuple[float, float]:
        """Return the speed (mm/s) and the end (mm) of the one move down to where contact may be."""
        engine, settings = self.engine, self.engine.settings
        fastest_mm_s = min(engine.touch_limit.speed_mm_s, settings.limits.max_press_speed_mm_s)
        speed_mm_s = max(fastest_mm_s, settings.habits.approach_speed_mm_s)
        return speed_mm_s, max(engine.free_mm(speed_mm_s, self._expected_below_mm), self.lowest_mm)

    def _go_down_freely(self, lowest_mm: float) -> tuple[float, list[tuple[float, float]], bool]:
        """Make the one move, no lower than a height; return its end, its reading, and whether it touched.

        There is no reading where the indentor is that low already.
        """
        engine, readings = self.engine, list[tuple[float, float]]()
        speed_mm_s, down_mm = self._free_move()
        down_mm = max(down_mm, lowest_mm)
        safe_point(engine)
        touched = down_mm < engine.height_mm - AT_MM and self._touches(down_mm, "approach", readings, speed_mm_s)
        return down_mm, readings, touched

    def _go_near(self, place: TouchedPlace | None) -> tuple[list[tuple[float, float]], bool]:
        """Move down in one go to where contact may be, and on to just above a known one.

        Return the last (height, force) reading, and whether the finger is met.

        A known contact counts again when the press has ended normally. The increments go on from where a touch that
        vanishes at rest or a late reading ended the one move. A force below a touch is enough to meet a known contact
        too early: its fit needs readings above it.
        """
        engine, habits = self.engine, self.engine.settings.habits
        _, readings, touched = self._go_down_freely(-math.inf)
        if place is None:
            return readings, touched
        engine.touched.forget_at(engine.x_mm, engine.along_mm)
        near_mm = self._near_mm(place)
        while not touched and engine.height_mm > near_mm + 1e-9:
            safe_point(engine)
            touched = self._touches(max(engine.height_mm - habits.increment_mm, near_mm), "approach", readings)
        last = readings[-1:]
        return last, touched or any(self._shows(force_gwt) for _, force_gwt in last)

    def _touch_again(self, place: TouchedPlace, above: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        """Descend finely to the touch, and return the (height, force) readings; empty if contact is not there."""
        engine, habits, readings = self.engine, self.engine.settings.habits, list(above)
        lowest_mm = max(place.contact.height_at_threshold_mm - habits.increment_mm, self.lowest_mm)
        while engine.height_mm - habits.touch_increment_mm >= lowest_mm - 1e-9:
            safe_point(engine)
            if self._touches(engine.height_mm - habits.touch_increment_mm, "touch", readings):
                return readings
        return []

    def _touch_finely(self) -> list[tuple[float, float]]:
        """Back off from a touch by increments, touch finely, and return the (height, force) readings."""
        engine, habits = self.engine, self.engine.settings.habits
        touch_mm = engine.height_mm
        self.back_off()
        return self._descend(habits.touch_increment_mm, "touch", max(touch_mm - habits.increment_mm, self.lowest_mm))

    def _shows(self, force_gwt: float) -> bool:
        """Return whether a reading exceeds half of the smallest significant force."""
        return force_gwt > 0.5 * self.engine.sensing.least_gwt

    def back_off(self) -> None:
        """Move up by increments until the force vanishes or clearance is reached, then by one more."""
        engine, habits = self.engine, self.engine.settings.habits
        force = math.inf
        while self._shows(force) and engine.height_mm < habits.clearance_mm:
            engine.go_to_height(engine.height_mm + habits.increment_mm, habits.approach_speed_mm_s)
            force = engine.read_force_gwt(self.press, "back off")
        engine.go_to_height(engine.height_mm + habits.increment_mm, habits.approach_speed_mm_s)

    def _descend(self, step_mm: float, phase: Phase, lowest_mm: float) -> list[tuple[float, float]]:
        """Descend to the touch threshold and return the (height, force) readings; trip if there is no touch.

        One increment more is allowed above the lowest height of all if the mean of the last readings exceeds their
        noise: noise may have triggered the first touch too early. The coarse touch must reappear within one coarse
        increment, or the sensor is dead.
        """
        engine, readings = self.engine, list[tuple[float, float]]()
        farther_mm = engine.settings.habits.increment_mm
        shown_gwt = 0.5 * engine.sensing.least_gwt / math.sqrt(_SHOWN_BY)
        while True:
            safe_point(engine)
            below = engine.height_mm - step_mm
            if below < lowest_mm - 1e-9 and farther_mm:
                last = [force for _, force in readings[-_SHOWN_BY:]]
                if last and statistics.fmean(last) > shown_gwt:
                    lowest_mm, farther_mm = max(lowest_mm - farther_mm, self.lowest_mm), 0.0
            if below < lowest_mm - 1e-9:
                touched_before = lowest_mm > self.lowest_mm
                again = ", although the force showed a touch there just before" if touched_before else ""
                missed = TripError(
                    f"no contact at x = {engine.x_mm:g} mm down to {lowest_mm:.3f} mm from the nominal apex{again}; "
                    "check the force sensor, the position of the finger and frame.apex_z_mm",
                    "no_contact",
                )
                engine.trip(missed)
            if self._touches(below, phase, readings):
                return readings

    def _touches(
        self,
        height_mm: float,
        phase: Phase,
        readings: list[tuple[float, float]],
        speed_mm_s: float | None = None,
    ) -> bool:
        """Move down, add the reading, and return whether it is a touch; trip for a pull, or a touch too high up.

        The default speed is habits.approach_speed_mm_s.
        """
        engine = self.engine
        approach_mm_s = engine.settings.habits.approach_speed_mm_s
        engine.go_to_height(height_mm, speed_mm_s or approach_mm_s, expected_below_mm=self._expected_below_mm)
        force = engine.read_force_gwt(self.press, phase)
        readings.append((engine.height_mm, force))
        if force <= -engine.sensing.touch_gwt:
            engine.trip(pull_in_descent(force), force)
        if force < engine.sensing.touch_gwt:
            return False
        if engine.height_mm > self.highest_mm:
            too_high = TripError(
                f"contact at x = {engine.x_mm:g} mm is {engine.height_mm:.3f} mm above the nominal apex, expected "
                f"below {self.highest_mm:.3f} mm; check the position of the finger and frame.apex_z_mm",
                "contact_too_high",
            )
            engine.trip(too_high)
        return True


Reached = tuple[float, float] | None
"""Depth (mm) and force (gwt) of the last press at a position since the last homing."""


def _rested_s(touched_s: float, lifted_off_s: float | None) -> float:
    """Return the time from lift-off to a touch (s); infinite without an earlier touch, zero while one lasts."""
    return 0.0 if lifted_off_s is None else touched_s - lifted_off_s


class PredictedPress(NamedTuple):
    """Depth (mm) and force (gwt) in the last hold that the finger model predicts."""

    predicted_doi_mm: float
    predicted_force_gwt: float


@dataclass(frozen=True)
class ScriptedPress:
    """Press as the script asked for it and as it was predicted; speed in mm/s, hold_s of each hold."""

    verb: str
    target: Target
    increments: int
    speed_mm_s: float
    hold_s: float
    rest_s: float
    expected_contact_mm: float
    contact_area_mm2: float
    predicted: PredictedPress | None
    id: PressId | None


def indent(
    engine: Engine,
    target: Target,
    *,
    increments: int = 1,
    speed_mm_s: float | None = None,
    hold_s: float = 1.0,
    rest_s: float = 0.0,
    expected_contact_mm: float = 0.0,
    contact_area_mm2: float = math.inf,
    predicted: PredictedPress | None = None,
    press_id: PressId | None = None,
) -> Indentation:
    """Touch off at the present x, press in equal increments with a hold after each, and lift to clearance.

    Contact is expected within limits.search_mm of expected_contact_mm (height from the nominal apex). Missing or
    higher contact trips, because a dead or frozen sensor looks the same. Raises LimitError, after a lift, if the
    target is not reached within limits.max_doi_mm or the contact time exceeds its limit. The pressure limit uses
    contact_area_mm2. An indentation that the operator paused is repeated under the same press_id.
    """
    press_mm_s = engine.settings.habits.press_speed_mm_s if speed_mm_s is None else speed_mm_s
    asked = ScriptedPress(
        "indent", target, increments, press_mm_s, hold_s, rest_s, expected_contact_mm, contact_area_mm2, predicted,
        press_id,
    )  # fmt: skip

    def holds(approach: Approach, press: Press, before: Reached) -> tuple[Hold, ...]:
        parts = range(1, increments + 1)
        return tuple(press.hold_at(target.part(k, increments), hold=k, hold_s=hold_s) for k in parts)

    return _indentation(engine, asked, press_mm_s, holds)


def ramp(
    engine: Engine,
    doi_mm: float,
    speed_mm_s: float,
    *,
    hold_s: float = 1.0,
    rest_s: float = 0.0,
    expected_contact_mm: float = 0.0,
    contact_area_mm2: float = math.inf,
    predicted: PredictedPress | None = None,
    press_id: PressId | None = None,
) -> Indentation:
    """Touch off at the present x, move to a depth at constant speed, hold, and lift to clearance.

    The stiffness is that of the last press here since the last homing, if it reached this depth; else the ramp begins
    with a press by increments to its depth. Where it is known and contact is certain, nothing touches the finger
    before the ramp. Raises LimitError, after a lift, if the overshoot of the ramp with this
    stiffness could pass the trip and the overshoot of a press. Otherwise as `indent`.
    """
    settings = engine.settings
    refuse_no_ramps(NotReadyError, "ramp", settings)
    asked = ScriptedPress(
        "ramp", Target("doi_mm", doi_mm), 1, speed_mm_s, hold_s, rest_s, expected_contact_mm, contact_area_mm2,
        predicted, press_id,
    )  # fmt: skip

    def holds(approach: Approach, press: Press, before: Reached) -> tuple[Hold, ...]:
        if not _reaches(before, doi_mm, settings):
            before = press.reach_doi(doi_mm)
        bound = _bound(engine, doi_mm, speed_mm_s, before)
        if engine.height_mm < press.contact_mm:
            approach.back_off()
        return (press.ramp_and_hold(doi_mm, bound, hold_s),)

    return _indentation(engine, asked, settings.habits.press_speed_mm_s, holds)


def _reaches(before: Reached, doi_mm: float, settings: RigSettings) -> TypeGuard[tuple[float, float]]:
    """Return whether a press by increments has measured the force at this depth."""
    return before is not None and before[0] >= doi_mm - settings.stage.resolution_mm


def _is_certain(engine: Engine, place: TouchedPlace, doi_mm: float) -> bool:
    """Return whether contact and force at this depth are known well enough to ramp without a touch before."""
    return place.is_certain(engine.clock.monotonic_s()) and _reaches(place.reached, doi_mm, engine.settings)


def _bound(engine: Engine, doi_mm: float, speed_mm_s: float, reached: tuple[float, float]) -> RampBound:
    """Return the bound of a ramp with the measured stiffness. Raises LimitError for one that is too fast."""
    deepest_mm, force_gwt = reached
    # A press ends within half a step of its depth; that may be above contact.
    share = doi_mm / max(deepest_mm, doi_mm)
    here_gwt = max(force_gwt * share**CONTACT_EXPONENT, engine.sensing.touch_gwt)
    bound = RampBound.of(engine.settings, speed_mm_s, engine.trips.lowest_gwt, here_gwt, doi_mm)
    bound.refuse_too_fast(LimitError, engine.x_mm)
    return bound


def _indentation(
    engine: Engine,
    asked: ScriptedPress,
    press_mm_s: float,
    holds: Callable[[Approach, Press, Reached], tuple[Hold, ...]],
) -> Indentation:
    """Carry out an indentation; `holds` presses from the touch on. Repeat it after a pause."""
    ready_to_indent(engine)
    press = PressId(engine.next_index()) if asked.id is None else asked.id
    approach = _approach(engine, press, asked.expected_contact_mm)

    def attempt() -> Indentation:
        engine.trips.press_on(asked.contact_area_mm2)
        safe_point(engine)
        approach.rest(asked.rest_s, ramps=asked.verb == "ramp")
        place = approach.place
        before = None if place is None else place.reached
        start_s = engine.clock.monotonic_s()
        start = IndentationStartEvent(
            index=press.index,
            indentor=engine.indentor,
            x_mm=engine.x_mm,
            verb=asked.verb,
            target=asked.target.kind,
            value=asked.target.value,
            increments=asked.increments,
            speed_mm_s=asked.speed_mm_s,
            hold_s=asked.hold_s,
            rest_s=asked.rest_s,
            predicted_doi_mm=None if asked.predicted is None else asked.predicted.predicted_doi_mm,
            predicted_force_gwt=None if asked.predicted is None else asked.predicted.predicted_force_gwt,
            **press.marks,
        )
        engine.record(start, press)
        try:
            lifted_off_s, certain = engine.contact.lifted_off_s, None
            if asked.verb == "ramp" and place is not None and _is_certain(engine, place, asked.target.value):
                certain = approach.go_above(place, asked.speed_mm_s, lifted_off_s)
            touch = certain or approach.touch_off(lifted_off_s)
            pressing = Press(engine, press, touch, press_mm_s)
            done = holds(approach, pressing, before)
        except LimitError:
            retract(engine)
            raise
        except LateReading as late:
            retract(engine)
            engine.record(AlarmEvent(f"{late}; the ramp is repeated"))
            raise
        retract(engine)
        found = place if place is not None and certain else approach.found(touch, start_s, place)
        engine.touched.at(engine.x_mm, engine.along_mm, replace(found, reached=pressing.reached or before))
        duration = engine.clock.monotonic_s() - start_s
        engine.record(IndentationEndEvent(press.index, round(duration, 6)), press)
        return Indentation(press.index, engine.x_mm, done)

    for _ in range(_LATE_RAMPS):
        with suppress(LateReading):
            return unpaused(attempt)
    raise LimitError(f"{_LATE_RAMPS} ramps at x = {engine.x_mm:g} mm had a late force reading", "late_readings")


def touch_place(engine: Engine, index: int, expected_contact_mm: float) -> float:
    """Touch off at the present position, lift, and return the contact height above the nominal apex (mm)."""
    ready_to_indent(engine)
    approach = _approach(engine, PressId(index, "find"), expected_contact_mm)
    try:
        contact = unpaused(lambda: approach.touch_off(engine.contact.lifted_off_s))
    except LimitError:
        retract(engine)
        raise
    retract(engine)
    engine.touched.at(engine.x_mm, engine.along_mm, approach.found(contact, engine.clock.monotonic_s(), None))
    height_mm = contact.contact_height_mm
    engine.record(FindEvent(index, engine.indentor, engine.x_mm, engine.along_mm, round(height_mm, 6)))
    return height_mm


def _approach(engine: Engine, press: PressId, expected_contact_mm: float) -> Approach:
    search_mm = engine.settings.limits.search_mm
    return Approach(engine, press, expected_contact_mm - search_mm, expected_contact_mm + search_mm)


def ready_to_indent(engine: Engine) -> None:
    """Raise NotReadyError unless the rig is homed, zeroed, at a position and clear, with an indentor mounted."""
    engine.require_clear("indent")
    if engine.indentor is None:
        raise NotReadyError("indent: no indentor is mounted; mount one first", "no_indentor")
    if not engine.sensing.zeroed:
        raise NotReadyError("indent: the force sensor is not zeroed; zero it first", "not_zeroed")
    if not engine.placed:
        raise NotReadyError(
            "indent: the stage has not moved to a position since homing; move to one first", "not_placed"
        )
    engine.contact_time.refuse_more()
