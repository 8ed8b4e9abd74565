"""The one source of time for drivers and engine."""

import time
from collections.abc import Callable
from typing import Protocol

POLL_S = 0.001


class Clock(Protocol):
    """What everything in the controller asks for the time, and waits with."""

    def monotonic_s(self) -> float:
        """Seconds that never run backwards; the origin is arbitrary."""
        ...

    def unix_s(self) -> float:
        """Wall time, seconds since 1970-01-01 UTC."""
        ...

    def wait_s(self, seconds: float) -> None:
        """Let this many seconds pass."""
        ...

    def wait_until(self, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait for ready(), at most until monotonic_s() is deadline_s; return what ready() said last."""
        ...


class WallClock:
    """The clock of a real run; it begins at not_before_s at the earliest, where an earlier part of the run ended."""

    def __init__(self, not_before_s: float = 0.0) -> None:
        self._ahead_s = max(not_before_s - time.monotonic(), 0.0)

    def monotonic_s(self) -> float:
        return time.monotonic() + self._ahead_s

    def unix_s(self) -> float:
        return time.time()

    def wait_s(self, seconds: float) -> None:
        time.sleep(max(seconds, 0.0))

    def wait_until(self, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Poll ready() every millisecond."""
        while not ready():
            left_s = deadline_s - self.monotonic_s()
            if left_s <= 0:
                return ready()
            time.sleep(min(POLL_S, left_s))
        return True
