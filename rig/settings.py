"""What the rig must know of itself: ports, frame, limits and habits. Unknown keys are errors."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """A table of the configuration file; every value is checked, none may be NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class StageSettings(Settings):
    """The motorised stage."""

    kind: Literal["grbl"] = "grbl"
    port: str = "/dev/ttyUSB0"
    baud: int = Field(115200, ge=300, le=1_000_000)
    travel_mm: tuple[float, float, float] = (60.0, 30.0, 40.0)


class ForceSettings(Settings):
    """The force sensor."""

    kind: Literal["mtsics"] = "mtsics"
    port: str = "/dev/ttyUSB1"
    baud: int = Field(9600, ge=300, le=1_000_000)
    sample_period_s: float = Field(0.05, gt=0, le=10)


class FrameSettings(Settings):
    """The finger's frame in machine coordinates (mm)."""

    pad_centre_x_mm: float = Field(-30.0, description="machine X over the centre of the finger pad, x = 0")
    pad_y_mm: float = Field(-15.0, description="machine Y of the receptor plane")
    apex_z_mm: float = Field(-25.0, description="machine Z at which the indentor is level with the pad's apex")


class LimitSettings(Settings):
    """Refused before a move, or tripped on; DEVICES: software is never the safety function."""

    max_doi_mm: float = Field(1.5, gt=0, le=2.0)
    max_force_gwt: float = Field(100.0, gt=0, le=500)
    soft_trip_n: float = Field(2.0, gt=0, le=5.0, description="cap; lowered to twice the predicted peak")
    x_mm: tuple[float, float] = (-6.0, 6.0)


class HabitSettings(Settings):
    """Speeds (mm/s), increments (mm) and thresholds of an indentation."""

    travel_speed_mm_s: float = Field(5.0, gt=0, le=10)
    approach_speed_mm_s: float = Field(0.5, gt=0, le=2)
    press_speed_mm_s: float = Field(1.0, gt=0, le=5)
    clearance_mm: float = Field(2.0, gt=0.2, le=20)
    increment_mm: float = Field(0.05, gt=0, le=0.05, description="the longest move below clearance")
    touch_increment_mm: float = Field(0.01, gt=0, le=0.05)
    touch_force_gwt: float = Field(0.05, gt=0, le=1)
    settle_readings: int = Field(1, ge=1, le=20, description="sensor periods between a move and its reading")


class RigSettings(Settings):
    """All that the engine needs."""

    stage: StageSettings = StageSettings()
    force: ForceSettings = ForceSettings()
    frame: FrameSettings = FrameSettings()
    limits: LimitSettings = LimitSettings()
    habits: HabitSettings = HabitSettings()
