"""A device behind a TCP port: a serial gateway, a Modbus gateway, or virtual devices in real time."""

import os
import select
import socket
from contextlib import suppress

from rig.transport.base import TransportError
from rig.transport.identity import SCHEME, Address, tcp_addresses
from rig.transport.ownership import PortOwnership

__all__ = ["SCHEME", "TcpTransport"]

CONNECT_S = 3.0
WRITE_S = 1.0
_CHUNK = 4096


class TcpTransport:
    """Transport over one TCP connection to `tcp://HOST:PORT`, owned by one process of this machine at a time.

    owned: False for a stop alone, which goes out beside whoever owns the port.

    Raises TransportError, in one line that names the port, if nobody answers; NotOwnedError if somebody else owns it.
    """

    def __init__(self, port: str, *, name: str | None = None, owned: bool = True) -> None:
        self.name = name or port
        self._port = port
        addresses = tcp_addresses(port)
        self._ownership = PortOwnership(port) if owned else None
        try:
            self._socket = _connect(port, addresses)
        except BaseException:
            if self._ownership is not None:
                self._ownership.release()
            raise

    def write(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except OSError as problem:
            raise TransportError(
                "cannot write to {port}: {problem}", code="not_written", port=self._port, problem=_said(problem)
            ) from problem

    def read(self, timeout_s: float) -> bytes:
        try:
            readable, _, _ = select.select([self._socket], [], [], max(timeout_s, 0.0))
            data = self._socket.recv(_CHUNK) if readable else None
        except (OSError, ValueError) as problem:
            raise TransportError(
                "cannot read from {port}: {problem}", code="not_read", port=self._port, problem=_said(problem)
            ) from problem
        if data == b"":
            raise TransportError(
                "cannot read from {port}: the other side closed the connection", code="hung_up", port=self._port
            )
        return data or b""

    def close(self) -> None:
        self._socket.close()
        if self._ownership is not None:
            self._ownership.release()


def _connect(port: str, addresses: tuple[Address, ...]) -> socket.socket:
    try:
        connection = _connected(addresses)
    except ConnectionRefusedError as problem:
        raise TransportError(
            "cannot open {port}: {problem}, nothing listens there, expected a device that is on, "
            "or `rig serve` that has said its ports",
            code="no_listener",
            port=port,
            problem=_said(problem),
        ) from problem
    except OSError as problem:
        raise TransportError(
            "cannot open {port}: {problem}", code="not_opened", port=port, problem=_said(problem)
        ) from problem
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # a stop must not wait for more bytes
    connection.settimeout(WRITE_S)
    return connection


def _connected(addresses: tuple[Address, ...]) -> socket.socket:
    """To the first address that answers. Raises OSError, that of the last one."""
    *others, last = addresses
    for family, address in others:
        with suppress(OSError):
            return _connected(((family, address),))
    connection = socket.socket(last[0], socket.SOCK_STREAM)
    try:
        connection.settimeout(CONNECT_S)
        connection.connect(last[1])
    except BaseException:
        connection.close()
        raise
    return connection


def _said(problem: Exception) -> str:
    number = getattr(problem, "errno", None)
    return os.strerror(number).lower() if number and number > 0 else str(problem)
