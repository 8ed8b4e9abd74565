"""What the devices on a bench must be told: ports, calibrations, outputs, and where the finger lies."""

import datetime
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, PositiveFloat, SerializeAsAny, model_validator

from rig.devices.registry import DEFAULTS, DeviceSettings, ForceKind, Kind, StageKind, find, known
from rig.errors import RuleError
from rig.settings import EIGHT_N_ONE, Character, DrivesSettings, Framing, LaumasSettings, Port, Settings, StopSettings

SLOWEST_MM_S = 1 / 60  # GRBL moves no slower, whatever F says
NOMINAL_STEPS_PER_MM = 400.0


class Calibration(Settings):
    """A number measured on this rig, the day it was measured, and the last day it may be used."""

    value: float = Field(description="the number, in the unit of its key")
    sd: float = Field(0.0, ge=0, description="standard deviation of the value, where it is known")
    date: datetime.date = Field(description="the day it was measured")
    expires: datetime.date = Field(
        description="the last day it may be used: `rig run` refuses it after that, a dry-run warns"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.expires < self.date:
            raise RuleError("expires: expected a day not before date", code="expires_before_date")
        return self


def _measured(allowed: Callable[[float], bool], expected: str) -> AfterValidator:
    def check(calibration: Calibration) -> Calibration:
        if not allowed(calibration.value):
            raise RuleError(
                "value = {given:g}: expected {expected}",
                code="impossible_value",
                given=calibration.value,
                expected=expected,
            )
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

    x_steps_per_mm: _StepsPerMm | None = Field(
        None, description="steps (pulses of a drive) a millimetre; negative where the motor runs against the axis"
    )
    y_steps_per_mm: _StepsPerMm | None = Field(None, description="the same along the finger")
    z_steps_per_mm: _StepsPerMm | None = Field(None, description="the same of the vertical axis")
    x_backlash_mm: _Length | None = Field(
        None, description="lost motion when the axis turns round; each move makes up for it"
    )
    y_backlash_mm: _Length | None = Field(None, description="the same along the finger")
    z_backlash_mm: _Length | None = Field(None, description="the same of the vertical axis")
    force_scale: _Scale | None = Field(
        None, description="true force over the force read; every reading is multiplied by it"
    )
    compliance_mm_per_n: _Length | None = Field(
        None, description="how far the rig itself gives under a force; a press goes so much further"
    )

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


class StageSettings(DeviceSettings):
    """The motorised stage; framing is read for Modbus only, drives for leadshine only, and both stand in any file."""

    kinds: ClassVar[type[Kind]] = StageKind
    kind: Annotated[str, known(StageKind)] = Field(DEFAULTS["stage"], description="which device it is")
    port: Port = Field("/dev/ttyUSB0", description="a serial port or tcp://HOST:PORT")
    baud: int = Field(115200, ge=300, le=1_000_000, description="bits a second of a serial port")
    character: Character = Field(EIGHT_N_ONE, description="data bits, parity and stop bits of a serial port")
    dtr: bool = Field(True, description="raised on opening, which resets many boards; false: left low")
    travel_mm: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = Field(
        (60.0, 30.0, 40.0),
        description="how far each axis can go from home, x, y and z; nothing is planned or moved beyond",
    )
    resolution_mm: float = Field(
        0.0025, gt=0, le=0.05, description="one step of the vertical axis; a depth is no finer"
    )
    acceleration_mm_s2: float = Field(
        50.0, gt=0, le=1e4, description="of the vertical axis; the stop distance comes from it"
    )
    framing: Framing | None = Field(None, description="of Modbus; absent: tcp on a tcp:// port, rtu elsewhere")
    drives: DrivesSettings = DrivesSettings()

    @property
    def entry(self) -> StageKind:
        """Its kind, in the catalogue."""
        return find(StageKind, self.kind)

    @property
    def ports(self) -> tuple[str, ...]:
        """Every port that the stage is on."""
        return self.entry.ports(self)

    @property
    def moves_along(self) -> bool:
        """Whether there is an axis along the finger."""
        return "y" in self.entry.axes

    @model_validator(mode="after")
    def _told_apart(self) -> Self:
        x, z = self.drives.x, self.drives.z
        if x.device_id == z.device_id and (x.port or self.port) == (z.port or self.port):
            raise RuleError("drives.x and drives.z: expected different device ids on one port", code="one_id_for_two")
        return self


class ForceSettings(DeviceSettings):
    """The force sensor; framing is read for Modbus only, laumas for laumas only, and both stand in any file."""

    kinds: ClassVar[type[Kind]] = ForceKind
    kind: Annotated[str, known(ForceKind)] = Field(DEFAULTS["force"], description="which device it is")
    port: Port = Field("/dev/ttyUSB1", description="a serial port or tcp://HOST:PORT")
    baud: int = Field(9600, ge=300, le=1_000_000, description="bits a second of a serial port")
    character: Character = Field(EIGHT_N_ONE, description="data bits, parity and stop bits of a serial port")
    dtr: bool = Field(True, description="raised on opening; false: left low")
    sample_period_s: float = Field(
        0.05,
        ge=0.01,
        le=10,
        description="time from one sample of the sensor to the next; a reading after a move waits for it",
    )
    latency_s: float = Field(0.0, ge=0, le=2, description="how late a reading is; waited for after every move")
    resolution_gwt: float = Field(
        0.01, gt=0, le=1, description="one step of what the sensor shows; contact is no finer"
    )
    framing: Framing | None = Field(None, description="of Modbus; absent: tcp on a tcp:// port, rtu elsewhere")
    laumas: LaumasSettings = LaumasSettings()


class SyncSettings(Settings):
    """A pulse for the recording amplifier at contact, hold start and hold end; off by default.

    Which register and words switch a drive's output depends on the drive: they have no default.
    """

    output: Literal["off", "coolant", "spindle", "drive"] = Field(
        "off", description="where the pulse comes out: M8/M9 or M3/M5 of a GRBL board, an output of a Leadshine drive"
    )
    width_s: float = Field(0.01, ge=0.001, le=1, description="how long the pulse lasts")
    drive: Literal["x", "z"] = Field("z", description="whose output it is")
    register_address: int | None = Field(
        None,
        ge=0,
        le=0x0FFF,
        description="of the output, from the drive's manual; what makes the drive move lies higher",
    )
    on_word: int | None = Field(
        None, ge=0, le=0xFFFF, description="what switches the output on, from the drive's manual"
    )
    off_word: int | None = Field(None, ge=0, le=0xFFFF, description="what switches it off, from the drive's manual")

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


@dataclass(frozen=True)
class StageBounds:
    """What no motion of the rig needs to go beyond, for a controller that can enforce it.

    Attributes
    ----------
    lowest_z_mm : float
        The lowest position of the vertical axis, machine mm.
    fastest_mm_s : float
        The highest speed of any axis, mm/s.
    """

    lowest_z_mm: float
    fastest_mm_s: float


class BenchSettings(Settings):
    """All that the devices need."""

    stage: SerializeAsAny[StageSettings] = StageSettings()
    force: SerializeAsAny[ForceSettings] = ForceSettings()
    sync: SyncSettings = SyncSettings()
    stop: StopSettings = StopSettings()
    frame: FrameSettings = FrameSettings()
    calibration: CalibrationSettings = CalibrationSettings()

    @property
    def bounds(self) -> StageBounds | None:
        """What the stage's controller may enforce; None where no limits are known."""
        return None

    @model_validator(mode="after")
    def _output_there(self) -> Self:
        allowed = self.stage.entry.outputs
        if self.sync.output not in allowed:
            raise RuleError(
                "sync.output: expected {allowed} with a {stage} stage",
                code="no_such_output",
                allowed=" or ".join(allowed),
                stage=self.stage.kind,
            )
        if self.sync.output == "drive" and self.sync.words is None:
            raise RuleError(
                "sync: expected register_address, on_word and off_word, from the manual of the drive",
                code="incomplete_sync",
            )
        return self

    @model_validator(mode="after")
    def _inputs_there(self) -> Self:
        allowed = self.stage.entry.inputs
        for key, name in self.stop.inputs.items():
            if name not in allowed:
                either = " or ".join(allowed) or "no input, none is reported"
                raise RuleError(
                    "stop.{setting} = {input!r}: expected {allowed} with a {stage} stage",
                    code="no_such_input",
                    setting=key,
                    input=name,
                    allowed=either,
                    stage=self.stage.kind,
                )
        return self
