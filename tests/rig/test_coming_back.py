"""Back to a place that was touched before: one move, how near, one touch; what makes it count as untouched."""

import itertools
from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import ForceReading
from rig.engine import Engine, LimitError, RunAborted, Target, TripError, indent, verbs
from rig.engine.indentation import touch_place
from rig.engine.limits import FingerStiffness, Stopping, TouchedPlace
from rig.records import ContactFit
from rig.units import GWT_N
from tests.error_codes import raises
from tests.rig.conftest import SpringBench
from tests.rig.plain_bench import GlidingBench, PlainBench

Make = Callable[..., Any]
CONTACT_MM, K_GWT = -0.3, 6.0
TARGET = Target("doi_mm", 0.2)
ABOVE_MM = CONTACT_MM + 0.1  # habits.retouch_margin_mm
FIT = ContactFit(0.05, CONTACT_MM - 0.02, 0.05, CONTACT_MM, 3)


def _bench(settings: dict[str, Any] | None = None, **options: Any) -> PlainBench:
    return PlainBench(lambda bench: round(bench.hertz(K_GWT, CONTACT_MM), 2), settings or {}, **options)


def _approached(bench: PlainBench) -> list[list[float]]:
    """Heights of the coarse readings of each press."""
    by_press: dict[int, list[float]] = {}
    for sample in bench.of("sample"):
        if sample["phase"] == "approach":
            by_press.setdefault(sample["index"], []).append(sample["height_mm"])
    return list(by_press.values())


# --- how near ---


@pytest.mark.parametrize("speed_mm_s", [0.5, 5.0])
@pytest.mark.parametrize("force", [{}, {"latency_s": 0.2}, {"sample_period_s": 0.2}])
@pytest.mark.parametrize("acceleration_mm_s2", [50.0, 5.0])
@pytest.mark.parametrize("trip_n", [0.002, 0.05, 2.0])
def test_no_single_move_ends_where_a_finger_that_it_meets_would_answer_more_than_half_the_trip(
    trip_n: float, speed_mm_s: float, force: dict[str, float], acceleration_mm_s2: float
) -> None:
    """Above the margin there is the way to stop from this speed, without the way that is harmless in this finger."""
    habits = {"retouch_margin_mm": 0.05, "clearance_mm": 20.0}
    tables = {"habits": habits, "force": force, "stage": {"acceleration_mm_s2": acceleration_mm_s2}}
    bench = _bench(tables, soft_trip_n=trip_n)
    engine = bench.ready()
    engine.touched.at(0.0, 0.0, TouchedPlace(FIT))
    stiffness = FingerStiffness.unknown()
    stop_mm = Stopping.at_a_touch(engine.settings, speed_mm_s).distance_mm
    harmless_mm = stiffness.depth_mm(0.5 * trip_n / GWT_N) - stiffness.depth_mm(0.05)
    nearest_mm = CONTACT_MM + 0.05 + max(stop_mm - max(harmless_mm, 0.0), 0.0)
    with raises(LimitError, "longer_than_an_increment"):
        engine.go_to_height(nearest_mm - 0.06, speed_mm_s)
    engine.go_to_height(nearest_mm + 0.02, speed_mm_s)


def test_a_finger_that_was_measured_stiffer_than_predicted_is_returned_to_more_slowly() -> None:
    bench = _bench(soft_trip_n=0.1)
    engine = bench.ready()
    predicted_mm_s = engine.touch_limit.speed_mm_s
    engine.touched.at(0.0, 0.0, TouchedPlace(FIT, reached=(0.5, 200.0 * 0.5**1.5)))
    limit = engine.touch_limit
    assert limit.speed_mm_s < 0.5 * predicted_mm_s
    assert limit.force_gwt == pytest.approx(0.5 * 0.1 / GWT_N)
    assert limit.in_contact_mm == pytest.approx(FingerStiffness(200.0).depth_mm(0.5 * 0.1 / GWT_N))


# --- what is felt is what is felt by increments ---


@pytest.mark.parametrize("press", ["indent", "touch"])
def test_a_repeated_press_goes_down_in_one_move_and_touches_the_finger_once(press: str) -> None:
    """Down to the margin above contact, by increments to three fine ones above it, then finely; no way back."""
    bench = _bench()
    engine = bench.ready()
    for n in range(3):
        if press == "indent":
            indent(engine, TARGET, hold_s=0.0)
        else:
            touch_place(engine, n, 0.0)
    samples = bench.of("sample" if press == "indent" else "find_sample")
    by_press = [[s for s in samples if s["index"] == n] for n in range(3)]
    assert by_press[0][0]["height_mm"] == pytest.approx(1.95)
    assert any(s["phase"] == "back off" for s in by_press[0])
    for again in by_press[1:]:
        assert [s["height_mm"] for s in again if s["phase"] == "approach"] == pytest.approx(
            [ABOVE_MM, ABOVE_MM - 0.05, CONTACT_MM + 0.03], abs=0.005
        )
        fine = [s["height_mm"] for s in again if s["phase"] == "touch"]
        assert [a - b for a, b in itertools.pairwise(fine)] == pytest.approx([0.01] * (len(fine) - 1))
        assert not any(s["phase"] == "back off" for s in again)
        touching = [s["force_gwt"] for s in again if s["phase"] in ("approach", "touch") and s["force_gwt"] >= 0.05]
        assert len(touching) == 1


