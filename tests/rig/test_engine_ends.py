"""How an engine ends: trips, stops, devices and records that fail, an operator, a step of a script."""

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest

from rig.devices.base import ForceTimeout, StageError, StageOverridden
from rig.engine import EngineError, PressId, RecordError, TripError, verbs
from rig.engine.engine import State
from rig.errors import RigError
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.steps import Checkpoint, Note, Rest, Retract, Zero
from rig.session.execute import Live, execute
from rig.transport.wire import TransportError
from tests.error_codes import raises
from tests.rig.plain_bench import PlainBench
from tests.rig.script_state import StandIn
from tests.stub_bench import StubBench, raising


def _reason() -> TripError:
    return TripError("for the test: 3 mm", "for_the_test")


def _retract(engine: Any) -> None:
    verbs.retract(engine)


def _trip(engine: Any) -> None:
    with raises(TripError, "for_the_test"):
        engine.trip(_reason())


def _trip_unlifted(engine: Any) -> None:
    engine.bench.stage.at_look = raising(StageError("it does not move"))
    _trip(engine)


def _stop(engine: Any) -> None:
    engine.stop()


def _make_safe(engine: Any) -> None:
    engine.make_safe()


def _stop_read_make_safe(engine: Any) -> None:
    engine.stop()
    engine.reading()  # a finger that may be touched is watched again
    engine.make_safe()


@pytest.mark.parametrize(
    "end", [_retract, _trip, _trip_unlifted, _stop, _make_safe, _stop_read_make_safe], ids=lambda f: f.__name__
)
def test_after_every_ending_the_heartbeat_rests(end: Callable[[Any], None]) -> None:
    engine = StubBench().in_contact()
    end(engine)
    engine.clock.wait_s(3600.0)
    engine.heartbeat.look()
    assert not engine.heartbeat.lost


# --- trips ---


@pytest.mark.parametrize(("on_trip", "height_mm"), [("retract", 2.0), ("park", 10.0), ("stop", 1.95)])
def test_a_trip_lifts_parks_or_stops_as_configured_and_stays_latched(on_trip: str, height_mm: float) -> None:
    bench = StubBench({"limits": {"on_trip": on_trip}})
    engine = bench.in_contact()
    bench.force.shows_gwt = 1.0
    engine.read_force_gwt(PressId(0), "press")
    contact_s = engine.contact_time.rounded_s
    bench.force.shows_gwt = 0.0
    with raises(TripError, "for_the_test", limit_mm=3.0) as tripped:
        engine.trip(_reason(), 7.0)
    assert bench.height_mm == pytest.approx(height_mm)
    assert (bench.stage.told[-1] == "stop", bench.stage.homed) == (on_trip == "stop", on_trip != "stop")
    assert (engine.state, engine.problem) == (State.TRIPPED, tripped.value)
    assert bench.of("trip") == [{"reason": str(_reason()), "force_gwt": 7.0, "contact_s": contact_s}]
    lifted = [name for name, _ in bench.events[-2:]] == ["trip", "retract"]
    assert lifted == (on_trip != "stop")


@pytest.mark.parametrize("error", [StageError("it does not move", "stuck"), TransportError("stage is closed")])
def test_a_trip_whose_lift_fails_stays_latched_and_names_both(error: RigError) -> None:
    bench = StubBench()
    engine = bench.in_contact()
    bench.stage.at_look = raising(error)
    with raises(TripError, "for_the_test", lift=str(error)) as tripped:
        engine.trip(_reason())
    assert tripped.value.lift_code == error.code
    assert (engine.state, engine.problem) == (State.TRIPPED, tripped.value)
    assert bench.of("trip")[0]["reason"] == str(_reason())
    assert not bench.of("retract")
    assert bench.stage.told[-1] == "stop"


def test_a_trip_that_cannot_be_journaled_still_trips() -> None:
    bench = StubBench()
    engine = bench.in_contact()
    bench.at_event = raising(RecordError("the disk is full"))
    with raises(TripError, "for_the_test") as tripped:
        engine.trip(_reason())
    assert engine.problem is tripped.value


