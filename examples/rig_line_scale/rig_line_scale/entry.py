"""Registry entry of the scale."""

from pydantic import Field

from rig.clock import Clock
from rig.devices.base import ForceSensor
from rig.devices.registry import Evidence, ForceKind, Opener
from rig.settings import BenchSettings, Settings
from rig_line_scale.driver import LineScaleForce


class LineScaleSettings(Settings):
    """Table [force.line_scale] of a configuration."""

    address: int = Field(1, ge=0, le=99, description="address that is set on the scale")


def line_scale(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    """Return the driver of the configured scale. Raises TransportError."""
    force = settings.force
    return LineScaleForce(
        opener(force.port),
        clock,
        force.own(LineScaleSettings).address,
        sample_period_s=force.sample_period_s,
        resolution_gwt=force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


DEVICE = ForceKind(
    name="line_scale",
    device="scale with a line protocol",
    driver=line_scale,
    settings=LineScaleSettings,
    twin="rig_line_scale.twin:line_scale_twin",
    tests=("tests/test_line_scale.py",),
    evidence=Evidence(manual="README.md of this package"),
)
