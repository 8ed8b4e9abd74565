"""What must not be passed: forces, each layer on its own, and the time that a finger is touched."""

import math

from rig.devices.units import GWT_N
from rig.engine.errors import LimitError, TripError
from rig.engine.rig_settings import LimitSettings, RigSettings
from rig.transport.clock import Clock

TRIP_MARGIN = 0.9  # no step is made that would go beyond so much of a trip, at the last stiffness
AT_MM = 0.02  # heights closer than this are the same place


class Trips:
    """Three layers of force, gwt; a reading that passes one trips, whichever way it points.

    Soft: the limit, lowered to what a plan allows. Area: limits.max_pressure_n_cm2 over a contact that is expected.
    Hard: the same whatever is planned or pressed, and for every reading there is.
    """

    def __init__(self, limits: LimitSettings, soft_trip_n: float | None) -> None:
        lowest_n = limits.soft_trip_n if soft_trip_n is None else min(limits.soft_trip_n, soft_trip_n)
        self.soft_gwt = lowest_n / GWT_N
        self.hard_gwt = limits.hard_trip_n / GWT_N
        self._max_pressure_n_cm2 = limits.max_pressure_n_cm2
        self._area_gwt = math.inf

    def press_on(self, contact_area_mm2: float) -> None:
        """From here on the area's layer counts, over this contact; infinite: it does not."""
        self._area_gwt = self._max_pressure_n_cm2 * contact_area_mm2 / 100 / GWT_N

    @property
    def lowest_gwt(self) -> float:
        """What a press must stay below."""
        return min(self.soft_gwt, self._area_gwt)

    @property
    def lowest(self) -> str:
        """The name of that."""
        return "soft trip" if self.soft_gwt <= self._area_gwt else "pressure limit"

    @property
    def lowest_code(self) -> str:
        """The same as a code."""
        return self.lowest.replace(" ", "_")

    def passed(self, force_gwt: float) -> TripError | None:
        """What a reading of a press has passed, or None."""
        if abs(force_gwt) > self.lowest_gwt:
            return TripError(
                f"force {{force_gwt:.2f}} gwt above the {self.lowest} {{limit_gwt:.2f}} gwt",
                code=self.lowest_code,
                force_gwt=force_gwt,
                limit_gwt=self.lowest_gwt,
            )
        return None

    def passed_hard(self, force_gwt: float) -> TripError | None:
        """Whether a reading, of whatever it is, has passed the hard trip."""
        if abs(force_gwt) > self.hard_gwt:
            return TripError(
                "force {force_gwt:.2f} gwt above the hard trip {limit_gwt:.2f} gwt",
                code="hard_trip",
                force_gwt=force_gwt,
                limit_gwt=self.hard_gwt,
            )
        return None

    def passed_any(self, force_gwt: float) -> TripError | None:
        """What a force has passed while something moves: every layer counts."""
        return self.passed_hard(force_gwt) or self.passed(force_gwt)


class ContactTime:
    """Seconds from first touch to lift, added up over all the parts of a run."""

    def __init__(self, clock: Clock, limits: LimitSettings, before_s: float = 0.0) -> None:
        """before_s: what the parts of the run before this one have used up."""
        self._clock, self._longest_s, self._before_s = clock, limits.max_contact_s, before_s
        self._since_s: float | None = None

    @property
    def total_s(self) -> float:
        """Until now."""
        return self._before_s + (0.0 if self._since_s is None else self._clock.monotonic_s() - self._since_s)

    def begin(self) -> None:
        """Touched now, if not already before."""
        if self._since_s is None:
            self._since_s = self._clock.monotonic_s()

    def end(self) -> None:
        """Lifted."""
        self._before_s, self._since_s = self.total_s, None

    @property
    def rounded_s(self) -> float:
        """Until now, as it is journalled."""
        return round(self.total_s, 6)

    def refuse_more(self) -> None:
        """Raises LimitError where the finger has been touched for longer than limits.max_contact_s."""
        if self.total_s > self._longest_s:
            raise LimitError(
                "the finger has been touched for {contact_s:.1f} s in this run, limits.max_contact_s = {limit_s:g}",
                code="contact_time",
                contact_s=self.total_s,
                limit_s=self._longest_s,
            )


def trip_height_mm(settings: RigSettings, height_mm: float) -> float:
    """Where a trip lifts to: clearance; farther up where that is configured, or where clearance is not clear."""
    habits, highest = settings.habits, -settings.frame.apex_z_mm
    if settings.limits.on_trip != "park" and height_mm <= habits.clearance_mm - AT_MM:
        return habits.clearance_mm
    return min(max(habits.park_height_mm, height_mm + habits.clearance_mm), highest)


def longer_than_an_increment(settings: RigSettings, from_mm: float, to_mm: float, free_mm: float) -> bool:
    """Whether a vertical move goes down below a height by more than one increment."""
    return to_mm < min(from_mm, free_mm) - settings.habits.increment_mm - 1e-9


def refuse_height(
    settings: RigSettings, from_mm: float, to_mm: float, speed_mm_s: float, free_mm: float = math.inf
) -> None:
    """Raises LimitError for a vertical move beyond the travel, or too long or too fast below clearance.

    free_mm: down to where nothing is met at this place and speed, if lower than clearance.
    """
    habits, fastest = settings.habits, settings.limits.max_press_speed_mm_s
    if longer_than_an_increment(settings, from_mm, to_mm, min(free_mm, habits.clearance_mm)):
        raise LimitError(
            "a move down to {to_mm:.3f} mm is longer than one increment below clearance",
            code="longer_than_an_increment",
            to_mm=to_mm,
        )
    if to_mm < min(from_mm, habits.clearance_mm) and speed_mm_s > fastest:
        raise LimitError(
            "a move down below clearance at {speed_mm_s:g} mm/s is faster than {limit_mm_s:g}",
            code="too_fast",
            speed_mm_s=speed_mm_s,
            limit_mm_s=fastest,
        )
    machine_mm, travel_mm = settings.frame.apex_z_mm + to_mm, settings.stage.travel_mm[2]
    if not -travel_mm - 1e-9 <= machine_mm <= 1e-9:
        raise LimitError(
            "machine z = {z_mm:.3f} mm is outside the stage's travel, {lowest_mm:g} … 0 mm",
            code="outside_travel",
            z_mm=machine_mm,
            lowest_mm=-travel_mm,
        )
    if machine_mm < settings.bounds.lowest_z_mm - 1e-9:
        raise LimitError(
            "machine z = {z_mm:.3f} mm is below {floor}",
            code="below_floor",
            z_mm=machine_mm,
            floor=settings.floor,
            floor_mm=settings.bounds.lowest_z_mm,
        )