def test_a_reading_above_the_trip_that_cannot_be_journaled_still_trips() -> None:
    bench = StubBench(soft_trip_n=0.5)
    engine = bench.in_contact()
    bench.at_event, bench.force.shows_gwt = raising(RecordError("the disk is full")), 60.0
    with raises(TripError, "soft_trip"):
        engine.read_force_gwt(PressId(0), "press")
    assert engine.state is State.TRIPPED


@pytest.mark.parametrize(("on_alarm", "trips"), [("warn", False), ("trip", True)])
def test_an_alarm_is_journaled_and_trips_where_configured(on_alarm: str, trips: bool) -> None:
    bench = StubBench({"limits": {"on_alarm": on_alarm}})
    engine = bench.ready()
    if trips:
        with raises(TripError, "for_the_test"):
            engine.alarm(_reason())
    else:
        engine.alarm(_reason())
    assert bench.of("alarm") == [{"reason": str(_reason())}]
    assert engine.state is (State.TRIPPED if trips else State.READY)


def test_a_stop_that_fails_raises_nothing() -> None:
    error = TransportError("stage is closed")
    bench = StubBench()
    engine = bench.ready()
    bench.stage.at_stop = raising(error)
    engine.stop()
    assert engine.state is State.UNHOMED


# --- failures elsewhere ---


def test_a_stage_that_fails_is_stopped_and_the_first_failure_is_reported() -> None:
    error = TransportError("stage is closed")
    bench = StubBench()
    engine = bench.in_contact()
    with pytest.raises(type(error)) as failed:
        engine.guarded(raising(error))
    assert failed.value is error
    assert (engine.state, engine.problem, bench.stage.told[-1]) == (State.UNHOMED, error, "stop")
    again = StageError("again")
    with pytest.raises(StageError) as failed_again:
        engine.guarded(raising(again))
    assert failed_again.value is again
    assert engine.problem is error


def test_after_a_failure_elsewhere_the_indentor_lifts() -> None:
    bench = StubBench()
    engine = bench.in_contact()
    engine.make_safe()
    assert bench.height_mm == pytest.approx(2.0)
    assert (engine.state, engine.contact.may_touch) == (State.READY, False)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda bench: setattr(bench.stage, "at_look", raising(StageError("it does not move"))),
        lambda bench: setattr(bench.stage, "homed", False),
    ],
    ids=["failed", "untrusted"],
)
def test_where_the_indentor_cannot_lift_the_stage_is_stopped(spoil: Callable[[StubBench], None]) -> None:
    """And once more, since what failed may have lost the first stop."""
    bench = StubBench()
    engine = bench.in_contact()
    spoil(bench)
    engine.make_safe()
    assert bench.stage.told[-2:] == ["stop", "stop"]
    assert engine.state is not State.READY


def test_a_silent_sensor_does_not_prevent_the_lift() -> None:
    """It is raised all the same; nothing says that it is lifted."""
    bench = StubBench()
    engine = bench.in_contact()
    bench.force.at_read = raising(ForceTimeout("no answer"))
    engine.make_safe()
    assert bench.height_mm == pytest.approx(2.0)
    assert (engine.state, engine.known_contact.kind) == (State.IN_CONTACT, "raised")


def test_a_run_that_cannot_be_recorded_ends_lifted() -> None:
    bench = StubBench()
    engine = bench.in_contact()
    error = RecordError("the disk is full")
    bench.at_event = raising(error)
    with pytest.raises(RecordError) as failed:
        verbs.note(engine, "a word")
    assert failed.value is error
    assert engine.problem is error
    assert bench.height_mm == pytest.approx(2.0)
    assert engine.state is State.READY
    bench.at_event = raising(RecordError("still full", "still_full"))
    with raises(RecordError, "still_full"):
        verbs.note(engine, "a word")
    assert engine.problem is error


