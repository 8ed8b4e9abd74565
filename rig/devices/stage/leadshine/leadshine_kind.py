"""The entry of a pair of Leadshine drives in the catalogue of devices."""

from rig.devices.bench_settings import NOMINAL_STEPS_PER_MM, BenchSettings, StageSettings
from rig.devices.kinds import Opener, StageKind
from rig.devices.stage.base import Stage
from rig.devices.stage.leadshine import leadshine_words as reg
from rig.devices.stage.leadshine.leadshine_drive import LeadshineDrive
from rig.devices.stage.leadshine.leadshine_settings import DriveSettings, DrivesSettings
from rig.devices.stage.leadshine.leadshine_stage import LeadshineStage
from rig.transport.clock import Clock
from rig.transport.modbus import ModbusMaster


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    drives = {"x": settings.stage.drives.x, "z": settings.stage.drives.z}
    buses = _buses(opener, clock, settings.stage)
    x, z = (_drive(buses, clock, axis, drive, settings) for axis, drive in drives.items())
    x_backlash, z_backlash = (settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in drives)
    return LeadshineStage(
        x,
        z,
        y_mm=settings.frame.pad_y_mm,
        x_backlash_mm=x_backlash,
        z_backlash_mm=z_backlash,
        output=settings.sync if settings.sync.output == "drive" else None,
        inputs_register=settings.stop.inputs_register,
    )


def _ports(stage: StageSettings) -> tuple[str, ...]:
    """Those of its drives."""
    return tuple(dict.fromkeys(drive.port or stage.port for drive in (stage.drives.x, stage.drives.z)))


def _buses(opener: Opener, clock: Clock, stage: StageSettings) -> dict[str, ModbusMaster]:
    """By port; none is left open where one does not open."""
    buses: dict[str, ModbusMaster] = {}
    try:
        for port in _ports(stage):
            buses[port] = ModbusMaster.on_port(opener(port), clock, port, framing=stage.framing, baud=stage.baud)
    except BaseException:
        for bus in buses.values():
            bus.close()
        raise
    return buses


def _drive(
    buses: dict[str, ModbusMaster], clock: Clock, axis: str, drive: DriveSettings, settings: BenchSettings
) -> LeadshineDrive:
    return LeadshineDrive(
        buses[drive.port or settings.stage.port],
        clock,
        axis,
        drive,
        pulses_per_mm=settings.calibration.value(f"{axis}_steps_per_mm", NOMINAL_STEPS_PER_MM),
        travel_mm=settings.stage.travel_mm["xyz".index(axis)],
    )


DEVICE = StageKind(
    name="leadshine",
    device="two Leadshine CS2RS or iEM-RS drives",
    driver=_driver,
    settings=DrivesSettings,
    table="drives",
    ports=_ports,
    axes="xz",
    outputs=("off", "drive"),
    inputs=reg.INPUT_NAMES,
    twin="sim.devices.leadshine:leadshine_twin",
    tests=("tests/rig/test_leadshine_driver.py", "tests/rig/test_modbus_counterparties.py"),
)
