"""Find the devices on ports by the probes of their registry entries, which only ask questions."""

import os
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from serial.tools import list_ports

from rig.clock import Clock
from rig.control.client import activity_of
from rig.devices.base import ForceError, StageError
from rig.devices.make_drivers import probe
from rig.devices.registry import KINDS, DeviceKind, KindError, NumberedIdentity, find, names
from rig.errors import RigError
from rig.transport import PortOwner, TransportError, port_owner
from rig.transport.ownership import DATAGRAMS
from rig_shared.outputs import Code, Name, Output, Port

AT_ONCE = 16
"""Maximum number of ports that are asked at the same time."""

BY_ID = Path("/dev/serial/by-id")
"""Folder of links whose names stay the same when ports are plugged in another order (Linux)."""


class PortFoundJson(Output):
    """Reply on a port; role, kind and identity are null if no known device answered."""

    port: Port
    role: Literal["stage", "force"] | None
    kind: Name | None
    identity: Name | None
    owner: int | None
    """Process that uses the port, which was then not searched; null also if the system does not report it."""
    code: Code | None
    """Reason that the port was not searched, or that the device cannot be used."""
    found_text: str


@dataclass(frozen=True)
class PortFound:
    """Answer of a port.

    kind and identity: device that answered. problem: why the port could not be asked, or what is wrong with the
    device. owner: process that uses the port, which was then not asked. own: keys of the kind's own table, without
    which the device does not answer. serial: serial number of the device, if its settings may name it.
    """

    port: str
    kind: DeviceKind | None = None
    identity: str | None = None
    problem: RigError | None = None
    owner: PortOwner | None = None
    own: Mapping[str, Any] = field(default_factory=dict)
    serial: int | None = None

    @property
    def words(self) -> str:
        """Result in one line, without the port."""
        if self.owner is not None:
            return f"in use by {self.owner}{_does(self.owner)}; not asked"
        if self.problem is not None:
            return str(self.problem)
        if self.kind is None:
            return "no known device answers"
        return f"{self.kind.room} {self.kind.name}: {self.identity}"

    def as_json(self) -> PortFoundJson:
        """Return the finding as JSON."""
        return {
            "port": self.port,
            "role": None if self.kind is None else self.kind.room,
            "kind": None if self.kind is None else self.kind.name,
            "identity": self.identity,
            "owner": None if self.owner is None else self.owner.pid,
            "code": "in_use" if self.owner is not None else None if self.problem is None else self.problem.code,
            "found_text": self.words,
        }


def _does(owner: PortOwner) -> str:
    activity = None if owner.pid is None else activity_of(owner.pid)
    return "" if activity is None else f" ({activity['does_text']})"


def serial_ports() -> list[str]:
    """Return the serial ports of this machine, on Linux by a name that survives replugging."""
    return [stable_name(port) for port in sorted(one.device for one in list_ports.comports())]


def stable_name(port: str) -> str:
    """Return the link of a serial device in /dev/serial/by-id, or the name itself."""
    links = sorted(BY_ID.iterdir()) if BY_ID.is_dir() else []
    return next((str(link) for link in links if os.path.realpath(link) == os.path.realpath(port)), port)


def find_devices(ports: Iterable[str], clock: Clock) -> Iterator[PortFound]:
    """Ask all ports at the same time, and yield each finding as soon as it is there."""
    with ThreadPoolExecutor(AT_ONCE, "probe") as threads:
        for asked in as_completed([threads.submit(look_at_port, port, clock) for port in dict.fromkeys(ports)]):
            yield asked.result()


def look_at_port(port: str, clock: Clock) -> PortFound:
    """Probe a port for each known kind in turn, the default stage first; skip it if another process uses it.

    The order matters: a board, which acts on single bytes, answers before bytes for other devices reach it.
    """
    owner = port_owner(port)
    if owner is not None:
        return PortFound(port, owner=owner)
    unopened: TransportError | None = None
    for kind in _probed():
        for own in _tables(kind, port):
            try:
                identity = probe(kind, port, clock, own=own)
            except TransportError as problem:
                if not kind.page_port:
                    return PortFound(port, problem=problem)
                unopened = unopened or problem
                continue
            except (StageError, ForceError) as problem:
                return PortFound(port, kind, problem=problem, own=own)
            if identity is not None:
                serial = identity.serial if isinstance(identity, NumberedIdentity) else None
                return PortFound(port, kind, identity, own=own, serial=serial)
    return PortFound(port, problem=unopened)


def _tables(kind: DeviceKind, port: str) -> Iterator[Mapping[str, Any]]:
    """Yield keys of a kind's own table to search with: the defaults, then the page of a virtual device."""
    yield {}
    number = port.rpartition(":")[2]
    if kind.page_port and port.startswith(DATAGRAMS) and number.isdecimal():
        yield {kind.page_port: int(number)}


def _probed() -> Iterator[DeviceKind]:
    """Yield the kinds that have a probe; a package that cannot be used is reported by `rig doctor`."""
    for of in KINDS:
        for name in names(of.room):
            try:
                kind = find(of, name)
            except KindError:
                continue
            if kind.probe is not None:
                yield kind
