"""Scheduling for virtual devices, and virtual time that jumps from event to event."""

import heapq
import math
from collections.abc import Callable
from typing import Protocol

from sim.errors import ArgumentError

_ON_GRID = 1e-6  # of a period: round-off allowed at a sample time


def sample_at(t_s: float, period_s: float) -> int:
    """Return the number of the last sample of a fixed grid at t_s."""
    return math.floor(t_s / period_s + _ON_GRID)


class Handle(Protocol):
    """Scheduled call that can be canceled."""

    def cancel(self) -> None: ...


class Scheduler(Protocol):
    """Time and scheduling as a virtual device needs them, on any clock."""

    def monotonic_s(self) -> float: ...

    def call_at(self, t_s: float, action: Callable[[], None]) -> Handle: ...


class _Event:
    __slots__ = ("action",)

    def __init__(self, action: Callable[[], None]) -> None:
        self.action: Callable[[], None] | None = action

    def cancel(self) -> None:
        self.action = None


class EventQueue:
    """Queue of future calls, ordered by time; ties in order of creation."""

    def __init__(self) -> None:
        self._count = 0
        self._heap: list[tuple[float, int, _Event]] = []

    def push(self, t_s: float, action: Callable[[], None]) -> Handle:
        """Schedule a call. Raises ArgumentError unless t_s is finite."""
        if not math.isfinite(t_s):
            raise ArgumentError(f"an event requires a finite time, got {t_s}", "endless_time")
        event = _Event(action)
        self._count += 1
        heapq.heappush(self._heap, (t_s, self._count, event))
        return event

    def next_s(self) -> float:
        """Return the time of the next call; inf if there is none."""
        while self._heap and self._heap[0][2].action is None:
            heapq.heappop(self._heap)
        return self._heap[0][0] if self._heap else math.inf

    def pop(self) -> Callable[[], None]:
        """Return the next call; call next_s() first."""
        _, _, event = heapq.heappop(self._heap)
        action, event.action = event.action, None
        assert action is not None
        return action


class VirtualClock:
    """Clock that jumps from event to event, without threads and in a fixed order.

    It begins at start_s, which is start_unix_s in wall time.
    """

    def __init__(self, start_unix_s: float = 0.0, start_s: float = 0.0) -> None:
        self._start_unix_s = start_unix_s - start_s
        self._now_s = start_s
        self._queue = EventQueue()

    def monotonic_s(self) -> float:
        return self._now_s

    def run_s(self, at_s: float | None = None) -> float:
        """Return the virtual time, now or at_s: the clock is made for one run."""
        return self._now_s if at_s is None else at_s

    def unix_s(self) -> float:
        return self._start_unix_s + self._now_s

    def suspended_s(self) -> float:
        """Return 0: virtual time is not suspended."""
        return 0.0

    def call_at(self, t_s: float, action: Callable[[], None]) -> Handle:
        """Call an action at t_s; a time in the past means now. Ties keep their order."""
        return self._queue.push(max(t_s, self._now_s), action)

    def wait_s(self, seconds: float) -> None:
        """Run all events of the next seconds."""
        self.wait_until(_never, self._now_s + max(seconds, 0.0))

    def wait_until(self, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Run event by event until ready() or deadline_s, and stop at exactly that time.

        Raises RuntimeError where no event could end the wait.
        """
        if math.isnan(deadline_s):
            raise ArgumentError("the deadline of a wait must be a number", "no_deadline")
        while not ready():
            t_s = self._queue.next_s()
            if t_s == math.inf or t_s > deadline_s:
                return self._stand_at(deadline_s, ready)
            self._now_s = t_s
            self._queue.pop()()
        return True

    def _stand_at(self, deadline_s: float, ready: Callable[[], bool]) -> bool:
        if math.isinf(deadline_s):
            raise RuntimeError("a wait without a deadline would never end, since no event is due")
        self._now_s = max(self._now_s, deadline_s)
        return ready()


def _never() -> bool:
    return False
