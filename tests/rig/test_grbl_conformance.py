"""One conversation with the virtual board, on either clock, and with real firmware where RIG_GRBL_PORT names a port.

Real firmware answers at its own pace, may read its input line by line, and need not have switches to home on: what is
asserted is order, states and end points, never timing.
"""

import os
from collections.abc import Callable, Iterator

import pytest

from rig.bench.served import ServedBench
from rig.clock import Clock, WallClock
from rig.devices.base import StageAlarm, StageError, StageOverridden, StageRejected
from rig.devices.grbl import GrblStage
from rig.transport import LineReader, LoopbackTransport, Transport
from rig.transport.ports import open_port
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

PORT = os.environ.get("RIG_GRBL_PORT")
Wire = tuple[Transport, Clock]
# In the suite the served board moves, holds and stops; what a board answers does not depend on how it is served.
pytestmark = pytest.mark.quick(rows=lambda wire, **_: wire != "served")
also_served = pytest.mark.quick(rows=lambda **_: True)
STATES_OF_A_HOLD = {"Hold:1", "Hold:0"}


@pytest.fixture(
    params=["virtual", "served", pytest.param("real", marks=pytest.mark.skipif(not PORT, reason="no RIG_GRBL_PORT"))]
)
def wire(request: pytest.FixtureRequest, served: Callable[..., ServedBench]) -> Iterator[Wire]:
    if request.param == "virtual":
        clock = VirtualClock()
        line = SerialLine(clock, 115200)
        VirtualGrbl(clock, line)
        yield LoopbackTransport(line, clock), clock
        return
    port = str(PORT) if request.param == "real" else served(stage="grbl").ports["stage"]
    transport = open_port(port, 115200)
    yield transport, WallClock()
    transport.close()


@pytest.fixture
def stage(wire: Wire) -> GrblStage:
    """Connected, unlocked and idle."""
    stage = GrblStage(*wire)
    stage.connect()
    stage.unlock()
    return stage


@also_served
def test_the_grbl_driver_connects_reads_the_settings_and_unlocks(wire: Wire) -> None:
    stage = GrblStage(*wire)
    assert "[VER:1.1" in stage.connect()
    assert {100, 101, 102, 110, 111, 112, 120, 121, 122, 130, 131, 132} <= set(stage.settings())
    stage.unlock()
    assert stage.status().state == "Idle"


@pytest.mark.parametrize(
    ("sent", "answer"),
    [
        (b"G90\n", "ok"), (b"\n", "ok"), (b"G999\n", "error:20"),
        (b"G1X0F0\n", "error:22"), (b"$J=G91X1\n", "error:22"),
        (b"M8\n", "ok"), (b"M9\n", "ok"), (b"M3S1000\n", "ok"), (b"M5\n", "ok"), (b"M8M9\n", "error:21"),
        (b"$J=G91X-1F60M8\n", "error:16"),
    ],
)  # fmt: skip
def test_grbl_answers_each_line_as_documented(wire: Wire, stage: GrblStage, sent: bytes, answer: str) -> None:
    transport, clock = wire
    transport.write(sent)
    assert LineReader(transport, clock).read_line(clock.monotonic_s() + 2.0) == answer


@pytest.mark.parametrize(
    ("sent", "grbl", "grblhal"),
    [(b"$999=1\n", "error:3", "error:53"), (b"N1" + b"0" * 80 + b"\n", "error:11", "ok")],
)
def test_grbl_and_grblhal_give_their_own_error_numbers(wire: Wire, sent: bytes, grbl: str, grblhal: str) -> None:
    transport, clock = wire
    stage = GrblStage(*wire)
    says = stage.connect()
    stage.unlock()
    transport.write(sent)
    answer = LineReader(transport, clock).read_line(clock.monotonic_s() + 2.0)
    assert answer == (grblhal if "grblHAL" in says else grbl)


def test_speed_overrides_are_reported_refused_and_reset_at_connecting(wire: Wire, stage: GrblStage) -> None:
    transport, clock = wire
    transport.write(b"\x91")
    _until_overrides(stage, clock, (110, 100, 100))
    before = stage.status()
    with raises(StageOverridden, "overridden", feed_percent=110):
        stage.jog("x", -1.0, 5.0)
    assert stage.status() == before
    stage.connect()
    transport.write(b"\x96\x9b")
    _until_overrides(stage, clock, (100, 50, 90))
    stage.connect()
    transport.write(b"\x93")
    _until_overrides(stage, clock, (101, 100, 100))
    stage.connect()
    stage.jog("x", -0.1, 5.0)
    _until(stage, clock, lambda state: state == "Idle")


