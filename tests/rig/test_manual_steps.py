"""What one step of manual control may do to a finger, on every stage. Bench virtual, bytes real.

The finger is a spring F = k d^1.5 below its skin; the truth is sampled every few milliseconds.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import replace
from typing import Any

import pytest

from rig.devices.base import ForceReading, StageError, StageOverridden, StageReset, StageStatus, StageTimeout
from rig.engine import verbs
from rig.engine.bench_memory import LastKnown
from rig.engine.engine import State
from rig.engine.motion import DOWN, UP
from rig.engine.sensing import ForceZero, NoReadingError
from rig.engine.steps import Steps, resume_position
from rig.errors import LimitError, NotReadyError
from rig.manual.without_force import SessionWithoutForce
from rig.plan.config import Config
from rig.settings import ZERO_LIFT_MM
from rig.transport import TransportError
from rig.units import GWT_N
from tests.error_codes import raises
from tests.rig.hand_bench import APEX_MM, KINDS, STAGES, Direction, SessionBench, code_of_end
from tests.stub_bench import StubBench

TOUCH_GWT = Config().habits.touch_force_gwt
INCREMENT_MM = Config().habits.increment_mm
CLEARANCE_MM = Config().habits.clearance_mm
SPRINGS = {"finger": 6.0, "ten times": 60.0, "a block": 6000.0}
ZERO = ForceZero(0.0, 0.0)


@pytest.fixture(params=KINDS)
def at_hand(request: pytest.FixtureRequest) -> Callable[..., SessionBench]:
    return lambda **options: SessionBench(request.param, **options)


def one_increment_gwt(bench: SessionBench, from_gwt: float) -> float:
    """What the spring adds over one increment from a force, with two readings' rounding."""
    depth_mm = (from_gwt / bench.spring.k_gwt) ** (2 / 3) + INCREMENT_MM + 0.003
    return float(bench.spring.k_gwt * depth_mm**1.5)


def freeze(bench: SessionBench, at_gwt: float | None) -> None:
    """The sensor stays at a value, its own last one if none is given."""
    sensor = bench.bench.force
    last_n = sensor.read().force_n if at_gwt is None else at_gwt * GWT_N

    def read() -> ForceReading:
        bench.clock.wait_s(0.02)
        return ForceReading(last_n, True, bench.clock.monotonic_s())

    sensor.read = read  # type: ignore[method-assign]


def silence(bench: SessionBench) -> None:
    """From here on the sensor has no number to say."""
    bench.bench.force.read = lambda: ForceReading(float("nan"), True, bench.clock.monotonic_s())  # type: ignore[method-assign]


# --- down ---


@pytest.mark.quick(rows=lambda kind, k_gwt, known: kind == "grbl" or k_gwt == 6.0)
@pytest.mark.parametrize("kind", STAGES)
@pytest.mark.parametrize("k_gwt", SPRINGS.values(), ids=SPRINGS)
@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_a_step_down_ends_at_the_first_touch(kind: str, k_gwt: float, known: bool) -> None:
    """Within one increment of it, however stiff what lies there."""
    bench = SessionBench(kind, k_gwt=k_gwt, known=known, above_mm=1.0)
    found = bench.step("z", -2.4, 5.0)
    assert code_of_end(found) in ("touched", "soft_trip", "hard_trip")
    assert bench.worst_gwt <= one_increment_gwt(bench, TOUCH_GWT)


def test_from_above_clearance_a_finger_that_lies_higher_ends_the_step(at_hand: Callable[..., SessionBench]) -> None:
    """frame.apex_z_mm is 4 mm too low: down to clearance it goes at habits.descent_speed_mm_s, 0.8 mm/s."""
    bench = at_hand(skin_mm=4.0, above_mm=7.0)
    found = bench.step("z", -5.0, 10.0)
    assert code_of_end(found) == "touched"
    assert bench.worst_gwt <= 6.0 * 0.3**1.5


@pytest.mark.parametrize(("k_gwt", "soft_trip_n"), [(6.0, 0.05), (0.4, 0.01)])
def test_the_next_step_goes_on_from_a_touch_and_never_passes_the_soft_trip(
    at_hand: Callable[..., SessionBench], k_gwt: float, soft_trip_n: float
) -> None:
    """0.05 N, 5.1 gwt; near the trip increments become smaller. An increment into a soft finger adds 0.04 gwt."""
    bench = at_hand(k_gwt=k_gwt, soft_trip_n=soft_trip_n, above_mm=0.2, known=False)
    ended = [code_of_end(bench.step("z", -1.2)) for _ in range(4)]
    assert (ended[0], ended[2:]) == ("touched", ["next_step_past_soft_trip"] * 2)
    assert 0.85 < bench.worst_gwt * GWT_N / soft_trip_n < 0.94


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_steps_of_a_hundredth_end_at_a_touch_too(at_hand: Callable[..., SessionBench], known: bool) -> None:
    """A touch counts from the force at the first of them."""
    bench = at_hand(above_mm=0.055, known=known)
    ended = [code_of_end(bench.step("z", -0.01)) for _ in range(12)]
    assert ended.count("touched") == 1
    touched_mm = 0.01 * (ended.index("touched") + 1) - 0.055
    assert 6.0 * touched_mm**1.5 <= one_increment_gwt(bench, TOUCH_GWT)


def test_a_finger_that_came_up_between_two_steps_is_not_pressed(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=1.0)
    assert code_of_end(bench.step("z", -0.2)) is None
    bench.spring.skin_mm = 1.0
    at_mm = bench.height_mm
    assert code_of_end(bench.step("z", -0.2)) == "touched"
    assert bench.height_mm == at_mm
    assert code_of_end(bench.step("z", -0.05)) is None, "the next one goes on"


