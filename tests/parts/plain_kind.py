"""The entry of the scale that answers in plain numbers."""

from pydantic import Field
from rig.devices.force.plain.plain_force import PlainForce

from rig.clock import Clock
from rig.devices.base import ForceSensor
from rig.devices.bench_settings import BenchSettings
from rig.devices.registry import ForceKind, Opener
from rig.settings import Settings


class PlainSettings(Settings):
    """What is set on the scale."""

    decimals: int = Field(2, ge=0, le=4, description="of a weight")


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    force, scale = settings.force, settings.calibration.value("force_scale", 1.0)
    period_s, step_gwt = force.sample_period_s, 10.0 ** -force.own(PlainSettings).decimals
    port = opener(force.port)
    return PlainForce(port, clock, sample_period_s=period_s, resolution_gwt=step_gwt, scale=scale)


DEVICE = ForceKind(
    name="plain",
    device="scale in plain numbers",
    driver=_driver,
    settings=PlainSettings,
    twin="sim.devices.plain:plain_twin",
    tests=("tests/test_plain.py",),
)
