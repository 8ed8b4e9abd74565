"""What an engine works on: a clock, a stage, a force sensor, and whoever stands there."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from rig.devices.force.base import ForceSensor
from rig.devices.stage.base import Stage
from rig.engine.by_hand.bench_memory import LastKnown
from rig.engine.contact import Contact
from rig.engine.heartbeat import Heartbeat
from rig.engine.sensing import Zero
from rig.transport.clock import Clock


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

    def touched(self, known: Contact) -> None:
        """Record what is known about contact, for whoever uses the bench next. Raises RecordError."""
        ...

    def left_with(self, zero: Zero | None) -> None:
        """What forces were counted from, for whoever uses the bench next."""
        ...

    def close(self) -> None:
        """Give the ports back."""
        ...