def test_a_person_may_take_a_minute_between_two_steps(at_hand: Callable[..., SessionBench]) -> None:
    """The heartbeat of a run does not run on between steps."""
    bench = at_hand(above_mm=0.2, zero=ZERO)
    assert code_of_end(bench.step("z", -1.0)) == "touched"
    bench.clock.wait_s(60.0)
    assert code_of_end(bench.step("z", -0.05)) is None


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_a_finger_that_was_touched_for_too_long_is_only_left(
    at_hand: Callable[..., SessionBench], known: bool
) -> None:
    bench = at_hand(above_mm=0.2, zero=ZERO, max_contact_s=30.0, known=known)
    assert code_of_end(bench.step("z", -1.0)) == "touched"
    bench.clock.wait_s(31.0)
    for axis, by_mm in (("z", -0.05), ("x", 1.0)):
        with raises(LimitError, "contact_time", limit_s=30.0):
            bench.step(axis, by_mm)
    assert code_of_end(bench.step("z", 3.0)) is None
    assert code_of_end(bench.step("z", -0.2)) is None, "each contact counts by itself"


@pytest.mark.parametrize(("force_gwt", "counts"), [(1.0, True), (-1.0, True), (-0.03, False)])
def test_at_an_unknown_height_a_pull_counts_as_contact_as_a_push_does(
    at_hand: Callable[..., SessionBench], force_gwt: float, counts: bool
) -> None:
    bench = at_hand(known=False, zero=ZERO, max_contact_s=30.0)
    bench.spring.offset_gwt = force_gwt
    assert code_of_end(bench.step("z", 0.5)) is None
    bench.clock.wait_s(31.0)
    with raises(LimitError, "contact_time", limit_s=30.0) if counts else nullcontext():
        bench.step("z", -0.05)


@pytest.mark.parametrize(("above_mm", "lifted", "clear"), [(3.0, True, True), (3.0, False, True), (1.0, True, False)])
def test_a_session_begins_in_contact_below_clearance(
    at_hand: Callable[..., SessionBench], above_mm: float, lifted: bool, clear: bool
) -> None:
    engine = at_hand(above_mm=above_mm, zero=ZERO, lifted=lifted).session.engine
    assert (engine.state is State.READY, engine.contact.may_touch) == (clear, not clear)


def test_a_session_sets_the_depth_limit_of_the_stage_as_homing_does() -> None:
    bench = StubBench()
    engine, floors_mm = bench.ready(), bench.stage.floors_mm
    homed_mm = floors_mm[-1]
    engine.motion.forget_depth()
    resume_position(engine)
    assert len(floors_mm) == 2
    assert floors_mm == [homed_mm] * 2
    limits, frame = bench.settings.limits, bench.settings.frame
    assert homed_mm == pytest.approx(frame.apex_z_mm - limits.search_mm - limits.max_doi_mm)


@pytest.mark.parametrize(("z_mm", "first_mm"), [(0.0, -1), (-0.3, -1), (-ZERO_LIFT_MM - 0.1, 1), (-9.0, 1)])
def test_a_zero_at_the_top_of_the_travel_makes_room_for_its_lift(z_mm: float, first_mm: int) -> None:
    bench = StubBench()
    engine = bench.ready()
    engine.go_to_height(z_mm - bench.settings.frame.apex_z_mm, 2.0)
    bench.stage.told.clear()
    name, zero = Steps(engine).zero(LastKnown(), 2.0)
    assert (name, zero.offset_n) == ("stub sensor", 0.0)
    ways_mm = [b - a for a, b in itertools.pairwise([z_mm, *(told[2] for told in bench.stage.told)])]
    assert math.copysign(1, ways_mm[0]) == first_mm
    assert len(ways_mm) == (2 if first_mm < 0 else 1)
    assert ways_mm[-1] == pytest.approx(ZERO_LIFT_MM)
    assert bench.stage.at_mm[2] <= 0.0


def test_a_zero_whose_lift_does_not_move_the_stage_is_none() -> None:
    bench = StubBench()
    engine = bench.ready()
    engine.lift(5.0)

    def stands(to_mm: list[float], lasts_s: float) -> Iterator[StageStatus | None]:
        bench.clock.wait_s(lasts_s)
        yield bench.stage.status()

    bench.stage._going = stands  # type: ignore[method-assign]
    with raises(StageError, "did_not_move"):
        Steps(engine).zero(LastKnown(), 2.0)
    assert engine.sensing.zero is None


def test_a_zero_of_a_stage_that_lost_its_position_is_refused_and_none() -> None:
    bench = StubBench()
    engine = bench.ready()
    bench.stage.homed = False
    with raises(StageError, "lost_position"):
        Steps(engine).zero(LastKnown(), 2.0)
    assert engine.sensing.zero is None
    assert bench.height_mm == pytest.approx(2.0)


def test_too_deep_in_the_known_finger_is_refused_before_anything_moves(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=3.0)
    at_mm = bench.height_mm
    with raises(LimitError, "too_deep", depth_mm=pytest.approx(2.0, abs=0.005), limit_mm=1.5):
        bench.step("z", -5.0)
    assert bench.height_mm == at_mm


def test_a_dead_sensor_is_stopped_by_depth(at_hand: Callable[..., SessionBench]) -> None:
    """Frozen at 0 from the beginning no sensor can show; the known height can."""
    bench = at_hand(above_mm=0.5)
    freeze(bench, 0.0)
    bench.step("z", -1.9)
    with raises(LimitError, "too_deep"):
        bench.step("z", -0.5)
    assert bench.height_mm == pytest.approx(-1.4, abs=0.051)


