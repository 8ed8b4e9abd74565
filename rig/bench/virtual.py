"""The bench of a dry-run: real drivers, real bytes, and virtual devices on one virtual clock."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, Self

from rig.devices.drivers import force_driver, stage_driver
from rig.devices.force.base import ForceSensor
from rig.devices.stage.base import Stage
from rig.engine.bench import NO_PAUSE, Pause
from rig.engine.by_hand.bench_memory import LastKnown
from rig.engine.contact import Contact
from rig.engine.heartbeat import LOOK_S, Heartbeat
from rig.engine.sensing import Zero
from rig.plan.config import Config
from rig.plan.shape_files import kept_in
from rig.session.virtual.twins import virtual_force, virtual_stage, wire_hardware_trip
from rig.session.virtual.virtual_devices import load_on_sensor, relaxation, true_carriage, truth, with_framing
from rig.transport.byte_log import LoggedTransport, Sink
from rig.transport.loopback import LoopbackTransport
from rig.transport.stop_gate import StopGate
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, SerialLine, VirtualStage
from sim.models.fingertip import Fingertip
from sim.plant import Carriage, Plant, RelaxingPlant, TruePose


class AnyPlant(Protocol):
    """What stands under the virtual indentor."""

    def mount(self, indentor: str) -> None: ...

    def pose_at(self, t_s: float) -> TruePose: ...

    def force_n(self, t_s: float) -> float: ...


@contextmanager
def looked_after_by(clock: VirtualClock, heartbeat: Heartbeat) -> Iterator[None]:
    """Have a timer of the virtual clock look at a heartbeat."""
    looking = True

    def look() -> None:
        heartbeat.look()
        if looking:
            clock.call_at(clock.monotonic_s() + LOOK_S, look)

    look()
    try:
        yield
    finally:
        looking = False


@dataclass(frozen=True)
class VirtualBench:
    """What the engine needs, and the plant behind the wire. It is its own operator."""

    clock: VirtualClock
    stage: Stage
    force: ForceSensor
    plant: AnyPlant
    pause: Pause
    virtual: Literal[True] = True
    board: VirtualStage | None = None
    shape_files: Path | None = None  # the folder of the run, which has its own copies of them

    @property
    def operator(self) -> Self:
        """Nobody else stands here."""
        return self

    def mount(self, indentor: str) -> str:
        """The virtual operator never takes the wrong one."""
        self.plant.mount(indentor if self.shape_files is None else kept_in(self.shape_files, indentor))
        return indentor

    def witness(self, stream: str, data: Mapping[str, Any]) -> dict[str, float]:
        """Where the indentor truly is at a touch and at the end of a hold, mm."""
        if stream.endswith("hold_end"):
            pose = self.plant.pose_at(self.clock.monotonic_s())
            return {"true_x_mm": round(pose.x_mm, 9), "true_doi_mm": round(pose.doi_mm, 9)}
        if stream.endswith("touch"):
            pose = self.plant.pose_at(self.clock.monotonic_s())
            return {"true_doi_bias_mm": round(pose.doi_mm - data["doi_mm"], 6)}
        return {}

    def look_after(self, heartbeat: Heartbeat) -> AbstractContextManager[None]:
        """A timer of the virtual clock looks at it."""
        return looked_after_by(self.clock, heartbeat)

    @property
    def before(self) -> LastKnown:
        """Nothing: it is a new one."""
        return LastKnown()

    def touched(self, known: Contact) -> None:
        """No finger is on it when the program is gone."""

    def left_with(self, zero: Zero | None) -> None:
        """The next virtual bench is a new one."""

    def close(self) -> None:
        """There is nothing to give back."""


def virtual_bench(
    config: Config, finger: Fingertip, byte_log: Sink, clock: VirtualClock, pause: Pause
) -> VirtualBench:
    """Devices as configured, with the fingertip under the indentor; the bytes go to `byte_log`."""

    terms, period_s = relaxation(config), config.force.sample_period_s

    def plant(carriage: Carriage) -> Plant:
        if terms:
            return RelaxingPlant(finger, carriage, terms, truth(config), clock, period_s)
        return Plant(finger, carriage, truth(config))

    return bench_around(plant, config, clock, byte_log, pause)


def bench_around(
    make_plant: Callable[[Carriage], AnyPlant],
    config: Config,
    clock: VirtualClock,
    byte_log: Sink,
    pause: Pause = NO_PAUSE,
    gate: StopGate | None = None,
) -> VirtualBench:
    """Devices as configured around a plant, which is told where the carriage is; the bytes go to `byte_log`.

    gate: what a stop closes, between the stage and its driver.
    """
    config = with_framing(config, "rtu")  # there is one wire, whatever ports the configuration names
    stage_line = SerialLine(clock, config.stage.baud)
    force_line = SerialLine(clock, config.force.baud)
    board = virtual_stage(clock, stage_line, config)
    plant = make_plant(true_carriage(board, config))
    load = load_on_sensor(Load(plant.force_n), config)
    wire_hardware_trip(config, board, virtual_force(clock, force_line, config, load))
    stage_wire = LoggedTransport(LoopbackTransport(stage_line, clock, name="stage"), clock, byte_log)
    stage_port = stage_wire if gate is None else gate.guarded(stage_wire)
    force_port = LoggedTransport(LoopbackTransport(force_line, clock, name="force"), clock, byte_log)
    return VirtualBench(
        clock,
        stage_driver(lambda _port: stage_port, clock, config),
        force_driver(lambda _port: force_port, clock, config),
        plant,
        pause,
        board=board,
    )
