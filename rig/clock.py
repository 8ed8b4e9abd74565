"""Source of time for drivers and engine."""

import time
from collections.abc import Callable
from typing import Protocol

POLL_S = 0.001
_TRIES, _AT_ONCE_S = 10, 0.01


class Clock(Protocol):
    """Source of time and waits for the whole controller."""

    def monotonic_s(self) -> float:
        """Return a time that never runs backwards (s); the origin is arbitrary."""
        ...

    def run_s(self, at_s: float | None = None) -> float:
        """Return the time since the start of the run (`t_s`, s), now or when monotonic_s() was at_s."""
        ...

    def unix_s(self) -> float:
        """Return the wall time (s since 1970-01-01 UTC)."""
        ...

    def suspended_s(self) -> float:
        """Return the time during which the computer was suspended (s), which monotonic_s() omits; the origin is
        arbitrary.
        """
        ...

    def wait_s(self, seconds: float) -> None:
        """Wait for a number of seconds."""
        ...

    def wait_until(self, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait until ready() is true or monotonic_s() reaches deadline_s; return the last value of ready()."""
        ...


def real_s(clock: Clock) -> float:
    """Return a time (s) that goes on while the computer is suspended, as a finger does."""
    return clock.monotonic_s() + clock.suspended_s()


class WallClock:
    """Clock of a real run. Outside of a run, run_s() counts from the creation of the clock."""

    def __init__(self, run_s: float = 0.0) -> None:
        """Set the present time of the run (s)."""
        self._began_s = time.monotonic() - run_s

    def begin_run(self, run_s: float = 0.0) -> float:
        """Begin a run, or its next part at run_s; return by how much earlier times of the run are ahead (s).

        monotonic_s() and all deadlines are unaffected.
        """
        before_s, self._began_s = self._began_s, time.monotonic() - run_s
        return self._began_s - before_s

    def monotonic_s(self) -> float:
        return time.monotonic()

    def run_s(self, at_s: float | None = None) -> float:
        return (time.monotonic() if at_s is None else at_s) - self._began_s

    def unix_s(self) -> float:
        return time.time()

    def suspended_s(self) -> float:
        """Return the suspended time; 0 if no clock counts it, or if the monotonic clock does (Windows)."""
        read: Callable[[int], float] | None = getattr(time, "clock_gettime", None)
        goes_on: int | None = getattr(time, "CLOCK_BOOTTIME", None)
        if read is None or goes_on is None:
            return 0.0
        for _ in range(_TRIES):  # The process may be interrupted between two clocks.
            before_s, all_s, after_s = time.monotonic(), read(goes_on), time.monotonic()
            if after_s - before_s < _AT_ONCE_S:
                break
        return all_s - before_s

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
