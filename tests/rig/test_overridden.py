"""Somebody changes the speed at the controller: what is under way ends, and is left at full speed."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import StageOverridden
from rig.engine import Target, TripError, indent, verbs
from rig.engine.engine import Engine, State
from rig.engine.sensing import ForceZero
from tests.error_codes import has_code
from tests.rig.hand_bench import SessionBench, code_of_end
from tests.rig.test_watched_moves import GRBL, Watched

OVERRIDES = {
    "twice the feed": (b"\x91" * 10, "feed override 200 %"),
    "a tenth of the feed": (b"\x92" * 9, "feed override 10 %"),
    "a quarter of the rapids": (b"\x97", "rapid override 25 %"),
}
CLEARANCE_MM = 2.0


def _struck(bench: Watched | SessionBench, data: bytes, *, after_s: float = 0.0) -> None:
    """Somebody else's bytes on the same wire."""
    wire = bench.bench.stage._link._transport  # type: ignore[attr-defined]
    bench.clock.call_at(bench.clock.monotonic_s() + after_s, lambda: wire.write(data))


def _pressed(engine: Engine) -> None:
    for height_mm in (1.95, 1.9):
        engine.go_to_height(height_mm, 0.5)


def _in_a_press(engine: Engine) -> None:
    indent(engine, Target("force_gwt", 8.0), hold_s=5.0, expected_contact_mm=0.0)


# What is under way when it happens, and so long after it began.
MOTIONS: dict[str, tuple[Callable[[Engine], object], float]] = {
    "aside": (lambda engine: verbs.move_to(engine, 4.0), 0.25),
    "down to clearance": (lambda engine: (engine.go_to_height(8.0, 5.0), verbs.move_to(engine, 0.0)), 1.6),
    "descent": (lambda engine: engine.go_to_height(1.95, 0.02), 0.25),
    "press": (_in_a_press, 3.0),
    "hold": (lambda engine: (_pressed(engine), engine.clock.wait_s(1.0), engine.go_to_height(1.89, 0.5)), 0.9),
    "lift": (lambda engine: (_pressed(engine), engine.lift(9.0)), 0.8),
}


@pytest.fixture
def watched() -> Watched:
    return Watched(GRBL)


@pytest.mark.quick(rows=lambda motion, what: what == "twice the feed" or motion == "press")
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("what", OVERRIDES)
def test_a_speed_override_trips_and_lifts_at_full_speed(watched: Watched, motion: str, what: str) -> None:
    data, says = OVERRIDES[what]
    engine = watched.ready()
    begin, after_s = MOTIONS[motion]
    _struck(watched, data, after_s=after_s)
    with pytest.raises(TripError, match=f"^stage: {says} at the controller"):
        begin(engine)
    assert engine.state is State.TRIPPED
    assert watched.bench.stage.homed
    assert watched.pose.above_apex_mm > CLEARANCE_MM - 0.01
    assert engine.height_mm == pytest.approx(watched.pose.above_apex_mm, abs=0.003)
    assert [stream for stream, _ in watched.events[-2:]] == ["trip", "retract"]
    assert [stream for stream, _ in watched.events].count("trip") == 1


@pytest.mark.parametrize(("on_trip", "above_mm"), [("park", 10.0), ("retract", CLEARANCE_MM)])
def test_a_speed_override_lifts_as_high_as_any_trip(on_trip: str, above_mm: float) -> None:
    watched = Watched(GRBL, on_trip=on_trip)
    engine = watched.ready()
    _pressed(engine)
    _struck(watched, b"\x91", after_s=0.25)
    with pytest.raises(TripError, match="feed override 110 %"):
        engine.go_to_height(1.88, 0.02)
    assert watched.pose.above_apex_mm == pytest.approx(above_mm, abs=0.003)


def test_a_speed_override_stops_without_a_lift_where_trips_stop() -> None:
    watched = Watched(GRBL, on_trip="stop")
    engine = watched.ready()
    _struck(watched, b"\x91", after_s=0.25)
    with pytest.raises(TripError, match="feed override 110 %"):
        engine.go_to_height(1.95, 0.02)
    assert 1.95 < watched.pose.above_apex_mm < 2.0
    assert not watched.bench.stage.homed


@pytest.mark.parametrize("data", [b"\x92" * 9, b"\x91" * 10])
def test_a_speed_override_during_the_lift_after_a_trip_does_not_end_the_lift(watched: Watched, data: bytes) -> None:
    """It goes up at the speed it was told, and further up each time."""
    engine = watched.ready()
    _pressed(engine)
    for after_s in (0.1, 0.5):
        _struck(watched, data, after_s=after_s)
    with pytest.raises(TripError, match=r"^for the test$"):
        engine.trip(TripError("for the test"))
    assert watched.pose.above_apex_mm == pytest.approx(CLEARANCE_MM, abs=0.003)
    assert [stream for stream, _ in watched.events].count("trip") == 1
    assert watched.bench.stage.homed


def test_a_lift_overridden_five_times_ends_with_an_error(watched: Watched) -> None:
    engine = watched.ready()
    engine.go_to_height(1.95, 0.5)
    stage, went = watched.bench.stage, []

    def overridden(**_: Any) -> Any:
        went.append(1)
        yield None
        raise StageOverridden("somebody changed it")

    stage.moving = overridden  # type: ignore[method-assign]
    with pytest.raises(TripError, match=r"^for the test; and the lift failed: somebody changed it$"):
        engine.trip(TripError("for the test"))
    assert len(went) == 5


# --- by hand ---

STEPS = {"down": ("z", -1.5), "up": ("z", 5.0), "sideways": ("x", 5.0)}


@pytest.mark.parametrize("name", STEPS)
def test_a_manual_step_ends_at_rest_on_a_speed_override_until_homing(name: str) -> None:
    bench = SessionBench("grbl", zero=ForceZero(0.0, 0.0))
    _struck(bench, b"\x92" * 5, after_s=1.6 if name == "sideways" else 0.8)  # contact, before the motion
    axis, by_mm = STEPS[name]
    found = bench.step(axis, by_mm, 1.0)
    assert found.ended_by is not None
    has_code(found.ended_by, "overridden", feed_percent=50)
    at = bench.height_mm, bench.x_mm
    bench.clock.wait_s(2.0)
    assert (bench.height_mm, bench.x_mm) == at
    bench.session.home()
    assert bench.step("z", -0.5).ended_by is None


def test_a_manual_step_that_trips_lifts_despite_a_speed_override() -> None:
    """Pressed to the trip, and somebody changes the speed just as it goes back up."""
    bench = SessionBench("grbl", k_gwt=6000.0, above_mm=0.52, soft_trip_n=0.1)
    trip, struck = bench.session.engine.trip, []

    def strikes(*args: Any) -> Any:
        struck.append(args)
        _struck(bench, b"\x92" * 9, after_s=0.1)
        return trip(*args)

    bench.session.engine.trip = strikes  # type: ignore[method-assign]
    assert code_of_end(bench.step("z", -1.0)) == "soft_trip"
    assert struck
    assert bench.force_gwt == 0.0
