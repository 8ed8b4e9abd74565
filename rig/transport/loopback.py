"""A wire inside this process, for devices that live behind a virtual line."""

from typing import Protocol

from rig.transport.base import TransportError
from rig.transport.clock import Clock


class HostLine(Protocol):
    """The host's end of a virtual serial line."""

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
            raise TransportError("{port} is closed", code="closed", port=self.name)
        return self._line
