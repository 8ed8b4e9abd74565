"""How far a stage goes on after a force has passed a trip, and what that adds to the force."""

import math
from dataclasses import dataclass, replace

from rig.engine.pressing.touch_fit import CONTACT_EXPONENT
from rig.engine.rig_settings import RigSettings

# What a controller has prepared it steps at full speed first: 0.05 s GRBL 1.1h, 0.11 s grblHAL (docs/devices.md).
PREPARED_S = 0.11
# The longest that the force goes unread while anything moves: 0.34 s behind `rig serve` (docs/speed.md).
UNREAD_S = 0.35


@dataclass(frozen=True)
class Stopping:
    """A stage at a speed, told to stop late by latency_s; it never has more than most_mm to go."""

    speed_mm_s: float
    latency_s: float
    deceleration_mm_s2: float
    most_mm: float

    @classmethod
    def of(cls, settings: RigSettings, speed_mm_s: float) -> "Stopping":
        """Late by sensor, wait for a reading and what is prepared; no more than an increment is ever queued."""
        waited_s = settings.habits.settle_readings * settings.force.sample_period_s
        late_s = settings.force.latency_s + waited_s + PREPARED_S
        return cls(speed_mm_s, late_s, settings.stage.acceleration_mm_s2, settings.habits.increment_mm)

    @classmethod
    def in_one_move(cls, settings: RigSettings, speed_mm_s: float) -> "Stopping":
        """In a move of any length that is looked at on the way: the force may also have gone unread for UNREAD_S."""
        late = cls.of(settings, speed_mm_s)
        return replace(late, latency_s=late.latency_s + UNREAD_S, most_mm=math.inf)

    @property
    def distance_mm(self) -> float:
        """v · latency + v² / 2a, or the whole of an increment where that is less."""
        free_mm = self.speed_mm_s * self.latency_s + self.speed_mm_s**2 / (2 * self.deceleration_mm_s2)
        return min(free_mm, self.most_mm)

    def overshoot_gwt(self, trip_gwt: float, force_gwt: float, doi_mm: float) -> float:
        """What the force gains over the trip in that distance, on F ∝ d^1.5 through (doi_mm, force_gwt)."""
        trip_doi_mm = doi_mm * (trip_gwt / force_gwt) ** (1 / CONTACT_EXPONENT)
        return trip_gwt * ((1 + self.distance_mm / trip_doi_mm) ** CONTACT_EXPONENT - 1)
