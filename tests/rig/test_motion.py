"""Where the indentor is while it moves, and what brings it to rest.

The pad's centre is at machine x = -30, y = -15, its apex at z = -25; the stub stage's switches are at -7, -3, -1.
"""

import math
import pickle
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest

from rig.devices.base import StageHeld, StageNotHomed, StageStatus
from rig.engine.motion import InterruptedMotionError, Motion, StrayedError
from rig.engine.sensing import NoReadingError
from rig.errors import TripError, recast
from rig.settings import RigSettings
from sim.devices.clock import VirtualClock
from tests.error_codes import has_code, raises
from tests.stub_bench import StubStage


class Watched:
    """A motion, its stage, and where the indentor was thought to be at each look."""

    def __init__(self) -> None:
        self.stage = StubStage(VirtualClock(1.7e9, 100.0))
        self.motion = Motion(RigSettings(), self.stage, self.stage.clock, self._glance)
        self.seen: list[tuple[float, float, float]] = []
        self.feel: Callable[[], None] = lambda: None

    def _glance(self) -> None:
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
            raise InterruptedMotionError("felt", 3.0, code="for_the_test")
        left.pop()

    return feel


def test_before_homing_nobody_knows_where_it_is(watched: Watched) -> None:
    assert (math.isnan(watched.motion.x_mm), math.isnan(watched.motion.height_mm)) == (True, True)
    assert watched.motion.along_mm == 0.0
    with pytest.raises(StageNotHomed):
        watched.motion.to_height(2.0, 1.0)


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("move", ["home", "aside", "to height"])
def test_what_was_told_to_move_has_begun_to(watched: Watched, move: str, fails: bool) -> None:
    """A motion that fails at once may have begun; before any, nothing has moved."""
    motion = watched.motion
    assert motion.begun is False
    watched.stage.homed = True
    if fails:
        watched.feel = _felt()
    with pytest.raises(InterruptedMotionError) if fails else nullcontext():
        {"home": Motion.home, **MOVES}[move](motion)
    assert motion.begun is True


def test_homing_ends_at_the_switches(watched: Watched) -> None:
    watched.motion.home()
    assert watched.at_mm == (23.0, 12.0, 24.0)
    assert all(math.isnan(height_mm) for *_, height_mm in watched.seen)  # not before the switches are found
    assert len(watched.seen) >= 3
    assert watched.stage.told == ["home"]


def test_aside_is_a_place_in_the_fingers_frame_at_the_same_height(watched: Watched) -> None:
    watched.motion.home()
    watched.seen.clear()
    watched.motion.aside(1.5, -0.5, 50.0)
    assert watched.stage.told[-1] == (-28.5, -15.5, -1.0, 50.0)
    assert watched.at_mm == (1.5, -0.5, 24.0)
    first, *_ = watched.seen
    assert 1.5 < first[0] < 23.0
    assert -0.5 < first[1] < 12.0
    assert {height_mm for *_, height_mm in watched.seen} == {24.0}


def test_up_and_down_is_straight(watched: Watched) -> None:
    watched.motion.home()
    watched.seen.clear()
    watched.motion.to_height(2.3, 50.0)
    assert watched.stage.told[-1] == (-7.0, -3.0, -22.7, 50.0)
    assert watched.at_mm == (23.0, 12.0, 2.3)
    assert 2.3 < watched.seen[0][2] < 24.0
    assert {(x_mm, along_mm) for x_mm, along_mm, _ in watched.seen} == {(23.0, 12.0)}


def test_a_stage_that_says_nothing_on_the_way_is_watched_all_the_same(watched: Watched) -> None:
    watched.motion.home()
    watched.seen.clear()
    watched.stage.silent = True
    watched.motion.to_height(2.0, 50.0)
    assert len(watched.seen) > 3
    assert {height_mm for *_, height_mm in watched.seen} == {24.0}
    assert watched.motion.height_mm == 2.0


