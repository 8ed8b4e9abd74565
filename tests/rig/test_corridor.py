"""Where a stage may be while a motion lasts; pure, by itself."""

import math
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.devices.base import StageStatus
from rig.engine.motion import DOWN, UP, Corridor, StrayedError, jog, refuse_strayed
from sim.devices.clock import VirtualClock
from tests.error_codes import has_code, raises
from tests.stub_bench import StubBench, StubStage

TOLERANCE_MM = 0.005
places = st.tuples(*[st.floats(-60.0, 0.0)] * 3)
shares = st.floats(0.0, 1.0)
speeds = st.floats(1 / 60, 10.0)


def _at(mm: tuple[float, ...]) -> StageStatus:
    return StageStatus("Run", *mm)


def _moved(mm: tuple[float, ...], axis: int, by_mm: float) -> tuple[float, ...]:
    return (*mm[:axis], mm[axis] + by_mm, *mm[axis + 1 :])


@given(places, places, shares, speeds, st.floats(0.0, 60.0), st.floats(-TOLERANCE_MM, TOLERANCE_MM))
def test_a_stage_on_its_path_and_within_time_has_not_strayed(
    start: tuple[float, ...], target: tuple[float, ...], share: float, speed: float, late_s: float, off_mm: float
) -> None:
    corridor = Corridor(start, target, speed, 100.0, TOLERANCE_MM)
    at = tuple(a + share * (b - a) for a, b in zip(start, target, strict=True))
    needed_s = share * max(abs(b - a) for a, b in zip(start, target, strict=True)) / speed
    report = _at(tuple(mm + 0.99 * off_mm for mm in at))
    assert corridor.strayed(report, 100.0 + needed_s + late_s + 1e-6) is None


@given(places, places, st.integers(0, 2), st.floats(2 * TOLERANCE_MM, 40.0), st.booleans(), speeds)
def test_a_stage_beyond_either_end_of_its_path_has_strayed(
    start: tuple[float, ...], target: tuple[float, ...], axis: int, by_mm: float, up: bool, speed: float
) -> None:
    """However long it takes; a motion of another axis is no excuse."""
    corridor = Corridor(start, target, speed, 0.0, TOLERANCE_MM)
    ends = (start[axis], target[axis])
    beyond = max(ends) + by_mm if up else min(ends) - by_mm
    report = _at((*start[:axis], beyond, *start[axis + 1 :]))
    strayed = corridor.strayed(report, 1e6)
    assert strayed is not None
    has_code(strayed, "off_its_way", axis="xyz"[axis], from_mm=start[axis], to_mm=target[axis], at_mm=beyond)


@given(places, st.integers(0, 2), st.floats(0.1, 40.0), speeds, st.floats(0.0, 0.9))
def test_a_stage_farther_along_than_its_speed_allows_has_strayed(
    start: tuple[float, ...], axis: int, by_mm: float, speed: float, share: float
) -> None:
    corridor = Corridor(start, _moved(start, axis, -by_mm), speed, 5.0, TOLERANCE_MM)
    gone_mm = by_mm
    heard_s = 5.0 + share * (gone_mm - 2 * TOLERANCE_MM) / speed
    strayed = corridor.strayed(_at(_moved(start, axis, -gone_mm)), heard_s)
    assert strayed is not None
    has_code(strayed, "ahead_of_its_speed", speed_mm_s=speed, gone_mm=pytest.approx(gone_mm))


