"""The drivers of the configured devices, on any wires or on the ports of the configuration."""

from collections.abc import Callable
from functools import partial

from rig.clock import Clock
from rig.devices.base import ForceSensor, Stage
from rig.devices.registry import ForceKind, Opener, StageKind, find
from rig.settings import BenchSettings, ForceSettings, StageSettings
from rig.transport import LoggedTransport, Transport, open_port
from rig.transport.wire import Sink


def stage_driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    """The driver for the configured kind of stage, on any wires and any clock. Raises what the opener raises."""
    return find(StageKind, settings.stage.kind).driver(opener, clock, settings)


def force_driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    """The driver for the configured kind of sensor, on any wire and any clock. Raises what the opener raises."""
    return find(ForceKind, settings.force.kind).driver(opener, clock, settings)


def open_stage(
    settings: BenchSettings,
    clock: Clock,
    byte_log: Sink | None = None,
    guarded: Callable[[Transport], Transport] = lambda wire: wire,
    *,
    owned: bool = True,
) -> Stage:
    """The stage on its port, not yet spoken to; its driver has each wire as it is guarded.

    Raises TransportError; NotOwnedError where somebody has the port, unless owned is False, as for a stop alone.
    """

    def opener(port: str) -> Transport:
        return guarded(_open(port, settings=settings.stage, clock=clock, byte_log=byte_log, owned=owned))

    return stage_driver(opener, clock, settings)


def open_force(settings: BenchSettings, clock: Clock, byte_log: Sink | None = None) -> ForceSensor:
    """The force sensor on its port, not yet spoken to. Raises TransportError."""
    opener = partial(_open, settings=settings.force, clock=clock, byte_log=byte_log)
    return force_driver(opener, clock, settings)


def _open(
    port: str, *, settings: StageSettings | ForceSettings, clock: Clock, byte_log: Sink | None, owned: bool = True
) -> Transport:
    transport = open_port(port, settings.baud, character=settings.character, dtr=settings.dtr, owned=owned)
    return transport if byte_log is None else LoggedTransport(transport, clock, byte_log)
