"""What an engine works on: clock, stage, force sensor and operator; and the heartbeat that watches it."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from rig.clock import Clock
from rig.devices.base import ForceSensor, Stage
from rig.engine.bench_memory import LastKnown
from rig.engine.contact import KnownContact
from rig.engine.sensing import ForceZero

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


@dataclass(frozen=True)
class Pause:
    """Ctrl-C and what follows it: asked at every safe point; go_on says whether the run goes on afterwards."""

    asked: Callable[[], bool] = lambda: False
    go_on: Callable[[], bool] = lambda: False


NO_PAUSE = Pause()


class Operator(Protocol):
    """Whoever stands at the bench."""

    @property
    def pause(self) -> Pause:
        """The wish to stop at the next safe point."""
        ...

    def mount(self, indentor: str) -> str:
        """Put this indentor on the carriage; returns the name of the one that is on then."""
        ...


class Bench(Protocol):
    """Devices on one clock, and their operator."""

    @property
    def clock(self) -> Clock: ...

    @property
    def stage(self) -> Stage: ...

    @property
    def force(self) -> ForceSensor: ...

    @property
    def operator(self) -> Operator: ...


class WatchedBench(Bench, Protocol):
    """A bench that a whole script is carried out on."""

    @property
    def virtual(self) -> bool: ...

    def witness(self, stream: str, data: Mapping[str, Any]) -> Mapping[str, float]:
        """What this bench alone knows of an event, for the journal: the truth of a virtual one, else nothing."""
        ...

    def look_after(self, heartbeat: Heartbeat) -> AbstractContextManager[None]:
        """Have the heartbeat looked at, whatever the engine waits for."""
        ...

    @property
    def before(self) -> LastKnown:
        """What the command before this one left; nothing of a virtual bench, which is always a new one."""
        ...

    def touched(self, known: KnownContact) -> None:
        """Record what is known about contact, for whoever uses the bench next. Raises RecordError."""
        ...

    def left_with(self, zero: ForceZero | None) -> None:
        """What forces were counted from, for whoever uses the bench next."""
        ...

    def close(self) -> None:
        """Give the ports back."""
        ...
