"""Fingers that moved when nobody expected it: each failure that was ever found, kept as its steps."""

import itertools
from collections.abc import Callable
from contextlib import suppress

import pytest

from rig.devices.base import StageError
from rig.engine import Pause, TripError, verbs
from rig.engine.indentation import indent
from rig.records import Target
from rig.session.script_run import ENDINGS, stopped_at_once
from rig.units import GWT_N
from tests.error_codes import raises
from tests.moving_finger import (
    FACT_S,
    OVERSHOOT_GWT,
    STAGES,
    STOP_MM,
    TRIP_GWT,
    FingerBench,
    FingerOnBytes,
    FingerOnStub,
)
from tests.stub_bench import raising

BENCHES: dict[str, Callable[[], FingerBench]] = {
    "stub": FingerOnStub,
    **{kind: lambda kind=kind: FingerOnBytes(kind) for kind in STAGES},  # type: ignore[misc]
}


@pytest.fixture(params=BENCHES)
def bench(request: pytest.FixtureRequest) -> FingerBench:
    return BENCHES[request.param]()


def on_all(first: object, *more: object) -> list[tuple[str, object]]:
    """Return benches and cases: the first case on all of them, all cases on the stub."""
    return [*((name, first) for name in BENCHES), *(("stub", case) for case in more)]


def few(*, bench: str) -> bool:
    """The engine is the same over all stages; what differs in them is in the tests that have cases."""
    return bench in ("stub", "grbl", "tmcl")


def in_s(bench: FingerBench, seconds: float) -> float:
    return bench.clock.monotonic_s() + seconds


def not_dragged(bench: FingerBench) -> None:
    far_mm, force_gwt = bench.witness.dragged(bench.least_gwt)
    assert far_mm <= STOP_MM, f"dragged by {far_mm:.2f} mm at up to {force_gwt:.1f} gwt"


# --- contact has an age ---


@pytest.mark.parametrize(("bench", "rises_mm"), on_all(4.0, 2.5), indirect=["bench"])
def test_a_finger_that_came_up_after_the_lift_is_not_called_lifted(bench: FingerBench, rises_mm: float) -> None:
    bench.ready()
    bench.ask()
    assert any(said.lifted for said in bench.witness.said), "as long as it is"
    bench.finger.moves(in_s(bench, 1.0), rises_mm)
    bench.clock.wait_s(10.0)
    bench.ask()
    assert not bench.witness.lies()


def ends(bench: FingerBench, how: str) -> None:
    """Let the next poll of a pause end what is done."""
    at_s = in_s(bench, 6.0)

    def asked() -> bool:
        if bench.clock.monotonic_s() < at_s:
            return False
        if how == "rig stop":
            raise KeyboardInterrupt
        if how == "cut cable":
            bench.stage.status = raising(StageError("the stage does not answer"))  # type: ignore[method-assign]
        return how == "SIGTERM"

    bench.pause = Pause(asked)


@pytest.mark.parametrize(("bench", "how"), on_all("cut cable", "rig stop", "SIGTERM"), indirect=["bench"])
def test_a_rest_that_ends_early_never_calls_a_finger_lifted_that_came_up(bench: FingerBench, how: str) -> None:
    engine = bench.ready()
    bench.finger.moves(in_s(bench, 1.0), 2.8)
    ends(bench, how)
    with suppress(KeyboardInterrupt, *ENDINGS), stopped_at_once(engine):
        verbs.rest(engine, 12.0)
    bench.ask()
    assert not bench.witness.lies()


# --- a finger is not zeroed away ---


@pytest.mark.parametrize(
    ("bench", "when"), on_all((0.8, 20.0), (0.2, 4.0), (0.4, 4.0), (0.5, 20.0), (0.6, 4.0)), indirect=["bench"]
)
def test_a_zero_of_a_run_never_hides_a_finger_that_comes_up(bench: FingerBench, when: tuple[float, float]) -> None:
    engine, (after_s, speed_mm_s) = bench.ready(), when
    bench.finger.moves(in_s(bench, after_s), 4.0, speed_mm_s)
    with suppress(*ENDINGS):
        verbs.zero(engine)
        assert bench.witness.now().force_gwt < bench.least_gwt, "the zero counts"
        verbs.move_to(engine, 4.0)
    assert engine.sensing.touch_gwt < 0.5, "or a touch is not felt any more"
    not_dragged(bench)
    assert bench.witness.made_gwt(TRIP_GWT, bench.read_s) <= OVERSHOOT_GWT


