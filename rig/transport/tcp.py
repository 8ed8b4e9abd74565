"""A device behind a TCP port: a serial gateway, a Modbus gateway, or virtual devices in real time."""

import os
import select
import socket

from rig.transport.base import TransportError
from rig.transport.ownership import PortOwnership

SCHEME = "tcp://"
CONNECT_S = 3.0
WRITE_S = 1.0
_CHUNK = 4096


class TcpTransport:
    """Transport over one TCP connection to `tcp://HOST:PORT`, owned by one process of this machine at a time.

    Raises TransportError, in one line that names the port, if nobody answers or somebody else owns it.
    """

    def __init__(self, port: str, *, name: str | None = None) -> None:
        self.name = name or port
        self._port = port
        address = _address(port)
        self._ownership = PortOwnership(port)
        try:
            self._socket = _connect(port, address)
        except BaseException:
            self._ownership.release()
            raise

    def write(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except OSError as problem:
            raise TransportError(f"cannot write to {self._port}: {_said(problem)}") from problem

    def read(self, timeout_s: float) -> bytes:
        try:
            readable, _, _ = select.select([self._socket], [], [], max(timeout_s, 0.0))
            data = self._socket.recv(_CHUNK) if readable else None
        except (OSError, ValueError) as problem:
            raise TransportError(f"cannot read from {self._port}: {_said(problem)}") from problem
        if data == b"":
            raise TransportError(f"cannot read from {self._port}: the other side closed the connection")
        return data or b""

    def close(self) -> None:
        self._socket.close()
        self._ownership.release()


def _address(port: str) -> tuple[str, int]:
    host, colon, number = port.removeprefix(SCHEME).rpartition(":")
    if not (port.startswith(SCHEME) and host and colon and number.isdigit() and 0 < int(number) < 65536):
        raise TransportError(f"{port!r} is no TCP port, expected tcp://HOST:PORT")
    return host.strip("[]"), int(number)


def _connect(port: str, address: tuple[str, int]) -> socket.socket:
    try:
        connection = socket.create_connection(address, CONNECT_S)
    except ConnectionRefusedError as problem:
        there = "nothing listens there, expected a device that is on, or `rig serve` that has said its ports"
        raise TransportError(f"cannot open {port}: {_said(problem)}, {there}") from problem
    except OSError as problem:
        raise TransportError(f"cannot open {port}: {_said(problem)}") from problem
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # a stop must not wait for more bytes
    connection.settimeout(WRITE_S)
    return connection


def _said(problem: Exception) -> str:
    number = getattr(problem, "errno", None)
    return os.strerror(number).lower() if number and number > 0 else str(problem)
