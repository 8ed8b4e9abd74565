"""The entry of a Laumas transmitter in the catalogue of devices."""

from rig.devices.bench_settings import BenchSettings
from rig.devices.force.base import ForceSensor
from rig.devices.force.laumas.laumas_force import LaumasForce
from rig.devices.force.laumas.laumas_settings import LaumasSettings
from rig.devices.kinds import ForceKind, Opener
from rig.transport.clock import Clock
from rig.transport.modbus import ModbusMaster


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    force = settings.force
    return LaumasForce(
        ModbusMaster.on_port(opener(force.port), clock, force.port, framing=force.framing, baud=force.baud),
        clock,
        force.laumas,
        sample_period_s=force.sample_period_s,
        resolution_gwt=force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


DEVICE = ForceKind(
    name="laumas",
    device="Laumas TLB or TLU load-cell transmitter",
    driver=_driver,
    settings=LaumasSettings,
    twin="sim.devices.laumas:laumas_twin",
    tests=("tests/rig/test_laumas_driver.py", "tests/rig/test_modbus_counterparties.py"),
)