@pytest.mark.parametrize(("bench", "by_mm"), on_all(2.03, 2.05), indirect=["bench"])
def test_a_zero_in_which_a_finger_pressed_lightly_and_left_is_refused(bench: FingerBench, by_mm: float) -> None:
    """It leaves before the lift, so that only the forces of the zero and in the air differ."""
    engine = bench.ready()
    zero = bench.force.zero

    def press() -> None:
        zero()
        bench.finger.moves(in_s(bench, 0.25), by_mm, 20.0, stays_s=0.3)

    bench.force.zero = press  # type: ignore[method-assign]
    with suppress(*ENDINGS):
        verbs.zero(engine)
    held = engine.sensing.zero
    assert held is None or abs(held.offset_n / GWT_N) < 0.05


@pytest.mark.quick(rows=few)
def test_a_finger_that_shakes_during_a_zero_does_not_raise_the_touch_threshold(bench: FingerBench) -> None:
    engine = bench.ready()
    zero = bench.force.zero

    def shake() -> None:
        zero()
        bench.finger.moves(in_s(bench, 0.0), 1.8, 20.0, stays_s=3.0)
        bench.finger.moves(in_s(bench, 0.1), 0.6, 8.0, cycles=30)

    bench.force.zero = shake  # type: ignore[method-assign]
    with suppress(*ENDINGS):
        verbs.zero(engine)
    assert engine.sensing.touch_gwt < 0.5
    assert engine.sensing.noise_gwt < 0.1


# --- a move sideways ends at a touch ---


@pytest.mark.parametrize(("bench", "rises_mm"), on_all(2.7, 3.2), indirect=["bench"])
def test_a_move_sideways_ends_when_a_finger_comes_up(bench: FingerBench, rises_mm: float) -> None:
    engine = bench.ready()
    bench.finger.moves(in_s(bench, 0.4), rises_mm)
    with suppress(*ENDINGS):
        verbs.move_to(engine, 6.0)
    not_dragged(bench)


@pytest.mark.parametrize(("bench", "flank_mm"), on_all((3.3, 3.3), (2.6, 2.6), (2.6, 0.2)), indirect=["bench"])
def test_a_move_sideways_ends_at_a_second_finger_beside_the_first(
    bench: FingerBench, flank_mm: tuple[float, float]
) -> None:
    engine = bench.ready()
    bench.finger.stands_beside(2.0, *flank_mm)
    with suppress(*ENDINGS):
        verbs.move_to(engine, 6.0)
    not_dragged(bench)
    assert bench.witness.made_gwt(TRIP_GWT, bench.read_s) <= OVERSHOOT_GWT


# --- a way down begins with a reading ---


@pytest.mark.parametrize(("bench", "rises_mm"), on_all(2.3, 2.8), indirect=["bench"])
def test_no_descent_begins_on_a_finger_that_came_up_since_the_last_reading(
    bench: FingerBench, rises_mm: float
) -> None:
    engine = bench.ready()
    indent(engine, Target("doi_mm", 0.3))
    bench.finger.moves(in_s(bench, 0.1), rises_mm, 50.0)
    bench.clock.wait_s(1.0)
    stood, so_far = bench.witness.now(), len(bench.witness.samples)
    with suppress(*ENDINGS):
        indent(engine, Target("doi_mm", 0.3))
    assert min(sample.height_mm for sample in bench.witness.samples[so_far:]) > stood.height_mm - 0.01


@pytest.mark.quick(rows=few)
def test_a_descent_after_the_computer_was_suspended_begins_with_a_reading(bench: FingerBench) -> None:
    engine = bench.ready()
    indent(engine, Target("doi_mm", 0.3))
    bench.clock.slept_s += 3600.0
    bench.finger.moves(in_s(bench, 0.0), 2.3, 1e4)
    bench.clock.wait_s(0.06)
    stood, so_far = bench.witness.now(), len(bench.witness.samples)
    with suppress(*ENDINGS):
        indent(engine, Target("doi_mm", 0.3))
    assert min(sample.height_mm for sample in bench.witness.samples[so_far:]) > stood.height_mm - 0.01


# --- rests are watched ---


@pytest.mark.quick(rows=few)
def test_a_force_above_the_trip_ends_a_rest(bench: FingerBench) -> None:
    engine = bench.ready()
    bench.finger.moves(in_s(bench, 2.0), 4.0)
    with pytest.raises(TripError):
        verbs.rest(engine, 12.0)
    above = [sample for sample in bench.witness.samples if sample.force_gwt > TRIP_GWT]
    assert above[-1].t_s - above[0].t_s < FACT_S + 0.5, "it lifts"


