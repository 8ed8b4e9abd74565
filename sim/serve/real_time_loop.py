"""Real-time event loop of the virtual devices: one thread over timers and open files."""

import math
import selectors
import socket
import sys
import time
from collections.abc import Callable
from typing import Protocol

from sim.devices.clock import EventQueue, Handle

# Ctrl-C does not end a wait for sockets on Windows: its handler runs afterwards.
_LONGEST_WAIT_S = 0.1 if sys.platform == "win32" else math.inf


class HasFileno(Protocol):
    """File, socket or pipe."""

    def fileno(self) -> int: ...


class WallScheduler:
    """Scheduler on the wall clock, in seconds since its creation.

    Nothing may block in the loop: a long call delays every device.
    """

    def __init__(self) -> None:
        self._origin_s = time.monotonic()
        self._queue = EventQueue()
        # select() waits to the microsecond, where epoll rounds up to the millisecond: a byte takes 87 µs.
        self._selector = selectors.SelectSelector()
        self._waker, self._woken = socket.socketpair()
        self._waker.setblocking(False)
        self._stopped = False
        self.watch(self._woken, lambda: None)

    def monotonic_s(self) -> float:
        return time.monotonic() - self._origin_s

    def call_at(self, t_s: float, action: Callable[[], None]) -> Handle:
        """Call an action as soon after t_s as the loop can."""
        return self._queue.push(t_s, action)

    def watch(self, file: HasFileno, on_readable: Callable[[], None]) -> None:
        """Call on_readable whenever a file has data."""
        self._selector.register(file, selectors.EVENT_READ, on_readable)

    def unwatch(self, file: HasFileno) -> None:
        """Stop watching a file; call this before closing it."""
        self._selector.unregister(file)

    def run(self) -> None:
        """Run until stop()."""
        while not self._stopped:
            self.run_once()

    def run_once(self, until_s: float = math.inf) -> None:
        """Run due calls, then wait for data, the next timer, or until_s."""
        self._run_due()
        left_s = max(min(self._queue.next_s(), until_s) - self.monotonic_s(), 0.0)
        left_s = min(left_s, _LONGEST_WAIT_S)
        for key, _ in self._selector.select(None if left_s == math.inf else left_s):
            key.data()

    def stop(self) -> None:
        """End run(), also from a signal handler or another thread."""
        self._stopped = True
        self._waker.send(b".")

    def close(self) -> None:
        """Close the loop's own files."""
        self._selector.close()
        self._waker.close()
        self._woken.close()

    def _run_due(self) -> None:
        while self._queue.next_s() <= self.monotonic_s():
            self._queue.pop()()
