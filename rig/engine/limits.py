"""Limits and trips: forces, time, heights, stopping distance, and positions of earlier contact."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rig.clock import Clock, real_s
from rig.devices.base import LOOK_S, Axis
from rig.devices.registry import ramps
from rig.errors import LimitError, RigError, TripError
from rig.records import ContactFit, PlannedIndentation
from rig.settings import SLOWEST_MM_S, LimitSettings, RigSettings
from rig.units import GWT_N

TRIP_MARGIN = 0.9  # share of the trip that a step may reach, extrapolated with the last stiffness
AT_MM = 0.02  # heights closer than this count as equal


class Trips:
    """Four force limits (gwt); a reading of either sign beyond one of them trips.

    Soft: the configured limit, lowered by the plan. Pressure: limits.max_pressure_kpa times the expected contact
    area. Ramp: lower than both during one, by what it may overshoot. Hard: the same for every plan and every reading.
    """

    def __init__(self, limits: LimitSettings, soft_trip_n: float | None) -> None:
        lowest_n = limits.soft_trip_n if soft_trip_n is None else min(limits.soft_trip_n, soft_trip_n)
        self.soft_gwt = lowest_n / GWT_N
        self.hard_gwt = limits.hard_trip_n / GWT_N
        self._max_pressure_kpa = limits.max_pressure_kpa
        self._area_gwt = self._ramp_gwt = math.inf

    def press_on(self, contact_area_mm2: float) -> None:
        """Apply the pressure limit to this contact area, and no limit of a ramp; infinity disables it."""
        self._area_gwt = pressure_limit_gwt(self._max_pressure_kpa, contact_area_mm2)
        self._ramp_gwt = math.inf

    def ramp_at(self, trip_gwt: float) -> None:
        """Apply the limit of a ramp, until the next press_on."""
        self._ramp_gwt = trip_gwt

    @property
    def lowest_gwt(self) -> float:
        """Lowest limit of a press (gwt)."""
        return min(self.soft_gwt, self._area_gwt, self._ramp_gwt)

    @property
    def lowest(self) -> str:
        """Name of the lowest limit."""
        limits_gwt = {"soft trip": self.soft_gwt, "pressure limit": self._area_gwt, "ramp trip": self._ramp_gwt}
        return min(limits_gwt, key=lambda name: limits_gwt[name])

    def passed(self, force_gwt: float) -> TripError | None:
        """Return the trip that a reading of a press exceeds, or None."""
        if abs(force_gwt) > self.lowest_gwt:
            return TripError(
                f"force {force_gwt:.2f} gwt exceeds the {self.lowest} of {self.lowest_gwt:.2f} gwt",
                self.lowest.replace(" ", "_"),
            )
        return None

    def passed_hard(self, force_gwt: float) -> TripError | None:
        """Return an error if any reading exceeds the hard trip, else None."""
        if abs(force_gwt) > self.hard_gwt:
            return TripError(
                f"force {force_gwt:.2f} gwt exceeds the hard trip of {self.hard_gwt:.2f} gwt", "hard_trip"
            )
        return None

    def passed_any(self, force_gwt: float) -> TripError | None:
        """Return the trip that a force exceeds during a motion; all limits apply."""
        return self.passed_hard(force_gwt) or self.passed(force_gwt)


def pressure_limit_gwt(max_pressure_kpa: float, contact_area_mm2: float) -> float:
    """Return the force (gwt) at which the mean pressure on a contact area is the highest allowed one."""
    return max_pressure_kpa * contact_area_mm2 / 1000 / GWT_N


class ContactTimeError(LimitError):
    """The finger has been touched for longer than limits.max_contact_s."""

    default_code = "contact_time"


class ContactTime:
    """Contact time (s) from first touch to lift, summed over all parts of a run."""

    def __init__(self, clock: Clock, limits: LimitSettings, before_s: float = 0.0) -> None:
        """Begin with the contact time of the earlier parts of the run (s)."""
        self._clock, self._longest_s, self._before_s = clock, limits.max_contact_s, before_s
        self._since_s: float | None = None

    @property
    def total_s(self) -> float:
        """Contact time so far (s)."""
        return self._before_s + (0.0 if self._since_s is None else self._now_s - self._since_s)

    @property
    def _now_s(self) -> float:
        return real_s(self._clock)

    def begin(self) -> None:
        """Begin contact, unless it has begun."""
        if self._since_s is None:
            self._since_s = self._now_s

    def end(self) -> None:
        """End contact."""
        self._before_s, self._since_s = self.total_s, None

    @property
    def rounded_s(self) -> float:
        """Contact time so far (s), rounded for the journal."""
        return round(self.total_s, 6)

    @property
    def over(self) -> bool:
        """Whether the contact time exceeds limits.max_contact_s."""
        return self.total_s > self._longest_s

    def refuse_more(self) -> None:
        """Raise ContactTimeError if the contact time exceeds limits.max_contact_s."""
        if self.over:
            raise ContactTimeError(
                f"the finger has been touched for {self.total_s:.1f} s in this run, longer than "
                f"limits.max_contact_s = {self._longest_s:g} s"
            )


class Heartbeat:
    """Deadline that stops the stage if the engine stops responding.

    The deadline is only set while the indentor may touch the finger; `look` checks it from another thread or timer.
    """

    def __init__(self, clock: Clock, stop: Callable[[], None]) -> None:
        self._clock, self._stop = clock, stop
        self._due_s: float | None = None
        self.lost = False

    def beat(self, within_s: float) -> None:
        """Set the deadline to within_s seconds from now."""
        self._due_s = self._clock.monotonic_s() + within_s

    def rest(self) -> None:
        """Clear the deadline: the indentor is clear of the finger."""
        self._due_s = None

    def look(self) -> None:
        """Stop the stage, once, if the deadline has passed."""
        due_s = self._due_s
        if due_s is None or self.lost or self._clock.monotonic_s() <= due_s:
            return
        self.lost = True
        self._stop()


def trip_height_mm(settings: RigSettings, height_mm: float) -> float:
    """Return the height that a trip lifts to: clearance, or higher if configured or if clearance is not clear."""
    habits = settings.habits
    if settings.limits.on_trip != "park" and height_mm <= habits.clearance_mm - AT_MM:
        return habits.clearance_mm
    return park_height_mm(settings, height_mm)


def park_height_mm(settings: RigSettings, height_mm: float) -> float:
    """Return the height that leaves a finger that came up: the park height, or higher from above it."""
    habits, highest_mm = settings.habits, -settings.frame.apex_z_mm
    return min(max(habits.park_height_mm, height_mm + habits.clearance_mm), highest_mm)


def longer_than_an_increment(settings: RigSettings, from_mm: float, to_mm: float, free_mm: float) -> bool:
    """Return whether a vertical move descends below a height by more than one increment."""
    return to_mm < min(from_mm, free_mm) - settings.habits.increment_mm - 1e-9


def refuse_height(
    settings: RigSettings, from_mm: float, to_mm: float, speed_mm_s: float, free_mm: float = math.inf
) -> None:
    """Raise LimitError for a vertical move beyond the travel, or too long or too fast below clearance.

    free_mm: height above which this position is free at this speed, if lower than clearance.
    """
    habits, fastest = settings.habits, settings.limits.max_press_speed_mm_s
    if longer_than_an_increment(settings, from_mm, to_mm, min(free_mm, habits.clearance_mm)):
        raise LimitError(
            f"a move down to {to_mm:.3f} mm exceeds habits.increment_mm, the longest move below clearance",
            "longer_than_an_increment",
        )
    if to_mm < min(from_mm, habits.clearance_mm) and speed_mm_s > fastest:
        raise LimitError(
            f"a move below clearance at {speed_mm_s:g} mm/s exceeds limits.max_press_speed_mm_s = {fastest:g} mm/s",
            "too_fast",
        )
    refuse_travel(LimitError, settings, "z", settings.frame.apex_z_mm + to_mm)


def refuse_travel(kind: type[RigError], settings: RigSettings, axis: Axis, machine_mm: float) -> None:
    """Raise an error of this kind for a machine position that the stage cannot reach, or below the lowest one."""
    travel_mm = settings.stage.travel_mm["xyz".index(axis)]
    if not -travel_mm - 1e-9 <= machine_mm <= 1e-9:
        raise kind(
            f"machine {axis} = {machine_mm:.3f} mm is outside the stage's travel, {-travel_mm:g} … 0 mm",
            "outside_travel",
        )
    if axis == "z" and machine_mm < settings.bounds.lowest_z_mm - 1e-9:
        raise kind(f"machine z = {machine_mm:.3f} mm is below {settings.floor}", "below_floor")


def refuse_outside(
    kind: type[RigError], verb: str, key: str, value_mm: float, limits_mm: tuple[float, float]
) -> None:
    """Raise an error of this kind for a position outside the two limits of that name."""
    low, high = limits_mm
    if not low <= value_mm <= high:
        raise kind(
            f"{verb}: {key} = {value_mm:g} mm is outside limits.{key} = {low:g} … {high:g} mm", "outside_limits"
        )


def refuse_no_ramps(kind: type[RigError], verb: str, settings: RigSettings) -> None:
    """Raise an error of this kind for a stage that cannot move into the finger at constant speed."""
    if not ramps(settings.stage):
        raise kind(
            f"{verb}: a {settings.stage.kind} stage has no motion at constant speed under force monitoring",
            "no_ramps",
        )


CONTACT_EXPONENT = 1.5  # F ∝ d^1.5, a sphere pressed on an elastic solid (Hertz)

# Time that a controller has queued at full speed: 0.05 s GRBL 1.1h, 0.11 s grblHAL (docs/validation/devices.md).
PREPARED_S = 0.11


def reading_delay_s(settings: RigSettings) -> float:
    """Return the time from the end of a move to a reading that is unaffected by it (s)."""
    return settings.force.latency_s + settings.habits.settle_readings * settings.force.sample_period_s


@dataclass(frozen=True)
class Stopping:
    """Stopping of a stage from a speed, with a delay latency_s and at most most_mm left to go."""

    speed_mm_s: float
    latency_s: float
    deceleration_mm_s2: float
    most_mm: float

    @classmethod
    def of(cls, settings: RigSettings, speed_mm_s: float) -> "Stopping":
        """Return the stopping in a press: delays of sensor, reading and controller, at most one increment queued."""
        late_s = reading_delay_s(settings) + PREPARED_S
        return cls(speed_mm_s, late_s, settings.stage.acceleration_mm_s2, settings.habits.increment_mm)

    @classmethod
    def in_a_ramp(cls, settings: RigSettings, speed_mm_s: float) -> "Stopping":
        """Return the stopping in a ramp, which a reading that comes too late ends."""
        late = cls.of(settings, speed_mm_s)
        return replace(late, latency_s=late.latency_s + late_reading_s(settings), most_mm=math.inf)

    @classmethod
    def at_a_touch(cls, settings: RigSettings, speed_mm_s: float) -> "Stopping":
        """Return the stopping of a motion that a touch ends, and a reading that comes too late."""
        late_s = settings.force.latency_s + late_reading_s(settings) + PREPARED_S
        return cls(speed_mm_s, late_s, settings.stage.acceleration_mm_s2, math.inf)

    @property
    def distance_mm(self) -> float:
        """Stopping distance (mm): v · latency + v² / 2a, at most most_mm."""
        free_mm = self.speed_mm_s * self.latency_s + self.speed_mm_s**2 / (2 * self.deceleration_mm_s2)
        return min(free_mm, self.most_mm)

    def overshoot_gwt(self, trip_gwt: float, force_gwt: float, doi_mm: float) -> float:
        """Return the force gained beyond the trip (gwt), for F ∝ d^1.5 through (doi_mm, force_gwt)."""
        trip_doi_mm = doi_mm * (trip_gwt / force_gwt) ** (1 / CONTACT_EXPONENT)
        return trip_gwt * ((1 + self.distance_mm / trip_doi_mm) ** CONTACT_EXPONENT - 1)

    def fastest_mm_s(self, distance_mm: float) -> float:
        """Return the highest speed (mm/s) whose stopping distance is this one."""
        a, late_s = self.deceleration_mm_s2, self.latency_s
        return a * (math.sqrt(late_s**2 + 2 * max(distance_mm, 0.0) / a) - late_s)


def late_reading_s(settings: RigSettings) -> float:
    """Return the longest time between two force readings sideways, down to a known contact, and in a ramp (s)."""
    return 2 * settings.force.sample_period_s + LOOK_S


@dataclass(frozen=True)
class FingerStiffness:
    """Stiffness of a finger under its stiffest press, for F ∝ d^1.5."""

    gwt_at_1_mm: float

    @classmethod
    def of(cls, presses: Sequence[PlannedIndentation]) -> "FingerStiffness":
        """Return the highest predicted stiffness of these presses."""
        if not presses:
            return cls.unknown()
        return cls(max(press.highest_gwt / press.predicted_doi_mm**CONTACT_EXPONENT for press in presses))

    @classmethod
    def unknown(cls) -> "FingerStiffness":
        """Return the stiffness that counts where nothing is predicted: a stiff finger under a wide flat indentor."""
        return cls(40.0)

    def depth_mm(self, force_gwt: float) -> float:
        """Return the depth at which the finger answers with a force (mm)."""
        return float((force_gwt / self.gwt_at_1_mm) ** (1 / CONTACT_EXPONENT))


@dataclass(frozen=True)
class TouchLimit:
    """Speed of a motion that a touch ends, how far it goes on in the finger that it meets, and the force then.

    Sideways at clearance, or down to a known contact. Until the stage is at rest it may go the way to the touch
    threshold, and the stopping distance: v · (delay of the sensor, longest time without a reading, delay of the
    controller) + v² / 2a. The finger counts as a wall as stiff as the stiffest press, predicted or measured, so that
    this distance stays below half the trip.
    """

    speed_mm_s: float
    stop_mm: float
    in_contact_mm: float
    force_gwt: float

    @classmethod
    def of(cls, settings: RigSettings, trip_gwt: float, touch_gwt: float, stiffness: FingerStiffness) -> "TouchLimit":
        """Return it for the lowest trip and the touch threshold (gwt)."""
        stop = Stopping.at_a_touch(settings, settings.habits.travel_speed_mm_s)
        touch_mm = stiffness.depth_mm(touch_gwt)
        fastest_mm_s = stop.fastest_mm_s(stiffness.depth_mm(_MET_SHARE * trip_gwt) - touch_mm)
        speed_mm_s = min(max(fastest_mm_s, SLOWEST_MM_S), stop.speed_mm_s)
        stop_mm = replace(stop, speed_mm_s=speed_mm_s).distance_mm
        way_mm = touch_mm + stop_mm
        return cls(speed_mm_s, stop_mm, way_mm, stiffness.gwt_at_1_mm * way_mm**CONTACT_EXPONENT)


_MET_SHARE = 0.5  # of the trip
RAMP_MARGIN = 1.25
"""Lowest trip of a ramp over the force at its depth: a fast ramp leaves the tissue less time to relax."""


@dataclass(frozen=True)
class RampBound:
    """Force limits of a ramp, for F ∝ d^1.5 through a depth and the force measured or predicted there.

    A press may reach bound_gwt: the trip and the documented overshoot of its increments. A ramp covers a longer
    distance `stop_mm` before it is at rest, v · (delays of sensor, reading and controller, and the longest time
    unread) + v² / 2a, so that it trips at a lower force, from which that distance ends at the same bound. `trip_gwt`
    is 0 if the stopping distance alone exceeds the bound; `fastest_mm_s` is the highest speed of a ramp to this
    depth.
    """

    speed_mm_s: float
    force_gwt: float
    trip_gwt: float
    stop_mm: float
    bound_gwt: float
    fastest_mm_s: float

    @classmethod
    def of(
        cls, settings: RigSettings, speed_mm_s: float, trip_gwt: float, force_gwt: float, doi_mm: float
    ) -> "RampBound":
        """Return it below the lowest trip of a press (gwt), for the force at a depth (mm)."""
        press = Stopping.of(settings, settings.limits.max_press_speed_mm_s)
        ramp = Stopping.in_a_ramp(settings, speed_mm_s)
        bound_gwt = trip_gwt + press.overshoot_gwt(trip_gwt, force_gwt, doi_mm)
        deepest_mm = doi_mm * (bound_gwt / force_gwt) ** (1 / CONTACT_EXPONENT)
        left_mm = max(deepest_mm - ramp.distance_mm, 0.0)
        room_mm = deepest_mm - doi_mm * RAMP_MARGIN ** (1 / CONTACT_EXPONENT)
        ramp_gwt = min(trip_gwt, force_gwt * (left_mm / doi_mm) ** CONTACT_EXPONENT)
        return cls(speed_mm_s, force_gwt, ramp_gwt, ramp.distance_mm, bound_gwt, ramp.fastest_mm_s(room_mm))

    def refuse_too_fast(self, kind: type[RigError], x_mm: float) -> None:
        """Raise an error of this kind for a ramp at x_mm that would trip too near to its own force."""
        if self.trip_gwt < RAMP_MARGIN * self.force_gwt:
            raise kind(
                f"a ramp at x = {x_mm:g} mm at {self.speed_mm_s:g} mm/s is too fast: it needs up to "
                f"{self.stop_mm:.2g} mm to stop, and would have to trip at {self.trip_gwt:.3g} gwt to stay below "
                f"{self.bound_gwt:.3g} gwt, too near to the {self.force_gwt:.3g} gwt at its depth; ramp at most at "
                f"{math.floor(1000 * self.fastest_mm_s) / 1000:g} mm/s",
                "ramp_too_fast",
            )


CERTAIN_S, CERTAIN_MM = 60.0, 0.02
"""Highest age (s) and drift (mm) of a contact that a ramp need not touch again before."""


@dataclass(frozen=True)
class TouchedPlace:
    """Contact at a position, when it was found, and what was measured there.

    found_s: on the clock of the bench. above_expected_mm: by how much contact was higher than predicted. drift_mm:
    distance from the contact found before. reached: depth (mm) and force (gwt) of the last press by increments.
    """

    contact: ContactFit
    found_s: float = -math.inf
    above_expected_mm: float = 0.0
    drift_mm: float | None = None
    reached: tuple[float, float] | None = None

    def is_certain(self, now_s: float) -> bool:
        """Return whether a press need not touch first: the contact was found twice in one place, and lately."""
        steady = self.drift_mm is not None and abs(self.drift_mm) <= CERTAIN_MM
        return steady and now_s - self.found_s <= CERTAIN_S

    @property
    def stiffness(self) -> FingerStiffness:
        """Stiffness that the press measured; zero without one."""
        doi_mm, force_gwt = self.reached or (1.0, 0.0)
        return FingerStiffness(force_gwt / doi_mm**CONTACT_EXPONENT)


class Touched:
    """Contacts by position, for one indentor since the last homing."""

    def __init__(self, settings: RigSettings) -> None:
        self._settings = settings
        self._found: dict[tuple[float, float], TouchedPlace] = {}

    def at(self, x_mm: float, along_mm: float, place: TouchedPlace) -> None:
        """Record the contact at a position after the lift."""
        self._found[x_mm, along_mm] = place

    def place_at(self, x_mm: float, along_mm: float) -> TouchedPlace | None:
        """Return what is known of a position, or None."""
        return self._found.get((x_mm, along_mm))

    def nearest(self, x_mm: float, along_mm: float) -> tuple[float, TouchedPlace] | None:
        """Return the distance (mm) and the contact of the nearest place, or None."""
        away = [(math.hypot(x_mm - x, along_mm - along), place) for (x, along), place in self._found.items()]
        return min(away, key=lambda one: one[0], default=None)

    def stiffest(self, predicted: FingerStiffness) -> FingerStiffness:
        """Return the highest stiffness, as predicted or as a press has measured it."""
        return max([predicted, *(place.stiffness for place in self._found.values())], key=lambda one: one.gwt_at_1_mm)

    def forget_at(self, x_mm: float, along_mm: float) -> None:
        """Forget the contact at a position."""
        self._found.pop((x_mm, along_mm), None)

    def forget(self) -> None:
        """Forget all contacts: new indentor, new homing, or an operator at the finger."""
        self._found.clear()

    def free_mm(self, x_mm: float, along_mm: float, expected_below_mm: float) -> float:
        """Return the height (mm) above which a position is free.

        The last contact there plus a margin; where another position was touched, the highest height at which contact
        is expected; clearance where none was.
        """
        habits, place = self._settings.habits, self.place_at(x_mm, along_mm)
        if not self._found:
            return habits.clearance_mm
        contact_mm = expected_below_mm
        if place is not None:
            contact_mm = place.contact.contact_height_mm + habits.retouch_margin_mm
        return min(contact_mm, habits.clearance_mm)
