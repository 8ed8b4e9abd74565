"""Devices and operator that an engine works with, and the thread that checks its heartbeat."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from rig.clock import Clock
from rig.devices.base import ForceSensor, Stage
from rig.engine.bench_memory import LastKnown
from rig.engine.contact import KnownContact
from rig.engine.limits import Heartbeat
from rig.engine.sensing import ForceZero

LOOK_S = 0.02


@contextmanager
def monitored(heartbeat: Heartbeat) -> Iterator[None]:
    """Check the heartbeat from a thread every LOOK_S of real time."""
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


Meanwhile = Callable[[], object]
"""Function that a wait for a person calls repeatedly; its exceptions end the wait."""


@dataclass(frozen=True)
class Pause:
    """Pause by the operator: `asked` is polled at safe points; `go_on` waits and returns whether to continue."""

    asked: Callable[[], bool] = lambda: False
    go_on: Callable[[Meanwhile], bool] = lambda meanwhile: False


NO_PAUSE = Pause()


class Operator(Protocol):
    """Operator of the bench."""

    @property
    def pause(self) -> Pause:
        """Pause, polled at safe points."""
        ...

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        """Ask for this indentor to be mounted; return the name of the mounted one."""
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

    @property
    def virtual(self) -> bool: ...


class EngineMemory(Protocol):
    """Record of contact and zero for the next command."""

    def touched(self, known: KnownContact) -> None:
        """Record the state of contact. Raises RecordError."""
        ...

    def record_zero(self, zero: ForceZero | None) -> None:
        """Record the zero of the force sensor; None if it has changed and is unknown."""
        ...


class NoMemory:
    """Memory of a bench that no command follows on."""

    def touched(self, known: KnownContact) -> None:
        """Do nothing."""

    def record_zero(self, zero: ForceZero | None) -> None:
        """Do nothing."""


class WatchedBench(Bench, EngineMemory, Protocol):
    """Bench for a whole script."""

    def witness(self, stream: str, data: Mapping[str, Any]) -> Mapping[str, float]:
        """Return journal fields from the bench itself: simulated truth, or none on a real bench."""
        ...

    def monitor(self, heartbeat: Heartbeat) -> AbstractContextManager[None]:
        """Monitor the heartbeat independently of the engine's thread."""
        ...

    @property
    def before(self) -> LastKnown:
        """State that the previous command left; empty on a virtual bench."""
        ...

    def close(self) -> None:
        """Close the ports."""
        ...
