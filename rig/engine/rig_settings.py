"""What the rig must know of itself besides its devices: limits and habits. Unknown keys are errors."""

from typing import Literal, Self

from pydantic import Field, model_validator

from rig.devices.bench_settings import SLOWEST_MM_S, BenchSettings, StageBounds
from rig.settings import Settings

FASTEST_PRESS_MM_S = 5.0


class LimitSettings(Settings):
    """Refused before a move, or tripped on; DEVICES: software is never the safety function."""

    max_doi_mm: float = Field(
        1.5, gt=0, le=2.0, description="the deepest indentation; a step that is deeper is refused"
    )
    max_force_gwt: float = Field(
        100.0, gt=0, le=500, description="the highest force asked for or predicted; a step above it is refused"
    )
    search_mm: float = Field(
        0.5,
        gt=0,
        le=1.5,
        description="how far contact may lie from where the finger model expects it; beyond, it trips",
    )
    fall_mm: float = Field(
        1.6,
        ge=0,
        le=10,
        description="how much lower than the apex the skin may lie where it is pressed; the floor is so much lower",
    )
    soft_trip_n: float = Field(
        2.0,
        gt=0,
        le=5.0,
        description="trips a run; lowered to twice the highest force of its plan, 1.25 times a met finger's",
    )
    hard_trip_n: float = Field(
        5.0, gt=0, le=5.0, description="trips on every reading there is, whatever was predicted"
    )
    max_pressure_n_cm2: float = Field(
        30.0,
        gt=0,
        le=60.0,
        description="force over predicted contact area; a step above it is refused, a reading trips",
    )
    max_press_speed_mm_s: float = Field(
        FASTEST_PRESS_MM_S,
        ge=SLOWEST_MM_S,
        le=FASTEST_PRESS_MM_S,
        description="the fastest that a finger is approached or pressed; a speed above it is refused",
    )
    heartbeat_s: float = Field(
        3.0, ge=0.5, le=60, description="the longest silence of the engine below clearance; then the stage is stopped"
    )
    max_contact_s: float = Field(
        3600.0,
        gt=0,
        le=36_000,
        description="how long a run may touch the finger, all its touches together; then it ends",
    )
    zero_drift_gwt: float = Field(
        0.03, gt=0, le=10, description="alarm: how far the zero may have drifted since the last one"
    )
    reference_band: float = Field(
        0.15, gt=0, le=1, description="alarm: the share by which a reference press may differ from the first"
    )
    on_alarm: Literal["warn", "trip"] = Field(
        "warn", description="warn: an alarm is journalled and printed; trip: it trips as well"
    )
    on_trip: Literal["stop", "retract", "park"] = Field(
        "retract",
        description="what follows a trip: stop and hold, retract to clearance, or park at habits.park_height_mm",
    )
    x_mm: tuple[float, float] = Field(
        (-6.0, 6.0), description="how far to either side of the pad's centre; a place beyond is refused"
    )
    along_mm: tuple[float, float] = Field(
        (-4.0, 4.0), description="how far along the finger from the receptor plane; a place beyond is refused"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.x_mm[0] < self.x_mm[1]:
            raise ValueError("x_mm: expected the lower limit before the upper one")
        if not self.along_mm[0] <= 0 <= self.along_mm[1]:
            raise ValueError("along_mm: expected a limit on either side of 0")
        if self.soft_trip_n > self.hard_trip_n:
            raise ValueError("soft_trip_n: expected no more than hard_trip_n")
        return self


class HabitSettings(Settings):
    """Speeds (mm/s), increments (mm) and thresholds of an indentation."""

    travel_speed_mm_s: float = Field(5.0, ge=SLOWEST_MM_S, le=10, description="of moves to a place, and of the lift")
    approach_speed_mm_s: float = Field(0.5, ge=SLOWEST_MM_S, le=2, description="of the increments down to contact")
    press_speed_mm_s: float = Field(
        1.0,
        ge=SLOWEST_MM_S,
        le=FASTEST_PRESS_MM_S,
        description="of the increments past contact, where a script names no speed",
    )
    clearance_mm: float = Field(
        2.0,
        gt=0.2,
        le=20,
        description="height above the apex between indentations; below it the stage goes by increments",
    )
    park_height_mm: float = Field(10.0, gt=0.2, le=40, description="above the apex, where on_trip = park lifts to")
    descent_speed_mm_s: float = Field(
        0.8, ge=SLOWEST_MM_S, le=2, description="of the way down to clearance after homing, which a touch ends"
    )
    descent_step_mm: float = Field(
        0.5, gt=0, le=5, description="between readings on the way down by hand, and after a touch that was none"
    )
    increment_mm: float = Field(
        0.05, gt=0, le=0.05, description="the longest move below clearance; force is read after each"
    )
    touch_increment_mm: float = Field(
        0.01, gt=0, le=0.05, description="the increments that find contact, after increment_mm has felt it"
    )
    retouch_margin_mm: float = Field(
        0.1,
        ge=0.05,
        le=20,
        description="besides the stopping distance, above the last contact: so far one move comes back to a place",
    )
    touch_force_gwt: float = Field(0.05, gt=0, le=1, description="a force above this is contact")
    settle_readings: int = Field(
        1, ge=1, le=20, description="sensor periods waited for between a move and its reading"
    )

    @model_validator(mode="after")
    def _fine_within_coarse(self) -> Self:
        if self.touch_increment_mm > self.increment_mm:
            raise ValueError("touch_increment_mm: expected no more than increment_mm")
        return self


class RigSettings(BenchSettings):
    """All that the engine needs."""

    limits: LimitSettings = LimitSettings()
    habits: HabitSettings = HabitSettings()

    @property
    def bounds(self) -> StageBounds:
        """What the stage's controller may enforce: a floor below the deepest press there is, the highest speed."""
        limits = self.limits
        given_mm = self.calibration.value("compliance_mm_per_n", 0.0) * limits.soft_trip_n
        floor_mm = self.frame.apex_z_mm - limits.fall_mm - limits.search_mm - limits.max_doi_mm - given_mm
        return StageBounds(
            lowest_z_mm=max(floor_mm, -self.stage.travel_mm[2]),
            fastest_mm_s=max(self.habits.travel_speed_mm_s, limits.max_press_speed_mm_s),
        )

    @property
    def floor(self) -> str:
        """The lowest height of the stage, in words."""
        return (
            f"the floor at {self.bounds.lowest_z_mm:g} mm: "
            "limits.fall_mm, limits.search_mm and limits.max_doi_mm below frame.apex_z_mm"
        )

    @model_validator(mode="after")
    def _slow_enough(self) -> Self:
        fastest = self.limits.max_press_speed_mm_s
        for name in ("approach_speed_mm_s", "press_speed_mm_s"):
            speed = getattr(self.habits, name)
            if speed > fastest:
                raise ValueError(
                    f"limits.max_press_speed_mm_s = {fastest:g}: expected no less than habits.{name} = {speed:g}"
                )
        return self
