"""A dead man's jog told to a stage of a few lines: what it is told, when it is looked at, and what ends it."""

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from rig.devices.base import StageError, StageHeld, StageStatus
from rig.engine import dead_man as module
from rig.engine.dead_man import UP, Direction, dead_man_jog, jog_up_from_rest
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

X_UP, X_DOWN = Direction("x", 1), Direction("x", -1)


@dataclass
class There:
    """A stage that is at once where it was told to be, but for a share or a rest of it."""

    clock: VirtualClock = field(default_factory=lambda: VirtualClock(0.0))
    steps: float = 400.0
    state: str = "Idle"
    goes: Callable[[float], float] = lambda mm: mm
    told: list[float] = field(default_factory=list)
    looked_s: list[float] = field(default_factory=list)
    x_mm: float = 0.0
    ended: int = 0

    def steps_per_mm(self, axis: str) -> float:
        assert axis == "x"
        return self.steps

    def status(self) -> StageStatus:
        self.looked_s.append(self.clock.monotonic_s())
        return StageStatus(self.state, self.x_mm, 0.0, 0.0)

    def jog(self, axis: str, mm: float, speed_mm_s: float) -> None:
        self.told.append(mm)
        self.x_mm += self.goes(mm)

    def end_jog(self) -> None:
        self.ended += 1

    stop = end_jog


@dataclass
class WithASwitch(There):
    """The same with a dead man's switch of its own."""

    left_to_it: int = 0

    def jog_while(self, axis: str, sign: int, held: Callable[[], bool], speed_mm_s: float) -> None:
        self.left_to_it += held()


@pytest.fixture(autouse=True)
def _faster_than_it_was_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stage of these tests is at once where it was told to be; the corridor has its own tests."""
    monkeypatch.setattr(module, "refuse_strayed", lambda *about: None)


def jog(stage: There, by_mm: float | None, *, speed: float = 2.0, way: Direction = X_UP, looks: int = 40) -> float:
    left = iter([way] * (looks + 1))
    return dead_man_jog(stage, stage.clock, lambda: next(left, None), speed, by_mm, lambda at: None).x_mm  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("steps", "speed", "by_mm", "told"),
    [
        (400.0, 2.0, 0.5, [0.2, 0.2, 0.1]),  # a tenth of a second's way
        (-400.0, 2.0, 0.5, [0.2, 0.2, 0.1]),
        (400.0, 2.01, 0.5, [0.2, 0.2, 0.1]),  # in whole steps
        (400.0, 0.01, 0.006, [0.0025, 0.0025, 0.001]),  # one at least
        (7.0, 1.0, 0.3, [0.1429, 0.1429, 0.0142]),  # as finely as a controller is told
    ],
)
def test_it_is_told_slices_of_whole_steps(steps: float, speed: float, by_mm: float, told: list[float]) -> None:
    for way in (X_UP, X_DOWN):
        stage = There(steps=steps)
        assert jog(stage, by_mm, speed=speed, way=way) == pytest.approx(way.sign * by_mm, abs=1e-12)
        assert stage.told == [way.sign * mm for mm in told]


def test_it_is_looked_at_fifty_times_a_second() -> None:
    stage = There()
    jog(stage, 0.9)
    looks = stage.looked_s[1:-1]
    assert len(looks) == 6
    assert looks == pytest.approx([0.02 * k for k in range(6)], abs=1e-9)


@pytest.mark.parametrize("state", ["Hold:0", "Door:1"])
def test_a_held_board_is_told_nothing(state: str) -> None:
    stage = There(state=state)
    with raises(StageHeld, "held", state=state):
        jog(stage, 0.5)
    assert stage.told == []
    assert stage.ended == 1


def test_one_that_stands_short_at_six_looks_in_a_row_was_stopped() -> None:
    stage = There(goes=lambda mm: 0.0)
    with raises(StageError, "jog_cut_short", short_mm=0.2):
        jog(stage, 0.2)
    assert stage.told == [0.2]
    assert len(stage.looked_s) == 1 + 1 + 6


@pytest.mark.parametrize(("short_mm", "stopped"), [(0.0054, False), (0.0056, True)])
def test_a_step_and_what_is_printed_may_be_missing(short_mm: float, stopped: bool) -> None:
    stage = There(goes=lambda mm: mm - short_mm)
    if stopped:
        with raises(StageError, "jog_cut_short", short_mm=pytest.approx(short_mm)):
            jog(stage, 0.2)
    else:
        assert jog(stage, 0.2) == pytest.approx(0.2 - short_mm)


@pytest.mark.parametrize("by_mm", [None, 0.4])
def test_one_that_stood_is_told_of_where_the_way_has_no_end(
    by_mm: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A way that has one is seen to be short at its end."""

    class Stood(module.StagePace):
        def seen(self, asked_s: float, heard_s: float, gone_mm: float, *, at_rest: bool) -> None:
            self.stood = gone_mm > 0.1

    monkeypatch.setattr(module, "StagePace", Stood)
    stage = There()
    if by_mm is None:
        with raises(StageError, "jog_stood_still"):
            jog(stage, by_mm)
    else:
        assert jog(stage, by_mm) == pytest.approx(by_mm)


@pytest.mark.parametrize(("by_mm", "looked_at", "left"), [(None, False, 1), (None, True, 0), (0.2, False, 0)])
def test_what_has_no_end_and_is_not_looked_at_is_left_to_a_switch_of_the_controllers(
    by_mm: float | None, looked_at: bool, left: int
) -> None:
    stage, held = WithASwitch(), iter([X_UP] * 9)
    look = (lambda at: None) if looked_at else None
    dead_man_jog(stage, stage.clock, lambda: next(held, None), 2.0, by_mm, look)  # type: ignore[arg-type]
    assert stage.left_to_it == left
    assert bool(stage.told) is not bool(left)


def test_a_way_up_from_rest_is_made_in_slices_of_a_fifth_of_a_second() -> None:
    """2 mm/s: 0.4 mm each, and what is left; the remaining distance is told after each."""

    class Above(There):
        def steps_per_mm(self, axis: str) -> float:
            return self.steps

        def status(self) -> StageStatus:
            return StageStatus(self.state, 0.0, 0.0, self.x_mm)

    stage = Above()
    slices = jog_up_from_rest(stage, stage.clock, lambda: UP, 2.0, 1.0)  # type: ignore[arg-type]
    assert [(at.z_mm, left_mm) for at, left_mm in slices] == [
        (pytest.approx(done), pytest.approx(1.0 - done)) for done in (0.4, 0.8, 1.0)
    ]
