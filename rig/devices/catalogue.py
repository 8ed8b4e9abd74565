"""Drivers by the names of their kinds, and on the ports of the configuration.

A new driver is one function here and one line in _STAGES or _FORCES.
"""

from collections.abc import Callable
from functools import partial

from rig.devices.bench_settings import (
    NOMINAL_STEPS_PER_MM,
    BenchSettings,
    DriveSettings,
    ForceSettings,
    StageSettings,
)
from rig.devices.force.base import ForceSensor
from rig.devices.force.laumas import LaumasForce
from rig.devices.force.mtsics import MtSicsForce
from rig.devices.stage.base import Stage
from rig.devices.stage.grbl import GrblStage
from rig.devices.stage.grbl_settings import expected_settings
from rig.devices.stage.leadshine import LeadshineStage
from rig.devices.stage.leadshine_drive import LeadshineDrive
from rig.transport import LoggedTransport, ModbusMaster, Transport, open_port
from rig.transport.byte_log import Sink
from rig.transport.clock import Clock
from rig.transport.port_settings import Framing
from rig.transport.tcp import SCHEME

Opener = Callable[[str], Transport]


def _grbl(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    x, y, z = (settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in "xyz")
    return GrblStage(
        opener(settings.stage.port),
        clock,
        expected=expected_settings(settings),
        output="off" if settings.sync.output == "drive" else settings.sync.output,
        backlash_mm=(x, y, z),
    )


def _leadshine(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    drives = {"x": settings.stage.drives.x, "z": settings.stage.drives.z}
    buses: dict[str, ModbusMaster] = {}
    try:
        for drive in drives.values():
            port = drive.port or settings.stage.port
            if port not in buses:
                buses[port] = _master(opener(port), clock, port, settings.stage.framing, settings.stage.baud)
    except BaseException:
        for bus in buses.values():
            bus.close()
        raise
    x, z = (_drive(buses, clock, axis, drive, settings) for axis, drive in drives.items())
    x_backlash, z_backlash = (settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in drives)
    return LeadshineStage(
        x,
        z,
        y_mm=settings.frame.pad_y_mm,
        x_backlash_mm=x_backlash,
        z_backlash_mm=z_backlash,
        output=settings.sync if settings.sync.output == "drive" else None,
    )


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


def _mtsics(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    return MtSicsForce(
        opener(settings.force.port),
        clock,
        sample_period_s=settings.force.sample_period_s,
        resolution_gwt=settings.force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


def _laumas(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    force = settings.force
    return LaumasForce(
        _master(opener(force.port), clock, force.port, force.framing, force.baud),
        clock,
        force.laumas,
        sample_period_s=force.sample_period_s,
        resolution_gwt=force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


def _master(transport: Transport, clock: Clock, port: str, framing: Framing | None, baud: int) -> ModbusMaster:
    by_port: Framing = "tcp" if port.startswith(SCHEME) else "rtu"
    return ModbusMaster(transport, clock, framing=framing or by_port, baud=baud)


_STAGES: dict[str, Callable[[Opener, Clock, BenchSettings], Stage]] = {"grbl": _grbl, "leadshine": _leadshine}
_FORCES: dict[str, Callable[[Opener, Clock, BenchSettings], ForceSensor]] = {"mtsics": _mtsics, "laumas": _laumas}


def stage_driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    """The driver for the configured kind of stage, on any wires and any clock. Raises what the opener raises."""
    return _STAGES[settings.stage.kind](opener, clock, settings)


def force_driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    """The driver for the configured kind of sensor, on any wire and any clock. Raises what the opener raises."""
    return _FORCES[settings.force.kind](opener, clock, settings)


def open_stage(settings: BenchSettings, clock: Clock, byte_log: Sink | None = None) -> Stage:
    """The stage on its port, not yet spoken to. Raises TransportError."""
    opener = partial(_open, settings=settings.stage, clock=clock, byte_log=byte_log)
    return stage_driver(opener, clock, settings)


def open_force(settings: BenchSettings, clock: Clock, byte_log: Sink | None = None) -> ForceSensor:
    """The force sensor on its port, not yet spoken to. Raises TransportError."""
    opener = partial(_open, settings=settings.force, clock=clock, byte_log=byte_log)
    return force_driver(opener, clock, settings)


def _open(port: str, *, settings: StageSettings | ForceSettings, clock: Clock, byte_log: Sink | None) -> Transport:
    transport = open_port(port, settings.baud, character=settings.character, dtr=settings.dtr)
    return transport if byte_log is None else LoggedTransport(transport, clock, byte_log)