@pytest.mark.parametrize("times", [1, 4, 5])
def test_a_lift_that_an_override_interrupts_is_repeated_up_to_four_times(times: int) -> None:
    bench = StubBench({"limits": {"on_trip": "park"}})
    engine = bench.in_contact()
    left = [True] * times

    def overridden() -> None:
        if left:
            left.pop()
            raise StageOverridden("feed override 200 %")

    bench.stage.at_look = overridden
    with raises(TripError, "for_the_test") as caught:
        engine.trip(TripError("for the test", "for_the_test"))
    assert [trip["reason"] for trip in bench.of("trip")] == ["for the test"]
    assert bench.stage.told.count("halt") == times
    assert ("the lift failed" in str(caught.value)) is (bench.height_mm < 9.0) is (times == 5)


def test_a_trip_where_the_position_is_not_trusted_moves_nothing() -> None:
    """Only a stage that strayed is unlocked and jogged up."""
    bench = StubBench()
    engine = bench.in_contact()
    bench.stage.homed = False
    with raises(TripError, "for_the_test", reason="for the test"):
        engine.trip(TripError("for the test", "for_the_test"))
    assert "unlock" not in bench.stage.told
    assert bench.height_mm == pytest.approx(1.95)


@pytest.mark.parametrize(
    ("zeroed", "shows_gwt", "code"),
    [(True, 3.0, "not_lifted"), (True, None, "not_lifted"), (True, 0.04, None), (False, 3.0, None)],
)
def test_a_lift_that_the_force_does_not_confirm_trips(
    zeroed: bool, shows_gwt: float | None, code: str | None
) -> None:
    bench = StubBench()
    engine = bench.in_contact()
    if not zeroed:
        engine.sensing.zero = None
    if shows_gwt is None:
        engine.lift()
        bench.force.at_read = raising(ForceTimeout("no answer"))
    else:
        bench.force.shows_gwt = shows_gwt
    with raises(TripError, code) if code else nullcontext():
        verbs.retract(engine)
    assert engine.state is (State.TRIPPED if code else State.READY)
    lifted = [event["contact"] == "lifted" for event in bench.of("retract")]
    assert lifted == [code is None and zeroed]


@pytest.mark.parametrize(("shows_gwt", "height_mm"), [(0.04, 2.0), (0.06, 10.0), (-0.06, 10.0)])
def test_a_touch_that_remains_after_the_lift_of_a_trip_is_left_to_the_park_height(
    shows_gwt: float, height_mm: float
) -> None:
    bench = StubBench()
    engine = bench.in_contact()
    bench.force.shows_gwt = shows_gwt
    with raises(TripError, "for_the_test"):
        engine.trip(_reason())
    assert bench.height_mm == pytest.approx(height_mm)


# --- a script whose step failed ---


def test_an_interrupt_in_a_step_stops_the_stage_before_it_propagates(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a script cannot catch comes when the stage is stopped; an error does not stop it."""
    engine = PlainBench(lambda bench: 0.0, {}).engine
    stopped: list[bool] = []
    monkeypatch.setattr(engine, "stop", lambda: stopped.append(True))
    for error, stops in ((EngineError("it failed"), []), (KeyboardInterrupt(), [True])):
        monkeypatch.setattr(verbs, "zero", raising(error))
        with pytest.raises(type(error)):
            execute(engine, Zero(), None)
        assert stopped == stops


def test_after_a_swallowed_failure_a_script_can_only_write_notes_and_checkpoints() -> None:
    bench = PlainBench(lambda bench: 0.0, {})
    live = Live(bench.engine, ScriptState(bench.settings, StandIn()))
    at = PressPlace("bar", 0.0, 0.0, ())
    bench.engine.problem = EngineError("it failed")
    live.handle(Note(text="a"), at)
    live.handle(Checkpoint(name="b"), at)
    for step in (Zero(), Retract(), Rest(seconds=1)):
        with pytest.raises(EngineError, match="it failed"):
            live.handle(step, at)
    assert [stream for stream, _ in bench.events] == ["note", "checkpoint"]
