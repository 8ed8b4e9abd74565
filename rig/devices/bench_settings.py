"""What the devices on a bench must be told: ports, calibrations, outputs, and where the finger lies."""

import datetime
from collections.abc import Callable, Iterator
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, PositiveFloat, model_validator

from rig.transport.port_settings import EIGHT_N_ONE, Character, Framing, Port, Settings

SLOWEST_MM_S = 1 / 60  # GRBL moves no slower, whatever F says
NOMINAL_STEPS_PER_MM = 400.0


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
    character: Character = EIGHT_N_ONE
    dtr: bool = Field(True, description="raised on opening, which resets many boards; false: left low")
    travel_mm: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (60.0, 30.0, 40.0)
    resolution_mm: float = Field(0.0025, gt=0, le=0.05, description="one step of the vertical axis")
    acceleration_mm_s2: float = Field(50.0, gt=0, le=1e4, description="of the vertical axis, for the stop distance")
    framing: Framing | None = Field(None, description="of Modbus; absent: tcp on a tcp:// port, rtu elsewhere")
    drives: DrivesSettings = DrivesSettings()

    @property
    def ports(self) -> tuple[str, ...]:
        """Every port that the stage is on: its own, or those of its drives."""
        if self.kind == "leadshine":
            return tuple(dict.fromkeys(drive.port or self.port for drive in (self.drives.x, self.drives.z)))
        return (self.port,)

    @property
    def moves_along(self) -> bool:
        """Whether there is an axis along the finger."""
        return self.kind != "leadshine"

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
    character: Character = EIGHT_N_ONE
    dtr: bool = Field(True, description="raised on opening; false: left low")
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


_OUTPUTS = {"grbl": ("off", "coolant", "spindle"), "leadshine": ("off", "drive")}


class FrameSettings(Settings):
    """The finger's frame in machine coordinates (mm)."""

    pad_centre_x_mm: float = Field(-30.0, description="machine X over the centre of the finger pad, x = 0")
    pad_y_mm: float = Field(-15.0, description="machine Y of the receptor plane")
    apex_z_mm: float = Field(-25.0, description="machine Z at which the indentor is level with the pad's apex")
    roll_deg: float = Field(
        0.0, ge=-20, le=20, description="about the finger's axis, as found; turn the holder by it"
    )
    tilt_deg: float = Field(0.0, ge=-20, le=20, description="about x, as found; turn the holder by it")


class BenchSettings(Settings):
    """All that the devices need."""

    stage: StageSettings = StageSettings()
    force: ForceSettings = ForceSettings()
    sync: SyncSettings = SyncSettings()
    frame: FrameSettings = FrameSettings()
    calibration: CalibrationSettings = CalibrationSettings()

    @model_validator(mode="after")
    def _output_there(self) -> Self:
        allowed = _OUTPUTS.get(self.stage.kind, ("off",))
        if self.sync.output not in allowed:
            raise ValueError(f"sync.output: expected {' or '.join(allowed)} with a {self.stage.kind} stage")
        if self.sync.output == "drive" and self.sync.words is None:
            raise ValueError("sync: expected register_address, on_word and off_word, from the manual of the drive")
        return self
