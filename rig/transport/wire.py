"""Transports of bytes for drivers: line reader, byte log, and loopback to virtual devices."""

import json
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rig.clock import Clock
from rig.errors import RigError


class TransportError(RigError):
    """Error of a transport: port missing, busy, unplugged or closed."""

    default_code = "wire_failed"


@contextmanager
def in_turn(lock: threading.Lock, most_s: float) -> Iterator[None]:
    """Wait for an exchange in another thread, but not for one that hangs."""
    mine = lock.acquire(timeout=most_s)
    try:
        yield
    finally:
        if mine:
            lock.release()


class Transport(Protocol):
    """Two-way stream of bytes."""

    @property
    def name(self) -> str:
        """Name of the port in messages."""
        ...

    def write(self, data: bytes) -> None:
        """Send at once, even while another thread waits in read(). Raises TransportError."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return as soon as there is at least one byte, b"" after timeout_s. Raises TransportError."""
        ...

    def close(self) -> None: ...


LONGEST_LINE = 4096
MOST_CHUNKS = 1000
"""Chunks that can have arrived: 64 MB of a socket, more than its buffer holds."""


class NeverQuietError(TransportError):
    """A port delivers bytes without end."""

    default_code = "never_quiet"


def arrived(transport: Transport) -> Iterator[bytes]:
    """Yield what has arrived, without waiting. Raises TransportError, NeverQuietError."""
    for _ in range(MOST_CHUNKS):
        data = transport.read(0.0)
        if not data:
            return
        yield data
    raise NeverQuietError(f"{transport.name}: the device never stops sending; check the device and the baud rate")


class LineReader:
    """Reader of lines that end in LF or CR LF; it skips empty ones and turns non-ASCII bytes into U+FFFD."""

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self._transport = transport
        self._clock = clock
        self._rest = b""
        self._lines: deque[str] = deque()

    def read_line(self, deadline_s: float) -> str | None:
        """Return the next line, or None if monotonic_s() gets to deadline_s first. Raises TransportError."""
        while not self._lines:
            left_s = deadline_s - self._clock.monotonic_s()
            data = self._transport.read(max(left_s, 0.0))
            if data:
                self._take(data)
            elif left_s <= 0:
                return None
        return self._lines.popleft()

    @property
    def unended(self) -> bytes:
        """Bytes that have been read since the last end of line."""
        return self._rest

    def pending(self) -> Iterator[str]:
        """Yield the lines that have already arrived, without waiting. Raises TransportError."""
        while self._lines:
            yield self._lines.popleft()
        for data in arrived(self._transport):
            self._take(data)
            while self._lines:
                yield self._lines.popleft()

    def discard(self) -> None:
        """Discard everything that has arrived, partial lines included. Raises TransportError."""
        for _ in arrived(self._transport):
            pass
        self._rest = b""
        self._lines.clear()

    def _take(self, data: bytes) -> None:
        *whole, self._rest = (self._rest + data).split(b"\n")
        for raw in whole:
            line = raw.decode("ascii", "replace").strip()
            if line:
                self._lines.append(line)
        if len(self._rest) > LONGEST_LINE:
            self._rest = b""
            raise TransportError(
                f"{self._transport.name}: {LONGEST_LINE} bytes without an end of line (LF); check the baud rate, and "
                "how the device ends its lines",
                "line_too_long",
            )


class Sink(Protocol):
    """Destination of lines."""

    def write(self, text: str, /) -> object:
        """Write one whole line."""


class LoggedTransport:
    """Transport that logs each chunk as one JSON line: t_s (of the run), port, dir (tx or rx), hex."""

    def __init__(self, inner: Transport, clock: Clock, sink: Sink) -> None:
        self.name = inner.name
        self._inner = inner
        self._clock = clock
        self._sink = sink
        port = json.dumps(inner.name)
        self._tx = f', "port": {port}, "dir": "tx", "hex": "'
        self._rx = f', "port": {port}, "dir": "rx", "hex": "'

    def write(self, data: bytes) -> None:
        # The bytes are sent first: a full disk must not delay a stop.
        t_s = self._clock.run_s()
        self._inner.write(data)
        self._log(t_s, self._tx, data)

    def read(self, timeout_s: float) -> bytes:
        data = self._inner.read(timeout_s)
        if data:
            self._log(self._clock.run_s(), self._rx, data)
        return data

    def close(self) -> None:
        self._inner.close()

    def _log(self, t_s: float, middle: str, data: bytes) -> None:
        self._sink.write(f'{{"t_s": {t_s:.6f}{middle}{data.hex()}"}}\n')


class HostLine(Protocol):
    """Host end of a virtual serial line."""

    def host_write(self, data: bytes) -> None: ...

    def host_read(self) -> bytes: ...

    def host_pending(self) -> bool: ...


class LoopbackTransport:
    """Transport over a HostLine; waiting lets the clock run to the next byte."""

    def __init__(self, line: HostLine, clock: Clock, name: str = "loopback") -> None:
        self.name = name
        self._line: HostLine | None = line
        self._clock = clock

    def write(self, data: bytes) -> None:
        self._open_line().host_write(data)

    def read(self, timeout_s: float) -> bytes:
        line = self._open_line()
        if timeout_s > 0 and not line.host_pending():
            self._clock.wait_until(line.host_pending, self._clock.monotonic_s() + timeout_s)
        return line.host_read()

    def close(self) -> None:
        self._line = None

    def _open_line(self) -> HostLine:
        if self._line is None:
            raise TransportError(f"port {self.name} is closed", "closed")
        return self._line


class TimeLimitedTransport:
    """Transport for a probe; reading raises TransportError when the probe has taken too long."""

    def __init__(self, inner: Transport, clock: Clock, within_s: float) -> None:
        self.name = inner.name
        self._inner, self._clock, self._within_s = inner, clock, within_s
        self._until_s = clock.monotonic_s() + within_s

    def write(self, data: bytes) -> None:
        self._inner.write(data)

    def read(self, timeout_s: float) -> bytes:
        left_s = self._until_s - self._clock.monotonic_s()
        if left_s <= 0:
            raise TransportError(
                f"port {self.name}: no device was identified within {self._within_s:g} s", "probe_timeout"
            )
        return self._inner.read(min(timeout_s, left_s))

    def close(self) -> None:
        self._inner.close()
