"""A place that was touched before is come back to in one move, and how near; what makes it count as untouched."""

import itertools
from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import ForceReading
from rig.engine import Engine, LimitError, RunAborted, Target, TripError, indent, verbs
from rig.engine.indentation import touch_place
from rig.engine.limits import Stopping, Touched, refuse_height
from rig.settings import RigSettings
from rig.units import GWT_N
from tests.error_codes import raises
from tests.rig.plain_bench import PlainBench

Make = Callable[..., Any]
CONTACT_MM, K_GWT = -0.3, 6.0
TARGET = Target("doi_mm", 0.2)
# 0.5 mm/s · (0.05 s a sample + 0.11 s prepared + 0.35 s unread) + 0.25 / (2 · 50) mm
GOES_ON_MM = 0.2575
NEVER = {"habits": {"retouch_margin_mm": 20.0}}


def _bench(settings: dict[str, Any] | None = None) -> PlainBench:
    return PlainBench(lambda bench: round(bench.hertz(K_GWT, CONTACT_MM), 2), settings or {})


def _approached(bench: PlainBench) -> list[list[float]]:
    """Heights of the coarse readings of each press."""
    by_press: dict[int, list[float]] = {}
    for sample in bench.of("sample"):
        if sample["phase"] == "approach":
            by_press.setdefault(sample["index"], []).append(sample["height_mm"])
    return list(by_press.values())


# --- how near ---


@pytest.mark.parametrize("speed_mm_s", [0.02, 5.0])
@pytest.mark.parametrize("force", [{}, {"latency_s": 0.2}, {"sample_period_s": 0.2}])
@pytest.mark.parametrize(("increment_mm", "acceleration_mm_s2"), [(0.05, 50.0), (0.05, 5.0), (0.01, 50.0)])
def test_no_configuration_lets_a_single_move_end_within_the_stopping_distance_of_the_skin(
    speed_mm_s: float, force: dict[str, float], increment_mm: float, acceleration_mm_s2: float
) -> None:
    """The smallest margin there is, and the increment that any move may go on below where it is free."""
    habits = {"retouch_margin_mm": 0.05, "increment_mm": increment_mm, "clearance_mm": 20.0}
    tables = {"habits": habits, "force": force, "stage": {"acceleration_mm_s2": acceleration_mm_s2}}
    settings = RigSettings.model_validate(tables)
    touched = Touched(settings)
    touched.at(0.0, 0.0, CONTACT_MM)
    nearest_mm = CONTACT_MM + Stopping.in_one_move(settings, speed_mm_s).distance_mm
    with raises(LimitError, "longer_than_an_increment"):
        refuse_height(settings, 20.0, nearest_mm - 1e-6, speed_mm_s, touched.free_mm(0.0, 0.0, speed_mm_s))


# --- what is felt is what is felt by increments ---


@pytest.mark.parametrize("press", ["indent", "touch"])
def test_a_second_press_at_a_place_approaches_in_one_move_and_increments_below(press: str) -> None:
    """Down to 0.1 mm: the lowest whole increment from clearance above -0.3 + 0.1 + 0.2575 mm, about 0.06 mm."""
    bench = _bench()
    engine = bench.ready()
    for n in range(3):
        if press == "indent":
            indent(engine, TARGET, hold_s=0.0)
        else:
            touch_place(engine, n, 0.0)
    samples = bench.of("sample" if press == "indent" else "find_sample")
    first, second, third = (
        [s["height_mm"] for s in samples if (s["index"], s["phase"]) == (n, "approach")] for n in range(3)
    )
    assert first[0] == pytest.approx(1.95)
    assert second == third == pytest.approx(first[-len(second) :])
    assert second[0] == pytest.approx(0.1)
    assert [a - b for a, b in itertools.pairwise(second)] == pytest.approx([0.05] * (len(second) - 1))


