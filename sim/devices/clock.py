"""What devices know of time, and virtual time: nothing happens between events, so nothing is waited for."""

import heapq
import math
from collections.abc import Callable
from typing import Protocol

from sim.errors import ArgumentError

_ON_GRID = 1e-6  # of a period: an instant that is a sample's but for round-off


def sample_at(t_s: float, period_s: float) -> int:
    """The number of the last instant of a fixed grid by t_s."""
    return math.floor(t_s / period_s + _ON_GRID)


class Handle(Protocol):
    """A promise of a later call that can be taken back."""

    def cancel(self) -> None: ...


class Scheduler(Protocol):
    """All that a virtual device knows of time, so that it runs on any clock."""

    def monotonic_s(self) -> float: ...

    def call_at(self, t_s: float, action: Callable[[], None]) -> Handle: ...


class _Event:
    __slots__ = ("action",)

    def __init__(self, action: Callable[[], None]) -> None:
        self.action: Callable[[], None] | None = action

    def cancel(self) -> None:
        self.action = None


class EventQueue:
    """Calls to come, in the order of their times; ties in the order they were made."""

    def __init__(self) -> None:
        self._count = 0
        self._heap: list[tuple[float, int, _Event]] = []

    def push(self, t_s: float, action: Callable[[], None]) -> Handle:
        """Raises ValueError unless t_s is finite."""
        if not math.isfinite(t_s):
            raise ArgumentError("an event requires a finite time, got {t_s}", code="endless_time", t_s=t_s)
        event = _Event(action)
        self._count += 1
        heapq.heappush(self._heap, (t_s, self._count, event))
        return event

    def next_s(self) -> float:
        """When the next call is due; inf if there is none."""
        while self._heap and self._heap[0][2].action is None:
            heapq.heappop(self._heap)
        return self._heap[0][0] if self._heap else math.inf

    def pop(self) -> Callable[[], None]:
        """The next call, which next_s() has just found."""
        _, _, event = heapq.heappop(self._heap)
        action, event.action = event.action, None
        assert action is not None
        return action


class VirtualClock:
    """A clock that jumps from event to event: no threads, the same order every time.

    It begins at start_s, when the wall time it claims is start_unix_s.
    """

    def __init__(self, start_unix_s: float = 0.0, start_s: float = 0.0) -> None:
        self._start_unix_s = start_unix_s - start_s
        self._now_s = start_s
        self._queue = EventQueue()

    def monotonic_s(self) -> float:
        return self._now_s

    def unix_s(self) -> float:
        return self._start_unix_s + self._now_s

    def call_at(self, t_s: float, action: Callable[[], None]) -> Handle:
        """Call action when the clock gets to t_s; a time already past means now. Ties run in this order."""
        return self._queue.push(max(t_s, self._now_s), action)

    def wait_s(self, seconds: float) -> None:
        """Run everything that happens in this many seconds."""
        self.wait_until(_never, self._now_s + max(seconds, 0.0))

    def wait_until(self, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Run event by event until ready() or deadline_s, and stop at exactly that instant.

        Raises RuntimeError where nothing could ever end the wait.
        """
        if math.isnan(deadline_s):
            raise ArgumentError("the deadline of a wait must be a number", code="no_deadline", deadline_s=deadline_s)
        while not ready():
            if not self._run_next(deadline_s):
                return self._stand_at(deadline_s, ready)
        return True

    def _run_next(self, deadline_s: float) -> bool:
        t_s = self._queue.next_s()
        if t_s == math.inf or t_s > deadline_s:
            return False
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
