"""The entry of an MT-SICS balance in the catalogue of devices."""

from rig.devices.bench_settings import BenchSettings
from rig.devices.force.base import ForceSensor
from rig.devices.force.mtsics.mtsics_force import MtSicsForce
from rig.devices.kinds import ForceKind, Opener
from rig.transport.clock import Clock


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    return MtSicsForce(
        opener(settings.force.port),
        clock,
        sample_period_s=settings.force.sample_period_s,
        resolution_gwt=settings.force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


DEVICE = ForceKind(
    name="mtsics",
    device="balance that speaks MT-SICS",
    driver=_driver,
    twin="sim.devices.mtsics:balance_twin",
    tests=("tests/rig/test_mtsics_driver.py",),
)