def test_a_press_after_one_move_measures_the_same_contact_and_holds_as_by_increments() -> None:
    found = []
    for settings in ({}, NEVER):
        bench = _bench(settings)
        engine = bench.ready()
        for _ in range(2):
            indent(engine, Target("force_gwt", 2.0), hold_s=0.2)
        ends = [(end["force_gwt"], end["peak_gwt"]) for end in bench.of("hold_end")]
        found.append([[touch["contact_height_mm"] for touch in bench.of("touch")], ends])
    assert found[0] == found[1]


def test_the_single_move_of_a_repeated_press_stays_above_the_lowest_search_height() -> None:
    """Contact is expected at 0.9 - 0.5 mm at the lowest now: above where it was, so it is missed, not gone to."""
    bench = _bench()
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.0, expected_contact_mm=CONTACT_MM)
    with raises(TripError, "no_contact", x_mm=0.0, lowest_mm=0.4):
        indent(engine, TARGET, hold_s=0.0, expected_contact_mm=0.9)
    assert min(_approached(bench)[1]) == pytest.approx(0.4)


@pytest.mark.parametrize(("free_mm", "first_mm"), [(2.0, 1.95), (1.88, 1.9), (0.06, 0.1)])
def test_the_single_move_of_a_repeated_press_covers_whole_increments(free_mm: float, first_mm: float) -> None:
    bench = _bench({"habits": {"retouch_margin_mm": free_mm - CONTACT_MM - GOES_ON_MM}})
    engine = bench.ready()
    for _ in range(2):
        indent(engine, TARGET, hold_s=0.0)
    first, second = _approached(bench)
    assert second[0] == pytest.approx(first_mm)
    assert second == pytest.approx(first[-len(second) :])


# --- what makes a place untouched ---


def _elsewhere(engine: Engine) -> None:
    verbs.move_to(engine, 0.5)


def _there_and_back(engine: Engine) -> None:
    verbs.move_to(engine, 0.5)
    verbs.move_to(engine, 0.0)


def _along_and_back(engine: Engine) -> None:
    verbs.move_to(engine, 0.0, 1.0)
    verbs.move_to(engine, 0.0)


def _home(engine: Engine) -> None:
    verbs.home(engine)
    verbs.move_to(engine, 0.0)


def _paused(engine: Engine) -> None:
    wants = [True, False]
    engine.bench.wants_pause = lambda: wants.pop(0) if wants else False  # type: ignore[attr-defined]
    verbs.safe_point(engine)


def _stopped(engine: Engine) -> None:
    engine.stop()
    _home(engine)


def _not_reached(engine: Engine) -> None:
    with raises(LimitError, "too_deep", limit_mm=1.5):
        indent(engine, Target("doi_mm", 1.8), hold_s=0.0)


@pytest.mark.parametrize(
    ("between", "one_move"),
    [
        (lambda engine: None, True),
        (lambda engine: verbs.rest(engine, 600.0), True),
        (verbs.zero, True),
        (_there_and_back, True),
        (_along_and_back, True),
        (_elsewhere, False),
        (lambda engine: verbs.mount(engine, "bar:3.0"), False),
        (_home, False),
        (_paused, False),
        (_stopped, False),
        (_not_reached, False),
    ],
    ids=["nothing", "rest", "zero", "there and back", "along and back", "elsewhere", "mount", "home", "pause", "stop",
         "not reached"],
)  # fmt: skip
def test_a_press_approaches_by_increments_after_each_event_that_makes_a_place_untouched(
    between: Callable[[Engine], None], one_move: bool
) -> None:
    bench = _bench()
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.0)
    between(engine)
    indent(engine, TARGET, hold_s=0.0)
    assert _approached(bench)[-1][0] == pytest.approx(0.1 if one_move else 1.95)