MOVES: dict[str, Callable[[Motion], None]] = {
    "aside": lambda motion: motion.aside(1.5, -0.5, 50.0),
    "to height": lambda motion: motion.to_height(2.0, 50.0),
}


@pytest.mark.parametrize("silent", [False, True])
@pytest.mark.parametrize("move", MOVES)
def test_what_is_felt_halts_the_stage_where_it_then_is(watched: Watched, move: str, silent: bool) -> None:
    watched.motion.home()
    watched.stage.silent, watched.feel = silent, _felt(after=1)
    with raises(InterruptedMotionError, "for_the_test", force_gwt=3.0) as felt:
        MOVES[move](watched.motion)
    assert felt.value.force_gwt == 3.0
    assert watched.stage.told[-1] == "halt"
    x_mm, y_mm, z_mm = watched.stage.at_mm
    assert watched.at_mm == pytest.approx((x_mm + 30.0, y_mm + 15.0, z_mm + 25.0))
    assert watched.at_mm not in ((1.5, -0.5, 24.0), (23.0, 12.0, 2.0), (23.0, 12.0, 24.0))


def test_what_is_felt_in_homing_stops_the_stage_and_its_position_is_not_taken(watched: Watched) -> None:
    watched.feel = _felt()
    with pytest.raises(InterruptedMotionError):
        watched.motion.home()
    assert watched.stage.told == ["home", "stop"]
    assert math.isnan(watched.motion.height_mm)


def test_a_halt_that_lost_the_position_is_not_asked_for_it(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    watched.motion.home()
    watched.stage.silent, watched.feel = True, _felt(after=2)
    monkeypatch.setattr(watched.stage, "halt", watched.stage.stop)
    with pytest.raises(InterruptedMotionError):
        watched.motion.to_height(2.0, 50.0)
    assert watched.motion.height_mm == 24.0  # the last that was trusted


@pytest.mark.parametrize("state", ["Hold:0", "Hold:1", "Door:2"])
def test_a_stage_that_somebody_holds_is_named(watched: Watched, state: str) -> None:
    watched.motion.home()
    watched.stage.state = state
    with raises(StageHeld, "held", state=state):
        watched.motion.to_height(2.0, 50.0)


@pytest.mark.parametrize("state", ["Idle", "Run", "Home"])
def test_any_other_state_is_none_of_its_business(watched: Watched, state: str) -> None:
    watched.motion.home()
    watched.stage.state = state
    watched.motion.to_height(2.0, 50.0)
    assert watched.motion.height_mm == 2.0


def test_what_is_felt_says_what_and_how_much() -> None:
    felt: list[Any] = [InterruptedMotionError("no reading"), InterruptedMotionError("too much", 7.0)]
    assert [(str(e), e.force_gwt, e.fields) for e in felt] == [
        ("no reading", None, {}), ("too much", 7.0, {"force_gwt": 7.0}),
    ]  # fmt: skip


@pytest.mark.parametrize("kind", [TripError, InterruptedMotionError])
def test_an_error_of_another_kind_says_the_same(kind: type[TripError | InterruptedMotionError]) -> None:
    found = recast(kind, NoReadingError("{older_s:g} s {{old}}", code="stale_reading", older_s=0.5))
    assert str(found) == "0.5 s {old}"
    has_code(found, "stale_reading", older_s=0.5)
    assert str(recast(kind, OSError("{as it is}"))) == "{as it is}"


def test_what_is_felt_survives_a_pickle() -> None:
    at = StageStatus("Run", 1.0, 2.0, 3.0)
    strayed = pickle.loads(pickle.dumps(StrayedError("at {z_mm:g} mm", at, code="off_its_way", z_mm=3.0)))
    assert (str(strayed), strayed.at, strayed.force_gwt) == ("at 3 mm", at, None)
    felt = pickle.loads(pickle.dumps(InterruptedMotionError("{force_gwt:g} gwt", 7.0)))
    assert (str(felt), felt.force_gwt) == ("7 gwt", 7.0)
