"""What a Laumas transmitter must be told: `[force.laumas]`."""

from typing import Literal

from pydantic import Field

from rig.transport.port_settings import Settings


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
