"""What the rig must know of itself: ports, frame, limits and habits. Unknown keys are errors."""

import datetime
import re
from collections.abc import Callable, Iterator
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PositiveFloat, model_validator

FASTEST_PRESS_MM_S = 5.0
SLOWEST_MM_S = 1 / 60  # GRBL moves no slower, whatever F says

Framing = Literal["rtu", "tcp"]
NOMINAL_STEPS_PER_MM = 400.0


class Settings(BaseModel):
    """A table of the configuration file; every value is checked, none may be NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _addressed(port: str) -> str:
    if not port or (port.startswith("tcp://") and not re.fullmatch(r"tcp://[^/]+:\d{1,5}", port)):
        raise ValueError("expected tcp://HOST:PORT or the name of a serial port")
    return port


Port = Annotated[str, AfterValidator(_addressed)]


class Calibration(Settings):
    """A number measured on this rig, the day it was measured, and the last day it may be used."""

    value: float
    sd: float = Field(0.0, ge=0, description="standard deviation of the value, where it is known")
    date: datetime.date
    expires: datetime.date

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.expires < self.date:
            raise ValueError("expires: expected a day not before date")
        return self


def _measured(allowed: Callable[[float], bool], expected: str) -> AfterValidator:
    def check(calibration: Calibration) -> Calibration:
        if not allowed(calibration.value):
            raise ValueError(f"value = {calibration.value:g}: expected {expected}")
        return calibration

    return AfterValidator(check)


_StepsPerMm = Annotated[Calibration, _measured(lambda value: value != 0, "a number other than zero")]
_Length = Annotated[Calibration, _measured(lambda value: value >= 0, "a number ≥ 0")]
_Scale = Annotated[Calibration, _measured(lambda value: value > 0, "a positive number")]


class CalibrationSettings(Settings):
    """What was measured on this rig; a line that is absent was not.

    steps_per_mm of each axis (pulses of a drive), negative where the motor runs against the axis; backlash_mm;
    force_scale, true force over the force read; compliance_mm_per_n, how far the rig itself gives under a force.
    """

    x_steps_per_mm: _StepsPerMm | None = None
    y_steps_per_mm: _StepsPerMm | None = None
    z_steps_per_mm: _StepsPerMm | None = None
    x_backlash_mm: _Length | None = None
    y_backlash_mm: _Length | None = None
    z_backlash_mm: _Length | None = None
    force_scale: _Scale | None = None
    compliance_mm_per_n: _Length | None = None

    def measured(self) -> Iterator[tuple[str, Calibration]]:
        """Every calibration there is, by name."""
        for name in type(self).model_fields:
            calibration = getattr(self, name)
            if calibration is not None:
                yield name, calibration

    def value(self, name: str, otherwise: float) -> float:
        """The measured number, or another where nothing was measured."""
        calibration: Calibration | None = getattr(self, name)
        return otherwise if calibration is None else calibration.value

    def expired(self, day: datetime.date) -> list[str]:
        """Names of those that may no longer be used on this day."""
        return [name for name, calibration in self.measured() if calibration.expires < day]


class DriveSettings(Settings):
    """One Leadshine drive. Second-hand: not from the maker's manual, to be looked up before the drive moves."""

    device_id: int = Field(ge=1, le=31)
    port: Port | None = Field(None, description="its own, where it does not share the stage's")
    pulses_per_rev: int = Field(400, ge=200, le=51200, description="must be what the drive says")
    pulses_per_rev_register: int = Field(0x0001, ge=0, le=0xFFFF, description="second-hand")
    ramp_ms: int = Field(333, ge=1, le=10_000, description="acceleration and deceleration as the drive takes them")
    ramp_rpm: float = Field(1000.0, gt=0, description="a ramp is told in ms for this many rpm; second-hand")
    homing_mode: int = Field(0x0001, ge=0, le=0xFFFF, description="as in the drive's manual; second-hand")
    homing_high_rpm: int = Field(300, ge=1, le=600)
    homing_low_rpm: int = Field(25, ge=1, le=100)
    homing_ramp_ms: int = Field(333, ge=1, le=10_000)
    jog_rpm_register: int = Field(0x01E1, ge=0, le=0xFFFF, description="second-hand")


class DrivesSettings(Settings):
    """The drives of a stage without a board: x lateral and z vertical; y stays where it was set by hand."""

    x: DriveSettings = DriveSettings(device_id=1)
    z: DriveSettings = DriveSettings(device_id=2)


