"""Every table that the rig reads of a configuration: devices, calibration, limits, habits. Unknown keys are errors.

A kind of device is a name here. What depends on it (is there such a kind, its own table, its axes, ports, outputs and
inputs) the registry says, which checks a configuration where it is made: `rig/devices/registry.py: KnownBench`.
"""

import datetime
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    PrivateAttr,
    SerializeAsAny,
    model_validator,
)

from rig.errors import RuleError

Framing = Literal["rtu", "tcp"]
EIGHT_N_ONE = "8N1"

SLOWEST_MM_S = 1 / 60  # GRBL moves no slower, whatever F says
FASTEST_PRESS_MM_S = 5.0
NOMINAL_STEPS_PER_MM = 400.0


class Settings(BaseModel):
    """Base class of a table of the configuration file.

    Unknown keys, wrong types and NaN are errors.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _addressed(port: str) -> str:
    if not port.strip() or (port.startswith("tcp://") and not re.fullmatch(r"tcp://[^/]+:\d{1,5}", port)):
        raise RuleError("expected tcp://HOST:PORT or the name of a serial port", code="no_port_name")
    return port


def _spelled(character: str) -> str:
    if not re.fullmatch(r"[78][NEO][12]", character):
        raise RuleError("expected data bits, parity and stop bits, such as 8N1 or 7E1", code="no_character")
    return character


Character = Annotated[str, AfterValidator(_spelled)]
"""Data bits, parity (none, even, odd) and stop bits of a serial line."""

Port = Annotated[str, AfterValidator(_addressed)]


class StatusBits(Settings):
    """Bits of a Laumas status word.

    They are second-hand for TLB and TLU: as printed in the manual of the LCB.
    """

    cell_error: int = Field(0, ge=0, le=15, description="bit of a cell that is broken or not connected")
    converter_error: int = Field(1, ge=0, le=15, description="bit of a converter that failed")
    over_max: int = Field(2, ge=0, le=15, description="bit of a weight above the largest one set")
    over_full_scale: int = Field(3, ge=0, le=15, description="bit of a weight above full scale")
    gross_out_of_range: int = Field(4, ge=0, le=15, description="bit of a gross weight out of range")
    net_out_of_range: int = Field(5, ge=0, le=15, description="bit of a net weight out of range")
    gross_negative: int = Field(7, ge=0, le=15, description="bit of a negative gross weight")
    net_negative: int = Field(8, ge=0, le=15, description="bit of a negative net weight")
    stable: int = Field(11, ge=0, le=15, description="bit of a weight at rest")


class LaumasSettings(Settings):
    """Settings of a Laumas load-cell transmitter.

    The status bits, the commands and the units word are second-hand.
    """

    device_id: int = Field(1, ge=1, le=99, description="its Modbus address")
    weight: Literal["gross", "net"] = Field(
        "gross", description="which weight is read: gross is zeroed, net is tared"
    )
    count_g: float = Field(0.01, gt=0, le=10, description="one count of a weight register")
    units_word: int = Field(0x010C, ge=0, le=0xFFFF, description="what register 13 says when count_g is right")
    signs: Literal["status", "registers"] = Field("status", description="where the sign of a weight is told")
    filter_samples: int = Field(
        1, ge=1, le=64, description="samples that the instrument's filter averages; waited for after every move"
    )
    tare_command: int = Field(7, ge=0, le=0xFFFF, description="written to tare; second-hand")
    zero_command: int = Field(8, ge=0, le=0xFFFF, description="written to zero; second-hand")
    gross_command: int = Field(9, ge=0, le=0xFFFF, description="written to show the gross weight again; second-hand")
    bits: StatusBits = StatusBits()


class DriveSettings(Settings):
    """Settings of one Leadshine drive.

    They are second-hand, not from the maker's manual: verify them before the drive moves.
    """

    device_id: int = Field(ge=1, le=31, description="its Modbus address")
    port: Port | None = Field(None, description="its own, where it does not share the stage's")
    pulses_per_rev: int = Field(
        400, ge=200, le=51200, description="pulses a turn; what the drive says must be the same"
    )
    pulses_per_rev_register: int = Field(0x0001, ge=0, le=0xFFFF, description="where the drive says it; second-hand")
    ramp_ms: int = Field(333, ge=1, le=10_000, description="acceleration and deceleration as the drive takes them")
    ramp_rpm: float = Field(1000.0, gt=0, description="a ramp is told in ms for this many rpm; second-hand")
    homing_mode: int = Field(0x0001, ge=0, le=0xFFFF, description="as in the drive's manual; second-hand")
    homing_high_rpm: int = Field(300, ge=1, le=600, description="speed towards the home switch")
    homing_low_rpm: int = Field(25, ge=1, le=100, description="speed back to its edge")
    homing_ramp_ms: int = Field(333, ge=1, le=10_000, description="acceleration and deceleration while homing")
    jog_rpm_register: int = Field(
        0x01E1, ge=0, le=0xFFFF, description="where the speed of a jog is told; second-hand"
    )


class DrivesSettings(Settings):
    """Settings of the drives of a stage without a board.

    x is lateral and z vertical; y stays where it was set by hand.
    """

    x: DriveSettings = DriveSettings(device_id=1)
    z: DriveSettings = DriveSettings(device_id=2)


def _said(text: str) -> str:
    if not text.strip():
        raise RuleError("expected a name", code="no_name")
    return text


Name = Annotated[str, AfterValidator(_said)]


class StopSettings(Settings):
    """Settings of the participant's stop button, and of the relay that stops the stage without the program."""

    kind: Literal["off", "board", "key"] = Field(
        "off",
        description="the participant's stop button: off, an input of the stage's controller, or a USB key or switch",
    )
    input: Name | None = Field(
        None, description="kind = board: which input of the controller, door or hold (GRBL), di1 … di7 (Leadshine)"
    )
    device: Name | None = Field(
        None, description="kind = key: its file below /dev/input/by-id, which this program then has for itself"
    )
    key_code: int | None = Field(
        None, ge=1, le=767, description="kind = key: only this key of the device, by its Linux code; absent: any"
    )
    trip_input: Name | None = Field(
        None, description="input of the controller that the force transmitter's relay is wired to; absent: none is"
    )
    trip_gwt: float | None = Field(
        None, gt=0, le=2000, description="set-point of that relay; a transmitter that can report its own must agree"
    )
    trip_register: int = Field(
        16,
        ge=0,
        le=0xFFFF,
        description="register of the set-point of a Laumas transmitter (two words); second-hand, see its manual",
    )
    inputs_register: int = Field(
        0x0179,
        ge=0,
        le=0xFFFF,
        description="register of the digital inputs of a Leadshine drive, DI1 lowest; second-hand, see its manual",
    )

    @property
    def inputs(self) -> dict[str, str]:
        """Inputs of the controller that are used, by the key that names them."""
        found = {"input": self.input, "trip_input": self.trip_input}
        return {key: name for key, name in found.items() if name is not None}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        for kind, key in (("board", "input"), ("key", "device")):
            if self.kind == kind and getattr(self, key) is None:
                raise RuleError(
                    "{setting}: expected with kind = {kind!r}", code="expected_with_kind", setting=key, kind=kind
                )
            if self.kind != kind and getattr(self, key) is not None:
                raise RuleError(
                    "{setting}: expected with kind = {kind!r} only",
                    code="expected_with_kind_only",
                    setting=key,
                    kind=kind,
                )
        if self.key_code is not None and self.kind != "key":
            raise RuleError(
                "{setting}: expected with kind = {kind!r} only",
                code="expected_with_kind_only",
                setting="key_code",
                kind="key",
            )
        if self.trip_gwt is not None and self.trip_input is None:
            raise RuleError("trip_gwt: expected with trip_input only", code="no_trip_input")
        if self.trip_input is not None and self.trip_input == self.input:
            raise RuleError(
                "trip_input: expected another input than the participant's button", code="input_used_twice"
            )
        return self