@pytest.mark.quick(rows=few)
def test_contact_time_counts_while_a_finger_touches_during_a_rest(bench: FingerBench) -> None:
    engine = bench.ready()
    bench.finger.moves(in_s(bench, 2.0), 2.3)
    with suppress(*ENDINGS):
        verbs.rest(engine, 12.0)
    touched = [sample for sample in bench.witness.samples if sample.force_gwt >= bench.least_gwt]
    assert touched, "it came up"
    touched_s = touched[-1].t_s - touched[0].t_s
    assert engine.contact_time.total_s >= touched_s - FACT_S - 0.5


@pytest.mark.parametrize("again_s", [1.4, 1.9, 2.2])
@pytest.mark.parametrize("kind", ["stub", *STAGES])
def test_a_finger_that_reaches_the_park_height_twice_is_not_dragged_there(kind: str, again_s: float) -> None:
    """Its first touch vanishes at rest, as that of a stage that shakes does."""
    tables = {"habits": {"park_height_mm": 4.0, "clearance_mm": 1.5}}
    bench = FingerOnStub(tables) if kind == "stub" else FingerOnBytes(kind, tables)
    engine = bench.ready()
    engine.go_to_height(4.0, 2.0)
    bench.finger.moves(in_s(bench, 0.8), 4.3, 20.0, stays_s=0.05)
    bench.finger.moves(in_s(bench, again_s), 4.3, 20.0, stays_s=3.0)
    with suppress(*ENDINGS):
        verbs.go_sideways(engine, 6.0, 0.0, 1.0)
    assert bench.witness.worst_gwt() > bench.least_gwt
    not_dragged(bench)


# --- a trip is left behind ---


@pytest.mark.parametrize(("bench", "rises_mm"), on_all(3.5, 2.6, 4.4), indirect=["bench"])
def test_the_lift_after_a_trip_continues_while_a_force_remains(bench: FingerBench, rises_mm: float) -> None:
    engine = bench.ready()
    bench.finger.moves(in_s(bench, 8.0), rises_mm, 20.0)
    with pytest.raises(TripError):
        indent(engine, Target("force_gwt", 6.0), hold_s=30.0)
    assert bench.stage.homed
    now = bench.witness.now()
    assert now.force_gwt < bench.least_gwt, f"left at {now.height_mm:.2f} mm with {now.force_gwt:.1f} gwt"


def test_the_lift_after_a_trip_continues_when_the_finger_follows(bench: FingerBench) -> None:
    """It reaches the indentor just after the lift, while contact is measured."""
    engine = bench.ready()
    bench.finger.moves(in_s(bench, 0.5), 2.15, 1.0)
    with raises(TripError, "contact_too_high"):
        indent(engine, Target("doi_mm", 0.3))
    now = bench.witness.now()
    assert now.force_gwt < bench.least_gwt, f"left at {now.height_mm:.2f} mm with {now.force_gwt:.1f} gwt"
    assert engine.known_contact.kind == "lifted"


def test_a_trip_is_journaled_even_if_its_lift_is_stopped() -> None:
    bench = FingerOnStub()
    engine = bench.ready()
    bench.finger.moves(in_s(bench, 8.0), 1.0, 20.0)
    looks = itertools.count()

    def stop() -> None:
        if engine.problem is not None and next(looks) == 2:
            raise KeyboardInterrupt

    bench.stage.at_look = stop
    with pytest.raises(KeyboardInterrupt), stopped_at_once(engine):
        indent(engine, Target("force_gwt", 6.0), hold_s=30.0)
    trips = bench.of("trip")
    assert trips
    assert "soft trip" in str(trips[0]["reason"])


# --- and the bench itself is a fair one ---


@pytest.mark.quick(rows=few)
def test_a_finger_that_stays_still_is_pressed_and_left_without_a_trip(bench: FingerBench) -> None:
    engine = bench.ready()
    indent(engine, Target("force_gwt", 6.0))
    verbs.rest(engine, 3.0)
    verbs.move_to(engine, 1.0)
    verbs.zero(engine)
    bench.ask()
    assert 5.5 < bench.witness.worst_gwt() < 7.0
    assert bench.witness.dragged(bench.least_gwt) == (0.0, 0.0)
    assert not bench.witness.lies()
    assert any(said.lifted for said in bench.witness.said)
