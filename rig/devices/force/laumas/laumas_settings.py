"""What a Laumas transmitter must be told: `[force.laumas]`."""

from typing import Literal

from pydantic import Field

from rig.transport.port_settings import Settings


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