class Calibration(Settings):
    """A number measured on this rig, the day of the measurement, and the last day on which it may be used."""

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
    """Calibrations of this rig; an absent key was not measured."""

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
        """Yield every calibration.

        Yields
        ------
        tuple of str and Calibration
            The key and the calibration.
        """
        for name in type(self).model_fields:
            calibration = getattr(self, name)
            if calibration is not None:
                yield name, calibration

    def value(self, name: str, otherwise: float) -> float:
        """Return a measured number, or another one where nothing was measured.

        Parameters
        ----------
        name : str
            Key of the calibration.
        otherwise : float
            Number to return if there is no calibration.

        Returns
        -------
        float
            The number, in the unit of its key.
        """
        calibration: Calibration | None = getattr(self, name)
        return otherwise if calibration is None else calibration.value

    def expired(self, day: datetime.date) -> list[str]:
        """Return the calibrations that have expired.

        Parameters
        ----------
        day : datetime.date
            The day on which they would be used.

        Returns
        -------
        list of str
            Their keys.
        """
        return [name for name, calibration in self.measured() if calibration.expires < day]


T = TypeVar("T", bound=Settings)


class DeviceSettings(Settings):
    """Base class of [stage] and [force]; the registry adds the table of a package's kind."""

    room: ClassVar[Literal["stage", "force"]]
    kind: str = Field(description="which device it is")
    _place: str = PrivateAttr("")  # of the kind's own table; the registry says it

    def own(self, table: type[T]) -> T:
        """Return the kind's own table.

        Parameters
        ----------
        table : type of Settings
            Class of the table.

        Returns
        -------
        Settings
            The table.

        Raises
        ------
        TypeError
            If the kind has no such table.
        """
        found = getattr(self, self._place, None)
        if not isinstance(found, table):
            raise TypeError(f"{self.kind} has no {table.__name__}")
        return found