@pytest.mark.parametrize(("to_mm", "at_mm", "strayed"), [
    (-3.0, -2.796, False), (-3.0, -2.794, True),  # up, twice the backlash farther
    (-5.0, -5.004, False), (-5.0, -5.006, True),  # down, where none is taken up
])  # fmt: skip
def test_backlash_compensation_widens_the_corridor_in_the_positive_direction_only(
    to_mm: float, at_mm: float, strayed: bool
) -> None:
    corridor = Corridor((0.0, 0.0, -4.0), (0.0, 0.0, to_mm), 5.0, 0.0, TOLERANCE_MM, (0.0, 0.0, 0.2))
    assert (corridor.strayed(_at((0.0, 0.0, at_mm)), 60.0) is not None) is strayed


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize(("off_mm", "strays"), [(0.204, False), (0.207, True)])
def test_a_stage_may_overshoot_by_twice_the_backlash_measured_on_that_axis_and_no_other(
    axis: str, off_mm: float, strays: bool
) -> None:
    """A tenth of a millimeter, and 5.5 um for a step and for rounding."""
    backlash = {f"{axis}_backlash_mm": {"value": 0.1, "sd": 0.001, "date": "2026-01-01", "expires": "2099-01-01"}}
    bench = StubBench({"calibration": backlash})
    engine = bench.ready()
    to_mm = list(bench.stage.at_mm)
    to_mm["xyz".index(axis)] += 0.5

    def overshoots() -> None:
        if all(abs(a - b) < 1e-9 for a, b in zip(bench.stage.at_mm, to_mm, strict=True)):
            bench.clock.wait_s(1.0)  # so that its speed is no reason
            bench.stage.at_mm["xyz".index(axis)] += off_mm

    bench.stage.at_look = overshoots
    motion = engine.motion
    aside = {"x": (0.5, 0.0), "y": (0.0, 0.5)}.get(axis)
    act = partial(motion.to_height, engine.height_mm + 0.5) if aside is None else partial(motion.aside, *aside)
    with raises(StrayedError, "off_its_way", axis=axis) if strays else nullcontext():
        act(1.0, check=lambda: None)


class Asked:
    """A stage that is asked once more."""

    def __init__(self, again: StageStatus) -> None:
        self.again, self.times = again, 0

    def status(self) -> StageStatus:
        self.times += 1
        return self.again


INSIDE, OUTSIDE = _at((0.0, 0.0, -3.5)), _at((0.0, 0.0, -7.5))


@pytest.mark.parametrize(("first", "again", "times", "strays"), [
    (INSIDE, OUTSIDE, 0, False), (OUTSIDE, INSIDE, 1, False), (OUTSIDE, OUTSIDE, 1, True),
])  # fmt: skip
def test_a_single_stray_position_is_queried_again_before_it_counts(
    first: StageStatus, again: StageStatus, times: int, strays: bool
) -> None:
    stage, clock = Asked(again), VirtualClock(0.0, 100.0)
    corridor = Corridor((0.0, 0.0, -4.0), (0.0, 0.0, -3.0), 5.0, 90.0, TOLERANCE_MM)
    act: Callable[[], None] = lambda: refuse_strayed(corridor, first, stage, clock)  # type: ignore[arg-type]  # noqa: E731
    if strays:
        with raises(StrayedError, "off_its_way", axis="z", at_mm=-7.5) as found:
            act()
        assert found.value.at == again
    else:
        act()
    assert stage.times == times


def test_a_position_report_of_nan_counts_as_strayed() -> None:
    corridor = Corridor((0.0, 0.0, -4.0), (0.0, 0.0, -3.0), 5.0, 90.0, TOLERANCE_MM)
    assert corridor.strayed(_at((0.0, 0.0, math.nan)), 100.0)


@pytest.mark.parametrize("by_mm", [0.5, -0.05])
def test_a_jog_ends_at_rest_and_not_as_soon_as_it_is_near_its_target(by_mm: float) -> None:
    """The controller reports the target, and that it still moves, for a fifth of a second."""
    clock = VirtualClock(1.7e9)
    stage: Any = StubStage(clock)
    jog_to = stage.jog
    rest_s = list[float]()

    def jogged(axis: str, mm: float, speed_mm_s: float) -> None:
        jog_to(axis, mm, speed_mm_s)
        stage.state = "Jog"
        rest_s.append(clock.monotonic_s() + 0.2)
        clock.call_at(rest_s[0], lambda: setattr(stage, "state", "Idle"))

    stage.jog = jogged
    at = jog(stage, clock, UP if by_mm > 0 else DOWN, abs(by_mm), 1.0)
    assert at.state == "Idle"
    assert clock.monotonic_s() >= rest_s[0]