@pytest.mark.quick(
    rows=lambda at_hand, known, value_gwt, code, steps, by_mm: at_hand == "grbl" or (known and not steps)
)
@pytest.mark.parametrize(("value_gwt", "code"), [(0.0, "lost_finger"), (None, "frozen")], ids=["0", "last"])
@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize("steps", [0, 2])
@pytest.mark.parametrize("by_mm", [0.05, 0.9])
def test_a_sensor_that_freezes_after_a_touch_trips(
    at_hand: Callable[..., SessionBench], known: bool, value_gwt: float | None, code: str, steps: int, by_mm: float
) -> None:
    """0: known to have been touched. At its last value: the finger does not answer for three increments."""
    bench = at_hand(above_mm=0.2, known=known)
    assert code_of_end(bench.step("z", -1.0)) == "touched"
    for _ in range(steps):
        bench.step("z", -0.2)
    before_gwt = bench.worst_gwt
    freeze(bench, value_gwt)
    times = 6 if by_mm < 0.1 else 1
    ended = [code_of_end(bench.step("z", -by_mm)) for _ in range(times) if not bench.session.tripped]
    assert ended[-1] == code
    depth_mm = (before_gwt / 6.0) ** (2 / 3)
    assert bench.worst_gwt <= 6.0 * (depth_mm + 5 * INCREMENT_MM) ** 1.5


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize(("k_gwt", "down_mm"), [(6.0, 1.0), (60.0, 0.25)])
def test_a_sensor_that_freezes_in_a_finger_is_noticed_within_three_increments(
    at_hand: Callable[..., SessionBench], known: bool, k_gwt: float, down_mm: float
) -> None:
    """At 6.5 and 9.9 gwt, where the last increment has added 0.5 and 2.4 gwt, not the touch force of 0.05 gwt."""
    bench = at_hand(above_mm=0.2, k_gwt=k_gwt, known=known, on_trip="stop")
    for by_mm, code in ((-1.0, "touched"), (-down_mm, None)):
        assert code_of_end(bench.step("z", by_mm)) == code
    freeze(bench, None)
    from_mm = bench.height_mm
    assert code_of_end(bench.step("z", -0.4)) == "frozen"
    assert from_mm - bench.height_mm == pytest.approx(3 * INCREMENT_MM, abs=0.003)


def test_a_finger_lost_above_clearance_is_noticed_one_increment_below_it(
    at_hand: Callable[..., SessionBench],
) -> None:
    """After a touch at 4 mm it withdrew: the slow motion down to clearance counts as distance below the touch."""
    bench = at_hand(skin_mm=4.0, above_mm=7.0, on_trip="stop")
    assert code_of_end(bench.step("z", -5.0)) == "touched"
    bench.spring.skin_mm = -4.0
    assert code_of_end(bench.step("z", CLEARANCE_MM - 0.3 - bench.height_mm)) == "lost_finger"
    assert bench.height_mm == pytest.approx(CLEARANCE_MM - INCREMENT_MM, abs=0.003)


def test_a_reading_that_falls_on_the_way_down_trips(at_hand: Callable[..., SessionBench]) -> None:
    assert code_of_end(at_hand(above_mm=0.2, k_gwt=-6.0).step("z", -1.0)) == "reads_backwards"


@pytest.mark.parametrize("kind", STAGES)
@pytest.mark.parametrize(
    ("known", "on_trip", "height_mm"),
    [(True, "retract", 2.0), (False, "retract", 0.52), (True, "stop", None), (False, "stop", None)],
)
def test_above_a_trip_the_step_lifts_and_only_homing_follows(
    kind: str, known: bool, on_trip: str, height_mm: float | None
) -> None:
    """A block so stiff that one increment passes the trip. At an unknown height the way down is taken back."""
    bench = SessionBench(kind, above_mm=0.52, k_gwt=6000.0, soft_trip_n=0.1, known=known, on_trip=on_trip)
    assert code_of_end(bench.step("z", -1.0)) == "soft_trip"
    if height_mm is None:
        assert bench.height_mm < 0.0
    else:
        assert bench.height_mm == pytest.approx(height_mm, abs=0.006)
        assert bench.force_gwt == 0.0
    at = bench.x_mm, bench.height_mm
    for axis, by_mm in (("z", -0.1), ("z", 0.1), ("x", 1.0)):
        with raises(NotReadyError, "tripped"):
            bench.step(axis, by_mm)
    with raises(NotReadyError, "tripped"):
        bench.session.park()
    assert (bench.x_mm, bench.height_mm) == at
    assert bench.session.home().kind == "raised"
    assert code_of_end(bench.step("z", -0.1)) is None


def test_at_an_unknown_height_a_trip_lifts_on_while_the_force_falls(
    at_hand: Callable[..., SessionBench],
) -> None:
    bench = at_hand(above_mm=0.1, soft_trip_n=0.05, known=False, zero=ZERO)
    bench.step("z", -0.2)
    finger = bench.spring
    now_s = bench.clock.monotonic_s()
    finger.skin_at_mm = lambda t_s: 3.0 if t_s > now_s + 0.3 else 0.0  # type: ignore[method-assign]
    assert code_of_end(bench.step("z", -0.5)) in ("soft_trip", "hard_trip")
    assert bench.force_gwt < TOUCH_GWT
    assert bench.height_mm > 3.0 - 0.1


# --- sideways and up ---


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize(("on_trip", "higher_mm"), [("retract", 2.0), ("stop", 0.0)])
def test_a_touch_sideways_ends_the_step_and_lifts(
    at_hand: Callable[..., SessionBench], known: bool, on_trip: str, higher_mm: float
) -> None:
    """A wall has no end upwards; with limits.on_trip = stop the indentor stays."""
    bench = at_hand(zero=ZERO, known=known, on_trip=on_trip, soft_trip_n=0.02)
    bench.spring.wall_x_mm = 2.0
    assert code_of_end(bench.step("x", 5.0)) in ("touched", "touch_at_clearance")
    assert 2.0 < bench.x_mm < 2.6
    assert bench.worst_gwt < 0.02 / GWT_N
    assert bench.height_mm >= 3.0 + higher_mm - 0.005


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize(("zero", "code"), [(ZERO, "touches_still"), (None, "not_zeroed")])
def test_a_step_sideways_is_refused_in_contact_and_without_a_zero(
    at_hand: Callable[..., SessionBench], known: bool, zero: ForceZero | None, code: str
) -> None:
    """0.1 mm in a spring, 0.19 gwt."""
    bench = at_hand(above_mm=-0.1, zero=zero, known=known)
    from_mm = bench.x_mm
    with raises(LimitError, code):
        bench.step("x", 1.0)
    assert bench.x_mm == from_mm
    assert code_of_end(bench.step("z", 2.2)) is None