class StageSettings(DeviceSettings):
    """Settings of the stage.

    Only Modbus uses `framing`, and only `leadshine` uses `drives`; both may stand in any file.
    """

    room: ClassVar[Literal["stage", "force"]] = "stage"
    kind: str = Field("grbl", description="which device it is")
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

    @model_validator(mode="after")
    def _told_apart(self) -> Self:
        x, z = self.drives.x, self.drives.z
        if x.device_id == z.device_id and (x.port or self.port) == (z.port or self.port):
            raise RuleError("drives.x and drives.z: expected different device ids on one port", code="one_id_for_two")
        return self


class ForceSettings(DeviceSettings):
    """Settings of the force sensor.

    Only Modbus uses `framing`, and only `laumas` uses `laumas`; both may stand in any file.
    """

    room: ClassVar[Literal["stage", "force"]] = "force"
    kind: str = Field("mtsics", description="which device it is")
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
    """Settings of the pulse for the recording amplifier at contact, hold start and hold end; off by default.

    The register and the words that switch a drive's output depend on the drive: they have no default.
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
        """Register, word for on and word for off, or None unless all are set."""
        if self.register_address is None or self.on_word is None or self.off_word is None:
            return None
        return self.register_address, self.on_word, self.off_word


class FrameSettings(Settings):
    """Position of the finger in machine coordinates (mm)."""

    pad_centre_x_mm: float = Field(-30.0, description="machine X over the centre of the finger pad, x = 0")
    pad_y_mm: float = Field(-15.0, description="machine Y of the receptor plane")
    apex_z_mm: float = Field(-25.0, description="machine Z at which the indentor is level with the pad's apex")
    roll_deg: float = Field(
        0.0, ge=-20, le=20, description="about the finger's axis, as found; turn the holder by it"
    )
    tilt_deg: float = Field(0.0, ge=-20, le=20, description="about x, as found; turn the holder by it")


@dataclass(frozen=True)
class StageBounds:
    """Bounds of every motion of the rig, for a controller that can enforce them.

    Attributes
    ----------
    lowest_z_mm : float
        Lowest position of the vertical axis, in machine coordinates (mm).
    fastest_mm_s : float
        Highest speed of any axis (mm/s).
    """

    lowest_z_mm: float
    fastest_mm_s: float


class LimitSettings(Settings):
    """Limits that refuse a step before a move, and forces that trip; software is never the safety function."""

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


class BenchSettings(Settings):
    """Settings of the devices."""

    stage: SerializeAsAny[StageSettings] = StageSettings()
    force: SerializeAsAny[ForceSettings] = ForceSettings()
    sync: SyncSettings = SyncSettings()
    stop: StopSettings = StopSettings()
    frame: FrameSettings = FrameSettings()
    calibration: CalibrationSettings = CalibrationSettings()

    @property
    def bounds(self) -> StageBounds | None:
        """Bounds that the stage's controller may enforce; None where no limits are known."""
        return None


class RigSettings(BenchSettings):
    """Settings of the engine and the devices."""

    limits: LimitSettings = LimitSettings()
    habits: HabitSettings = HabitSettings()

    @property
    def bounds(self) -> StageBounds:
        """Bounds that the stage's controller may enforce, a floor below the deepest press and the highest speed."""
        limits = self.limits
        given_mm = self.calibration.value("compliance_mm_per_n", 0.0) * limits.soft_trip_n
        floor_mm = self.frame.apex_z_mm - limits.fall_mm - limits.search_mm - limits.max_doi_mm - given_mm
        return StageBounds(
            lowest_z_mm=max(floor_mm, -self.stage.travel_mm[2]),
            fastest_mm_s=max(self.habits.travel_speed_mm_s, limits.max_press_speed_mm_s),
        )

    @property
    def floor(self) -> str:
        """Lowest height of the stage, in words."""
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
