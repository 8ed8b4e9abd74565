"""Somebody else at the controller: overrides and holds are named at the next look, whatever is being done."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import LOOK_S, StageError, StageHeld, StageOverridden, arrive
from rig.devices.grbl import GrblStage
from rig.engine.motion import Direction, jog
from rig.transport import LoopbackTransport
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock
from tests.error_codes import printed, raises

OVERRIDES = {
    "twice the feed": (b"\x91" * 10, "feed override 200 %"),
    "a tenth of the feed": (b"\x92" * 9, "feed override 10 %"),
    "a little more": (b"\x93", "feed override 101 %"),
    "a quarter of the rapids": (b"\x97", "rapid override 25 %"),
    "the spindle": (b"\x9b", "spindle override 90 %"),
    "feed and rapids": (b"\x92\x96", "feed override 90 %, rapid override 50 %"),
}
HOLDS = {"a hold": (b"!", "Hold:"), "the door": (b"\x84", "Door:")}
PREPARED_S = 0.05
# A status may carry WCO instead, and then the next one carries Ov; and the bytes take their time.
NAMED_S = 2 * LOOK_S + 0.02


class Bench:
    """A homed board at -1, -1, -1, with a driver; somebody else has the same wire."""

    def __init__(self, **driver: Any) -> None:
        self.clock = VirtualClock()
        self.line = SerialLine(self.clock, 115200)
        self.board = VirtualGrbl(self.clock, self.line)
        self.stage = GrblStage(LoopbackTransport(self.line, self.clock, "stage"), self.clock, **driver)
        self.stage.connect()
        self.stage.home()

    def x_mm(self) -> float:
        return self.board.carriage_steps_at(self.clock.monotonic_s())[0] / 400

    def later(self, seconds: float, data: bytes) -> float:
        at_s = self.clock.monotonic_s() + seconds
        self.clock.call_at(at_s, lambda: self.line.host_write(data))
        return at_s


@pytest.fixture
def bench() -> Bench:
    return Bench()


def _move(bench: Bench) -> None:
    arrive(bench.stage.moving(x_mm=-21.0, speed_mm_s=1.0))


def _jog(bench: Bench, by_mm: float = 20.0) -> None:
    jog(bench.stage, bench.clock, Direction("x", -1), by_mm, 1.0)


MOTIONS: dict[str, Callable[[Bench], None]] = {"move": _move, "jog": _jog}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("what", OVERRIDES)
def test_a_speed_override_at_the_controller_is_reported_at_the_next_poll(
    bench: Bench, motion: str, what: str
) -> None:
    """Not by a timeout while the board goes on, and not after the press is over."""
    data, changed = OVERRIDES[what]
    at_s = bench.later(1.05, data)
    with raises(StageOverridden, "overridden", changed=f"stage: {changed} at the controller"):
        MOTIONS[motion](bench)
    assert bench.clock.monotonic_s() - at_s <= NAMED_S + (PREPARED_S + 0.1 if "jog" in motion else 0.0)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("what", HOLDS)
def test_a_hold_at_the_controller_is_reported_at_the_next_poll(bench: Bench, motion: str, what: str) -> None:
    data, state = HOLDS[what]
    if motion != "move" and what == "a hold":
        pytest.skip("a hold during a jog is a jog cancel: the board is Idle again, not held")
    at_s = bench.later(1.05, data)
    with raises(StageHeld, "held", who="stage: ", state=f"(state {state}"):
        MOTIONS[motion](bench)
    assert bench.clock.monotonic_s() - at_s <= NAMED_S + PREPARED_S


@pytest.mark.parametrize(("data", "factor"), [(b"\x91" * 10, 2.0), (b"\x92" * 9, 0.1)])
def test_a_stage_at_an_overridden_speed_moves_for_at_most_two_polls(bench: Bench, data: bytes, factor: float) -> None:
    """Twice the speed for two looks at most. Then the stage is stopped, as the engine does."""
    bench.later(1.05, data)
    depth: list[float] = []
    bench.clock.call_at(bench.clock.monotonic_s() + 1.05, lambda: depth.append(bench.x_mm()))
    with raises(StageOverridden, "overridden"):
        _move(bench)
    bench.stage.stop()
    bench.clock.wait_s(1.0)
    gone_mm = depth[0] - bench.x_mm()
    assert 0 < gone_mm <= 1.0 * PREPARED_S + factor * NAMED_S
    bench.clock.wait_s(5.0)
    assert depth[0] - bench.x_mm() == gone_mm, "it stands"


def test_after_a_speed_override_no_motion_starts_until_a_reset_or_connection(bench: Bench) -> None:
    bench.later(0.5, b"\x91")
    with raises(StageOverridden, "overridden", feed_percent=110):
        _move(bench)
    bench.stage.halt()
    bench.stage.move_to(x_mm=-5.0, speed_mm_s=1.0)
    bench.line.host_write(b"\x91")
    bench.clock.wait_s(0.01)
    for _ in range(2):
        bench.stage.look()
    at_mm = bench.x_mm()
    for move in (_move, _jog):
        with raises(StageOverridden, "overridden", feed_percent=110):
            move(bench)
    assert bench.x_mm() == at_mm
    bench.stage.connect()
    bench.stage.jog("x", -0.1, 1.0)


@pytest.mark.parametrize("at_s", [0.3, 0.8, 1.9])
def test_a_jog_cut_short_at_the_controller_is_an_error_with_the_missing_distance(bench: Bench, at_s: float) -> None:
    """A feed hold in a jog cancels what was told so far: the way is shorter by that, a caliper misled."""
    bench.later(at_s, b"!")
    with raises(StageError, "jog_cut_short") as caught:
        _jog(bench, 2.0)
    assert 0 < printed(caught.value, "stopped ", " mm short") < 2
    at_mm = bench.x_mm()
    bench.clock.wait_s(3.0)
    assert bench.x_mm() == at_mm > -3.0


CYCLE_S = [0.6 + 0.0083 * i for i in range(13)]


@pytest.mark.parametrize("after_s", CYCLE_S)
def test_an_open_door_during_a_jog_is_reported(bench: Bench, after_s: float) -> None:
    at_s = bench.later(after_s, b"\x84")
    with raises(StageHeld, "held", who="stage: "):
        _jog(bench)
    assert bench.clock.monotonic_s() - at_s <= NAMED_S + PREPARED_S + 0.02
    rest_mm = bench.x_mm()
    bench.line.host_write(b"~")
    bench.clock.wait_s(2.0)
    assert bench.x_mm() == rest_mm, "nothing waits in the board"


@pytest.mark.parametrize("motion", [*MOTIONS, "output", "home"])
@pytest.mark.parametrize("what", HOLDS)
def test_a_motion_at_a_held_board_is_refused_at_the_first_poll_and_never_runs_later(what: str, motion: str) -> None:
    """It reads no line: an `ok` used to be waited for, and the line carried out when somebody let go."""
    bench = Bench(output="coolant")
    data, state = HOLDS[what]
    bench.line.host_write(data)
    bench.clock.wait_s(0.01)
    begun_s, at_mm = bench.clock.monotonic_s(), bench.x_mm()
    begin = MOTIONS | {
        "output": lambda b: b.stage.set_output(True),
        "home": lambda b: b.stage.home(),
    }
    with raises(StageHeld, "held", state=f"(state {state}"):
        begin[motion](bench)
    assert bench.clock.monotonic_s() - begun_s <= LOOK_S + 0.02
    bench.stage.stop()
    bench.line.host_write(b"~")
    bench.clock.wait_s(2.0)
    assert bench.x_mm() == at_mm


def test_homing_under_a_speed_override_is_refused_and_keeps_the_position(bench: Bench) -> None:
    bench.line.host_write(b"\x91")
    bench.clock.wait_s(0.01)
    for _ in range(2):
        bench.stage.look()
    at_mm = bench.x_mm()
    with raises(StageOverridden, "overridden", feed_percent=110):
        bench.stage.home()
    assert (bench.stage.homed, bench.x_mm()) == (True, at_mm)


@pytest.mark.parametrize("data", [b"\x91", b"\x92\x92", b"\x97"])
def test_a_halt_resets_speed_overrides(bench: Bench, data: bytes) -> None:
    """Also one that keeps its overrides through a reset: they are ended by themselves, before it."""
    bench.later(1.05, data)
    with raises(StageOverridden, "overridden"):
        _move(bench)
    sent: list[bytes] = []
    write = bench.stage._transport.write
    bench.stage._transport.write = lambda data: (sent.append(data), write(data))[1]  # type: ignore[method-assign]
    bench.stage.halt()
    assert sent[0] == b"\x90\x95\x99"
    assert (bench.stage.homed, str(bench.board._overrides)) == (True, "100,100,100")
    sent.clear()
    bench.stage.halt()
    assert b"\x90\x95\x99" not in sent, "nothing to end"