class StageSettings(Settings):
    """The motorised stage; framing and drives are read for leadshine only."""

    kind: Literal["grbl", "leadshine"] = "grbl"
    port: Port = "/dev/ttyUSB0"
    baud: int = Field(115200, ge=300, le=1_000_000)
    travel_mm: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (60.0, 30.0, 40.0)
    resolution_mm: float = Field(0.0025, gt=0, le=0.05, description="one step of the vertical axis")
    acceleration_mm_s2: float = Field(50.0, gt=0, le=1e4, description="of the vertical axis, for the stop distance")
    framing: Framing | None = Field(None, description="of Modbus; absent: tcp on a tcp:// port, rtu elsewhere")
    drives: DrivesSettings = DrivesSettings()

    @property
    def ports(self) -> tuple[str, ...]:
        """Every port that the stage is on: its own, or those of its drives."""
        if self.kind == "grbl":
            return (self.port,)
        return tuple(dict.fromkeys(drive.port or self.port for drive in (self.drives.x, self.drives.z)))

    @model_validator(mode="after")
    def _told_apart(self) -> Self:
        x, z = self.drives.x, self.drives.z
        if x.device_id == z.device_id and (x.port or self.port) == (z.port or self.port):
            raise ValueError("drives.x and drives.z: expected different device ids on one port")
        return self


class StatusBits(Settings):
    """Bits of a Laumas status word; second-hand for TLB and TLU, as printed in the manual of the LCB."""

    cell_error: int = Field(0, ge=0, le=15)
    converter_error: int = Field(1, ge=0, le=15)
    over_max: int = Field(2, ge=0, le=15)
    over_full_scale: int = Field(3, ge=0, le=15)
    gross_out_of_range: int = Field(4, ge=0, le=15)
    net_out_of_range: int = Field(5, ge=0, le=15)
    gross_negative: int = Field(7, ge=0, le=15)
    net_negative: int = Field(8, ge=0, le=15)
    stable: int = Field(11, ge=0, le=15)


class LaumasSettings(Settings):
    """A Laumas load-cell transmitter. Second-hand: all of the status bits, the commands and the units word."""

    device_id: int = Field(1, ge=1, le=99)
    weight: Literal["gross", "net"] = "gross"
    count_g: float = Field(0.01, gt=0, le=10, description="one count of a weight register")
    units_word: int = Field(0x010C, ge=0, le=0xFFFF, description="what register 13 says when count_g is right")
    signs: Literal["status", "registers"] = Field("status", description="where the sign of a weight is told")
    filter_samples: int = Field(1, ge=1, le=64, description="samples that the instrument's filter averages")
    tare_command: int = Field(7, ge=0, le=0xFFFF)
    zero_command: int = Field(8, ge=0, le=0xFFFF)
    gross_command: int = Field(9, ge=0, le=0xFFFF)
    bits: StatusBits = StatusBits()


class ForceSettings(Settings):
    """The force sensor; framing and laumas are read for laumas only."""

    kind: Literal["mtsics", "laumas"] = "mtsics"
    port: Port = "/dev/ttyUSB1"
    baud: int = Field(9600, ge=300, le=1_000_000)
    sample_period_s: float = Field(0.05, ge=0.01, le=10)
    latency_s: float = Field(0.0, ge=0, le=2, description="how late a reading is; waited for after every move")
    resolution_gwt: float = Field(0.01, gt=0, le=1, description="one step of what the sensor shows")
    framing: Framing | None = Field(None, description="of Modbus; absent: tcp on a tcp:// port, rtu elsewhere")
    laumas: LaumasSettings = LaumasSettings()


class SyncSettings(Settings):
    """A pulse for the recording amplifier at contact, hold start and hold end; off by default.

    Which register and words switch a drive's output depends on the drive: they have no default.
    """

    output: Literal["off", "coolant", "spindle", "drive"] = Field(
        "off", description="of a GRBL board: M8/M9 or M3/M5; of a Leadshine drive: a digital output"
    )
    width_s: float = Field(0.01, ge=0.001, le=1)
    drive: Literal["x", "z"] = Field("z", description="whose output it is")
    register_address: int | None = Field(
        None, ge=0, le=0x0FFF, description="from the drive's manual; what makes it move lies higher"
    )
    on_word: int | None = Field(None, ge=0, le=0xFFFF)
    off_word: int | None = Field(None, ge=0, le=0xFFFF)

    @property
    def words(self) -> tuple[int, int, int] | None:
        """Register, word for on and word for off, where all are given."""
        if self.register_address is None or self.on_word is None or self.off_word is None:
            return None
        return self.register_address, self.on_word, self.off_word


