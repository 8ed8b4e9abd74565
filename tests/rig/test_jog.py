"""The dead man's switch on the virtual clock: how much the stage has been told to go at any instant."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from rig.cli.jog import RELEASED_S, HeldKey, way
from rig.devices.base import StageRejected, StageStatus
from rig.devices.grbl import GrblStage
from rig.engine.dead_man import SLICE_S, Direction, dead_man_jog
from rig.errors import BadInputError
from rig.transport import LoopbackTransport, TransportError
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

LEFT = Direction("x", -1)


class Bench:
    """An unlocked board at its zero, with a driver."""

    def __init__(self, **settings: float) -> None:
        self.clock = VirtualClock()
        line = SerialLine(self.clock, 115200)
        self.board = VirtualGrbl(self.clock, line, settings={int(k[1:]): v for k, v in settings.items()})
        self.wire = LoopbackTransport(line, self.clock)
        self.stage = GrblStage(self.wire, self.clock)
        self.stage.connect()
        self.stage.unlock()
        self.zero = self.board.carriage_steps_at(self.clock.monotonic_s())[0]
        self.farthest_ahead_mm = 0.0

    def x_mm(self, t_s: float | None = None) -> float:
        """Where the carriage is, or will be by t_s if nobody says anything more."""
        t_s = self.clock.monotonic_s() if t_s is None else t_s
        return (self.board.carriage_steps_at(t_s)[0] - self.zero) / 400

    def look(self) -> None:
        self.farthest_ahead_mm = max(self.farthest_ahead_mm, abs(self.x_mm(1e9) - self.x_mm()))

    def held_until(self, t_s: float) -> Callable[[], Direction | None]:
        def held() -> Direction | None:
            self.look()
            return LEFT if self.clock.monotonic_s() < t_s else None

        return held


@pytest.mark.parametrize("speed_mm_s", [0.1, 1.0, 5.0, 10.0])
@pytest.mark.parametrize("settings", [{}, {"_120": 5.0}, {"_110": 120.0}], ids=["usual", "sluggish", "slow"])
def test_never_more_than_two_slices_ahead(speed_mm_s: float, settings: dict[str, float]) -> None:
    """Whatever the board can do: also where it accelerates at 5 mm/s², or goes at 2 mm/s at most."""
    bench = Bench(**settings)
    now = bench.clock.monotonic_s()
    at = dead_man_jog(bench.stage, bench.clock, bench.held_until(now + 2.0), speed_mm_s)
    assert at.state == "Idle"
    assert bench.x_mm() < -0.1, "it went"
    assert 0 < bench.farthest_ahead_mm <= 2 * speed_mm_s * SLICE_S + 1 / 400
    rest_mm = bench.x_mm()
    bench.clock.wait_s(5.0)
    assert bench.x_mm() == rest_mm
    assert at.x_mm == pytest.approx(rest_mm, abs=0.0006)


def test_the_motion_is_smooth_at_the_speed_asked_for() -> None:
    bench = Bench()
    start_s = bench.clock.monotonic_s()
    dead_man_jog(bench.stage, bench.clock, lambda: LEFT, 2.0, 10.0)
    assert bench.x_mm() == -10.0
    # 10 mm at 2 mm/s and 50 mm/s² are 5.04 s; a stage that stopped between slices would take far longer.
    assert bench.clock.monotonic_s() - start_s < 5.04 + 0.15


def test_a_distance_is_kept_to_a_step() -> None:
    bench = Bench()
    at = dead_man_jog(bench.stage, bench.clock, lambda: LEFT, 3.0, 1.2345)
    assert bench.x_mm() == pytest.approx(
        -1.2345, abs=0.5 / 400 + 5 * 0.5e-4
    )  # half a step, and the last digit of five slices
    assert at.state == "Idle"


def test_nothing_held_is_no_motion() -> None:
    bench = Bench()
    assert dead_man_jog(bench.stage, bench.clock, lambda: None, 1.0) == StageStatus("Idle", 0.0, 0.0, 0.0)


def test_an_interrupt_ends_the_jog_at_once() -> None:
    bench = Bench()

    def held() -> Direction:
        if bench.x_mm() < -1.0:
            raise KeyboardInterrupt
        return LEFT

    with pytest.raises(KeyboardInterrupt):
        dead_man_jog(bench.stage, bench.clock, held, 5.0)
    rest_mm = bench.x_mm()
    assert rest_mm > -2.0
    bench.clock.wait_s(2.0)
    assert bench.x_mm() == rest_mm
    assert bench.stage.status().state == "Idle"


def test_a_wire_that_is_cut_stops_the_stage_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()

    def cut(*_: Any) -> None:
        raise TransportError("the wire is cut")

    def held() -> Direction:
        if bench.x_mm() < -1.0:
            monkeypatch.setattr(bench.wire, "write", cut)
        return LEFT

    with pytest.raises(TransportError):
        dead_man_jog(bench.stage, bench.clock, held, 5.0)
    cut_mm = bench.x_mm()
    bench.clock.wait_s(5.0)
    assert cut_mm - 2 * 5.0 * SLICE_S - 1 / 400 <= bench.x_mm() <= cut_mm
    rest_mm = bench.x_mm()
    bench.clock.wait_s(5.0)
    assert bench.x_mm() == rest_mm


def test_the_end_of_the_travel_is_told() -> None:
    bench = Bench()
    with pytest.raises(StageRejected, match="outside the travel"):
        dead_man_jog(bench.stage, bench.clock, lambda: Direction("x", +1), 1.0)
    assert bench.stage.status().state == "Idle"


# --- keys ---


def test_a_key_counts_until_it_is_not_repeated_any_more(clock: VirtualClock) -> None:
    typed = [b"a", b"", b"aa", b"", b"", b"w", b"?", b"aq"]
    held = HeldKey(clock, lambda: typed.pop(0))
    seen = [held()]
    for wait_s in (0.1, 0.1, RELEASED_S - 0.01, 0.02, 0.1, 0.1):
        clock.wait_s(wait_s)
        seen.append(held())
    assert seen == [LEFT, LEFT, LEFT, LEFT, None, Direction("z", +1), None]
    assert not held.finished
    assert held() is None
    assert held.finished


@pytest.mark.parametrize(("again_s", "there"), [(0.033, True), (math.inf, False)], ids=["held", "let go"])
def test_what_was_typed_while_nothing_read_it_may_be_long_ago(
    clock: VirtualClock, again_s: float, there: bool
) -> None:
    """The process stood still for 5 s: 150 repetitions wait. The key counts only if it goes on."""
    waiting = bytearray()

    def read() -> bytes:
        typed = bytes(waiting[:100])
        del waiting[:100]
        return typed

    def repeat() -> None:
        waiting.extend(b"a")
        clock.call_at(clock.monotonic_s() + again_s, repeat)

    held = HeldKey(clock, read)
    waiting.extend(b"a")
    assert held() == LEFT
    clock.wait_s(5.0)
    waiting.extend(b"a" * 150)
    if there:
        repeat()
    for _ in range(20):
        assert held() == (LEFT if there else None)
        clock.wait_s(0.02)


def test_keys_that_end_are_a_release(clock: VirtualClock) -> None:
    typed: list[bytes | None] = [b"s", None]
    held = HeldKey(clock, lambda: typed.pop(0))
    assert held() == Direction("z", -1)
    assert held() is None
    assert held.finished


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize(("by_mm", "sign"), [(0.5, 1), (-0.5, -1), (50.0, 1), (-50.0, -1)])
def test_a_distance_says_which_way_and_how_far(axis: Any, by_mm: float, sign: int) -> None:
    assert way(axis, by_mm) == (Direction(axis, sign), abs(by_mm))


@pytest.mark.parametrize(
    ("axis", "by_mm", "code", "fields"),
    [
        ("a", 1.0, "unknown_choice", {"option": "--axis", "value": "a"}),
        ("x", 0.0, "outside_range", {"option": "--by-mm", "value": 0.0, "most_mm": 1000.0}),
        ("x", 1001, "outside_range", {"option": "--by-mm", "value": 1001, "most_mm": 1000.0}),
    ],
)
def test_what_is_no_way_is_refused(axis: str, by_mm: float, code: str, fields: dict[str, Any]) -> None:
    with raises(BadInputError, code, **fields):
        way(axis, by_mm)
