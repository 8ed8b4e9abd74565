"""Open a port by its name: serial, TCP to a gateway or virtual devices, or UDP to a sensor."""

import errno
import os
import re
import select
import socket
import threading
from collections import deque
from contextlib import suppress
from typing import Any, Literal

import serial

from rig.settings import EIGHT_N_ONE
from rig.transport.ownership import (
    DATAGRAMS,
    SCHEME,
    Address,
    PortOwnership,
    identities,
    tcp_addresses,
    udp_addresses,
)
from rig.transport.wire import Transport, TransportError

WRITE_TIMEOUT_S = 1.0
ModemLine = Literal["rts", "dtr"]


class SerialTransport:
    """Transport over pyserial.

    port: device or pyserial URL such as rfc2217://host:port. character: data bits, parity, stop bits. Opening
    raises DTR, which resets many GRBL boards, and RTS, or keeps them low. owned: False for a stop, which is sent
    even if another process owns the port. Raises TransportError if the port is missing or not permitted;
    NotOwnedError if it is owned.
    """

    def __init__(
        self,
        port: str,
        baud: int = 115200,
        *,
        name: str | None = None,
        character: str = EIGHT_N_ONE,
        dtr: bool = True,
        rts: bool = True,
        owned: bool = True,
    ) -> None:
        self.name = name or port
        self._port = port
        self._serial = _made(port, baud, character, dtr=dtr, rts=rts, exclusive=owned)
        device = str(self._serial.port)  # The device behind a URL such as spy:// or hwgrep://.
        self._ownership = PortOwnership(device) if owned else None
        try:
            _open(port, self._serial)
            if self._ownership is not None and identities(device) != self._ownership.names:
                self._serial.close()
                raise TransportError(
                    f"port {port} changed to another device while it was opened; connect again", "exchanged"
                )
        except BaseException:
            self._let_go()
            raise

    def write(self, data: bytes) -> None:
        try:
            self._serial.write(data)
        except (serial.SerialException, OSError) as problem:
            raise TransportError(f"cannot write to port {self._port}: {problem}", "not_written") from problem

    def read(self, timeout_s: float) -> bytes:
        try:
            self._serial.timeout = max(timeout_s, 0.0)
            first = self._serial.read(1)
            return bytes(first + self._serial.read(self._serial.in_waiting)) if first else b""
        except (serial.SerialException, OSError, TypeError) as problem:
            # pyserial raises TypeError when another thread closes the port during a read.
            raise TransportError(f"cannot read from port {self._port}: {problem}", "not_read") from problem

    def set_line(self, line: ModemLine, *, level: bool) -> None:
        """Raise or lower RTS or DTR, and return when the system confirms it. Raises TransportError."""
        try:
            setattr(self._serial, line, level)
        except (serial.SerialException, OSError, TypeError) as problem:
            raise TransportError(
                f"cannot set {line.upper()} of port {self._port}: {problem}", "not_written"
            ) from problem

    def input_of(self, line: ModemLine) -> bool:
        """Return the level of the input that a loop-back joins with a line: CTS of RTS, DSR of DTR."""
        try:
            return bool(self._serial.cts if line == "rts" else self._serial.dsr)
        except (serial.SerialException, OSError, TypeError) as problem:
            raise TransportError(f"cannot read inputs of port {self._port}: {problem}", "not_read") from problem

    def close(self) -> None:
        self._serial.close()
        self._let_go()

    def _let_go(self) -> None:
        if self._ownership is not None:
            self._ownership.release()


def _made(port: str, baud: int, character: str, *, dtr: bool, rts: bool, exclusive: bool) -> Any:
    """Create the serial object without opening it, since opening may reset the board."""
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
        wire.dtr, wire.rts = dtr, rts
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
        return TransportError(
            f"port {port} does not exist; connect the device, or correct its port in the configuration", "no_port"
        )
    if number in (errno.EBUSY, errno.EAGAIN):
        return TransportError(f"port {port} is in use by another program; end it or wait for it", "in_use")
    if number == errno.EACCES:
        return TransportError(f"no permission to open port {port}; give your account access to it", "no_permission")
    first = "".join(str(problem).splitlines()[:1])
    return TransportError(f"cannot open port {port}: {first}", "not_opened")


__all__ = ["SCHEME", "TcpTransport"]

CONNECT_S = 3.0
WRITE_S = 1.0
_CHUNK = 1 << 16