def test_a_press_paused_midway_starts_again_by_increments() -> None:
    bench = _bench()
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.0)
    asked = [False] * 5 + [True]
    bench.wants_pause = lambda: asked.pop(0) if asked else False
    indent(engine, TARGET, hold_s=0.0)
    heights = _approached(bench)[1]
    assert (heights[0], heights.count(1.95)) == (pytest.approx(0.1), 1)


def test_a_pause_takes_effect_before_the_single_move_down() -> None:
    bench = _bench()
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.0)
    bench.goes_on, moves = False, bench.stage.moves
    asked = [False, True]  # the first is asked before the press begins
    bench.wants_pause = lambda: asked.pop(0)
    with raises(RunAborted, "stopped_at_a_safe_point"):
        indent(engine, TARGET, hold_s=0.0)
    assert bench.stage.moves == moves


# --- a finger that has come nearer, on real bytes ---


@pytest.mark.parametrize(("nearer_mm", "trips"), [(0.3, False), (0.45, False), (1.0, True), (1.5, True)])
def test_the_single_move_down_ends_at_the_touch_of_a_finger_that_came_nearer(
    spring: Make, nearer_mm: float, trips: bool
) -> None:
    """The contact is expected at -0.3 ± 0.5 mm. Beyond the touch it goes on for less than the stopping distance."""
    bench = spring(k_gwt=10.0)
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
    bench.contact_mm = CONTACT_MM + nearer_mm
    bench.events.clear()
    if trips:
        with raises(TripError, "contact_too_high", x_mm=0.0):
            indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
        assert bench.height_mm == pytest.approx(2.0, abs=0.003)
    else:
        done = indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
        assert done.holds[0].doi_mm == pytest.approx(0.2, abs=0.0025)
    met = next(s for s in bench.of("sample") if s["force_gwt"] >= 0.05)
    assert met["phase"] == "approach"
    gone_on_mm = bench.contact_mm - met["height_mm"]
    assert 0 < gone_on_mm < GOES_ON_MM
    assert met["force_gwt"] == pytest.approx(10.0 * gone_on_mm**1.5, abs=0.02)
    assert [s["height_mm"] for s in bench.of("sample") if s["phase"] == "approach"][-1] == met["height_mm"], (
        "no deeper"
    )


def test_the_planned_soft_trip_acts_during_the_single_move_down(spring: Make) -> None:
    """A block, 1.5 mm nearer, and a soft trip of 10.2 gwt: the move ends, tripped, and lifts."""
    bench = spring(k_gwt=10.0, soft_trip_n=0.1)
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
    bench.contact_mm, bench.k_gwt = CONTACT_MM + 1.53, 5000.0
    with raises(TripError, "soft_trip", limit_gwt=0.1 / GWT_N, phase="moving"):
        indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
    assert bench.height_mm == pytest.approx(2.0, abs=0.003)


@pytest.mark.parametrize("shown_gwt", [0.05, -0.05])
def test_after_a_touch_in_motion_that_vanishes_at_rest_the_press_goes_on_by_increments(
    spring: Make, shown_gwt: float
) -> None:
    """A knock at the table. Anything less than a touch ends nothing."""
    for knock_gwt, ends in ((shown_gwt, True), (0.8 * shown_gwt, False)):
        bench = spring(k_gwt=10.0)
        engine = bench.ready()
        indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
        bench.events.clear()
        read, knocked = engine.sensing.read_in_motion, [ForceReading(knock_gwt * GWT_N, True, 0.0)]
        engine.sensing.read_in_motion = lambda begun, read=read, knocked=knocked: (
            knocked.pop() if knocked else read(begun)
        )
        done = indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
        heights = [s["height_mm"] for s in bench.of("sample") if s["phase"] == "approach"]
        assert (heights[0] > 1.0) is ends
        if ends:
            assert [a - b for a, b in itertools.pairwise(heights)] == pytest.approx([0.05] * (len(heights) - 1))
        assert done.holds[0].doi_mm == pytest.approx(0.2, abs=0.0025)
