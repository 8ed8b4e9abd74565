"""A real serial port, owned by one process at a time."""

import errno
from typing import Any

import serial

from rig.transport.base import TransportError
from rig.transport.ownership import PortOwnership

WRITE_TIMEOUT_S = 1.0


class SerialTransport:
    """Transport over pyserial, 8N1.

    port is a device or a pyserial URL such as rfc2217://host:port. Raises TransportError, in one line that
    names the port, if it is missing, not permitted, or owned by somebody else. Opening resets many GRBL
    boards (DTR).
    """

    def __init__(self, port: str, baud: int = 115200, *, name: str | None = None) -> None:
        self.name = name or port
        self._port = port
        self._ownership = PortOwnership(port)
        try:
            self._serial = _open(port, baud)
        except BaseException:
            self._ownership.release()
            raise

    def write(self, data: bytes) -> None:
        try:
            self._serial.write(data)
        except (serial.SerialException, OSError) as problem:
            raise TransportError(f"cannot write to {self._port}: {problem}") from problem

    def read(self, timeout_s: float) -> bytes:
        try:
            self._serial.timeout = max(timeout_s, 0.0)
            first = self._serial.read(1)
            return bytes(first + self._serial.read(self._serial.in_waiting)) if first else b""
        except (serial.SerialException, OSError, TypeError) as problem:
            # pyserial fails with a TypeError when another thread closes the port under a read.
            raise TransportError(f"cannot read from {self._port}: {problem}") from problem

    def close(self) -> None:
        self._serial.close()
        self._ownership.release()


def _open(port: str, baud: int) -> Any:
    try:
        return serial.serial_for_url(port, baudrate=baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as problem:
        raise TransportError(_why_not(port, problem)) from problem


def _why_not(port: str, problem: Exception) -> str:
    number = getattr(problem, "errno", None)
    if number == errno.ENOENT:
        return f"there is no port {port}"
    if number in (errno.EBUSY, errno.EAGAIN):
        return f"{port} is already in use by another program"
    if number == errno.EACCES:
        return f"no permission to open {port}"
    return f"cannot open {port}: {problem}".splitlines()[0]
