"""Drivers of the configured devices, on any transport or on the configured ports."""

from collections.abc import Callable
from functools import partial

from rig.clock import Clock
from rig.devices.base import ForceSensor, Stage
from rig.devices.registry import ForceKind, Opener, StageKind, find
from rig.settings import BenchSettings, ForceSettings, StageSettings
from rig.transport import LoggedTransport, Transport, open_port
from rig.transport.wire import Sink


def stage_driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    """Return the driver of the configured stage. Raises what the opener raises."""
    return find(StageKind, settings.stage.kind).driver(opener, clock, settings)


def force_driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    """Return the driver of the configured force sensor. Raises what the opener raises."""
    return find(ForceKind, settings.force.kind).driver(opener, clock, settings)


def open_stage(
    settings: BenchSettings,
    clock: Clock,
    byte_log: Sink | None = None,
    guarded: Callable[[Transport], Transport] = lambda wire: wire,
    *,
    owned: bool = True,
) -> Stage:
    """Return the stage on its ports, not yet connected; `guarded` wraps each transport.

    Raises TransportError; NotOwnedError if another process owns the port, unless owned is False, as for a mere
    stop.
    """

    def opener(port: str) -> Transport:
        return guarded(_open(port, settings=settings.stage, clock=clock, byte_log=byte_log, owned=owned))

    return stage_driver(opener, clock, settings)


def open_force(settings: BenchSettings, clock: Clock, byte_log: Sink | None = None) -> ForceSensor:
    """Return the force sensor on its port, not yet connected. Raises TransportError."""
    opener = partial(_open, settings=settings.force, clock=clock, byte_log=byte_log)
    return force_driver(opener, clock, settings)


def _open(
    port: str, *, settings: StageSettings | ForceSettings, clock: Clock, byte_log: Sink | None, owned: bool = True
) -> Transport:
    transport = open_port(port, settings.baud, character=settings.character, dtr=settings.dtr, owned=owned)
    return transport if byte_log is None else LoggedTransport(transport, clock, byte_log)