class TcpTransport:
    """Transport over one TCP connection to `tcp://HOST:PORT`, owned by one process of this machine at a time.

    owned: False for a stop, which is sent even if another process owns the port. Raises TransportError if there is
    no connection; NotOwnedError if the port is owned.
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
            raise TransportError(f"cannot write to port {self._port}: {_reason(problem)}", "not_written") from problem

    def read(self, timeout_s: float) -> bytes:
        try:
            readable, _, _ = select.select([self._socket], [], [], max(timeout_s, 0.0))
            data = self._socket.recv(_CHUNK) if readable else None
        except (OSError, ValueError) as problem:
            raise TransportError(f"cannot read from port {self._port}: {_reason(problem)}", "not_read") from problem
        if data == b"":
            raise TransportError(f"cannot read from port {self._port}: the device closed the connection", "hung_up")
        return data or b""

    def close(self) -> None:
        self._socket.close()
        if self._ownership is not None:
            self._ownership.release()


RECORD_BYTES = 36
"""Length of the datagrams that UdpTransport joins: a record of the Net F/T sensor."""
_DATAGRAMS_KEPT = 1 << 14
_LONGEST_DATAGRAM = 2048
_RECEIVE_BUFFER = 1 << 22  # bytes; the system grants fewer


class UdpTransport:
    """Transport of datagrams to and from `udp://HOST:PORT`, owned by one process of this machine at a time.

    A thread takes the datagrams as they arrive, because the system's buffer holds those of some 40 ms at 7000 a
    second, and then drops the newest. read() returns the records that have arrived, joined, or one datagram of
    another length. owned: as for TcpTransport. Raises TransportError.
    """

    def __init__(self, port: str, *, name: str | None = None, owned: bool = True) -> None:
        self.name = name or port
        self._port = port
        family, address = udp_addresses(port)[0]
        self._ownership = PortOwnership(port) if owned else None
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            self._socket.connect(address)  # Datagrams of other senders are dropped.
        except OSError as problem:
            self.close()
            raise TransportError(f"cannot open port {port}: {_reason(problem)}", "not_opened") from problem
        self._arrived: deque[bytes] = deque(maxlen=_DATAGRAMS_KEPT)
        self._news = threading.Condition()
        self._problem: OSError | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._receive, name=f"datagrams of {self.name}", daemon=True)
        self._thread.start()

    def write(self, data: bytes) -> None:
        try:
            self._socket.send(data)
        except OSError as problem:
            raise TransportError(f"cannot write to port {self._port}: {_reason(problem)}", "not_written") from problem

    def read(self, timeout_s: float) -> bytes:
        with self._news:
            if not self._arrived and self._problem is None and timeout_s > 0:
                self._news.wait(timeout_s)
            problem, self._problem = self._problem, None
            if problem is None:
                return self._joined()
        raise TransportError(f"cannot read from port {self._port}: {_reason(problem)}", "not_read") from problem

    def close(self) -> None:
        self._closed = True
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # Ends a receive that waits.
        self._socket.close()
        if self._ownership is not None:
            self._ownership.release()

    def _joined(self) -> bytes:
        arrived, whole = self._arrived, list[bytes]()
        while arrived and len(arrived[0]) == RECORD_BYTES:
            whole.append(arrived.popleft())
        return b"".join(whole) if whole or not arrived else arrived.popleft()

    def _receive(self) -> None:
        while not self._closed:
            try:
                data, problem = self._socket.recv(_LONGEST_DATAGRAM), None
            except OSError as error:
                data, problem = b"", error
            with self._news:
                if data:
                    self._arrived.append(data)
                self._problem = problem or self._problem
                self._news.notify()
            if problem is not None and problem.errno != errno.ECONNREFUSED:
                return  # Nothing listens there (yet) after ECONNREFUSED; any other error ends the port.


def _connect(port: str, addresses: tuple[Address, ...]) -> socket.socket:
    try:
        connection = _connected(addresses)
    except ConnectionRefusedError as problem:
        raise TransportError(
            f"cannot open port {port}: {_reason(problem)}; switch the device on, or start `rig serve` and wait "
            "until it prints its ports",
            "no_listener",
        ) from problem
    except OSError as problem:
        raise TransportError(f"cannot open port {port}: {_reason(problem)}", "not_opened") from problem
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # A stop must not wait for more bytes.
    connection.settimeout(WRITE_S)
    return connection


def _connected(addresses: tuple[Address, ...]) -> socket.socket:
    """Connect to the first address that accepts. Raises the OSError of the last one."""
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


def _reason(problem: Exception) -> str:
    number = getattr(problem, "errno", None)
    return os.strerror(number).lower() if number and number > 0 else str(problem)


def open_port(
    port: str,
    baud: int,
    *,
    name: str | None = None,
    character: str = EIGHT_N_ONE,
    dtr: bool = True,
    owned: bool = True,
) -> Transport:
    """Open `tcp://HOST:PORT`, `udp://HOST:PORT`, a serial device or a pyserial URL.

    Raises TransportError; NotOwnedError if another process owns the port, unless owned is False, as for a stop.
    """
    if port.startswith(SCHEME):
        return TcpTransport(port, name=name, owned=owned)
    if port.startswith(DATAGRAMS):
        return UdpTransport(port, name=name, owned=owned)
    return SerialTransport(port, baud, name=name, character=character, dtr=dtr, owned=owned)


def may_be_renamed(port: str) -> bool:
    """Return whether the system numbers this port in the order of plugging, so that its name changes the device."""
    return re.fullmatch(r"/dev/tty(ACM|USB)\d+", port) is not None


def refuse_missing(port: str) -> None:
    """Raise TransportError if a device does not exist; URLs are not checked."""
    if os.name == "posix" and "://" not in port and not os.path.exists(port):
        raise TransportError(
            f"port {port} does not exist; connect the device, or correct its port in the configuration", "no_port"
        )