MOVED_MM = [-0.3, -0.06, -0.03, -0.01, 0.0, 0.01, 0.025, 0.04, 0.08, 0.2, 0.4]


@pytest.mark.parametrize("moved_mm", MOVED_MM)
def test_a_contact_that_has_moved_is_found_as_by_increments(spring: Make, moved_mm: float) -> None:
    """Touched early, late or beside: contact and depth are those of a place that was never touched."""
    found = []
    for known in (True, False):
        bench = spring(k_gwt=10.0)
        engine = bench.ready()
        indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
        if not known:
            engine.touched.forget()
        bench.contact_mm = CONTACT_MM + moved_mm
        done = indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
        found.append(bench.of("touch")[-1]["contact_height_mm"])
        assert done.holds[0].doi_mm == pytest.approx(0.2, abs=0.0025)
    assert found == pytest.approx([CONTACT_MM + moved_mm] * 2, abs=0.006)


def test_a_press_after_one_move_measures_the_same_contact_and_holds_as_by_increments() -> None:
    found = []
    for known in (True, False):
        bench = _bench()
        engine = bench.ready()
        for _ in range(2):
            indent(engine, Target("force_gwt", 2.0), hold_s=0.2)
            if not known:
                engine.touched.forget()
        found += [touch["contact_height_mm"] for touch in bench.of("touch")]
        assert [end["force_gwt"] for end in bench.of("hold_end")] == pytest.approx([2.0, 2.0], rel=0.05)
    assert found == pytest.approx([CONTACT_MM] * 4, abs=0.005)


def test_a_late_reading_ends_the_one_move_and_the_press_goes_on_by_increments() -> None:
    """The sensor needs 0.5 s for a reading, once, halfway down."""
    bench = GlidingBench(lambda bench: round(bench.hertz(K_GWT, CONTACT_MM), 2), {})
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.0)
    read, late_s = bench.read, [0.5]

    def slow() -> ForceReading:
        if 0.9 < bench.height_mm < 1.1 and late_s:
            bench.clock.wait_s(late_s.pop())
        return read()

    bench.read = slow  # type: ignore[method-assign]
    indent(engine, TARGET, hold_s=0.0)
    heights = _approached(bench)[1]
    assert 0.5 < heights[0] < 1.1
    assert [a - b for a, b in itertools.pairwise(heights[:-1])] == pytest.approx([0.05] * (len(heights) - 2))


def test_the_single_move_of_a_repeated_press_stays_above_the_lowest_search_height() -> None:
    """Contact is expected at 0.9 - 0.5 mm at the lowest now: above where it was, so it is missed, not gone to."""
    bench = _bench()
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.0, expected_contact_mm=CONTACT_MM)
    with raises(TripError, "no_contact", x_mm=0.0, lowest_mm=0.4):
        indent(engine, TARGET, hold_s=0.0, expected_contact_mm=0.9)
    assert min(_approached(bench)[1]) == pytest.approx(0.4)


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


BESIDE_MM = CONTACT_MM + 0.1 + 0.1 * 0.5  # half a millimeter beside a contact at its height
BY_INCREMENTS_MM = 1.95


@pytest.mark.parametrize(
    ("between", "down_mm"),
    [
        (lambda engine: None, ABOVE_MM),
        (lambda engine: verbs.rest(engine, 600.0), ABOVE_MM),
        (verbs.zero, ABOVE_MM),
        (_there_and_back, ABOVE_MM),
        (_along_and_back, ABOVE_MM),
        (_elsewhere, BESIDE_MM),
        (lambda engine: verbs.mount(engine, "bar:3.0"), BY_INCREMENTS_MM),
        (_home, BY_INCREMENTS_MM),
        (_paused, BY_INCREMENTS_MM),
        (_stopped, BY_INCREMENTS_MM),
        (_not_reached, BY_INCREMENTS_MM),
    ],
    ids=["nothing", "rest", "zero", "there and back", "along and back", "elsewhere", "mount", "home", "pause", "stop",
         "not reached"],
)  # fmt: skip
def test_a_press_approaches_by_increments_after_each_event_that_makes_a_place_untouched(
    between: Callable[[Engine], None], down_mm: float
) -> None:
    """Beside a contact of this run one move goes down to where contact may be, and increments from there on."""
    bench = _bench()
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.0)
    between(engine)
    indent(engine, TARGET, hold_s=0.0)
    assert _approached(bench)[-1][0] == pytest.approx(down_mm, abs=0.005)