def test_below_clearance_a_step_sideways_is_refused(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=CLEARANCE_MM - 0.1, zero=ZERO)
    with raises(LimitError, "below_clearance"):
        bench.step("x", 1.0)
    assert bench.x_mm == pytest.approx(0.0, abs=0.002)


@pytest.mark.parametrize("kind", STAGES)
def test_beyond_the_travel_a_step_is_refused_and_the_position_kept(kind: str) -> None:
    bench = SessionBench(kind, zero=ZERO)
    with raises(LimitError, "outside_travel"):
        for _ in range(30):
            bench.step("x", 5.0, 10.0)
    assert bench.session.homed


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_a_step_up_is_free(at_hand: Callable[..., SessionBench], known: bool) -> None:
    """Above the trip only up; there no force that falls stops it."""
    bench = at_hand(above_mm=-0.8, soft_trip_n=0.02, zero=ZERO, known=known)
    for axis, by_mm in (("x", 1.0), ("z", -0.1)):
        with raises(LimitError, "soft_trip", limit_gwt=0.02 / GWT_N):
            bench.step(axis, by_mm)
    assert code_of_end(bench.step("z", 2.0)) is None
    assert bench.height_mm == pytest.approx(1.2, abs=0.003)


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_a_force_that_grows_ends_a_step_up(at_hand: Callable[..., SessionBench], known: bool) -> None:
    bench = at_hand(soft_trip_n=0.02, known=known)
    from_s = bench.clock.monotonic_s() + 2.0
    bench.spring.true_gwt = lambda t_s: 30.0 + t_s if t_s > from_s else 0.0  # type: ignore[method-assign]
    assert code_of_end(bench.step("z", 5.0, 1.0)) == "soft_trip"


def test_a_sensor_beyond_its_range_lets_it_go_up_and_nowhere_else(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=0.5, zero=ZERO)
    bench.spring.offset_gwt = 500.0
    for axis, by_mm in (("x", 1.0), ("z", -0.2)):
        with raises(LimitError, "no_reading") as refused:
            bench.step(axis, by_mm)
        assert isinstance(refused.value.__cause__, NoReadingError)
        assert refused.value.__cause__.out_of_range
    assert code_of_end(bench.step("z", 1.0)) is None
    assert bench.height_mm == pytest.approx(1.5, abs=0.003)


@pytest.mark.parametrize("kind", STAGES)
@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize(("axis", "by_mm"), [("x", 1.5), ("z", 1.5), ("z", -1.5), ("z", -0.123)])
@pytest.mark.quick(rows=lambda kind, known, axis, by_mm: kind in KINDS)
def test_a_free_step_is_made_to_its_end(kind: str, known: bool, axis: str, by_mm: float) -> None:
    bench = SessionBench(kind, zero=ZERO, known=known)
    before = {"x": bench.x_mm, "z": bench.height_mm}[axis]
    found = bench.step(axis, by_mm)
    assert found.ended_by is None
    assert {"x": bench.x_mm, "z": bench.height_mm}[axis] - before == pytest.approx(by_mm, abs=0.0035)
    clear = known and bench.height_mm >= CLEARANCE_MM - 0.02
    assert found.known.kind == ("lifted" if clear else "unknown")
    recorded = bench.memory.read().contact
    assert recorded is not None
    assert recorded.kind == found.known.kind


def over_a_finger(k_gwt: float = 6.0) -> tuple[StubBench, Steps]:
    """At clearance above a spring whose skin is at the nominal apex."""
    bench = StubBench()
    engine = bench.ready()
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", k_gwt * max(-bench.height_mm, 0.0) ** 1.5)
    return bench, Steps(engine)


BETWEEN: dict[str, Callable[[Steps], Any]] = {
    "up": lambda steps: steps.make(UP, 0.5, 2.0),
    "park": lambda steps: steps.park(5.0),
    "sideways": lambda steps: (steps.make(UP, 4.0, 2.0), steps.make(Direction("x", 1), 0.5, 2.0)),
}


@pytest.mark.parametrize("between", BETWEEN)
def test_after_any_other_step_the_next_one_down_ends_at_the_touch_again(between: str) -> None:
    bench, steps = over_a_finger()
    for _ in range(2):
        for _ in range(4):
            found = steps.make(DOWN, min(bench.height_mm + 1.0, 5.0), 2.0)
            if found.ended_by is not None:
                break
        assert code_of_end(found) == "touched"
        assert bench.force.shows_gwt <= 6.0 * ((TOUCH_GWT / 6.0) ** (2 / 3) + INCREMENT_MM) ** 1.5
        BETWEEN[between](steps)


@pytest.mark.parametrize(("to_mm", "clear"), [(CLEARANCE_MM + 0.1, True), (CLEARANCE_MM - 0.1, False)])
def test_a_step_up_to_clearance_ends_the_contact_and_its_time(to_mm: float, clear: bool) -> None:
    bench, steps = over_a_finger()
    engine = bench.engine
    steps.make(DOWN, 3.0, 2.0)
    assert (engine.state, engine.contact.may_touch) == (State.IN_CONTACT, True)
    bench.clock.wait_s(5.0)
    steps.make(UP, to_mm - bench.height_mm, 2.0)
    assert (engine.state is State.READY, engine.contact.may_touch) == (clear, not clear)
    assert (engine.contact_time.total_s == 0.0) is clear


