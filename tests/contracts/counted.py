"""Stages whose axes count steps: driver and virtual devices, and a wire for their links."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from rig.bench.virtual import stage_opener, virtual_stage
from rig.devices.base import Stage
from rig.devices.make_drivers import stage_driver
from rig.plan.config import Config
from rig.transport import LoopbackTransport
from sim.devices.clock import VirtualClock
from sim.devices.counted_motor import DriveAxis, MotorPair
from sim.devices.line import SerialLine
from tests.timed_wire import TimedWire

NEAR_MM = 0.05
"""So far from home an axis of a homed bench begins, so that its test spends little time on the way."""


@dataclass
class Bench:
    """Driver and virtual devices; sent: when, to the line of z or to that of x, and what."""

    clock: VirtualClock
    devices: Any
    stage: Stage
    lines: tuple[SerialLine, ...]
    sent: list[tuple[float, str, bytes]]

    def carriage_steps(self) -> tuple[float, float, float]:
        """Where the carriage is now."""
        steps: tuple[float, float, float] = self.devices.carriage_steps_at(self.clock.monotonic_s())
        return steps

    def stands(self, for_s: float = 1.0) -> bool:
        """Whether nothing moves for so long."""
        before = self.carriage_steps()
        self.clock.wait_s(for_s)
        return self.carriage_steps() == before


def bench_of(kind: str, *, homed: bool = True, connected: bool = True, **tables: Any) -> Bench:
    """A bench of a kind, homed unless that is not asked."""
    config = Config.model_validate({"stage": {"kind": kind, **tables.pop("stage", {})}, **tables})
    clock, sent = VirtualClock(1.7e9, 50.0), list[tuple[float, str, bytes]]()
    line = SerialLine(clock, config.stage.baud)
    devices: Any = virtual_stage(clock, line, config)

    def noted(one: SerialLine, name: str) -> LoopbackTransport:
        wire, axis = LoopbackTransport(one, clock, "wire"), "z" if one is line else "x"
        write = wire.write

        def writing(data: bytes) -> None:
            sent.append((clock.monotonic_s(), axis, data))
            write(data)

        wire.write = writing  # type: ignore[method-assign]
        return wire

    stage: Stage = stage_driver(stage_opener(config, line, noted), clock, config)
    if connected:
        stage.connect()
    if homed and isinstance(devices, MotorPair):
        _home_from_near(stage, devices)
    elif homed:
        stage.home()
    sent.clear()
    return Bench(clock, devices, stage, (line, *line.further), sent)


def _home_from_near(stage: Stage, devices: MotorPair) -> None:
    """Home from near, at 1 mm/s and without backing off."""
    for name in ("x", "z"):
        axis, per_mm = getattr(devices, name), abs(stage.steps_per_mm(name))
        start = -round(NEAR_MM * per_mm)
        axis._axis, axis._zero = DriveAxis(start), start
        axis._axis.go = partial(_straight, axis._axis, per_mm)
    stage.home()
    for motor in (devices.x, devices.z):
        del motor._axis.go


def _straight(axis: DriveAxis, speed: float, legs: list[tuple[float, float]], *ramps_and_time: float) -> None:
    DriveAxis.go(axis, [(legs[-1][0], speed)], 1e6, 1e6, ramps_and_time[-1])


class ScriptedWire(TimedWire):
    """A wire whose far end says, to each write, what the test wants: a piece in each ms, or at once."""

    def __init__(self, clock: VirtualClock, says: Callable[[bytes], list[bytes]], piece_s: float = 0.0) -> None:
        super().__init__(clock)
        self.says, self._piece_s = says, piece_s
        self.sent: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        now_s = self.clock.monotonic_s()
        self.coming += [(now_s + n * self._piece_s, piece) for n, piece in enumerate(self.says(data), 1)]
