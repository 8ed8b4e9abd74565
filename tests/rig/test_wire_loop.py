"""Driver, wire and virtual board together, on the virtual clock."""

import itertools
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.devices.base import (
    ForceOverload,
    StageReset,
)
from rig.devices.grbl import GrblStage
from rig.devices.mtsics import MtSicsForce
from rig.transport import LoopbackTransport
from sim.devices import Load, SerialLine, VirtualBalance, VirtualGrbl
from sim.devices.clock import VirtualClock
from tests.error_codes import raises


class Bench:
    """A stage driver with a board at 115200 baud behind it."""

    def __init__(self, **options: Any) -> None:
        self.clock = VirtualClock()
        self.line = SerialLine(self.clock, 115200)
        self.board = VirtualGrbl(self.clock, self.line, **options)
        self.stage = GrblStage(LoopbackTransport(self.line, self.clock, "board"), self.clock)

    def carriage_mm(self) -> tuple[float, ...]:
        steps = self.board.carriage_steps_at(self.clock.monotonic_s())
        return tuple(count / 400 for count in steps)


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.stage.connect()
    bench.stage.home()
    return bench


def test_a_long_move_takes_its_nominal_time_and_five_messages(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten seconds on the bench's clock, in which nearly nothing is to be done: the board is asked once it is due."""
    start_s, sent, write = bench.clock.monotonic_s(), list[bytes](), bench.line.host_write
    monkeypatch.setattr(bench.line, "host_write", lambda data: (sent.append(data), write(data)))
    bench.stage.move_to(z_mm=-11.0, speed_mm_s=1.0)
    assert sent == [b"G92X0Y0Z10G90G21G94F60\n", b"$G\n", b"?", b"G1Z0\n", b"?"]
    assert bench.clock.monotonic_s() - start_s == pytest.approx(10.0 + 1.0 / 50, abs=0.025)
    assert bench.carriage_mm() == (-1.0, -1.0, -11.0)


def test_a_power_failure_during_a_move_is_reported_and_leaves_the_stage_unhomed(bench: Bench) -> None:
    bench.clock.call_at(bench.clock.monotonic_s() + 1.0, bench.board.power_cycle)
    start_s = bench.clock.monotonic_s()
    with raises(StageReset, "was_reset"):
        bench.stage.move_to(x_mm=-20.0, speed_mm_s=5.0)
    assert bench.clock.monotonic_s() - start_s < 1.1
    assert not bench.stage.homed


TARGETS = st.lists(
    st.tuples(
        st.none() | st.floats(-60.0, 0.0),
        st.none() | st.floats(-30.0, 0.0),
        st.none() | st.floats(-40.0, 0.0),
        st.floats(0.05, 12.0),
    ).filter(lambda move: any(mm is not None for mm in move[:3])),
    min_size=1,
    max_size=6,
)


@given(TARGETS)
@settings(max_examples=25, deadline=None)
def test_any_moves_within_the_travel_end_at_their_targets(moves: list[tuple[Any, Any, Any, float]]) -> None:
    bench = Bench()
    bench.stage.connect()
    bench.stage.home()
    expected = [-1.0, -1.0, -1.0]
    for x_mm, y_mm, z_mm, speed in moves:
        bench.stage.move_to(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm, speed_mm_s=speed)
        expected = [was if mm is None else mm for was, mm in zip(expected, (x_mm, y_mm, z_mm), strict=True)]
        # Half a step, and half of the last digit sent.
        assert bench.carriage_mm() == pytest.approx(expected, abs=0.5 / 400 + 0.5e-4 + 1e-9)


@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(0.5, 10.0), st.floats(0.0, 1.5)), max_size=8))
@settings(max_examples=15, deadline=None)
def test_the_virtual_carriage_never_exceeds_its_speed_limit(
    moves: list[tuple[float, float, float]],
) -> None:
    """Streamed moves, holds and resumes: between two looks 5 ms apart no axis outruns its own limit."""
    bench = Bench()
    bench.stage.connect()
    bench.stage.home()
    bench.line.host_write(b"G53G0X-30Y-15Z-20\n")
    seen = list(_watch(bench, 7.0))
    for by_mm, speed, pause_s in moves:
        bench.line.host_write(f"G91G1X{by_mm / 9:.3f}Z{by_mm / 3:.3f}F{60 * speed:.1f}\n".encode())
        seen += _watch(bench, pause_s)
        bench.line.host_write(b"!")
        seen += _watch(bench, pause_s / 2)
        bench.line.host_write(b"~")
    for before, after in itertools.pairwise(seen):
        jump_mm = max(abs(a - b) for a, b in zip(after, before, strict=True))
        assert jump_mm <= 10.0 * 0.005 + 2 / 400


def _watch(bench: Bench, seconds: float) -> Iterator[tuple[float, ...]]:
    for _ in range(int(seconds / 0.005)):
        bench.clock.wait_s(0.005)
        yield bench.carriage_mm()


# --- the balance ---


def test_the_virtual_balance_reads_the_force_at_its_own_sample_time(bench: Bench) -> None:
    """A spring of 0.2 N/mm under the stage: the balance reads the force of its own sample instant."""

    def force_n(t_s: float) -> float:
        return max(-5.0 - bench.board.carriage_steps_at(t_s)[2] / 400, 0.0) * 0.2

    line = SerialLine(bench.clock, 9600)
    VirtualBalance(bench.clock, line, Load(force_n))
    balance = MtSicsForce(LoopbackTransport(line, bench.clock, "balance"), bench.clock)
    assert balance.connect() == "MT-SICS balance 0123456789"
    balance.zero()
    bench.stage.move_to(z_mm=-7.0, speed_mm_s=5.0)
    bench.clock.wait_s(0.2)
    reading = balance.read()
    assert reading.stable
    assert reading.force_n == pytest.approx(0.4, abs=0.01 * 9.80665e-3)
    bench.line.host_write(b"G53G1Z-9F60\n")
    bench.clock.wait_s(1.0)
    moving = balance.read()
    assert not moving.stable
    assert moving.force_n == pytest.approx(0.4 + 0.2 * 0.97, abs=0.02)
    assert moving.t_s == bench.clock.monotonic_s()
    bench.stage.move_to(z_mm=-20.0, speed_mm_s=5.0)
    with pytest.raises(ForceOverload):
        balance.read()