@pytest.mark.parametrize(("gwt", "increments"), [(0.04, False), (0.2, True), (-0.2, True)])
def test_with_a_force_on_the_sensor_it_goes_down_by_increments_from_any_height(gwt: float, increments: bool) -> None:
    """A push or a pull: the zero has drifted, or something touches."""
    bench = StubBench()
    bench.ready().lift(6.0)
    bench.force.shows_gwt = gwt
    bench.stage.told.clear()
    assert code_of_end(Steps(bench.engine).make(DOWN, 1.0, 2.0)) is None
    heights_mm = [6.0, *(told[2] - bench.settings.frame.apex_z_mm for told in bench.stage.told)]
    assert heights_mm[-1] == pytest.approx(5.0)
    longest_mm = max(a - b for a, b in itertools.pairwise(heights_mm))
    assert longest_mm == pytest.approx(INCREMENT_MM if increments else 1.0)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("by_mm", [0.6, -0.4])
def test_steps_add_up_along_their_axis_alone(axis: Any, by_mm: float) -> None:
    bench = StubBench()
    engine = bench.ready()
    verbs.move_to(engine, 1.0, -0.5)
    engine.lift(5.0)
    for n in (1, 2, 3):
        assert Steps(engine).make(Direction(axis, 1 if by_mm > 0 else -1), abs(by_mm), 2.0).ended_by is None
        there = [x + n * by_mm * (axis == name) for name, x in (("x", 1.0), ("y", -0.5), ("z", 5.0))]
        assert [engine.x_mm, engine.along_mm, engine.height_mm] == pytest.approx(there)
        frame = bench.settings.frame
        machine_mm = [frame.pad_centre_x_mm + there[0], frame.pad_y_mm + there[1], frame.apex_z_mm + there[2]]
        assert bench.stage.at_mm == pytest.approx(machine_mm)


def _slow_table() -> dict[str, tuple[bool, float, Direction, float]]:
    """Whether the height is known, from where, which way, and the highest speed there (mm/s)."""
    habits, limits = Config().habits, Config().limits
    aside = Direction("x", 1)
    return {
        "down above clearance": (True, 6.0, DOWN, habits.descent_speed_mm_s),
        "down below clearance": (True, CLEARANCE_MM, DOWN, limits.max_press_speed_mm_s),
        "up": (True, 3.0, UP, math.inf),
        "sideways": (True, 3.0, aside, -1.0),
        "sideways from the park height": (True, habits.park_height_mm, aside, habits.travel_speed_mm_s),
        "down at an unknown height": (False, 3.0, DOWN, limits.max_press_speed_mm_s),
        "up at an unknown height": (False, 3.0, UP, math.inf),
        "sideways at an unknown height": (False, 3.0, aside, -1.0),
    }


SLOW = _slow_table()
"""-1: the speed of a guarded move sideways."""


@pytest.mark.parametrize("way", SLOW)
@pytest.mark.parametrize("speed_mm_s", [0.05, 100.0])
def test_a_step_has_the_speed_that_a_person_chose_unless_a_guard_asks_for_a_lower_one(
    way: str, speed_mm_s: float
) -> None:
    known, from_mm, direction, most_mm_s = SLOW[way]
    bench = StubBench()
    engine, made = bench.ready(), list[float]()
    engine.go_to_height(from_mm, 0.5)
    if most_mm_s < 0.0:
        most_mm_s = verbs.guarded_sideways(engine)[0].speed_mm_s
    if not known:
        bench.stage.homed, engine.state = False, State.UNHOMED
    jog, moving = bench.stage.jog, bench.stage.moving
    bench.stage.jog = lambda axis, mm, mm_s: (made.append(mm_s), jog(axis, mm, mm_s))  # type: ignore[method-assign, assignment]
    bench.stage.moving = lambda **told: (made.append(told["speed_mm_s"]), moving(**told))[1]  # type: ignore[method-assign]
    assert code_of_end(Steps(engine).make(direction, 0.1, speed_mm_s)) is None
    assert made
    assert made == pytest.approx([min(speed_mm_s, most_mm_s)] * len(made))


@pytest.mark.parametrize(("shows_gwt", "touches"), [(10.0, False), (0.0, True), (10.2, True), (9.8, True)])
def test_a_zero_counts_a_touch_from_the_last_recorded_zero(shows_gwt: float, touches: bool) -> None:
    """That zero was taken at 10 gwt."""
    bench = StubBench()
    engine = bench.ready()
    engine.sensing.zero, bench.force.shows_gwt = None, shows_gwt
    with raises(LimitError, "maybe_touched") if touches else nullcontext():
        Steps(engine).zero(LastKnown(zero_offset_n=10.0 * GWT_N), 2.0)


@pytest.mark.parametrize("direction", [DOWN, Direction("x", 1)])
def test_at_an_unknown_height_a_step_begins_with_a_possible_touch_on_record(direction: Direction) -> None:
    """So that its heartbeat counts."""
    bench = StubBench()
    engine = bench.ready()
    bench.stage.homed, engine.state = False, State.UNHOMED
    assert not engine.contact.may_touch
    jog, seen = bench.stage.jog, list[bool]()
    bench.stage.jog = lambda *told: (seen.append(engine.contact.may_touch), jog(*told))  # type: ignore[method-assign, assignment]
    Steps(engine).make(direction, 0.1, 2.0)
    assert seen
    assert all(seen)


