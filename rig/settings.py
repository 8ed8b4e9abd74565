"""What stops the stage without this program's screen: `[stop]`, the participant's button and the hardware trip."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from rig.errors import RuleError
from rig.transport.port_settings import Settings


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
