"""Tables of a configuration that the rig reads: devices, calibration, limits, habits. Unknown keys are errors.

The type of a device is only a name here. The device registry checks what depends on it, its own table, axes, ports,
outputs and inputs: `rig/devices/registry.py: KnownBench`.
"""

import datetime
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PositiveFloat,
    PrivateAttr,
    SerializeAsAny,
    field_validator,
    model_validator,
)

from rig.errors import RuleError

Framing = Literal["rtu", "tcp"]
EIGHT_N_ONE = "8N1"

ZERO_LIFT_MM = 0.3
"""Lift after a zero, which must not change the force (mm)."""
SLOWEST_MM_S = 1 / 60  # GRBL moves no slower, whatever F says
FASTEST_PRESS_MM_S = 5.0
NOMINAL_STEPS_PER_MM = 400.0


class Settings(BaseModel):
    """Base class of a table of the configuration file.

    Unknown keys, wrong types and NaN are errors. A whole number counts as a number; nothing else is converted.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    @field_validator("*", mode="before")
    @classmethod
    def _rows(cls, value: Any) -> Any:
        return as_tuples(value)


def as_tuples(value: Any) -> Any:
    """Return a value of a file with tuples in place of lists, also in tables and rows."""
    if isinstance(value, list):
        return tuple(map(as_tuples, value))
    return {key: as_tuples(one) for key, one in value.items()} if isinstance(value, dict) else value


def _addressed(port: str) -> str:
    over_ip = port.startswith(("tcp://", "udp://"))
    no_scheme = re.fullmatch(r"[^/:]+:\d{1,5}", port)  # a host and its port; a serial port has no such name
    if not port.strip() or no_scheme or (over_ip and not re.fullmatch(r"(tcp|udp)://[^/]+:\d{1,5}", port)):
        raise RuleError(
            "not a port; use tcp://HOST:PORT, udp://HOST:PORT or a serial port, such as /dev/ttyUSB0 or COM3",
            "no_port_name",
        )
    return port


def _spelled(character: str) -> str:
    if not re.fullmatch(r"[78][NEO][12]", character):
        raise RuleError(
            "not a character format; give data bits, parity and stop bits, such as 8N1 or 7E1", "no_character"
        )
    return character


_LINE_OF_ADAPTER = re.compile(r"(rts|dtr):(.+)")


def _an_output(output: str) -> str:
    found = _LINE_OF_ADAPTER.fullmatch(output)
    if found is None and output not in ("off", "coolant", "spindle", "drive"):
        raise RuleError("must be off, coolant, spindle, drive, rts:PORT or dtr:PORT", "no_such_output")
    if found is not None and _addressed(found[2]).startswith(("tcp://", "udp://", "socket://")):
        raise RuleError(
            f"{found[2]} has no {found[1].upper()} line; use the port of a serial adapter, such as "
            f"{found[1]}:/dev/ttyUSB1",
            "no_adapter",
        )
    return output


Character = Annotated[str, AfterValidator(_spelled)]
"""Data bits, parity (none, even, odd) and stop bits of a serial line."""

Port = Annotated[str, AfterValidator(_addressed)]


class StatusBits(Settings):
    """Bits of a Laumas status word.

    They are second-hand for TLB and TLU: as printed in the manual of the LCB.
    """

    cell_error: int = Field(0, ge=0, le=15, description="status bit: load cell broken or not connected")
    converter_error: int = Field(1, ge=0, le=15, description="status bit: analog-to-digital converter failed")
    over_max: int = Field(2, ge=0, le=15, description="status bit: weight above the maximum set in the transmitter")
    over_full_scale: int = Field(3, ge=0, le=15, description="status bit: weight above full scale")
    gross_out_of_range: int = Field(4, ge=0, le=15, description="status bit: gross weight out of range")
    net_out_of_range: int = Field(5, ge=0, le=15, description="status bit: net weight out of range")
    gross_negative: int = Field(7, ge=0, le=15, description="status bit: gross weight negative")
    net_negative: int = Field(8, ge=0, le=15, description="status bit: net weight negative")
    stable: int = Field(11, ge=0, le=15, description="status bit: weight stable")


class LaumasSettings(Settings):
    """Settings of a Laumas load-cell transmitter.

    The status bits, the commands and the units word are second-hand.
    """

    device_id: int = Field(1, ge=1, le=99, description="Modbus address of the transmitter")
    weight: Literal["gross", "net"] = Field("gross", description="weight that is read; gross is zeroed, net is tared")
    count_g: float = Field(0.01, gt=0, le=10, description="weight of one count of a weight register, in g")
    units_word: int = Field(
        0x010C, ge=0, le=0xFFFF, description="content of register 13 that agrees with count_g; checked on connecting"
    )
    signs: Literal["status", "registers"] = Field(
        "status", description="source of the sign of a weight: the status word, or signed registers"
    )
    filter_samples: int = Field(
        1,
        ge=1,
        le=64,
        description="samples averaged by the transmitter's filter; the rig waits for them after every move",
    )
    tare_command: int = Field(
        7, ge=0, le=0xFFFF, description="command word that tares; not from the maker's manual, check it"
    )
    zero_command: int = Field(
        8, ge=0, le=0xFFFF, description="command word that zeroes; not from the maker's manual, check it"
    )
    gross_command: int = Field(
        9,
        ge=0,
        le=0xFFFF,
        description="command word that returns to the gross weight; not from the maker's manual, check it",
    )
    bits: StatusBits = StatusBits()


class DriveSettings(Settings):
    """Settings of one Leadshine drive.

    They are second-hand, not from the maker's manual: verify them before the drive moves.
    """

    device_id: int = Field(ge=1, le=31, description="Modbus address of the drive")
    port: Port | None = Field(
        None, description="port of this drive: a serial port or tcp://HOST:PORT; absent: the port of the stage"
    )
    pulses_per_rev: int = Field(
        400, ge=200, le=51200, description="pulses per turn of the motor; must equal the setting stored in the drive"
    )
    pulses_per_rev_register: int = Field(
        0x0001,
        ge=0,
        le=0xFFFF,
        description="register that holds the pulses per turn; not from the maker's manual, check it",
    )
    ramp_ms: int = Field(
        333, ge=1, le=10_000, description="acceleration and deceleration time of moves, in ms per ramp_rpm"
    )
    ramp_rpm: float = Field(
        1000.0,
        gt=0,
        description="speed change that the ramp times refer to, in rpm; not from the maker's manual, check it",
    )
    homing_mode: int = Field(
        0x0001, ge=0, le=0xFFFF, description="homing mode word of the drive; not from the maker's manual, check it"
    )
    homing_high_rpm: int = Field(300, ge=1, le=600, description="homing speed towards the switch, in rpm")
    homing_low_rpm: int = Field(25, ge=1, le=100, description="homing speed back to the edge of the switch, in rpm")
    homing_ramp_ms: int = Field(
        333, ge=1, le=10_000, description="acceleration and deceleration time of homing, in ms per ramp_rpm"
    )
    jog_rpm_register: int = Field(
        0x01E1,
        ge=0,
        le=0xFFFF,
        description="register that holds the jog speed; not from the maker's manual, check it",
    )


class DrivesSettings(Settings):
    """Settings of the drives of a stage without a board.

    x is lateral and z vertical; y stays where it was set by hand.
    """

    x: DriveSettings = DriveSettings(device_id=1)
    z: DriveSettings = DriveSettings(device_id=2)


class ZaberAxisSettings(Settings):
    """Settings of one axis of a Zaber chain."""

    address: int = Field(ge=1, le=99, description="address of the device in the chain")
    axis: int = Field(1, ge=1, le=9, description="number of the axis of that device")
    microstep_um: float = Field(
        2.5,
        gt=0,
        le=10,
        description="length of one microstep, from the stage's data sheet; a calibration of steps_per_mm replaces it",
    )
    resolution: int = Field(
        64,
        ge=1,
        le=256,
        description="microsteps per full step for which microstep_um holds; compared with the device",
    )
    encoder: bool = Field(False, description="read the position from the encoder instead of the motor's step counter")


class ZaberSettings(Settings):
    """Settings of two Zaber axes.

    x is lateral and z vertical; y stays where it was set by hand. The two units are second-hand.
    """

    x: ZaberAxisSettings = ZaberAxisSettings(address=1)
    z: ZaberAxisSettings = ZaberAxisSettings(address=2)
    speed_unit: float = Field(
        1.6384,
        gt=0,
        description="native speed for one microstep per second; not from the maker's manual, check it",
    )
    acceleration_unit: float = Field(
        1.6384e-4,
        gt=0,
        description="native acceleration for one microstep per second squared; not from the maker's manual, check it",
    )

    @model_validator(mode="after")
    def _axes_are_distinct(self) -> Self:
        if (self.x.address, self.x.axis) == (self.z.address, self.z.axis):
            raise RuleError("x and z: same address and axis; give each its own", "one_axis_for_two")
        return self


class StandaAxisSettings(Settings):
    """Settings of one axis with a Standa controller."""

    step_um: float = Field(
        10.0,
        gt=0,
        le=100,
        description="length of a full step, from the stage's data sheet; a calibration of steps_per_mm replaces it",
    )
    microsteps: int = Field(
        256, ge=1, le=256, description="microsteps per full step, a power of two; compared with the controller"
    )
    home: Literal["left", "right"] = Field(
        "left",
        description="limit switch to which the axis homes, as in the controller's home flags; for z the upper one",
    )
    serial: int | None = Field(
        None,
        ge=0,
        description=(
            "serial number of the controller, compared with it; required for ports whose names change, such as "
            "/dev/ttyACM0"
        ),
    )

    @field_validator("microsteps")
    @classmethod
    def _is_power_of_two(cls, value: int) -> int:
        if value & (value - 1):
            raise RuleError(f"{value}: must be a power of two", "no_power_of_two")
        return value


class StandaSettings(Settings):
    """Settings of two Standa controllers, that of z on the port of the stage.

    x is lateral and z vertical; y stays where it was set by hand.
    """

    x_port: Port = Field(
        "/dev/ttyACM1", description="port of the controller of the x axis: a serial port or tcp://HOST:PORT"
    )
    x: StandaAxisSettings = StandaAxisSettings()
    z: StandaAxisSettings = StandaAxisSettings()


class TmclAxisSettings(Settings):
    """Settings of one motor of a Trinamic module."""

    address: int = Field(1, ge=1, le=255, description="address of the module")
    motor: int = Field(ge=0, le=5, description="number of the motor of that module")
    microstep_um: float = Field(
        2.5,
        gt=0,
        le=10,
        description="length of one microstep, in µm; a calibration of steps_per_mm replaces it",
    )
    resolution: int = Field(
        8,
        ge=0,
        le=8,
        description="microstep resolution of the module, 8 for 256 microsteps per step; compared with parameter 140",
    )
    home_switch: Literal["left", "right"] = Field(
        "left", description="switch at the home position; with left, the module counts upwards away from home"
    )
    far_switch: bool = Field(True, description="whether the other switch is wired; if it is active, the stage trips")
    search_mode: int = Field(
        1,
        ge=1,
        le=255,
        description=(
            "mode of the reference search, compared with parameter 193; 65 for a right switch; not from the maker's "
            "manual, check it"
        ),
    )
    home_speed_mm_s: float = Field(
        5.0, gt=0, le=20, description="maximum speed set before the reference search, in mm/s"
    )


class TmclSettings(Settings):
    """Settings of two motors of Trinamic modules.

    x is lateral and z vertical; y stays where it was set by hand. Units and flags differ between modules.
    """

    x: TmclAxisSettings = TmclAxisSettings(motor=0)
    z: TmclAxisSettings = TmclAxisSettings(motor=1)
    host_address: int = Field(2, ge=1, le=255, description="address to which the modules reply")
    speed_unit: float = Field(
        1.0,
        gt=0,
        description="the module's speed for one microstep per second; not from the maker's manual, check it",
    )
    acceleration_unit: float = Field(
        1.0,
        gt=0,
        description=(
            "the module's acceleration for one microstep per second squared; not from the maker's manual, check it"
        ),
    )
    lost_steps_parameter: int = Field(
        207,
        ge=0,
        le=255,
        description="axis parameter with flags of lost steps, 0: none; not from the maker's manual, check it",
    )
    fault_parameter: int = Field(
        208,
        ge=0,
        le=255,
        description="axis parameter with flags of the motor driver, 0: none; not from the maker's manual, check it",
    )
    fault_mask: int = Field(
        0x1A,
        ge=0,
        le=0xFFFF,
        description="flags of fault_parameter that trip; not from the maker's manual, check it",
    )

    @model_validator(mode="after")
    def _motors_are_distinct(self) -> Self:
        if (self.x.address, self.x.motor) == (self.z.address, self.z.motor):
            raise RuleError("x and z: same address and motor; give each its own", "one_axis_for_two")
        return self


def _not_empty(text: str) -> str:
    if not text.strip():
        raise RuleError("the name is empty; give a name", "no_name")
    return text


Name = Annotated[str, AfterValidator(_not_empty)]


class StopSettings(Settings):
    """Settings of the participant's stop button, and of the relay that stops the stage without the program."""

    kind: Literal["off", "board", "key"] = Field(
        "off",
        description=(
            "participant's stop button: none (off), input of the stage's controller (board), or USB key or "
            "switch (key)"
        ),
    )
    input: Name | None = Field(
        None, description="with kind = board: input of the controller, door or hold (GRBL), di1 … di7 (Leadshine)"
    )
    device: Name | None = Field(
        None,
        description="with kind = key: name of its file in /dev/input/by-id; no other program can use it during a run",
    )
    key_code: int | None = Field(
        None,
        ge=1,
        le=767,
        description="with kind = key: Linux code of the only key that stops; absent: any key of the device",
    )
    trip_input: Name | None = Field(
        None,
        description=(
            "input of the controller that is wired to the relay of the force transmitter; absent: no hardware trip"
        ),
    )
    trip_gwt: float | None = Field(
        None,
        gt=0,
        le=2000,
        description="set-point of the relay, in gwt; must equal the one that the transmitter reports",
    )
    trip_register: int = Field(
        16,
        ge=0,
        le=0xFFFF,
        description=(
            "register of the set-point of a Laumas transmitter (two words); not from the maker's manual, check it"
        ),
    )
    inputs_register: int = Field(
        0x0179,
        ge=0,
        le=0xFFFF,
        description=(
            "register of a Leadshine drive's digital inputs, DI1 = lowest bit; not from the maker's manual, check it"
        ),
    )

    @property
    def inputs(self) -> dict[str, str]:
        """Inputs of the controller that are in use, by configuration key."""
        found = {"input": self.input, "trip_input": self.trip_input}
        return {key: name for key, name in found.items() if name is not None}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        for kind, key in (("board", "input"), ("key", "device")):
            if self.kind == kind and getattr(self, key) is None:
                raise RuleError(f"{key}: required with kind = {kind!r}", "expected_with_kind")
            if self.kind != kind and getattr(self, key) is not None:
                raise RuleError(f"{key}: allowed only with kind = {kind!r}", "expected_with_kind_only")
        if self.key_code is not None and self.kind != "key":
            raise RuleError("key_code: allowed only with kind = 'key'", "expected_with_kind_only")
        if self.trip_gwt is not None and self.trip_input is None:
            raise RuleError("trip_gwt: allowed only together with trip_input", "no_trip_input")
        if self.trip_input is not None and self.trip_input == self.input:
            raise RuleError(
                "trip_input: same as input; connect the participant's button to another input", "input_used_twice"
            )
        return self