@pytest.mark.parametrize("times", [1, 2])
def test_a_lift_at_an_unknown_height_that_a_person_slows_is_tried_again(times: int) -> None:
    bench = StubBench()
    engine = bench.ready()
    bench.stage.homed, engine.state = False, State.UNHOMED
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", 300.0 if bench.height_mm < 1.95 else 0.0)
    jog, lifts = bench.stage.jog, list[float]()

    def slowed(axis: str, mm: float, speed_mm_s: float) -> None:
        lifts.extend([mm] if mm > 0.0 else [])
        if mm > 0.0 and len(lifts) <= times:
            raise StageOverridden("the speed was changed")
        jog(axis, mm, speed_mm_s)

    bench.stage.jog = slowed  # type: ignore[method-assign]
    assert code_of_end(Steps(engine).make(DOWN, 0.2, 2.0)) == "soft_trip"
    assert bench.height_mm >= 1.95
    assert bench.stage.told.count("halt") >= times


def test_a_step_up_ends_at_the_top_of_the_travel(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(zero=ZERO)
    bench.session.home()
    assert code_of_end(bench.step("z", 5.0)) is None
    assert bench.height_mm == pytest.approx(-APEX_MM, abs=0.003)


def test_park_lifts_to_the_park_height_and_needs_a_known_height(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(zero=ZERO, above_mm=-0.3)
    assert code_of_end(bench.session.park()) is None
    assert bench.height_mm == pytest.approx(10.0, abs=0.003)
    with raises(NotReadyError, "not_homed"):
        at_hand(zero=ZERO, known=False).session.park()


# --- the sensor ---


@pytest.mark.parametrize(("axis", "by_mm"), [("x", 1.0), ("x", -1.0), ("z", -0.5), ("z", 1.0)])
def test_a_sensor_that_does_not_answer_moves_nothing(
    at_hand: Callable[..., SessionBench], axis: str, by_mm: float
) -> None:
    bench = at_hand(zero=ZERO)
    at = bench.x_mm, bench.height_mm
    silence(bench)
    with raises(LimitError, "not_a_number"):
        bench.step(axis, by_mm)
    assert (bench.x_mm, bench.height_mm) == at
    assert not bench.session.tripped


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize(("axis", "above_mm"), [("x", 3.0), ("z", 1.0)])
def test_a_sensor_that_falls_silent_ends_a_step_within_a_look(
    at_hand: Callable[..., SessionBench], axis: str, above_mm: float, known: bool
) -> None:
    bench = at_hand(zero=ZERO, above_mm=above_mm, known=known)
    bench.clock.call_at(bench.clock.monotonic_s() + 1.5, lambda: silence(bench))
    before = bench.x_mm, bench.height_mm
    assert code_of_end(bench.step(axis, 5.0 if axis == "x" else -2.0)) == "not_a_number"
    assert bench.x_mm - before[0] < 2.5
    assert bench.height_mm > before[1] - 1.5


def test_without_a_zero_force_counts_from_before_the_first_step(at_hand: Callable[..., SessionBench]) -> None:
    """A holder of 80 gwt hangs on the sensor, and the soft trip is 51."""
    bench = at_hand(above_mm=0.3, soft_trip_n=0.5)
    bench.spring.offset_gwt = 80.0
    found = bench.step("z", -1.0)
    assert code_of_end(found) == "touched"
    assert found.force_gwt == pytest.approx(bench.worst_gwt, abs=0.02)
    assert found.known.kind == "unknown", "a change is no force"


def test_homing_forgets_a_count_of_changes_and_keeps_a_zero() -> None:
    """From a reading of before the first step no lift is shown, from a zero one is."""
    for zero, kind in ((None, "raised"), (ZERO, "lifted")):
        bench = SessionBench("grbl", zero=zero)
        assert code_of_end(bench.step("z", -0.1)) is None
        assert bench.session.sensing.zeroed
        assert bench.session.home().kind == kind
        assert bench.session.sensing.zero == zero


def test_a_zero_anyway_counts_the_next_touch_from_itself() -> None:
    bench = SessionBench("grbl", above_mm=0.2, zero=ZERO)
    assert code_of_end(bench.step("z", -0.5)) == "touched"
    bench.session.zero_anyway()
    assert bench.memory.read().zero == bench.session.sensing.lasting_zero is not None
    from_mm = bench.height_mm
    assert code_of_end(bench.step("z", -0.5)) == "touched"
    assert from_mm - bench.height_mm <= 2 * INCREMENT_MM


def test_a_zero_that_has_drifted_does_not_hide_a_touch(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=0.3, zero=ZERO)
    bench.spring.offset_gwt = 3.0
    assert code_of_end(bench.step("z", -1.0)) == "touched"
    assert bench.height_mm < 0.0
    assert bench.worst_gwt <= one_increment_gwt(bench, TOUCH_GWT)
    freeze(bench, 3.0)
    assert code_of_end(bench.step("z", -0.5)) == "lost_finger", "nor a sensor that shows the air again"


def test_position_and_force_are_shown_while_it_moves_and_at_a_look(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=0.3)
    assert bench.session.look().z_mm == pytest.approx(APEX_MM + 0.3, abs=0.003)
    bench.step("z", -0.6)
    assert len({round(at.z_mm, 3) for at, _ in bench.shown if at is not None}) >= 5
    assert bench.session.force_gwt == pytest.approx(bench.force_gwt, abs=0.011)
    silence(bench)
    bench.session.look()
    assert bench.session.force_gwt is None


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_the_position_shown_is_that_of_the_stage_along_each_axis(axis: Any, known: bool) -> None:
    """During a step and after it; the pad lies aside of the machine's zero on both."""
    bench = SessionBench("grbl", above_mm=3.0, known=known, zero=ZERO, lifted=True)
    from_mm = bench.bench.stage.status()
    assert min(abs(bench.config.frame.pad_centre_x_mm), abs(bench.config.frame.pad_y_mm)) > 1.0
    bench.shown.clear()
    assert code_of_end(bench.step(axis, 0.5)) is None
    now, shown = bench.bench.stage.status(), bench.session.at
    assert shown is not None
    assert (shown.state, shown.referenced) == (now.state, now.referenced)
    for name in ("x_mm", "y_mm", "z_mm"):
        least_mm, most_mm = getattr(from_mm, name), getattr(now, name)
        assert getattr(shown, name) == pytest.approx(most_mm, abs=0.003)
        on_the_way_mm = [getattr(at, name) for at, _ in bench.shown if at is not None]
        assert on_the_way_mm
        assert min(on_the_way_mm) >= least_mm - 0.003
        assert max(on_the_way_mm) <= most_mm + 0.003


# --- the position ---


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize("axis", ["x", "z"])
def test_a_stage_that_leaves_its_way_is_stopped(
    at_hand: Callable[..., SessionBench], axis: Any, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two reports in a row say so."""
    bench = at_hand(zero=ZERO, known=known)
    stage = bench.bench.stage
    looks, status = itertools.count(), stage._status
    far_mm = {"x": 0.0, "z": 0.0, "y": 5.0}

    def strayed(*args: Any) -> Any:
        at = status(*args)
        return replace(at, y_mm=at.y_mm + far_mm["y"]) if next(looks) > 8 else at

    monkeypatch.setattr(stage, "_status", strayed)
    assert code_of_end(bench.step(axis, 5.0, 1.0)) == "off_its_way"
    with suppress(StageReset):  # A stopped board reports its reset first.
        bench.session.look()
    with raises(NotReadyError, "tripped"):  # It has lost its position, too.
        bench.step("z", 0.1)


def test_a_stage_that_lost_its_position_steps_as_at_an_unknown_height(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(zero=ZERO, above_mm=3.0)
    bench.bench.stage.stop()
    bench.bench.stage.connect()
    bench.bench.stage.unlock()
    found = bench.step("z", -1.2)
    assert (bench.session.homed, found.known.height_mm) == (False, None)
    assert found.known.kind == "unknown"
    assert code_of_end(bench.step("x", 1.0)) is None


def test_a_stage_that_fails_raises_and_is_stopped(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(zero=ZERO)
    stage, status = bench.bench.stage, bench.bench.stage._status
    looks = itertools.count()

    def fails(*args: Any) -> Any:
        if next(looks) > 6:
            stage._status = status  # type: ignore[method-assign]
            raise StageTimeout("no reply", "silent")
        return status(*args)

    stage._status = fails  # type: ignore[method-assign]
    with raises(StageTimeout, "silent"):
        bench.step("z", 5.0, 1.0)
    assert not bench.session.homed


def test_an_override_ends_a_step_and_homing_restores_the_speed() -> None:
    bench = SessionBench("grbl", zero=ZERO)
    stage, status = bench.bench.stage, bench.bench.stage.status
    looks = itertools.count()

    def overridden() -> Any:
        if next(looks) == 9:
            raise StageOverridden("feed override 200 %")
        return status()

    stage.status = overridden  # type: ignore[method-assign]
    assert code_of_end(bench.step("z", 5.0, 1.0)) == "overridden"
    assert bench.session.homed, "its position is kept"
    bench.session.home()
    assert code_of_end(bench.step("z", -0.5)) is None


@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_a_possible_touch_is_on_record_while_a_step_moves(at_hand: Callable[..., SessionBench], known: bool) -> None:
    """Killed now, the next command knows."""
    bench = at_hand(zero=ZERO, above_mm=CLEARANCE_MM, known=known, lifted=True)
    kept = list[bool]()
    first_s = bench.clock.monotonic_s() + 0.3
    for n in range(10):
        bench.clock.call_at(first_s + 0.05 * n, lambda: kept.append(bench.memory.read().is_lifted))
    bench.step("z", -1.0)
    assert len(kept) == 10
    assert kept[-1] is False


@pytest.mark.parametrize("above_mm", [-0.3, -0.06])
def test_a_zero_in_a_touch_is_refused_by_its_lift(at_hand: Callable[..., SessionBench], above_mm: float) -> None:
    """No zero is on record, and contact is recorded as lifted: only the lift shows it; of 0.09 gwt, too."""
    bench = at_hand(above_mm=above_mm, lifted=True)
    with raises(LimitError, "zero_in_contact"):
        bench.session.zero()
    assert (bench.memory.read().zero, bench.session.sensing.zero) == (None, None)


def test_a_zero_is_that_of_the_sensor_that_it_names(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=3.0, lifted=True)
    assert bench.session.zero() == bench.session.zero_anyway() == bench.bench.force.connect() != ""
    assert bench.memory.read().zero == bench.session.sensing.lasting_zero is not None


def test_a_zero_without_a_reading_after_its_lift_is_none(at_hand: Callable[..., SessionBench]) -> None:
    """Twelve for the zero, and one before the lift."""
    bench = at_hand(above_mm=3.0)
    sensor, read, reads = bench.bench.force, bench.bench.force.read, itertools.count()

    def falls_silent() -> ForceReading:
        return read() if next(reads) < 13 else ForceReading(float("nan"), True, bench.clock.monotonic_s())

    sensor.read = falls_silent  # type: ignore[method-assign]
    with raises(LimitError, "no_reading"):
        bench.session.zero()
    assert (bench.memory.read().zero, bench.session.sensing.zero) == (None, None)


# --- without force ---


@pytest.mark.parametrize("kind", STAGES)
def test_without_force_a_step_is_a_jog_and_depth_still_counts(kind: str) -> None:
    bench = SessionBench(kind, above_mm=1.0)
    bench.begun.__exit__(None, None, None)
    session = SessionWithoutForce(bench.config, bench.bench.stage, bench.clock)
    bench.bench.stage.connect()
    with session.begun():
        assert session.step(Direction("z", -1), 2.0, 2.0).known.kind == "unknown"
        assert bench.height_mm == pytest.approx(-1.0, abs=0.003)
        with raises(LimitError, "too_deep", limit_mm=1.5):
            session.step(Direction("z", -1), 1.0, 2.0)
        session.step(Direction("x", 1), 0.5, 2.0)
        assert session.step(Direction("z", 1), 4.0, 2.0).known.kind == "raised"
        recorded = bench.memory.read().contact
        assert recorded is not None
        assert recorded.kind == "raised"
        assert bench.x_mm == pytest.approx(0.5, abs=0.003)
        assert session.home().kind == "raised"
        assert bench.height_mm > 15.0, "at its switches"
    assert bench.memory.read().left_at_mm is not None


@pytest.mark.parametrize("kind", STAGES)
@pytest.mark.parametrize("above_mm", [CLEARANCE_MM, CLEARANCE_MM + 0.06])
def test_without_force_a_step_down_is_made_of_increments_at_the_speed_of_a_press_or_the_lower_one_chosen(
    kind: str, above_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that dies leaves one of them; a refused step leaves the position known."""
    bench = SessionBench(kind, above_mm=above_mm)
    bench.begun.__exit__(None, None, None)
    stage, made = bench.bench.stage, list[tuple[float, float]]()
    stage.connect()
    session = SessionWithoutForce(bench.config, stage, bench.clock)
    jog = stage.jog

    def heard(axis: Any, by_mm: float, speed_mm_s: float) -> None:
        made.append((by_mm, speed_mm_s))
        jog(axis, by_mm, speed_mm_s)

    monkeypatch.setattr(stage, "jog", heard)
    with session.begun():
        session.step(Direction("z", -1), 0.5, 10.0)
    assert min(by_mm for by_mm, _ in made) >= -max(INCREMENT_MM, above_mm - CLEARANCE_MM) - 0.003
    assert {speed_mm_s for _, speed_mm_s in made} == {bench.config.limits.max_press_speed_mm_s}
    made.clear()
    with session.begun():
        session.step(Direction("z", -1), 0.1, 0.2)
        session.step(Direction("z", 1), 0.1, 0.2)
    assert {speed_mm_s for _, speed_mm_s in made} == {0.2}
    with raises(LimitError, "too_deep"), session.begun():
        session.step(Direction("z", -1), 5.0, 2.0)
    assert bench.memory.read().left_at_mm is not None


def test_a_zero_after_a_trip_is_refused_before_the_sensor_is_zeroed(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=1.0, zero=ZERO)
    bench.session.engine.state = State.TRIPPED
    with raises(NotReadyError, "tripped"):
        bench.session.zero()
    assert bench.memory.read().zero == ZERO


def test_a_drift_between_two_steps_down_is_no_pull(at_hand: Callable[..., SessionBench]) -> None:
    bench = at_hand(above_mm=2.5, zero=ZERO)
    for _ in range(3):
        assert code_of_end(bench.step("z", -0.2)) is None
        zero = bench.session.sensing.zero
        assert zero is not None
        bench.session.sensing.zero = replace(zero, offset_n=zero.offset_n + 0.2 * GWT_N)


# --- a process that dies ---


@pytest.mark.parametrize("kind", STAGES)
@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize(
    ("axis", "by_mm", "above_mm", "after_s"),
    [("x", 5.0, 3.0, 2.0), ("z", 5.0, 3.0, 0.6), ("z", -5.0, 9.0, 1.0), ("z", -1.0, 1.5, 1.0)],
    ids=["sideways", "up", "down to clearance", "down below clearance"],
)
def test_a_process_that_dies_leaves_one_step(
    kind: str, known: bool, axis: str, by_mm: float, above_mm: float, after_s: float
) -> None:
    """Nothing goes out any more: the stage ends what it was told by itself."""
    bench = SessionBench(kind, zero=ZERO, known=known, above_mm=above_mm)
    at: list[tuple[float, float]] = []

    def dies() -> None:
        at.append((bench.x_mm, bench.height_mm))
        bench.gate.stopping().__enter__()

    bench.clock.call_at(bench.clock.monotonic_s() + after_s, dies)
    from_mm = bench.x_mm, bench.height_mm
    with suppress(TransportError, StageError):
        bench.step(axis, by_mm, 1.0)
    bench.clock.wait_s(20.0)
    there = bench.x_mm, bench.height_mm
    gone_mm, rest_mm = (there[axis == "z"] - before[axis == "z"] for before in (from_mm, at[0]))
    assert abs(gone_mm) <= abs(by_mm) + 0.003
    assert abs(gone_mm) > 0.04, "it was on its way"
    if by_mm < 0 and not (known and above_mm > CLEARANCE_MM):
        assert abs(rest_mm) <= INCREMENT_MM + 0.003
    other = (bench.height_mm, from_mm[1]) if axis == "x" else (bench.x_mm, from_mm[0])
    assert other[0] == pytest.approx(other[1], abs=0.003)


def test_a_board_that_is_held_during_a_zero_is_sent_nothing() -> None:
    """Somebody holds it on purpose: a motion, and the reset after it, would override that."""
    bench = SessionBench("grbl", above_mm=12.0, lifted=True, zero=ForceZero(0.0, 0.0))
    sensor, stage = bench.bench.force, bench.bench.stage
    zero = sensor.zero

    def held_meanwhile() -> None:
        zero()
        stage.hold()  # type: ignore[attr-defined]

    sensor.zero = held_meanwhile  # type: ignore[method-assign]
    with pytest.raises(StageError) as caught:
        bench.session.zero()
    assert "cannot be checked by a lift" in str(caught.value)
    sent = [data for _, data in bench.sent() if data != b"?"]
    assert sent[-1] == b"!"
    assert stage.status().state.startswith("Hold")
    assert stage.homed
