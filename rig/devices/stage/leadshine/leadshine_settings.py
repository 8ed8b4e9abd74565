"""What a pair of Leadshine drives must be told: `[stage.drives]`."""

from pydantic import Field

from rig.transport.port_settings import Port, Settings


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
