"""Bench of a real run: devices on the configured ports, and the operator."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Literal, Self

from rig.clock import WallClock
from rig.control.owned_stage import OwnedStage
from rig.devices.base import ForceError, ForceSensor, Stage, StageAlarm, StageError, StageHeld, StageReset
from rig.devices.make_drivers import open_force, open_stage
from rig.engine.bench import NO_PAUSE, Bench, Meanwhile, Pause, monitored
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.contact import KnownContact
from rig.engine.limits import Heartbeat
from rig.engine.sensing import ForceZero
from rig.settings import BenchSettings
from rig.transport import TransportError
from rig.transport.wire import Sink


class PortError(TransportError):
    """Error of a port that could not be opened; `device` names it."""

    def __init__(self, device: Literal["stage", "force"], error: TransportError) -> None:
        super().__init__(str(error), error.code)
        self.device = device


@dataclass(frozen=True)
class Request:
    """Request to the person at the bench.

    indentor: the one to mount, if that is the request. meanwhile: called while the answer is waited for.
    """

    text: str
    indentor: str | None = None
    meanwhile: Meanwhile = lambda: None


@dataclass(frozen=True)
class RealBench:
    """Bench on real ports and the wall clock; `ask` prompts the operator."""

    clock: WallClock
    stage: Stage
    force: ForceSensor
    ask: Callable[[Request], str]
    pause: Pause
    memory: BenchMemory
    before: LastKnown
    let_go_of_stage: Callable[[], None]
    virtual: Literal[False] = False

    @property
    def operator(self) -> Self:
        """Operator of the bench."""
        return self

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        """Ask for an indentor and return the mounted one: Enter confirms, a name replaces it."""
        return self.ask(Request(f"mount {indentor}", indentor, meanwhile)).strip() or indentor

    def confirm(self, request: str) -> None:
        """Return when the operator confirms a request."""
        self.ask(Request(request))

    def witness(self, stream: str, data: Mapping[str, Any]) -> dict[str, float]:
        """Return nothing, because a real bench has no simulated truth."""
        return {}

    def monitor(self, heartbeat: Heartbeat) -> AbstractContextManager[None]:
        """Monitor the heartbeat from a thread."""
        return monitored(heartbeat)

    def touched(self, known: KnownContact) -> None:
        """Record the known state of contact for the next command. Raises RecordError."""
        self.memory.touched(known)

    def record_zero(self, zero: ForceZero | None) -> None:
        """Record the zero for the next command; None: it is not known."""
        self.memory.record_zero(zero)

    def close(self) -> None:
        """Release the ports; record the position of a homed stage."""
        if self.stage.homed:
            with suppress(StageError, TransportError):
                self.memory.left(self.stage.status())
        self.let_go_of_stage()
        self.force.close()


def open_bench(
    settings: BenchSettings,
    clock: WallClock,
    byte_log: Sink,
    ask: Callable[[Request], str],
    pause: Pause = NO_PAUSE,
    in_hand: OwnedStage | None = None,
) -> RealBench:
    """Open both ports; the bytes go to `byte_log`, and `ask` prompts the operator.

    in_hand: owner of a stage that is already open, which gets it back. Raises PortError.
    """
    memory = BenchMemory(settings)
    with _named("stage"):
        stage = open_stage(settings, clock, byte_log) if in_hand is None else in_hand.lend(byte_log)
    let_go = stage.close if in_hand is None else in_hand.give_back
    try:
        with _named("force"):
            force = open_force(settings, clock, byte_log)
        before = memory.read()
        memory.moves()
        return RealBench(clock, stage, force, ask, pause, memory, before, let_go)
    except BaseException:
        let_go()
        raise


WAKES_S, AGAIN_S = 3.0, 0.1
"""Time for a sensor to answer after its port was opened, which restarts some devices; time between questions (s)."""


def refuse_silent_sensor(bench: Bench) -> None:
    """Ask the force sensor for its identity, before a person mounts anything.

    Raises ForceError, with the code swapped_ports if the stage does not answer either.
    """
    deadline_s = bench.clock.monotonic_s() + WAKES_S
    while True:
        try:
            bench.force.identify()
            return
        except ForceError as error:
            if bench.clock.monotonic_s() >= deadline_s:
                problem = error
                break
        bench.clock.wait_s(AGAIN_S)
    try:
        bench.stage.look()
    except (StageAlarm, StageReset, StageHeld):  # It answers, and homing will report what is wrong.
        pass
    except StageError as silent:
        raise ForceError(
            f"{problem}; {silent}; exchange stage.port and force.port if they are swapped", "swapped_ports"
        ) from problem
    raise problem


@contextmanager
def _named(device: Literal["stage", "force"]) -> Iterator[None]:
    try:
        yield
    except TransportError as error:
        raise PortError(device, error) from error
