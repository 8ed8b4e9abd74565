"""A gate on the wires of a stage: after a stop nothing goes out any more of what was under way."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rig.transport.wire import Transport, TransportError

STUCK_S = 0.05
"""A write that has not come back after so long does not hold up a stop."""


class StopGate:
    """Closed by a stop, which comes from another thread than what is being done.

    Between its bytes and the moment when the other thread notices, that one may be about to send a move: a controller
    that was reset at rest would carry it out. Whatever is sent or heard through a closed gate, but by who stops, is a
    TransportError. It is opened again by whoever has come to the end of what was under way.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._stopping: list[int] = []  # threads that stop now
        self.closed = False

    def guarded(self, wire: Transport) -> Transport:
        """The wire behind the gate."""
        return _Guarded(wire, self)

    @contextmanager
    def stopping(self) -> Iterator[None]:
        """From here on the gate is closed; what is said inside, in this thread, passes."""
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
        """Open it again, unless somebody is stopping now; whether it is open."""
        with self._lock:
            self.closed = bool(self._stopping)
            return not self.closed

    def write(self, wire: Transport, data: bytes) -> None:
        """Raises TransportError where it is closed."""
        if threading.get_ident() in self._stopping:
            wire.write(data)
            return
        with self._lock:  # checked and written at once: nothing slips through behind a stop
            self.refuse(wire)
            wire.write(data)

    def refuse(self, wire: Transport) -> None:
        """Raises TransportError where it is closed for this thread."""
        if self.closed and threading.get_ident() not in self._stopping:
            raise TransportError("{port}: stopped by the operator", code="stopped", port=wire.name)


class _Guarded:
    """A transport behind a gate."""

    def __init__(self, wire: Transport, gate: StopGate) -> None:
        self.name = wire.name
        self._wire, self._gate = wire, gate

    def write(self, data: bytes) -> None:
        self._gate.write(self._wire, data)

    def read(self, timeout_s: float) -> bytes:
        self._gate.refuse(self._wire)
        data = self._wire.read(timeout_s)
        self._gate.refuse(self._wire)  # it is the answer to who stops
        return data

    def close(self) -> None:
        self._wire.close()
