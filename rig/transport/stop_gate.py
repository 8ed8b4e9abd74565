"""Gate on the transports of a stage: after a stop, pending commands are blocked."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rig.transport.wire import Transport, TransportError

STUCK_S = 0.05
"""Longest time that a stop waits for a pending write (s)."""


class StopGate:
    """Gate that a stop closes from another thread.

    After the stop is sent, the working thread may still send a move before it notices, and a controller that was
    reset at rest would carry it out. Through a closed gate, every other thread's read or write raises
    TransportError. The working thread opens the gate again when it has ended its command.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._stopping: list[int] = []  # threads that stop now
        self.closed = False

    def guarded(self, wire: Transport) -> Transport:
        """Return the transport behind the gate."""
        return _Guarded(wire, self)

    @contextmanager
    def stopping(self) -> Iterator[None]:
        """Close the gate; this thread may still read and write inside the context."""
        held = self._lock.acquire(timeout=STUCK_S)
        self.closed = True
        self._stopping.append(threading.get_ident())
        if held:
            self._lock.release()
        try:
            yield
        finally:
            self._stopping.remove(threading.get_ident())

    def open(self) -> bool:
        """Open the gate unless a stop is in progress; return whether it is open."""
        with self._lock:
            self.closed = bool(self._stopping)
            return not self.closed

    def write(self, wire: Transport, data: bytes) -> None:
        """Write through the gate. Raises TransportError if it is closed."""
        if threading.get_ident() in self._stopping:
            wire.write(data)
            return
        with self._lock:  # Check and write under one lock, so that nothing follows a stop.
            self.refuse(wire)
            wire.write(data)

    def refuse(self, wire: Transport) -> None:
        """Raise TransportError if the gate is closed for this thread."""
        if self.closed and threading.get_ident() not in self._stopping:
            raise TransportError(f"{wire.name}: stopped by the operator", "stopped")


class _Guarded:
    """Transport behind a gate."""

    def __init__(self, wire: Transport, gate: StopGate) -> None:
        self.name = wire.name
        self._wire, self._gate = wire, gate

    def write(self, data: bytes) -> None:
        self._gate.write(self._wire, data)

    def read(self, timeout_s: float) -> bytes:
        self._gate.refuse(self._wire)
        data = self._wire.read(timeout_s)
        self._gate.refuse(self._wire)  # The reply belongs to the stopping thread.
        return data

    def close(self) -> None:
        self._wire.close()
