"""The bench of a dry-run: real drivers, real bytes, and virtual devices on one virtual clock."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, Protocol, TextIO

from rig.devices.bench import force_driver, stage_driver
from rig.devices.force.base import ForceSensor
from rig.devices.heartbeat import LOOK_S, Heartbeat
from rig.devices.stage.base import Stage
from rig.plan.config import Config
from rig.transport.byte_log import LoggedTransport
from rig.transport.loopback import LoopbackTransport
from rig.virtual.virtual_devices import FORCES, STAGES, load_on_sensor, true_carriage, truth
from sim.devices.cell import Load
from sim.devices.clock import VirtualClock
from sim.devices.line import SerialLine
from sim.models.fingertip import Fingertip
from sim.plant.plant import Carriage, Plant, TruePose


class AnyPlant(Protocol):
    """What stands under the virtual indentor."""

    def mount(self, indentor: str) -> None: ...

    def pose_at(self, t_s: float) -> TruePose: ...

    def force_n(self, t_s: float) -> float: ...


@dataclass(frozen=True)
class VirtualBench:
    """What the engine needs, and the plant behind the wire. It is its own operator."""

    clock: VirtualClock
    stage: Stage
    force: ForceSensor
    plant: AnyPlant
    virtual: Literal[True] = True

    def mount(self, indentor: str) -> str:
        """The virtual operator never takes the wrong one."""
        self.plant.mount(indentor)
        return indentor

    def confirm(self, request: str) -> None:
        """Nobody needs to be asked here."""

    def true_pose(self) -> tuple[float, float]:
        """True x and DOI in mm."""
        pose = self.plant.pose_at(self.clock.monotonic_s())
        return pose.x_mm, pose.doi_mm

    @contextmanager
    def look_after(self, heartbeat: Heartbeat) -> Iterator[None]:
        """A timer of the virtual clock looks at it."""
        looking = True

        def look() -> None:
            heartbeat.look()
            if looking:
                self.clock.call_at(self.clock.monotonic_s() + LOOK_S, look)

        look()
        try:
            yield
        finally:
            looking = False

    def close(self) -> None:
        """There is nothing to give back."""


def virtual_bench(
    config: Config, finger: Fingertip, byte_log: TextIO, start_unix_s: float, start_s: float = 0.0
) -> VirtualBench:
    """Devices as configured, with the fingertip under the indentor; the bytes go to `byte_log`."""

    def plant(carriage: Carriage) -> Plant:
        return Plant(finger, carriage, truth(config))

    return bench_around(plant, config, VirtualClock(start_unix_s, start_s), byte_log)


def bench_around(
    make_plant: Callable[[Carriage], AnyPlant], config: Config, clock: VirtualClock, byte_log: TextIO
) -> VirtualBench:
    """Devices as configured around a plant, which is told where the carriage is; the bytes go to `byte_log`."""
    stage_line = SerialLine(clock, config.stage.baud)
    force_line = SerialLine(clock, config.force.baud)
    board = STAGES[config.stage.kind](clock, stage_line, config)
    plant = make_plant(true_carriage(board, config))
    load = load_on_sensor(clock, Load(plant.force_n), config)
    FORCES[config.force.kind](clock, force_line, config, load)
    stage_port = LoggedTransport(LoopbackTransport(stage_line, clock, name="stage"), clock, byte_log)
    force_port = LoggedTransport(LoopbackTransport(force_line, clock, name="force"), clock, byte_log)
    return VirtualBench(
        clock,
        stage_driver(lambda _port: stage_port, clock, config),
        force_driver(lambda _port: force_port, clock, config),
        plant,
    )
