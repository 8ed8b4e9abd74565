"""Tables of the configuration that know no device driver: ports, Laumas, Leadshine, `[stop]`."""

import re
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from rig.errors import RuleError

Framing = Literal["rtu", "tcp"]
EIGHT_N_ONE = "8N1"


class Settings(BaseModel):
    """A table of the configuration file; every value is checked, none may be NaN."""

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
"""Of a serial line: data bits, parity (none, even, odd) and stop bits."""

Port = Annotated[str, AfterValidator(_addressed)]


class StatusBits(Settings):
    """Bits of a Laumas status word; second-hand for TLB and TLU, as printed in the manual of the LCB."""

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
    """A Laumas load-cell transmitter. Second-hand: all of the status bits, the commands and the units word."""

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
    """One Leadshine drive. Second-hand: not from the maker's manual, to be looked up before the drive moves."""

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
    """The drives of a stage without a board: x lateral and z vertical; y stays where it was set by hand."""

    x: DriveSettings = DriveSettings(device_id=1)
    z: DriveSettings = DriveSettings(device_id=2)


def _said(text: str) -> str:
    if not text.strip():
        raise RuleError("expected a name", code="no_name")
    return text


Name = Annotated[str, AfterValidator(_said)]


class StopSettings(Settings):
    """The participant's stop button, and the relay of the force transmitter that stops the stage by itself."""

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
