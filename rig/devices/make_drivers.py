"""Drivers of the configured devices, on any transport or on the configured ports."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from pydantic import ValidationError

from rig.clock import Clock
from rig.devices.base import ForceSensor, Stage
from rig.devices.registry import DeviceKind, ForceKind, KnownBench, Opener, StageKind, find
from rig.settings import BenchSettings, ForceSettings, StageSettings
from rig.transport import LoggedTransport, TimeLimitedTransport, Transport, TransportError, open_port
from rig.transport.wire import Sink


def stage_driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    """Return the driver of the configured stage. Raises the errors of the opener."""
    return find(StageKind, settings.stage.kind).driver(opener, clock, settings)


def force_driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    """Return the driver of the configured force sensor. Raises the errors of the opener."""
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

    Raises TransportError; NotOwnedError if another process owns the port, unless owned is False, as for a mere stop.
    """

    def opener(port: str) -> Transport:
        return guarded(_open(port, settings=settings.stage, clock=clock, byte_log=byte_log, owned=owned))

    return stage_driver(opener, clock, settings)


def open_force(settings: BenchSettings, clock: Clock, byte_log: Sink | None = None) -> ForceSensor:
    """Return the force sensor on its port, not yet connected. Raises TransportError."""
    opener = partial(_open, settings=settings.force, clock=clock, byte_log=byte_log)
    return force_driver(opener, clock, settings)


PROBE_S = 6.0
"""Longest time that a probe may take at a port (s)."""


def probe(
    kind: DeviceKind, port: str, clock: Clock, byte_log: Sink | None = None, *, own: Mapping[str, Any] | None = None
) -> str | None:
    """Return the identity of a device of this kind at a port, or None if no such device answers.

    Only the questions of the kind's own probe are sent, with its default settings but for `own`, keys of its own
    table. Raises TransportError if the port does not open; StageError or ForceError if the device answers but cannot
    be used.
    """
    if kind.probe is None:
        return None
    try:
        table = {"kind": kind.name, "port": port, **({kind.place: dict(own)} if own else {})}
        settings = KnownBench.model_validate({kind.room: table})
    except ValidationError:  # A kind with settings that have no default cannot be asked.
        return None
    device = settings.stage if kind.room == "stage" else settings.force
    opened: list[Transport] = []

    def opener(name: str) -> Transport:
        opened.append(_open(name, settings=device, clock=clock, byte_log=byte_log))
        return TimeLimitedTransport(opened[-1], clock, PROBE_S)

    try:
        return kind.probe(opener, clock, settings)
    except TransportError:
        if opened:  # What is there speaks another language.
            return None
        raise
    finally:
        for transport in opened:
            transport.close()


def _open(
    port: str, *, settings: StageSettings | ForceSettings, clock: Clock, byte_log: Sink | None, owned: bool = True
) -> Transport:
    transport = open_port(port, settings.baud, character=settings.character, dtr=settings.dtr, owned=owned)
    return transport if byte_log is None else LoggedTransport(transport, clock, byte_log)