@pytest.mark.parametrize("after_mm", [0.2])
def test_a_speed_override_during_a_jog_is_reported_and_the_jog_can_be_ended(
    stage: GrblStage, wire: Wire, after_mm: float
) -> None:
    transport, clock = wire
    start_mm = stage.status().x_mm
    stage.jog("x", -20.0, 2.0)
    _until(stage, clock, lambda _state: abs(stage.status().x_mm - start_mm) > after_mm)
    transport.write(b"\x92")
    with raises(StageOverridden, "overridden", feed_percent=90):
        _until(stage, clock, lambda state: state == "Idle")
    stage.end_jog()
    at = stage.status()
    clock.wait_s(0.3)
    assert stage.status().x_mm == at.x_mm
    assert abs(at.x_mm - start_mm) < 20.0


def test_a_jog_ends_at_its_target(stage: GrblStage, wire: Wire) -> None:
    before = stage.status()
    stage.jog("x", -0.5, 5.0)
    _until(stage, wire[1], lambda state: state == "Idle")
    after = stage.status()
    assert after.x_mm - before.x_mm == pytest.approx(-0.5, abs=0.0051)
    assert (after.y_mm, after.z_mm) == (before.y_mm, before.z_mm)


def test_a_canceled_jog_stops_midway_and_another_can_follow(stage: GrblStage, wire: Wire) -> None:
    before = stage.status()
    stage.jog("x", -20.0, 2.0)
    _wait_until_it_moves(stage, wire[1])
    assert stage.status().state == "Jog"
    stage.end_jog()
    after = stage.status()
    assert after.state == "Idle"
    assert -20.0 < after.x_mm - before.x_mm < 0.0
    stage.jog("x", -0.1, 5.0)
    _until(stage, wire[1], lambda state: state == "Idle")
    assert stage.status().x_mm - after.x_mm == pytest.approx(-0.1, abs=0.0051)


@also_served
def test_a_move_that_is_held_and_resumed_ends_at_its_target(stage: GrblStage, wire: Wire) -> None:
    transport, clock = wire
    before = stage.status()
    transport.write(b"G91G1X-2F120\n")
    assert LineReader(transport, clock).read_line(clock.monotonic_s() + 2.0) == "ok"
    _wait_until_it_moves(stage, clock)
    stage.hold()
    states = _until(stage, clock, lambda state: state == "Hold:0")
    assert states[-1] == "Hold:0"
    assert set(states) <= {"Run", *STATES_OF_A_HOLD}
    held = stage.status()
    assert -2.0 < held.x_mm - before.x_mm < 0.0
    assert stage.status().x_mm == held.x_mm, "it stands"
    stage.resume()
    states = _until(stage, clock, lambda state: state == "Idle")
    assert set(states) <= {"Run", "Idle"}
    assert stage.status().x_mm - before.x_mm == pytest.approx(-2.0, abs=0.0051)


@also_served
def test_a_stop_in_motion_raises_an_alarm_that_an_unlock_clears(stage: GrblStage, wire: Wire) -> None:
    transport, clock = wire
    before = stage.status()
    transport.write(b"G91G1X-20F120\n")
    assert LineReader(transport, clock).read_line(clock.monotonic_s() + 2.0) == "ok"
    _wait_until_it_moves(stage, clock)
    stage.stop()
    assert not stage.homed
    with raises(StageError, "needs_reset"):
        stage.move_to(x_mm=0.0, speed_mm_s=1.0)
    stage.unlock()
    after = stage.status()
    assert after.state == "Idle"
    assert abs(after.x_mm - before.x_mm) < 20.0


def test_a_jog_beyond_the_travel_is_refused_and_a_move_raises_an_alarm_that_an_unlock_clears(
    stage: GrblStage,
) -> None:
    """The move is the board's own: the driver makes none before it is homed, for which a board may lack switches."""
    if not stage.settings()[20]:
        pytest.skip("the board's soft limits ($20) are off")
    before = stage.status()
    with raises(StageRejected, "line_refused", number=15):
        stage.jog("x", -5000.0, 5.0)
    assert stage.status() == before
    with raises(StageAlarm, "alarm", number=2):  # comes when it comes: a `?` would go past it
        stage._link.command("G53G1G90G21X-5000F60")
    stage.unlock()
    assert stage.status().state == "Idle"


def _until_overrides(stage: GrblStage, clock: Clock, overrides: tuple[int, int, int]) -> None:
    """A change is in the next status, or in the one after it."""
    deadline_s = clock.monotonic_s() + 30.0
    while stage._link.overrides != overrides:
        assert clock.monotonic_s() < deadline_s
        stage.status()
        clock.wait_s(0.01)


def _wait_until_it_moves(stage: GrblStage, clock: Clock) -> None:
    start_mm = stage.status().x_mm
    _until(stage, clock, lambda _state: stage.status().x_mm != start_mm)


def _until(stage: GrblStage, clock: Clock, over: Callable[[str], bool]) -> list[str]:
    """The states that were seen until it was over; bounded."""
    seen: list[str] = []
    deadline_s = clock.monotonic_s() + 30.0
    while not (seen and over(seen[-1])):
        assert clock.monotonic_s() < deadline_s, seen
        seen.append(stage.status().state)
        clock.wait_s(0.01)
    return seen
