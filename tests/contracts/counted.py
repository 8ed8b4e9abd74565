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
from sim.devices.counted_motor import DriveAxis
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
    if homed and kind in PER_MM:
        _home_from_near(kind, stage, devices)
    elif homed:
        stage.home()
    sent.clear()
    return Bench(clock, devices, stage, (line, *line.further), sent)


def _home_from_near(kind: str, stage: Stage, devices: Any) -> None:
    act = "search" if kind == "tmcl" else "_home"
    for axis in (devices.x, devices.z):
        per_mm = PER_MM[kind](axis)
        start = -round(NEAR_MM * per_mm)
        axis._axis, axis._zero = DriveAxis(start), start
        setattr(axis, act, partial(_search, axis, per_mm))
    stage.home()
    for axis in (devices.x, devices.z):
        delattr(axis, act)


PER_MM: dict[str, Callable[[Any], float]] = {
    "zaber": lambda axis: axis._counts_per_mm,
    "standa": lambda axis: 2 * axis._highest,  # half a millimeter beyond home
    "tmcl": lambda axis: axis._counts_per_mm,
    "leadshine": lambda axis: 400.0,
}


def _search(axis: Any, per_mm: float) -> None:
    """Home at once from near."""
    if hasattr(axis, "flags"):
        axis.flags &= ~0x20
    axis._search([(0.0, per_mm)], 1e6, 1e6)


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
