"""Where the indentor is while it moves, and what brings it to rest.

The pad's centre is at machine x = -30, y = -15, its apex at z = -25; the stub stage's switches are at -7, -3, -1.
"""

import math
from collections.abc import Callable

import pytest

from rig.devices.base import StageHeld
from rig.engine.motion import InterruptedMotionError, Motion
from rig.settings import RigSettings
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.stub_bench import StubStage


class Watched:
    """A motion, its stage, and where the indentor was thought to be at each look."""

    def __init__(self) -> None:
        self.stage = StubStage(VirtualClock(1.7e9, 100.0))
        self.motion = Motion(RigSettings(), self.stage, self.stage.clock)
        self.seen: list[tuple[float, float, float]] = []
        self.feel: Callable[[], None] = lambda: None

    def check(self) -> None:
        self.seen.append(self.at_mm)
        self.feel()

    @property
    def at_mm(self) -> tuple[float, float, float]:
        return self.motion.x_mm, self.motion.along_mm, self.motion.height_mm


@pytest.fixture
def watched() -> Watched:
    return Watched()


def _felt(*, after: int = 0) -> Callable[[], None]:
    left = [None] * after

    def feel() -> None:
        if not left:
            raise InterruptedMotionError("felt", "for_the_test", 3.0)
        left.pop()

    return feel


def test_a_stage_that_says_nothing_on_the_way_is_watched_all_the_same(watched: Watched) -> None:
    watched.motion.home(watched.check)
    watched.seen.clear()
    watched.stage.silent = True
    watched.motion.to_height(2.0, 50.0, watched.check)
    assert len(watched.seen) > 3
    assert {height_mm for *_, height_mm in watched.seen} == {24.0}
    assert watched.motion.height_mm == 2.0


MOVES: dict[str, Callable[[Watched], None]] = {
    "aside": lambda watched: watched.motion.aside(1.5, -0.5, 50.0, watched.check),
    "to height": lambda watched: watched.motion.to_height(2.0, 50.0, watched.check),
}


@pytest.mark.parametrize("silent", [False, True])
@pytest.mark.parametrize("move", MOVES)
def test_what_is_felt_halts_the_stage_where_it_then_is(watched: Watched, move: str, silent: bool) -> None:
    watched.motion.home(watched.check)
    watched.stage.silent, watched.feel = silent, _felt(after=1)
    with raises(InterruptedMotionError, "for_the_test") as felt:
        MOVES[move](watched)
    assert felt.value.force_gwt == 3.0
    assert watched.stage.told[-1] == "halt"
    x_mm, y_mm, z_mm = watched.stage.at_mm
    assert watched.at_mm == pytest.approx((x_mm + 30.0, y_mm + 15.0, z_mm + 25.0))
    assert watched.at_mm not in ((1.5, -0.5, 24.0), (23.0, 12.0, 2.0), (23.0, 12.0, 24.0))


def test_what_is_felt_in_homing_stops_the_stage_and_its_position_is_not_taken(watched: Watched) -> None:
    watched.feel = _felt()
    with pytest.raises(InterruptedMotionError):
        watched.motion.home(watched.check)
    assert watched.stage.told == ["home", "stop"]
    assert math.isnan(watched.motion.height_mm)


def test_a_halt_that_lost_the_position_is_not_asked_for_it(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    watched.motion.home(watched.check)
    watched.stage.silent, watched.feel = True, _felt(after=2)
    monkeypatch.setattr(watched.stage, "halt", watched.stage.stop)
    with pytest.raises(InterruptedMotionError):
        watched.motion.to_height(2.0, 50.0, watched.check)
    assert watched.motion.height_mm == 24.0  # the last that was trusted


@pytest.mark.parametrize("state", ["Hold:0", "Hold:1", "Door:2"])
def test_a_stage_that_somebody_holds_is_named(watched: Watched, state: str) -> None:
    watched.motion.home(watched.check)
    watched.stage.state = state
    with raises(StageHeld, "held", state=state):
        watched.motion.to_height(2.0, 50.0, watched.check)
