"""A device that stalls: a reply that comes late is never taken for the reply to another question."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest

from rig.devices.base import ForceError, StageError
from rig.errors import RigError
from rig.transport import LoopbackTransport
from rig.transport.modbus import ModbusMaster
from sim.devices import ModbusBus, SerialLine
from sim.devices.clock import VirtualClock
from tests.contracts.counted import Bench, bench_of
from tests.contracts.force_twin import ForceTwin
from tests.contracts.tables import force_table

STALLS_S = (0.15, 0.21, 0.25, 0.45, 0.65, 1.65)
EVERY_S, BAUD = 0.05, 115200


@dataclass
class Stall:
    """A line whose device falls silent at a time (s) for a while, and then replies to what it received meanwhile.

    forgets: it replies to nothing that it received meanwhile but the first request.
    """

    line: SerialLine
    clock: VirtualClock
    from_s: float
    for_s: float
    forgets: bool

    def __post_init__(self) -> None:
        self._reply, self._hear, self._heard = self.line.device_write, self.line._on_bytes, 0
        self.line.device_write = self.replies  # type: ignore[method-assign]
        self.line._on_bytes = self.hears

    @property
    def on(self) -> bool:
        return self.from_s <= self.clock.monotonic_s() < self.from_s + self.for_s

    def replies(self, data: bytes) -> None:
        """Deliver a reply, after the stall and in turn."""
        if self.on:
            self.clock.call_at(self.from_s + self.for_s, partial(self._reply, data))
        else:
            self._reply(data)

    def hears(self, data: bytes) -> None:
        """Receive a request."""
        self._heard += self.on
        if not (self.on and self.forgets and self._heard > 1):
            self._hear(data)


class OwnAddress:
    """Registers that hold their address."""

    functions = frozenset({3, 6, 16})

    def read(self, address: int, count: int) -> list[int]:
        return [address + k for k in range(count)]

    def write(self, address: int, values: Sequence[int]) -> None:
        """Change nothing."""


forgetting = pytest.mark.parametrize("forgets", [False, True], ids=["replies to all", "forgets what came meanwhile"])
stalls = pytest.mark.parametrize("for_s", STALLS_S)


@forgetting
@stalls
@pytest.mark.parametrize("every_s", [EVERY_S, 0.7], ids=lambda t_s: f"asked each {t_s:g} s")
@pytest.mark.parametrize("turnaround_s", [2e-3, 0.03, 0.15], ids=lambda t_s: f"replies in {1e3 * t_s:g} ms")
def test_a_modbus_rtu_read_after_a_stall_has_its_own_registers(
    for_s: float, forgets: bool, turnaround_s: float, every_s: float
) -> None:
    clock = VirtualClock()
    line = SerialLine(clock, BAUD)
    ModbusBus(clock, line, {1: OwnAddress()}, turnaround_s=turnaround_s)
    Stall(line, clock, 0.5, for_s, forgets)
    bus, read = ModbusMaster(LoopbackTransport(line, clock, "wire"), clock, baud=BAUD), 0
    while clock.monotonic_s() < 12.0:
        for address, count in ((0x602C, 2), (0x1014, 2), (0x1003, 1), (0x2203, 1)):
            clock.wait_s(every_s)
            if every_s == EVERY_S:
                with suppress(RigError):
                    bus.write_one(1, 0x6002, 0x0010)
            try:
                found = bus.read(1, address, count)
            except RigError:
                continue
            assert found == [address + k for k in range(count)], clock.monotonic_s()
            read += clock.monotonic_s() > 0.5 + for_s + 2.0
    assert read > 4, "it recovers"


@forgetting
@stalls
@pytest.mark.parametrize("kind", ["leadshine", "tmcl", "standa", "zaber"])
def test_a_stage_that_stalls_at_rest_is_never_said_to_be_elsewhere(kind: str, for_s: float, forgets: bool) -> None:
    bench: Bench = bench_of(kind)
    bench.stage.move_to(x_mm=-1.0, speed_mm_s=5.0)
    bench.stage.move_to(z_mm=-2.0, speed_mm_s=5.0)
    there = bench.stage.status()
    for line in bench.lines:
        Stall(line, bench.clock, bench.clock.monotonic_s() + 0.1, for_s, forgets)
    until_s, found = bench.clock.monotonic_s() + for_s + 4.0, None
    while bench.clock.monotonic_s() < until_s:
        found = _unless_it_fails(bench.stage.status)
        assert found in (there, None)
        bench.clock.wait_s(EVERY_S)
    assert found == there, "it recovers"


def _unless_it_fails(ask: Callable[[], Any]) -> Any:
    try:
        return ask()
    except (StageError, ForceError):
        return None


@forgetting
@stalls
@pytest.mark.parametrize("name", ["laumas_rtu", "mtsics"])
def test_a_force_is_never_older_than_it_says_after_a_stall(name: str, for_s: float, forgets: bool) -> None:
    """The load rises from one g to the next each 0.1 s; a reading is of the last 0.2 s or it is an error."""
    bench = ForceTwin(force_table(name), load_g=lambda t_s: 10.0 * (t_s - 1000.0))
    bench.driver.connect()
    Stall(bench.line, bench.clock, bench.clock.monotonic_s() + 0.5, for_s, forgets)
    until_s, found = bench.clock.monotonic_s() + for_s + 5.0, None
    while bench.clock.monotonic_s() < until_s:
        asked_s = bench.clock.monotonic_s()
        found = _unless_it_fails(bench.driver.read)
        if found is not None:
            assert bench.grams(found) > 10.0 * (asked_s - 1000.0 - 0.1 - bench.driver.sample_period_s)
        bench.clock.wait_s(EVERY_S)
    assert found is not None, "it recovers"
