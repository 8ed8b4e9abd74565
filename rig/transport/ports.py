"""A real serial port, owned by one process at a time."""

import errno
from typing import Any

import serial

from rig.transport.base import TransportError
from rig.transport.identity import identities
from rig.transport.ownership import PortOwnership
from rig.transport.port_settings import EIGHT_N_ONE

WRITE_TIMEOUT_S = 1.0


class SerialTransport:
    """Transport over pyserial.

    port is a device or a pyserial URL such as rfc2217://host:port. Raises TransportError, in one line that
    names the port, if it is missing or not permitted; NotOwnedError if somebody else owns it. character: data bits,
    parity, stop bits. Opening raises DTR, which resets many GRBL boards, or leaves it low. owned: False for a stop
    alone, which goes out beside whoever owns the port.
    """

    def __init__(
        self,
        port: str,
        baud: int = 115200,
        *,
        name: str | None = None,
        character: str = EIGHT_N_ONE,
        dtr: bool = True,
        owned: bool = True,
    ) -> None:
        self.name = name or port
        self._port = port
        self._serial = _made(port, baud, character, dtr=dtr, exclusive=owned)
        device = str(self._serial.port)  # of a URL that leads to one, such as spy:// or hwgrep://
        self._ownership = PortOwnership(device) if owned else None
        try:
            _open(port, self._serial)
            if self._ownership is not None and identities(device) != self._ownership.names:
                self._serial.close()
                raise TransportError("{port} became another device while it was opened", code="exchanged", port=port)
        except BaseException:
            self._let_go()
            raise

    def write(self, data: bytes) -> None:
        try:
            self._serial.write(data)
        except (serial.SerialException, OSError) as problem:
            raise TransportError(
                "cannot write to {port}: {problem}", code="not_written", port=self._port, problem=str(problem)
            ) from problem

    def read(self, timeout_s: float) -> bytes:
        try:
            self._serial.timeout = max(timeout_s, 0.0)
            first = self._serial.read(1)
            return bytes(first + self._serial.read(self._serial.in_waiting)) if first else b""
        except (serial.SerialException, OSError, TypeError) as problem:
            # pyserial fails with a TypeError when another thread closes the port under a read.
            raise TransportError(
                "cannot read from {port}: {problem}", code="not_read", port=self._port, problem=str(problem)
            ) from problem

    def close(self) -> None:
        self._serial.close()
        self._let_go()

    def _let_go(self) -> None:
        if self._ownership is not None:
            self._ownership.release()


def _made(port: str, baud: int, character: str, *, dtr: bool, exclusive: bool) -> Any:
    """What is not open yet: opening may reset the board, and is for the owner alone."""
    try:
        wire = serial.serial_for_url(
            port,
            do_not_open=True,
            baudrate=baud,
            bytesize=int(character[0]),
            parity=character[1],
            stopbits=int(character[2]),
            timeout=0,
            write_timeout=WRITE_TIMEOUT_S,
            exclusive=exclusive or None,
        )
        wire.dtr = dtr
        return wire
    except (serial.SerialException, OSError, ValueError) as problem:
        raise _not_opened(port, problem) from problem


def _open(port: str, wire: Any) -> None:
    try:
        wire.open()
    except (serial.SerialException, OSError, ValueError) as problem:
        raise _not_opened(port, problem) from problem


def _not_opened(port: str, problem: Exception) -> TransportError:
    number = getattr(problem, "errno", None)
    if number == errno.ENOENT:
        return TransportError("there is no port {port}", code="no_port", port=port)
    if number in (errno.EBUSY, errno.EAGAIN):
        return TransportError("{port} is already in use by another program", code="in_use", port=port)
    if number == errno.EACCES:
        return TransportError("no permission to open {port}", code="no_permission", port=port)
    first = "".join(str(problem).splitlines()[:1])
    return TransportError("cannot open {port}: {problem}", code="not_opened", port=port, problem=first)