class FrameSettings(Settings):
    """The finger's frame in machine coordinates (mm)."""

    pad_centre_x_mm: float = Field(-30.0, description="machine X over the centre of the finger pad, x = 0")
    pad_y_mm: float = Field(-15.0, description="machine Y of the receptor plane")
    apex_z_mm: float = Field(-25.0, description="machine Z at which the indentor is level with the pad's apex")
    roll_deg: float = Field(
        0.0, ge=-20, le=20, description="about the finger's axis, as found; turn the holder by it"
    )
    tilt_deg: float = Field(0.0, ge=-20, le=20, description="about x, as found; turn the holder by it")


class LimitSettings(Settings):
    """Refused before a move, or tripped on; DEVICES: software is never the safety function."""

    max_doi_mm: float = Field(1.5, gt=0, le=2.0)
    max_force_gwt: float = Field(100.0, gt=0, le=500)
    search_mm: float = Field(0.5, gt=0, le=1.5, description="below the expected contact; then the sensor is dead")
    soft_trip_n: float = Field(2.0, gt=0, le=5.0, description="cap; lowered to twice the predicted peak")
    hard_trip_n: float = Field(5.0, gt=0, le=5.0, description="whatever was predicted")
    max_pressure_n_cm2: float = Field(30.0, gt=0, le=60.0, description="force over the predicted contact area")
    max_press_speed_mm_s: float = Field(FASTEST_PRESS_MM_S, ge=SLOWEST_MM_S, le=FASTEST_PRESS_MM_S)
    heartbeat_s: float = Field(3.0, ge=0.5, le=60, description="longest silence of the engine below clearance")
    max_contact_s: float = Field(3600.0, gt=0, le=36_000, description="of a run, all its touches together")
    zero_drift_gwt: float = Field(0.03, gt=0, le=10, description="alarm: drift of the zero since the last one")
    reference_band: float = Field(0.15, gt=0, le=1, description="alarm: share by which a reference may differ")
    on_alarm: Literal["warn", "trip"] = "warn"
    on_trip: Literal["stop", "retract", "park"] = Field("retract", description="stop and hold, lift, or lift far")
    x_mm: tuple[float, float] = (-6.0, 6.0)
    along_mm: tuple[float, float] = (-4.0, 4.0)

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

    travel_speed_mm_s: float = Field(5.0, ge=SLOWEST_MM_S, le=10)
    approach_speed_mm_s: float = Field(0.5, ge=SLOWEST_MM_S, le=2)
    press_speed_mm_s: float = Field(1.0, ge=SLOWEST_MM_S, le=FASTEST_PRESS_MM_S)
    clearance_mm: float = Field(2.0, gt=0.2, le=20)
    park_height_mm: float = Field(10.0, gt=0.2, le=40, description="above the apex, where on_trip = park lifts to")
    descent_step_mm: float = Field(0.5, gt=0, le=5, description="between readings on the way down after homing")
    increment_mm: float = Field(0.05, gt=0, le=0.05, description="the longest move below clearance")
    touch_increment_mm: float = Field(0.01, gt=0, le=0.05)
    touch_force_gwt: float = Field(0.05, gt=0, le=1)
    settle_readings: int = Field(1, ge=1, le=20, description="sensor periods between a move and its reading")

    @model_validator(mode="after")
    def _fine_within_coarse(self) -> Self:
        if self.touch_increment_mm > self.increment_mm:
            raise ValueError("touch_increment_mm: expected no more than increment_mm")
        return self


class RigSettings(Settings):
    """All that the engine needs."""

    stage: StageSettings = StageSettings()
    force: ForceSettings = ForceSettings()
    sync: SyncSettings = SyncSettings()
    frame: FrameSettings = FrameSettings()
    limits: LimitSettings = LimitSettings()
    habits: HabitSettings = HabitSettings()
    calibration: CalibrationSettings = CalibrationSettings()

    @model_validator(mode="after")
    def _output_there(self) -> Self:
        allowed = {"grbl": ("off", "coolant", "spindle"), "leadshine": ("off", "drive")}[self.stage.kind]
        if self.sync.output not in allowed:
            raise ValueError(f"sync.output: expected {' or '.join(allowed)} with a {self.stage.kind} stage")
        if self.sync.output == "drive" and self.sync.words is None:
            raise ValueError("sync: expected register_address, on_word and off_word, from the manual of the drive")
        return self