def test_a_press_paused_midway_starts_again_by_increments() -> None:
    bench = _bench()
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.0)
    asked = [False] * 5 + [True]
    bench.wants_pause = lambda: asked.pop(0) if asked else False
    indent(engine, TARGET, hold_s=0.0)
    heights = _approached(bench)[1]
    assert (heights[0], heights.count(1.95)) == (pytest.approx(ABOVE_MM, abs=0.005), 1)


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
    bench = spring(k_gwt=10.0, soft_trip_n=0.1)
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
    limit = engine.touch_limit
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
    assert 0 < gone_on_mm < limit.in_contact_mm
    assert met["force_gwt"] < limit.force_gwt <= 0.5 * 0.1 / GWT_N + 1e-9
    assert [s["height_mm"] for s in bench.of("sample") if s["phase"] == "approach"][-1] == met["height_mm"], (
        "no deeper"
    )


def test_the_planned_soft_trip_acts_during_the_single_move_down(spring: Make) -> None:
    """A block, 1.5 mm nearer, and a soft trip of 10.2 gwt: the move ends, tripped, and lifts."""
    bench = spring(k_gwt=10.0, soft_trip_n=0.1)
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
    bench.contact_mm, bench.k_gwt = CONTACT_MM + 1.53, 5000.0
    with raises(TripError, "soft_trip", limit_gwt=0.1 / GWT_N):
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
            assert [a - b for a, b in itertools.pairwise(heights[:-1])] == pytest.approx([0.05] * (len(heights) - 2))
        assert done.holds[0].doi_mm == pytest.approx(0.2, abs=0.0025)


# --- the rest of a finger counts from lift-off to touch ---


def _touched_since(bench: SpringBench) -> list[tuple[float, bool]]:
    """Watch on the clock of the bench whether the finger is truly touched."""
    found: list[tuple[float, bool]] = []

    def look() -> None:
        now_s = bench.clock.monotonic_s()
        found.append((now_s, bench.force_n(now_s) > 0.0))
        bench.clock.call_at(now_s + 0.005, look)

    look()
    return found


@pytest.mark.parametrize("rest_s", [0.0, 1.0, 4.0, 10.0])
@pytest.mark.parametrize(
    ("between", "most_s"),
    [(lambda engine: None, 1.6), (_there_and_back, 1.6), (_elsewhere, 4.0), (verbs.zero, 1.6), (_home, 8.0)],
    ids=["nothing", "there and back", "elsewhere", "zero", "home"],
)
def test_a_press_touches_no_earlier_than_its_rest_after_the_last_lift_off(
    spring: Make, rest_s: float, between: Callable[[Engine], None], most_s: float
) -> None:
    """And no later than its increments last, where the way is shorter than the rest."""
    bench = spring(k_gwt=10.0)
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
    lifted_s = bench.clock.monotonic_s()
    between(engine)
    way_s = bench.clock.monotonic_s() - lifted_s + 3.0
    touched = _touched_since(bench)
    indent(engine, TARGET, hold_s=0.1, rest_s=rest_s, expected_contact_mm=CONTACT_MM)
    last = bench.of("touch")[-1]
    first_s = next(t_s for t_s, touches in touched if touches)
    free_s = lifted_s - 1.2  # A lift lasts 0.6 s, and its confirmation another 0.6 s.
    assert last["rested_s"] >= rest_s
    assert first_s - free_s >= rest_s
    assert last["rested_s"] < max(rest_s, way_s) + most_s


def test_a_touch_during_the_rest_before_a_press_begins_it_again(spring: Make) -> None:
    """The finger comes up to the indentor for a second, as in a breath."""
    bench = spring(k_gwt=10.0)
    engine = bench.ready()
    indent(engine, TARGET, hold_s=0.1, expected_contact_mm=CONTACT_MM)
    now_s, still_mm = bench.clock.monotonic_s(), bench.contact_mm
    bench.clock.call_at(now_s + 1.0, lambda: setattr(bench, "contact_mm", 2.1))
    bench.clock.call_at(now_s + 2.0, lambda: setattr(bench, "contact_mm", still_mm))
    touched_s = []
    bench.on_event = lambda stream, data: touched_s.append(bench.clock.monotonic_s()) if stream == "touch" else None
    indent(engine, TARGET, hold_s=0.1, rest_s=6.0, expected_contact_mm=CONTACT_MM)
    assert touched_s[0] >= now_s + 2.0 + 6.0
    assert 6.0 <= bench.of("touch")[-1]["rested_s"] < 7.6


def test_the_first_press_of_a_run_waits_for_no_rest(spring: Make) -> None:
    bench = spring(k_gwt=10.0)
    engine = bench.ready()
    begun_s = bench.clock.monotonic_s()
    indent(engine, TARGET, hold_s=0.1, rest_s=1000.0, expected_contact_mm=CONTACT_MM)
    assert bench.clock.monotonic_s() - begun_s < 100.0
    assert "rested_s" not in bench.of("touch")[0]
