"""The engine's heartbeat: where it is not heard of in time, the stage is stopped, whatever the engine waits for."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rig.transport.clock import Clock

LOOK_S = 0.02


class Heartbeat:
    """A promise to be heard of again; look() keeps it, from a thread or a timer that waits for nothing.

    Only what is promised is watched: a rig that touches nothing may wait for its operator all day.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._due_s: float | None = None
        self.stop: Callable[[], None] = lambda: None
        self.lost = False

    def beat(self, within_s: float) -> None:
        """Here; and again within so many seconds."""
        self._due_s = self._clock.monotonic_s() + within_s

    def rest(self) -> None:
        """Nothing is touched: there is nothing to watch."""
        self._due_s = None

    def look(self) -> None:
        """Stop the stage, once, if the beat that was promised has not come."""
        due_s = self._due_s
        if due_s is None or self.lost or self._clock.monotonic_s() <= due_s:
            return
        self.lost = True
        self.stop()


@contextmanager
def looked_after(heartbeat: Heartbeat) -> Iterator[None]:
    """A thread of its own that looks, on the real clock, every LOOK_S."""
    over = threading.Event()

    def watch() -> None:
        while not over.wait(LOOK_S):
            heartbeat.look()

    thread = threading.Thread(target=watch, name="heartbeat", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