def _day(value: Any) -> Any:
    """Return the day of a text, as commands write it; another value as it is."""
    try:
        return datetime.date.fromisoformat(value) if isinstance(value, str) else value
    except ValueError:
        return value


Day = Annotated[datetime.date, BeforeValidator(_day)]


class Calibration(Settings):
    """A number measured on this rig, the day of the measurement, and the last day on which it may be used."""

    value: float = Field(description="calibrated value, in the unit of its key")
    sd: float = Field(0.0, ge=0, description="standard deviation of the value, in the unit of its key")
    date: Day = Field(description="day of the measurement")
    expires: Day = Field(
        description="last day on which the value may be used; then `rig run` refuses it and a dry run warns"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.expires < self.date:
            raise RuleError("expires: must not be earlier than date", "expires_before_date")
        return self


def _measured(allowed: Callable[[float], bool], expected: str) -> AfterValidator:
    def check(calibration: Calibration) -> Calibration:
        if not allowed(calibration.value):
            raise RuleError(f"value = {calibration.value:g}: must be {expected}", "impossible_value")
        return calibration

    return AfterValidator(check)


_StepsPerMm = Annotated[Calibration, _measured(lambda value: value != 0, "a number other than zero")]
_Length = Annotated[Calibration, _measured(lambda value: value >= 0, "a number of at least 0")]
_Scale = Annotated[Calibration, _measured(lambda value: value > 0, "a positive number")]


class CalibrationSettings(Settings):
    """Calibrations of this rig; an absent key was not measured."""

    x_steps_per_mm: _StepsPerMm | None = Field(
        None,
        description="motor steps (drive pulses) per mm of the x axis; negative if the motor runs against the axis",
    )
    y_steps_per_mm: _StepsPerMm | None = Field(
        None,
        description=("motor steps (drive pulses) per mm of the y axis; negative if the motor runs against the axis"),
    )
    z_steps_per_mm: _StepsPerMm | None = Field(
        None,
        description="motor steps (drive pulses) per mm of the z axis; negative if the motor runs against the axis",
    )
    x_backlash_mm: _Length | None = Field(
        None, description="lost motion at each reversal of the lateral axis, in mm; moves compensate for it"
    )
    y_backlash_mm: _Length | None = Field(
        None, description="lost motion at each reversal of the axis along the finger, in mm; moves compensate for it"
    )
    z_backlash_mm: _Length | None = Field(
        None, description="lost motion at each reversal of the vertical axis, in mm; moves compensate for it"
    )
    force_scale: _Scale | None = Field(
        None, description="true force divided by the sensor's reading; every reading is multiplied by it"
    )
    compliance_mm_per_n: _Length | None = Field(
        None, description="compliance of the rig, in mm/N; a press moves the stage that much farther per N"
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

    def to_come(self, day: datetime.date) -> list[str]:
        """Return the calibrations of a later day: their date is wrong, or the clock, which would show none expired.

        Parameters
        ----------
        day : datetime.date
            The present day; in another time zone it may be the next one.

        Returns
        -------
        list of str
            Their keys.
        """
        latest = day + datetime.timedelta(days=1)
        return [name for name, calibration in self.measured() if calibration.date > latest]


T = TypeVar("T", bound=Settings)


class DeviceSettings(Settings):
    """Base class of [stage] and [force]; the registry adds the table of a package's kind."""

    room: ClassVar[Literal["stage", "force"]]
    kind: str = Field(description="kind of the device")
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
    kind: str = Field("grbl", description="type of the stage")
    port: Port = Field(
        "/dev/ttyUSB0", description="port of the stage: a serial port (/dev/ttyUSB0, COM3) or tcp://HOST:PORT"
    )
    baud: int = Field(115200, ge=300, le=1_000_000, description="baud rate of a serial port, in bit/s")
    character: Character = Field(
        EIGHT_N_ONE, description="data bits, parity and stop bits of a serial port, e.g. 8N1"
    )
    dtr: bool = Field(
        True, description="raise the DTR line on opening a serial port, which resets many boards; false keeps it low"
    )
    travel_mm: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = Field(
        (60.0, 30.0, 40.0),
        description="travel of the x, y and z axes from home, in mm; plans and moves stay within it",
    )
    resolution_mm: float = Field(0.0025, gt=0, le=0.05, description="smallest step of the vertical axis, in mm")
    acceleration_mm_s2: float = Field(
        50.0,
        gt=0,
        le=1e4,
        description="acceleration of the vertical axis, in mm/s²; determines the stopping distance",
    )
    framing: Framing | None = Field(
        None, description="Modbus framing; absent: tcp on a tcp:// port, rtu on a serial port"
    )
    drives: DrivesSettings = DrivesSettings()

    @model_validator(mode="after")
    def _drives_are_distinct(self) -> Self:
        x, z = self.drives.x, self.drives.z
        if x.device_id == z.device_id and (x.port or self.port) == (z.port or self.port):
            raise RuleError(
                "drives.x and drives.z: same device_id on one port; give each drive its own", "one_id_for_two"
            )
        return self


class ForceSettings(DeviceSettings):
    """Settings of the force sensor.

    Only Modbus uses `framing`, and only `laumas` uses `laumas`; both may stand in any file.
    """

    room: ClassVar[Literal["stage", "force"]] = "force"
    kind: str = Field("mtsics", description="type of the force sensor")
    port: Port = Field(
        "/dev/ttyUSB1",
        description="port of the force sensor: a serial port (/dev/ttyUSB1, COM4), tcp://HOST:PORT or udp://HOST:PORT",
    )
    baud: int = Field(9600, ge=300, le=1_000_000, description="baud rate of a serial port, in bit/s")
    character: Character = Field(
        EIGHT_N_ONE, description="data bits, parity and stop bits of a serial port, e.g. 8N1"
    )
    dtr: bool = Field(True, description="raise the DTR line on opening a serial port; false keeps it low")
    sample_period_s: float = Field(
        0.05,
        ge=0.01,
        le=10,
        description="time between two samples of the sensor, in s; a reading after a move waits for it",
    )
    latency_s: float = Field(
        0.0,
        ge=0,
        le=2,
        description="delay of a reading behind the force, in s; the rig waits for it after every move",
    )
    resolution_gwt: float = Field(0.01, gt=0, le=1, description="smallest step of the sensor's reading, in gwt")
    framing: Framing | None = Field(
        None, description="Modbus framing; absent: tcp on a tcp:// port, rtu on a serial port"
    )
    laumas: LaumasSettings = LaumasSettings()


class AdapterLine(NamedTuple):
    """Line of a serial adapter, RTS or DTR, and the port of the adapter."""

    name: Literal["rts", "dtr"]
    port: str

    def __str__(self) -> str:
        return f"{self.name.upper()} of {self.port}"


class SyncSettings(Settings):
    """Settings of the pulse for the recording amplifier at contact, ramp and hold; off by default.

    The register and the words that switch a drive's output depend on the drive: they have no default.
    """

    output: Annotated[str, AfterValidator(_an_output)] = Field(
        "off",
        description=(
            "off; coolant or spindle of a GRBL board; drive (Leadshine); rts:PORT or dtr:PORT of a serial adapter"
        ),
    )
    width_s: float = Field(0.01, ge=0.001, le=1, description="width of the pulse, in s")
    inverted: bool = Field(
        False,
        description=(
            "whether RTS or DTR is released for a pulse, so that a TTL adapter, which is active-low, goes high"
        ),
    )
    drive: Literal["x", "z"] = Field("z", description="with output = drive: axis of the drive that makes the pulse")
    register_address: int | None = Field(
        None,
        ge=0,
        le=0x0FFF,
        description=(
            "with output = drive: register of the output, from the drive's manual; those that start a move "
            "are excluded"
        ),
    )
    on_word: int | None = Field(
        None,
        ge=0,
        le=0xFFFF,
        description="with output = drive: word that switches the output on, from the drive's manual",
    )
    off_word: int | None = Field(
        None,
        ge=0,
        le=0xFFFF,
        description="with output = drive: word that switches the output off, from the drive's manual",
    )

    @property
    def adapter(self) -> AdapterLine | None:
        """Line of a serial adapter, or None for an output of the stage."""
        found = _LINE_OF_ADAPTER.fullmatch(self.output)
        return None if found is None else AdapterLine("rts" if found[1] == "rts" else "dtr", found[2])

    @property
    def name(self) -> str:
        """Name of the output in sentences."""
        return str(self.adapter or self.output)

    @property
    def words(self) -> tuple[int, int, int] | None:
        """Register, word for on and word for off, or None unless all are set."""
        if self.register_address is None or self.on_word is None or self.off_word is None:
            return None
        return self.register_address, self.on_word, self.off_word


class FrameSettings(Settings):
    """Position of the finger in machine coordinates (mm)."""

    pad_centre_x_mm: float = Field(-30.0, description="machine X at the center of the finger pad (x = 0), in mm")
    pad_y_mm: float = Field(-15.0, description="machine Y of the receptor plane, in mm")
    apex_z_mm: float = Field(
        -25.0, description="machine Z at which the indentor's lowest point is level with the apex of the pad, in mm"
    )
    roll_deg: float = Field(
        0.0,
        ge=-20,
        le=20,
        description="measured roll of the finger about its long axis, in degrees; turn the finger holder by it",
    )
    tilt_deg: float = Field(
        0.0,
        ge=-20,
        le=20,
        description="measured tilt of the finger about the x axis, in degrees; turn the finger holder by it",
    )


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


_KPA_PER_N_CM2 = 10.0


def limits_in_kpa(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table `limits` with `max_pressure_kpa` instead of `max_pressure_n_cm2` of version 0.2."""
    found = dict(table)
    if "max_pressure_n_cm2" in found:
        if "max_pressure_kpa" in found:
            raise ValueError("max_pressure_kpa and max_pressure_n_cm2 cannot be combined; keep max_pressure_kpa")
        old = found.pop("max_pressure_n_cm2")
        is_number = isinstance(old, int | float) and not isinstance(old, bool)
        found["max_pressure_kpa"] = _KPA_PER_N_CM2 * old if is_number else old
    return found


class LimitSettings(Settings):
    """Limits that refuse a step before a move, and forces that trip; software is never the safety function."""

    max_doi_mm: float = Field(
        1.5, gt=0, le=2.0, description="maximum depth of indentation (DOI), in mm; deeper steps are refused"
    )
    max_force_gwt: float = Field(
        100.0, gt=0, le=500, description="maximum commanded or predicted force, in gwt; steps above it are refused"
    )
    search_mm: float = Field(
        0.5,
        gt=0,
        le=1.5,
        description=(
            "maximum distance of contact from the height that the finger model predicts, in mm; beyond it, a trip"
        ),
    )
    fall_mm: float = Field(
        1.6,
        ge=0,
        le=10,
        description=(
            "maximum depth of the skin below the apex where it is pressed, in mm; lowers the floor of the stage"
        ),
    )
    soft_trip_n: float = Field(
        2.0,
        gt=0,
        le=5.0,
        description=(
            "force that trips a run, in N; a plan lowers it to 2 × its peak force (1.25 × for an identified finger)"
        ),
    )
    hard_trip_n: float = Field(
        5.0, gt=0, le=5.0, description="force that trips on every reading, in N, whatever the plan predicts"
    )
    max_pressure_kpa: float = Field(
        300.0,
        gt=0,
        le=600.0,
        description="maximum force over predicted contact area, in kPa; steps above are refused, readings above trip",
    )
    max_press_speed_mm_s: float = Field(
        FASTEST_PRESS_MM_S,
        ge=SLOWEST_MM_S,
        le=FASTEST_PRESS_MM_S,
        description="maximum speed of approach and press, in mm/s; faster steps are refused",
    )
    heartbeat_s: float = Field(
        3.0,
        ge=0.5,
        le=60,
        description=(
            "longest silence of the engine while the indentor is below clearance, in s; then the stage stops"
        ),
    )
    max_contact_s: float = Field(
        3600.0,
        gt=0,
        le=36_000,
        description="maximum total contact time of a run, in s; then the run ends",
    )
    zero_drift_gwt: float = Field(
        0.03, gt=0, le=10, description="alarm: maximum drift of the sensor's zero since the last zeroing, in gwt"
    )
    reference_band: float = Field(
        0.15, gt=0, le=1, description="alarm: maximum relative deviation of a reference press from the first one"
    )
    on_alarm: Literal["warn", "trip"] = Field(
        "warn", description="reaction to an alarm: warn records and prints it, trip also trips the run"
    )
    on_trip: Literal["stop", "retract", "park"] = Field(
        "retract",
        description="motion after a trip: stop and hold, retract to clearance, or park at habits.park_height_mm",
    )
    x_mm: tuple[float, float] = Field(
        (-6.0, 6.0),
        description="allowed lateral positions from the center of the pad, in mm; others are refused",
    )
    along_mm: tuple[float, float] = Field(
        (-4.0, 4.0),
        description="allowed positions along the finger from the receptor plane, in mm; others are refused",
    )

    @model_validator(mode="before")
    @classmethod
    def _in_kpa(cls, tables: Any) -> Any:
        return limits_in_kpa(tables) if isinstance(tables, dict) else tables

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.x_mm[0] < self.x_mm[1]:
            raise ValueError("x_mm: the lower limit must be less than the upper one")
        if not self.along_mm[0] <= 0 <= self.along_mm[1]:
            raise ValueError("along_mm: must include 0 (lower limit ≤ 0 ≤ upper limit)")
        if self.soft_trip_n > self.hard_trip_n:
            raise ValueError("soft_trip_n: must not exceed hard_trip_n")
        return self


class HabitSettings(Settings):
    """Speeds (mm/s), increments (mm) and thresholds of an indentation."""

    travel_speed_mm_s: float = Field(
        5.0, ge=SLOWEST_MM_S, le=10, description="speed of lateral moves and lifts, in mm/s"
    )
    approach_speed_mm_s: float = Field(
        0.5, ge=SLOWEST_MM_S, le=2, description="speed of the approach to contact, in mm/s"
    )
    press_speed_mm_s: float = Field(
        1.0,
        ge=SLOWEST_MM_S,
        le=FASTEST_PRESS_MM_S,
        description="speed of the press past contact unless the protocol sets one, in mm/s",
    )
    clearance_mm: float = Field(
        2.0,
        gt=0.2,
        le=20,
        description=("height above the apex between indentations, in mm; below it the stage moves in increments"),
    )
    park_height_mm: float = Field(
        10.0, gt=0.2, le=40, description="height above the apex that limits.on_trip = park lifts to, in mm"
    )
    descent_speed_mm_s: float = Field(
        0.8,
        ge=SLOWEST_MM_S,
        le=2,
        description="speed of the descent to clearance after homing, in mm/s; a touch ends the descent",
    )
    descent_step_mm: float = Field(
        0.5, gt=0, le=5, description="step between readings during a manual descent, in mm, and after a false touch"
    )
    increment_mm: float = Field(
        0.05, gt=0, le=0.05, description="longest single move below clearance, in mm; the force is read after each"
    )
    touch_increment_mm: float = Field(
        0.01, gt=0, le=0.05, description="increment that locates contact once increment_mm has detected it, in mm"
    )
    retouch_margin_mm: float = Field(
        0.1,
        ge=0.05,
        le=20,
        description="margin above the last contact, in mm, where a repeated approach begins",
    )
    touch_force_gwt: float = Field(0.05, gt=0, le=1, description="force that counts as contact, in gwt")
    settle_readings: int = Field(
        1, ge=1, le=20, description="number of sensor periods to wait between a move and its reading"
    )

    @model_validator(mode="after")
    def _fine_within_coarse(self) -> Self:
        if self.touch_increment_mm > self.increment_mm:
            raise ValueError("touch_increment_mm: must not exceed increment_mm")
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
        """Bounds that the stage's controller may enforce; None if there are no limits."""
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
                    f"limits.max_press_speed_mm_s = {fastest:g}: must be at least habits.{name} = {speed:g} mm/s"
                )
        return self
