"""Lines out of a stream of bytes that arrives in any pieces."""

from collections import deque

from rig.transport.base import Transport, TransportError
from rig.transport.clock import Clock

LONGEST_LINE = 4096


class LineReader:
    """Assembles lines that end in LF or CR LF; empty ones are skipped, non-ASCII bytes become U+FFFD."""

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

    def next_pending(self) -> str | None:
        """Return a line that is already there, without waiting."""
        if not self._lines:
            data = self._transport.read(0.0)
            if data:
                self._take(data)
        return self._lines.popleft() if self._lines else None

    def discard(self) -> None:
        """Forget everything that has arrived, half lines included."""
        while self._transport.read(0.0):
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
                "{port}: {longest} bytes without an end of line",
                code="line_too_long",
                port=self._transport.name,
                longest=LONGEST_LINE,
            )
