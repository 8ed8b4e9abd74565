"""The engine: where it is, what it reads and feels on the way, its heartbeat, homing, rests and zeros.

Clearance is 2 mm; heights within 0.02 mm of it are clearance. The heartbeat is 3 s, the soft trip 203.94 gwt.
"""

import itertools
import math
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest

from rig.bench.virtual import looked_after_by
from rig.devices.base import LOOK_S, ForceBusy, ForceTimeout, StageError
from rig.engine import LimitError, PressId, TripError, verbs
from rig.engine.bench_memory import LastKnown
from rig.engine.contact import KnownContact
from rig.engine.engine import State
from rig.engine.limits import FingerStiffness, TouchedPlace
from rig.engine.motion import UP
from rig.engine.sensing import ForceZero
from rig.engine.steps import Steps
from rig.errors import RigError
from rig.records import NO_PRESS, ContactFit
from rig.settings import ZERO_LIFT_MM
from rig.units import GWT_N
from tests.error_codes import raises
from tests.stub_bench import KeptMemory, StubBench, raising

# --- clearance and contact ---


@pytest.mark.parametrize(("to_mm", "lifted_mm"), [(None, 2.0), (1.99, 1.99), (5.0, 5.0), (1.955, 1.95)])
def test_a_lift_is_straight_up_at_the_speed_of_travel(to_mm: float | None, lifted_mm: float) -> None:
    bench = StubBench()
    bench.in_contact().lift(to_mm)
    assert bench.height_mm == pytest.approx(lifted_mm)
    assert bench.stage.told[-1][3] == (0.5 if lifted_mm == 1.95 else 5.0)


def test_a_retract_ends_contact_pressure_limit_contact_time_and_heartbeat() -> None:
    bench = StubBench()
    engine = bench.in_contact()
    engine.trips.press_on(1.0)
    bench.force.shows_gwt = 1.0
    engine.read_force_gwt(PressId(0), "press")
    bench.clock.wait_s(1.0)
    bench.force.shows_gwt = 0.0
    verbs.retract(engine)
    assert (engine.state, engine.contact.may_touch) == (State.READY, False)
    assert engine.trips.lowest_gwt == pytest.approx(203.943, abs=1e-3)
    touched_s = bench.of("retract")[0]["contact_s"]
    bench.clock.wait_s(100.0)
    assert engine.contact_time.total_s == pytest.approx(touched_s)
    engine.heartbeat.look()
    assert not engine.heartbeat.lost


# --- what is known of contact without a question to a device ---


def _moved(bench: StubBench) -> None:
    bench.engine.go_to_height(1.9, 0.5)


def _read(bench: StubBench) -> None:
    bench.engine.go_to_height(1.9, 0.5)
    bench.engine.read_force_gwt(PressId(0), "press")


@pytest.mark.parametrize("last", [_moved, _read], ids=["in motion", "at rest"])
@pytest.mark.parametrize(
    ("shows_gwt", "zeroed", "kind", "force_gwt"),
    [
        (3.0, True, "touching", 3.0),
        (-0.06, True, "touching", -0.06),
        (0.04, True, "unknown", 0.04),
        (3.0, False, "unknown", None),
    ],
)
def test_before_a_measurement_contact_follows_from_position_and_last_force(
    last: Callable[[StubBench], None], shows_gwt: float, zeroed: bool, kind: str, force_gwt: float | None
) -> None:
    bench = StubBench()
    engine = bench.in_contact()
    if not zeroed:
        engine.sensing.zero = None
    bench.force.shows_gwt = shows_gwt
    last(bench)
    known = engine.known_contact
    assert (known.kind, known.force_gwt) == (kind, force_gwt if force_gwt is None else pytest.approx(force_gwt))
    assert (known.x_mm, known.height_mm) == (0.0, pytest.approx(1.9))


@pytest.mark.parametrize(
    ("height_mm", "homed", "shows_gwt", "kind"),
    [
        (10.0, True, 0.04, "lifted"),
        (1.985, True, 0.04, "lifted"),
        (1.97, True, 0.04, "unknown"),
        (1.985, True, -0.06, "disagreement"),
        (1.97, True, -0.06, "touching"),
        (10.0, False, 0.04, "unknown"),
        (10.0, False, 0.06, "touching"),
    ],
)
def test_contact_at_rest_follows_from_position_and_force(
    height_mm: float, homed: bool, shows_gwt: float, kind: str
) -> None:
    bench = StubBench()
    engine = bench.ready()
    engine.go_to_height(height_mm, 0.5)
    bench.stage.homed, bench.force.shows_gwt = homed, shows_gwt
    assert engine.measure_contact().kind == kind


def test_contact_is_recorded_before_the_first_motion_below_clearance_and_at_each_measurement() -> None:
    bench, kept = StubBench(), list[KnownContact]()
    engine = bench.ready()
    engine.memory = KeptMemory(kept)
    engine.go_to_height(1.95, 0.5)
    engine.go_to_height(1.9, 0.5)
    bench.force.shows_gwt = 3.0
    begun_s = bench.clock.unix_s()
    engine.measure_contact()
    assert [(one.kind, one.force_gwt, one.height_mm) for one in kept] == [
        ("unknown", pytest.approx(0.0), 2.0),
        ("touching", 3.0, 1.9),
    ]
    assert kept[0].unix_s < begun_s < kept[1].unix_s
    assert not engine.known_contact.aged
    bench.clock.wait_s(2.0)
    assert engine.known_contact.aged


def _measured_at_rest(bench: StubBench) -> None:
    bench.engine.measure_contact()


def _read_at_rest(bench: StubBench) -> None:
    bench.engine.read_force_gwt(NO_PRESS, "moving")


def _read_in_motion(bench: StubBench) -> None:
    bench.engine.lift(bench.height_mm + 1.0)


@pytest.mark.parametrize(
    ("last", "zeroed"),
    [(_measured_at_rest, True), (_read_at_rest, True), (_read_in_motion, True), (_read_at_rest, False),
     (_read_in_motion, False)],
)  # fmt: skip
def test_the_record_before_a_motion_below_clearance_has_the_last_force_from_a_zero(
    last: Callable[[StubBench], None], zeroed: bool
) -> None:
    """What the next command reads if this one is killed in that motion."""
    bench, kept = StubBench(), list[KnownContact]()
    engine = bench.ready()
    engine.memory = KeptMemory(kept)
    bench.force.shows_gwt = 0.03
    if not zeroed:
        engine.sensing.zero = None
    last(bench)
    kept.clear()
    engine.go_to_height(1.95, 0.5, touch_ends_it=True)
    assert (kept[0].kind, kept[0].force_gwt) == ("unknown", pytest.approx(0.03) if zeroed else None)


@pytest.mark.parametrize(
    ("moved", "after_s", "since", "measures"),
    [(False, 0.0, False, False), (True, 0.0, False, False), (True, 2.0, False, True), (True, 0.0, True, True)],
)
def test_at_the_end_of_a_run_contact_is_measured_unless_nothing_moved_or_it_was_just_measured(
    moved: bool, after_s: float, since: bool, measures: bool
) -> None:
    """since: whether it moved after the last measurement, be it an instant ago."""
    bench = StubBench()
    bench.engine.sensing.zero = ForceZero(0.0, 0.0)
    if moved:
        bench.ready().measure_contact()
    bench.clock.wait_s(after_s)
    if since:
        bench.engine.go_to_height(1.99, 2.0)
    read = len(bench.force.read_s)
    bench.engine.measure_at_end()
    assert (len(bench.force.read_s) > read) is measures


def test_the_depth_limit_of_a_stage_is_sent_again_after_it_may_be_lost() -> None:
    """After it was forgotten, after a stop, and after one that was not confirmed."""
    bench = StubBench()
    engine = bench.ready()
    lowest_mm, told = -bench.settings.stage.travel_mm[2], bench.stage.floors_mm
    told.clear()
    for lose in (lambda: None, engine.motion.forget_depth, engine.stop, lambda: None):
        lose()
        engine.limit_depth(-1000.0)
    assert told == [lowest_mm] * 3
    for fails in (True, False):
        with raises(StageError, "stage_failed") if fails else nullcontext():
            bench.stage.limit_depth = raising(StageError("busy")) if fails else told.append  # type: ignore[method-assign]
            engine.limit_depth(-0.5)
    assert told[-1] == bench.settings.frame.apex_z_mm - 0.5


# --- readings ---


@pytest.mark.parametrize(
    ("height_mm", "force_gwt", "touched"), [(1.95, 0.06, True), (1.95, 0.04, False), (2.0, 0.06, False)]
)
def test_contact_time_begins_with_the_first_touch_below_clearance(
    height_mm: float, force_gwt: float, touched: bool
) -> None:
    """Contact is 0.05 gwt; what a sensor shows at clearance is no touch."""
    bench = StubBench()
    engine = bench.ready()
    engine.go_to_height(height_mm, 0.5)
    bench.force.shows_gwt = force_gwt
    engine.read_force_gwt(PressId(0), "approach")
    bench.clock.wait_s(2.0)
    assert engine.contact_time.total_s == (pytest.approx(2.0) if touched else 0.0)


READINGS: dict[str, Callable[[Any], Any]] = {
    "reading": lambda engine: engine.reading(),
    "raw_reading": lambda engine: engine.reading(from_zero=False),
    "read_force_gwt": lambda engine: engine.read_force_gwt(PressId(0), "press"),
}


@pytest.mark.parametrize("read", READINGS)
def test_every_reading_trips_on_a_sensor_that_fails_and_above_the_hard_trip(read: str) -> None:
    bench = StubBench()
    engine = bench.ready()
    engine.trips.soft_gwt = 1e9
    bench.force.shows_gwt = -511.0
    with raises(TripError, "hard_trip", force_gwt=pytest.approx(-511.0), limit_gwt=5.0 / GWT_N):
        READINGS[read](engine)
    assert bench.of("trip")[0]["force_gwt"] == pytest.approx(-511.0)
    bench = StubBench()
    engine = bench.ready()
    bench.force.at_read = raising(ForceTimeout("no answer"))
    with raises(TripError, "no_reading", error="no answer"):
        READINGS[read](engine)
    assert bench.of("trip")[0]["force_gwt"] is None


@pytest.mark.parametrize("pressed_at", ["before", "after"])
@pytest.mark.parametrize("read", READINGS)
def test_a_stop_input_before_or_after_a_reading_at_rest_trips(read: str, pressed_at: str) -> None:
    bench = StubBench()
    engine, pressed = bench.in_contact(), list[bool]()
    bench.force.at_read = lambda: pressed.append(True)
    button = TripError("stop input button", "stop_input")
    engine.stop_inputs = lambda engine, *, at_rest: (
        button if at_rest and bool(pressed) is (pressed_at == "after") else None
    )
    with raises(TripError, "stop_input", input="button"):
        READINGS[read](engine)


# --- what is felt on the way ---


def test_the_lift_after_a_trip_reads_no_force() -> None:
    bench = StubBench()
    engine = bench.in_contact()
    asked = len(bench.force.read_s)
    heights_mm: list[float] = []

    def silent() -> None:
        heights_mm.append(bench.height_mm)
        raise ForceTimeout("no answer")

    bench.force.at_read = silent
    with raises(TripError, "for_the_test"):
        engine.trip(TripError("for the test", "for_the_test"))
    assert heights_mm == pytest.approx([2.0, 2.0]), "asked at rest: whether a force remains, and at the end"
    assert len(bench.force.read_s) == asked + 2
    assert bench.height_mm == pytest.approx(2.0)
    assert (engine.known_contact.kind, engine.known_contact.may_touch) == ("raised", True)


WHILE_MOVING: dict[str, Callable[[StubBench], object]] = {
    "soft_trip": lambda bench: setattr(bench.force, "shows_gwt", -60.0),
    "hard_trip": lambda bench: (
        setattr(bench.engine.trips, "soft_gwt", 1e9), setattr(bench.force, "shows_gwt", 600.0)),
    "no_reading": lambda bench: setattr(bench.force, "at_read", raising(ForceTimeout("no answer"))),
    "stop_input": lambda bench: setattr(
        bench.engine, "stop_inputs",
        lambda engine, *, at_rest: None if at_rest else TripError("pressed", "stop_input")),
    "suspended": lambda bench: setattr(bench.clock, "suspended_s", lambda: 9.0),
}  # fmt: skip


@pytest.mark.parametrize("code", WHILE_MOVING)
def test_a_motion_is_halted_and_trips_at_the_next_status(code: str) -> None:
    """The soft trip is 51 gwt; the increment of 2.5 s is looked at every 0.1 s."""
    bench, heights_mm = StubBench(soft_trip_n=0.5), list[float]()
    engine = bench.in_contact()

    def look() -> None:
        heights_mm.append(bench.height_mm)
        if len(heights_mm) == 3:
            WHILE_MOVING[code](bench)

    bench.stage.at_look = look
    with raises(TripError, code):
        engine.go_to_height(1.90, 0.02)
    assert "halt" in bench.stage.told
    assert min(heights_mm) == pytest.approx(1.95 - 3 * 0.002, abs=1e-6)
    assert engine.state is State.TRIPPED


@pytest.mark.parametrize(
    ("shows_gwt", "touch_ends_it", "goes"),
    [(3.0, False, True), (3.0, True, False), (-3.0, True, False), (0.04, True, True)],
)
def test_a_touch_ends_only_a_motion_that_should_end_at_a_touch(
    shows_gwt: float, touch_ends_it: bool, goes: bool
) -> None:
    bench = StubBench()
    engine = bench.in_contact()
    bench.force.shows_gwt = shows_gwt
    engine.go_to_height(1.90, 0.05, touch_ends_it=touch_ends_it)
    assert (bench.height_mm == pytest.approx(1.90), "halt" in bench.stage.told) == (goes, not goes)
    assert engine.height_mm == pytest.approx(bench.height_mm)


@pytest.mark.parametrize(("more_s", "trips"), [(0.4, False), (0.5, False), (0.6, True)])
def test_a_suspension_in_contact_trips_if_it_exceeds_half_a_second_since_the_last_poll(
    more_s: float, trips: bool
) -> None:
    """What it slept before, and in the air, does not count; nor do naps within half a second each."""
    bench, slept = StubBench(), [3600.0]
    bench.clock.suspended_s = lambda: slept[0]  # type: ignore[method-assign]
    engine = bench.ready()
    slept[0] += 60.0
    engine.go_to_height(1.95, 0.5)
    for _ in range(3):
        slept[0] += more_s
        with raises(TripError, "suspended", for_s=pytest.approx(more_s)) if trips else nullcontext():
            engine.reading()
        if trips:
            return


# --- the heartbeat ---


@pytest.mark.parametrize(
    ("to_mm", "speed_mm_s", "promised_s"),
    [(1.90, 0.5, 3.2), (1.90, 0.05, 5.0), (2.0, 0.5, 3.2), (1.94, 0.5, 3.04)],
)
def test_the_heartbeat_allows_a_move_below_clearance_twice_its_duration(
    to_mm: float, speed_mm_s: float, promised_s: float
) -> None:
    """From 1.95 mm; at each look it promises 3 s again."""
    bench = StubBench()
    engine = bench.in_contact()
    promised = bench.promises()
    engine.go_to_height(to_mm, speed_mm_s)
    assert promised[0] == pytest.approx(promised_s)
    assert len(promised) > 1
    assert set(promised[1:]) == {3.0}


def test_the_heartbeat_includes_the_wait_for_a_reading() -> None:
    """Two periods of 0.05 s and 0.1 s late after a move, then one period."""
    bench = StubBench({"force": {"latency_s": 0.1}, "habits": {"settle_readings": 2}, "limits": {"heartbeat_s": 4.0}})
    engine = bench.in_contact()
    promised = bench.promises()
    for read in READINGS.values():
        read(engine)
    assert promised == pytest.approx([4.2, 4.05, 4.05])


def test_an_engine_that_was_silent_too_long_stops_the_stage_and_trips() -> None:
    """Nobody else looked: it stops the stage itself, stays where it is, and can still be read afterwards."""
    bench = StubBench()
    engine = bench.in_contact()
    bench.clock.wait_s(3.5)
    with raises(TripError, "heartbeat_lost") as lost:
        engine.reading()
    assert bench.of("trip")[0]["reason"] == str(lost.value)
    assert bench.stage.told[-1] == "stop"
    assert bench.height_mm == pytest.approx(1.95)
    bench.force.shows_gwt = 3.0
    assert engine.reading().force_n == pytest.approx(3.0 * GWT_N)
    assert len(bench.of("trip")) == 1


@pytest.mark.parametrize("silent_s", [0.5, 2.9, 4.5])
def test_the_wait_for_a_dead_sensor_loses_no_heartbeat(silent_s: float) -> None:
    """A cell that sends a line every second or two is waited for as long; then the indentor leaves the finger."""
    bench = StubBench()
    engine = bench.in_contact()
    engine.sensing.max_age_s = silent_s

    def silent() -> None:
        bench.clock.wait_s(silent_s)
        raise ForceTimeout("no line")

    bench.force.at_read = silent
    with looked_after_by(bench.clock, engine.heartbeat), raises(TripError, "no_reading"):
        engine.reading()
    assert "stop" not in bench.stage.told
    assert bench.height_mm == 2.0


@pytest.mark.parametrize("speed_mm_s", [0.05, 2.0])
def test_the_heartbeat_allows_a_step_at_an_unknown_height_twice_its_duration(
    speed_mm_s: float,
) -> None:
    """Up in parts of habits.descent_step_mm, 0.5 mm."""
    bench = StubBench()
    engine = bench.in_contact()
    bench.stage.homed, engine.state = False, State.UNHOMED
    promised = bench.promises()
    Steps(engine).make(UP, 1.2, speed_mm_s)
    longest_s = 3.0 + 2.0 * bench.settings.habits.descent_step_mm / speed_mm_s
    assert max(promised) == pytest.approx(longest_s)


@pytest.mark.parametrize("busy_s", [0.6, 0.99])
def test_a_sensor_that_is_busy_at_rest_loses_no_heartbeat(busy_s: float) -> None:
    """A heartbeat of 0.5 s: the engine asks again all the while, for up to a second."""
    bench = StubBench({"limits": {"heartbeat_s": 0.5}})
    engine = bench.in_contact()
    until_s = bench.clock.monotonic_s() + busy_s

    def busy() -> None:
        if bench.clock.monotonic_s() < until_s:
            raise ForceBusy("no value now")

    for read in (*READINGS.values(), lambda engine: engine.measure_contact(), lambda engine: engine.make_safe()):
        until_s, bench.force.at_read = bench.clock.monotonic_s() + busy_s, busy
        with looked_after_by(bench.clock, engine.heartbeat):
            read(engine)
    assert not engine.heartbeat.lost
    assert "stop" not in bench.stage.told


# --- a stage that leaves its way ---


@pytest.mark.parametrize(("from_mm", "to_mm"), [(1.95, None), (1.5, None), (3.0, 10.0), (24.0, 25.0)])
def test_a_stage_that_strayed_is_lifted_by_at_least_clearance(from_mm: float, to_mm: float | None) -> None:
    """Since its height is not trusted any more. From above clearance to habits.park_height_mm, 10 mm, and never
    beyond the top of the travel, 25 mm.
    """
    bench = StubBench()
    engine = bench.in_contact()
    while engine.height_mm > from_mm + 1e-9:
        engine.go_to_height(max(engine.height_mm - 0.05, from_mm), 0.5)
    engine.lift(from_mm)
    at_mm: list[float] = []

    def strays() -> None:
        bench.stage.at_mm[0] += 1.0
        at_mm.append(bench.height_mm)

    bench.stage.at_look = strays
    with raises(TripError, "off_its_way", axis="x"):
        engine.go_to_height(from_mm - 0.05, 0.5)
    assert ("stop" in bench.stage.told, "unlock" in bench.stage.told) == (True, True)
    assert bench.height_mm == pytest.approx(at_mm[-1] + 2.0 if to_mm is None else to_mm, abs=0.01)


def test_a_slow_lift_of_a_stage_that_strayed_loses_no_heartbeat() -> None:
    """2 mm at 0.5 mm/s take 4 s, and the heartbeat 3."""
    bench = StubBench({"habits": {"travel_speed_mm_s": 0.5}})
    engine = bench.in_contact()

    def strays() -> None:
        bench.stage.at_mm[0] += 1.0

    bench.stage.at_look = strays
    with looked_after_by(bench.clock, engine.heartbeat), raises(TripError, "off_its_way", axis="x"):
        engine.go_to_height(1.9, 0.5)
    assert bench.stage.told.count("stop") == 1


@pytest.mark.parametrize(("off_mm", "strays"), [(0.0050, False), (0.0054, False), (0.0056, True)])
def test_a_reported_position_may_be_off_by_a_step_and_its_rounding(off_mm: float, strays: bool) -> None:
    """A step of 2.5 um at 400 steps/mm; 3 um more are the rounding of reports and the error of a feedback."""
    bench = StubBench()
    engine = bench.in_contact()

    def shifts() -> None:
        bench.stage.at_mm[0] = x_mm + off_mm

    x_mm = bench.stage.at_mm[0]
    bench.stage.at_look = shifts
    with raises(TripError, "off_its_way", axis="x") if strays else nullcontext():
        engine.go_to_height(engine.height_mm + 0.1, 0.5)
    assert ("stop" in bench.stage.told) is strays


# --- homing ---


@pytest.mark.parametrize(
    ("below", "shows_gwt", "code"),
    [
        (True, 0.06, "not_lifted"),
        (True, -0.06, "not_lifted"),
        (False, 0.06, None),
        (True, 0.04, None),
        (False, 250.0, "soft_trip"),
        (True, 600.0, "hard_trip"),
    ],
)
def test_a_force_that_remains_after_homing_trips_after_a_contact_or_above_a_trip(
    below: bool, shows_gwt: float, code: str | None
) -> None:
    """Else the zero has drifted."""
    bench = StubBench()
    engine = bench.in_contact() if below else bench.ready()
    bench.force.shows_gwt = shows_gwt
    with raises(TripError, code) if code else nullcontext():
        verbs.home(engine)
    assert engine.state is (State.TRIPPED if code else State.READY)
    assert engine.contact.may_touch is (below and code is not None)
    if code:
        assert bench.of("trip")[0]["force_gwt"] == pytest.approx(shows_gwt)


@pytest.mark.parametrize(("zeroed", "code"), [(True, "not_lifted"), (False, None)])
def test_a_zeroed_sensor_that_falls_silent_while_homing_trips(zeroed: bool, code: str | None) -> None:
    bench = StubBench()
    engine = bench.ready()
    if not zeroed:
        engine.sensing.zero = None
    bench.stage.at_look = lambda: setattr(bench.force, "at_read", raising(ForceTimeout("no answer")))
    if not zeroed:
        bench.stage.at_look = lambda: None
    with raises(TripError, code, contact="raised") if code else nullcontext():
        verbs.home(engine)
    assert engine.known_contact.kind == "raised"


ZEROED = ForceZero(1.0 * GWT_N, 0.02)
LEFT: dict[str, tuple[LastKnown, bool, float, bool, bool, str | None]] = {
    # what is on record, whether the run is resumed, what the sensor shows; whether it homes, alarms or trips
    "nothing": (LastKnown(), False, 9.0, False, False, None),
    "a lift": (LastKnown(contact=KnownContact("lifted")), False, 9.0, False, False, None),
    "a lift, resumed": (LastKnown(contact=KnownContact("lifted")), True, 9.0, True, False, None),
    "a lift and a zero": (LastKnown(contact=KnownContact("lifted")), False, 1.1, False, False, None),
    "a lift, and a push since": (LastKnown(contact=KnownContact("lifted")), False, 1.2, True, True, None),
    "a lift, and a pull since": (LastKnown(contact=KnownContact("lifted")), False, 0.8, True, True, None),
    "a touch": (LastKnown(contact=KnownContact("touching", 3.0)), False, 1.1, True, True, None),
    "a touch, resumed": (LastKnown(contact=KnownContact("unknown")), True, 1.1, True, True, None),
    "a touch that stays": (LastKnown(contact=KnownContact("touching", 3.0)), False, 1.2, True, True, "not_lifted"),
    "a touch and no zero": (LastKnown(contact=KnownContact("touching", 3.0)), False, 9.0, True, True, None),
}


@pytest.mark.parametrize("name", LEFT)
def test_a_run_homes_first_where_the_last_command_may_have_left_a_contact(name: str) -> None:
    """A touch is 0.12 gwt from the zero on record, by its noise; without a touch on record that may be any drift."""
    before, resumed, shows_gwt, homes, alarms, code = LEFT[name]
    if shows_gwt < 9.0:
        before = before.model_copy(update={"zero_offset_n": ZEROED.offset_n, "zero_noise_gwt": ZEROED.noise_gwt})
    bench, connected = StubBench(), list[bool]()
    bench.force.shows_gwt = shows_gwt
    bench.force.connect = lambda: (connected.append(True), "stub sensor")[1]  # type: ignore[method-assign]
    bench.force.at_read = lambda: None if connected else raising(ForceTimeout("not connected"))()
    with raises(TripError, code) if code else nullcontext():
        verbs.leave_finger(bench.engine, before, resumed=resumed)
    assert ("home" in bench.stage.told) is homes
    assert bool(bench.of("alarm")) is (alarms and code is None)
    assert bench.engine.sensing.zero is None


# --- a rest ---


def test_a_rest_polls_inputs_and_force_and_records_a_reading_each_second() -> None:
    """Not in its last fifth of a second."""
    bench = StubBench()
    engine = bench.ready()
    samples = len(bench.of("sample"))
    asked_s: list[float] = []
    engine.stop_inputs = lambda engine, *, at_rest: asked_s.append(bench.clock.monotonic_s()) if at_rest else None
    begun_s, read = bench.clock.monotonic_s(), len(bench.force.read_s)
    looks, status = list[float](), bench.stage.status
    bench.stage.status = lambda: (looks.append(bench.clock.monotonic_s()), status())[1]  # type: ignore[method-assign]
    verbs.rest(engine, 3.8)
    ended_s = bench.clock.monotonic_s()
    assert len(looks) == 3, "the stage each second"
    assert ended_s - begun_s == pytest.approx(3.8, abs=0.11)
    assert bench.of("rest") == [{"rest_s": 3.8}]
    waits_s = [b - a for a, b in itertools.pairwise([begun_s, *dict.fromkeys(asked_s)])]
    assert max(waits_s) < 0.2
    assert len(waits_s) > 20
    read_s = bench.force.read_s[read:]
    assert max(b - a for a, b in itertools.pairwise([begun_s, *read_s, ended_s])) < 0.35
    recorded = bench.of("sample")[samples:]
    assert [sample["phase"] for sample in recorded] == 3 * ["rest"]


def test_a_rest_with_a_slow_sensor_lasts_as_long_as_requested() -> None:
    bench = StubBench()
    engine = bench.ready()
    bench.force.sample_period_s = 0.5
    begun_s = bench.clock.monotonic_s()
    verbs.rest(engine, 3.8)
    assert bench.clock.monotonic_s() - begun_s == pytest.approx(3.8, abs=0.11)


def test_only_a_touch_counts_as_contact_time_in_a_rest() -> None:
    bench = StubBench()
    engine = bench.ready()
    for after_s, gwt in ((1.0, 0.3), (2.0, 0.0)):
        bench.clock.call_at(
            bench.clock.monotonic_s() + after_s, lambda gwt=gwt: setattr(bench.force, "shows_gwt", gwt)
        )
    verbs.rest(engine, 6.0)
    assert engine.contact_time.total_s == pytest.approx(1.0, abs=0.2)


def test_a_finger_that_touches_for_too_long_in_a_rest_is_lifted_off() -> None:
    """The indentor goes up to habits.park_height_mm."""
    bench = StubBench({"limits": {"max_contact_s": 2.0}})
    engine = bench.ready()
    bench.clock.call_at(bench.clock.monotonic_s() + 1.0, lambda: setattr(bench.force, "shows_gwt", 1.0))
    with raises(LimitError, "contact_time", limit_s=2.0):
        verbs.rest(engine, 60.0)
    assert bench.height_mm == pytest.approx(10.0)


# --- places and zeros ---


def test_a_move_to_a_position_ends_exactly_at_clearance() -> None:
    bench = StubBench()
    engine = bench.ready()
    engine.go_to_height(2.015, 0.5)
    verbs.move_to(engine, 1.0)
    assert bench.of("move")[-1] == {"x_mm": 1.0, "along_mm": 0.0, "height_mm": pytest.approx(2.0)}


@pytest.mark.parametrize(("height_mm", "fast"), [(9.97, False), (9.985, True), (10.0, True), (12.0, True)])
def test_from_the_park_height_up_a_move_sideways_has_travel_speed(height_mm: float, fast: bool) -> None:
    bench = StubBench(stiffness=FingerStiffness(1000.0))
    engine = bench.ready()
    engine.go_to_height(height_mm, 2.0)
    verbs.go_sideways(engine, 0.5, 0.0)
    assert (bench.stage.told[-1][3] == bench.settings.habits.travel_speed_mm_s) is fast


def test_above_a_stiffer_finger_a_move_sideways_is_slower() -> None:
    speeds_mm_s = []
    for stiffness in (None, FingerStiffness(1000.0)):
        bench = StubBench(stiffness=stiffness)
        verbs.move_to(bench.ready(), 3.0)
        speeds_mm_s.append(bench.stage.told[-1][3])
    assert speeds_mm_s[1] < 0.5 * speeds_mm_s[0]


@pytest.mark.parametrize(
    ("since_s", "drifts_gwt_s", "measured_at_rest"), [(0.3, 0.0, False), (1.5, 0.0, True), (1.5, 0.4, True)]
)
def test_a_move_sideways_begins_only_on_a_lift_measured_within_a_second(
    since_s: float, drifts_gwt_s: float, measured_at_rest: bool
) -> None:
    """After a second two readings at rest must agree again: one of a touch may pass through zero."""
    bench = StubBench()
    engine = bench.ready()
    engine.measure_contact()
    bench.clock.wait_s(since_s)
    begun_s, measured = bench.clock.monotonic_s(), list[float]()
    bench.force.at_read = lambda: setattr(
        bench.force, "shows_gwt", drifts_gwt_s * (bench.clock.monotonic_s() - begun_s)
    )
    engine.memory = KeptMemory(touched=lambda known: measured.append(bench.stage.at_mm[0]))
    x_mm, slips = bench.stage.at_mm[0], measured_at_rest and drifts_gwt_s > 0
    with raises(TripError, "not_lifted") if slips else nullcontext():
        verbs.go_sideways(engine, 0.02, 0.0)
    assert (x_mm in measured) is measured_at_rest
    assert (bench.stage.at_mm[0] == x_mm) is slips


@pytest.mark.parametrize("called_each_s", [0.01, 0.3, 2.0])
def test_a_wait_polls_inputs_and_force_every_tenth_of_a_second_and_the_stage_every_second(
    called_each_s: float,
) -> None:
    """However often it is called; not all that it asks goes into the journal."""
    bench = StubBench()
    engine, inputs = bench.ready(), list[float]()
    engine.stop_inputs = lambda engine, *, at_rest: inputs.append(bench.clock.monotonic_s())
    stage, status = list[float](), bench.stage.status
    bench.stage.status = lambda: (stage.append(bench.clock.monotonic_s()), status())[1]  # type: ignore[method-assign]
    bench.force.read_s.clear()
    look, until_s = verbs.LooksAtClearance(engine, bench.clock), bench.clock.monotonic_s() + 10.0
    while bench.clock.monotonic_s() < until_s:
        look()
        bench.clock.wait_s(called_each_s)
    for times, interval_s in ((bench.force.read_s, 0.1), (stage, 1.0), (inputs, 0.1)):
        gaps = [b - a for a, b in itertools.pairwise(times)]
        assert min(gaps) >= interval_s - 1e-9 or times is inputs, "a reading asks them, too"
        assert max(gaps) <= max(interval_s, called_each_s) + 0.2
    recorded = [sample for sample in bench.of("sample") if sample["phase"] == "rest"]
    assert len(recorded) == pytest.approx(len(stage), abs=1)


@pytest.mark.parametrize(("gwt", "below_mm", "code"), [(0.06, 8.2, True), (-0.06, 8.2, True), (0.04, 8.2, False)])
def test_the_descent_to_clearance_is_slow_and_ends_at_a_push_or_a_pull(
    gwt: float, below_mm: float, code: bool
) -> None:
    bench = StubBench()
    verbs.mount(bench.engine, "bar:3.0")
    verbs.home(bench.engine)
    verbs.zero(bench.engine)
    bench.stage.told.clear()
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", gwt if bench.height_mm < below_mm else 0.0)
    with raises(TripError, "touch_at_clearance") if code else nullcontext():
        verbs.move_to(bench.engine, 1.0)
    down = next(told for told in bench.stage.told if told[2] < bench.settings.frame.apex_z_mm + 20.0)
    assert down[3] == bench.settings.habits.descent_speed_mm_s
    assert down[2] - bench.settings.frame.apex_z_mm == pytest.approx(2.0)
    assert ("halt" in bench.stage.told) is code
    assert bench.engine.placed is not code


@pytest.mark.timeout(60)
def test_a_move_sideways_of_a_shaking_stage_ends_at_its_target() -> None:
    bench = StubBench()
    engine = bench.ready()
    looked = list[bool]()
    bench.stage.at_look = lambda: looked.append(True)

    def read() -> None:
        bench.force.shows_gwt = 0.06 * bool(looked)
        looked.clear()

    bench.force.at_read = read
    verbs.move_to(engine, 3.0)
    assert engine.x_mm == 3.0


@pytest.mark.parametrize(("from_mm", "to_mm"), [((0.0, 0.0), (3.0, 0.0)), ((-2.0, 1.5), (2.0, -1.5))])
def test_a_shaking_stage_moves_sideways_straight_and_by_steps_within_the_drag_limit(
    from_mm: tuple[float, float], to_mm: tuple[float, float]
) -> None:
    """The sensor shows a touch whenever the stage moves, and none at rest."""
    bench = StubBench()
    engine = bench.ready()
    verbs.move_to(engine, *from_mm)
    limit, _ = verbs.guarded_sideways(engine)
    shaking, rests_mm, was_mm = list[bool](), list[tuple[float, float]](), list[list[float]]()

    def look() -> None:
        if bench.stage.at_mm not in was_mm[-1:]:
            shaking.append(True)
        was_mm.append(list(bench.stage.at_mm))

    bench.stage.at_look = look

    def read() -> None:
        if not shaking:
            rests_mm.append((engine.x_mm, engine.along_mm))
        bench.force.shows_gwt = 0.06 * bool(shaking)
        shaking.clear()

    bench.force.at_read = read
    verbs.move_to(engine, *to_mm)
    assert (engine.x_mm, engine.along_mm) == to_mm
    steps_mm = [math.dist(a, b) for a, b in itertools.pairwise(dict.fromkeys([from_mm, *rests_mm]))]
    looks_mm = limit.speed_mm_s * 0.1
    assert len(steps_mm) <= 2 * (math.dist(from_mm, to_mm) / limit.in_contact_mm + 1)
    assert max(steps_mm) <= limit.in_contact_mm + looks_mm
    for at_mm in rests_mm:
        assert math.dist(from_mm, at_mm) + math.dist(at_mm, to_mm) == pytest.approx(math.dist(from_mm, to_mm))


@pytest.mark.parametrize("height_mm", [3.0, 12.0])
@pytest.mark.parametrize("most_mm_s", [0.1, math.inf])
def test_after_the_first_touch_a_move_sideways_has_the_guarded_speed_or_the_lower_one_chosen(
    height_mm: float, most_mm_s: float
) -> None:
    """From the park height on, too, where it had the speed of travel; the touch vanishes at rest."""
    bench = StubBench()
    engine = bench.ready()
    engine.lift(height_mm)
    limit, _ = verbs.guarded_sideways(engine)
    touches = [0.06]  # of the first reading on the way
    looked = list[bool]()
    bench.stage.at_look = lambda: looked.append(True)
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", touches.pop(0) if looked and touches else 0.0)
    bench.stage.told.clear()
    verbs.go_sideways(engine, 1.0, 0.0, most_mm_s)
    speeds_mm_s = [told[3] for told in bench.stage.told if told != "halt"]
    travel_mm_s = bench.settings.habits.travel_speed_mm_s
    assert "halt" in bench.stage.told
    assert speeds_mm_s[0] == min(travel_mm_s if height_mm > 10.0 else limit.speed_mm_s, most_mm_s)
    assert speeds_mm_s[1:] == [min(limit.speed_mm_s, most_mm_s)] * (len(speeds_mm_s) - 1)
    assert engine.x_mm == pytest.approx(1.0)


@pytest.mark.parametrize("from_mm", [2.0, 5.0, 24.8, 25.0])
def test_a_zero_lifts_by_its_lift_and_comes_back_to_where_it_began(from_mm: float) -> None:
    """At the top of the travel it first makes room."""
    bench = StubBench()
    engine = bench.ready()
    top_mm = -bench.settings.frame.apex_z_mm
    engine.lift(min(from_mm, top_mm))
    bench.stage.told.clear()
    verbs.zero(engine)
    heights_mm = [told[2] + top_mm for told in bench.stage.told]
    if from_mm <= top_mm - ZERO_LIFT_MM:
        assert heights_mm == pytest.approx([from_mm + ZERO_LIFT_MM, from_mm])
    else:
        assert heights_mm == pytest.approx([top_mm - ZERO_LIFT_MM, top_mm, from_mm][: 2 + (from_mm < top_mm)])
    assert engine.height_mm == pytest.approx(from_mm)


def test_before_the_first_zero_no_position_is_reported_as_lifted() -> None:
    """Forces count from readings at the place before: a change is no force."""
    bench, kept = StubBench(), KeptMemory()
    verbs.home(bench.engine)
    bench.engine.memory = kept
    verbs.move_to(bench.engine, 1.0)
    assert bench.engine.known_contact.kind == "raised"
    assert not [known for known in kept.contacts if known.kind == "lifted"]
    assert not bench.of("sample")


def test_a_zero_journals_the_reading_in_the_air() -> None:
    bench = StubBench()
    bench.force.shows_gwt = 7.0
    bench.ready()
    (zero,) = bench.of("zero")
    assert zero == {"sensor": "stub sensor", "noise_gwt": 0.0, "offset_gwt": pytest.approx(7.0), "drift_gwt": None}


@pytest.mark.parametrize("kind", [TripError, LimitError])
@pytest.mark.parametrize(("change_gwt", "touched"), [(0.0499, False), (0.05, True), (-0.0499, False), (-0.05, True)])
def test_a_zero_whose_lift_changes_the_force_by_a_touch_is_refused(
    kind: type[RigError], change_gwt: float, touched: bool
) -> None:
    """In a run by a trip, under manual control as a limit."""
    found = verbs.zero_in_contact_error(kind, StubBench().engine.sensing, [change_gwt] * 6)
    assert (found is not None) is touched
    assert found is None or (type(found), found.code) == (kind, "zero_in_contact")


def test_the_noise_of_a_zero_in_which_a_finger_pressed_does_not_hide_the_change_after_its_lift() -> None:
    """The scatter of the zero is that of the finger; in the air there is none."""
    sensing = StubBench().engine.sensing
    sensing.take_zero([0.0, 0.05, 0.1, 0.13, 0.1, 0.05])
    assert sensing.touch_gwt > 0.2
    found = verbs.zero_in_contact_error(LimitError, sensing, [-0.07] * 6)
    assert found is not None
    assert found.code == "zero_in_contact"
    assert verbs.zero_in_contact_error(LimitError, sensing, [-0.14, 0.1, -0.2, 0.05, -0.1, -0.13]) is None


@pytest.mark.parametrize(("noise_gwt", "refused"), [(0.1, False), (0.1001, True)])
def test_a_zero_whose_readings_scatter_by_more_than_ten_steps_is_refused(noise_gwt: float, refused: bool) -> None:
    found = verbs.zero_noise_error(LimitError, StubBench().engine.sensing, ForceZero(0.0, noise_gwt))
    assert (found is not None) is refused
    assert found is None or (type(found), found.code) == (LimitError, "zero_scatters")


# --- on a board and a balance ---

Make = Callable[..., Any]


def test_a_position_outside_the_lateral_limits_is_refused(spring: Make) -> None:
    """limits.x_mm is ± 6, limits.along_mm ± 4."""
    bench = spring()
    engine = bench.ready()
    before = len(bench.moves())
    for x_mm, along_mm in ((-6.01, 0.0), (6.01, 0.0), (math.nan, 0.0), (math.inf, 0.0), (0.0, -4.01), (0.0, 4.01)):
        with raises(LimitError, "outside_limits"):
            verbs.move_to(engine, x_mm, along_mm)
    assert len(bench.moves()) == before
    assert engine.state is State.READY


def test_homing_resets_state_position_contacts_and_depth_limit() -> None:
    """However long ago the engine said anything; contacts, place and limit of depth are those of before."""
    bench = StubBench()
    engine = bench.in_contact()
    engine.touched.at(0.0, 0.0, TouchedPlace(ContactFit(0.05, -0.32, 0.05, -0.3, 3), reached=(0.8, 4.0)))
    bench.clock.wait_s(10.0)
    bench.stage.floors_mm.clear()
    verbs.home(engine)
    assert (engine.state, engine.placed, engine.touched.place_at(0.0, 0.0)) == (State.READY, False, None)
    limits, apex_mm = bench.settings.limits, bench.settings.frame.apex_z_mm
    assert bench.stage.floors_mm == [round(apex_mm - limits.search_mm - limits.max_doi_mm, 6)]
    assert bench.of("home")[-1]["contact"] == "lifted"
    assert not engine.heartbeat.lost


def test_a_trip_at_rest_that_does_not_lift_records_a_possible_contact() -> None:
    """Contact was measured just before: a finger came up since."""
    bench = StubBench({"limits": {"on_trip": "stop"}})
    engine, kept = bench.ready(), KeptMemory()
    engine.memory = kept
    engine.measure_contact()
    bench.force.shows_gwt = 600.0
    with raises(TripError, "hard_trip"):
        engine.reading()
    assert kept.contacts[-1].may_touch


def test_without_a_zero_a_motion_down_trips_before_it_begins_where_the_sensor_does_not_answer() -> None:
    bench = StubBench()
    engine = bench.ready()
    engine.sensing.zero, bench.force.at_read = None, raising(ForceTimeout("the stub sensor does not answer"))
    bench.stage.told.clear()
    with raises(TripError, "no_reading"):
        engine.go_to_height(1.98, 0.5)
    assert engine.state is State.TRIPPED
    assert all(told[2] >= bench.stage.at_mm[2] for told in bench.stage.told if isinstance(told, tuple))


def test_the_force_of_a_hand_during_a_mount_neither_trips_nor_lifts() -> None:
    bench = StubBench()
    engine = bench.ready()
    height_mm = bench.height_mm

    def mount(indentor: str, meanwhile: Callable[[], None]) -> str:
        bench.force.shows_gwt = 300.0
        for _ in range(30):
            meanwhile()
            bench.clock.wait_s(0.1)
        bench.force.shows_gwt = 0.0
        return indentor

    bench.mount = mount  # type: ignore[method-assign, assignment]
    verbs.mount(engine, "bar:3.0")
    assert (engine.state, bench.height_mm) == (State.READY, height_mm)


def test_a_lift_stays_confirmed_through_a_long_move_that_reads_no_touch() -> None:
    bench = StubBench()
    engine = bench.ready()
    begun_s = bench.clock.monotonic_s()
    verbs.go_sideways(engine, 5.0, 0.0, 1.0)
    assert bench.clock.monotonic_s() - begun_s > 2.0
    assert engine.is_lifted


# --- what is polled, and what is on record ---


@pytest.mark.parametrize(("sample_s", "fast_s"), [(0.02, 0.02), (0.05, 0.05), (0.5, LOOK_S)])
def test_a_motion_that_a_touch_ends_is_polled_with_each_sample_and_an_increment_at_each_look(
    sample_s: float, fast_s: float
) -> None:
    bench = StubBench()
    engine = bench.ready()
    bench.force.sample_period_s = sample_s  # type: ignore[misc]
    polled_s, moving = list[float](), bench.stage.moving

    def spied(*, look_s: float = LOOK_S, **told: Any) -> Any:
        polled_s.append(look_s)
        return moving(look_s=look_s, **told)

    bench.stage.moving = spied  # type: ignore[method-assign]
    for act, expected_s in (
        (lambda: engine.go_to_height(1.95, 0.5), LOOK_S),
        (lambda: verbs.retract(engine), LOOK_S),
        (lambda: verbs.move_to(engine, 1.0), fast_s),
    ):
        polled_s.clear()
        act()
        assert set(polled_s) == {expected_s}


@pytest.mark.parametrize("zeroed", [True, False])
def test_every_reading_on_record_has_its_place_depth_force_stability_and_contact_time(zeroed: bool) -> None:
    """At rest, in a wait and in a motion that trips."""
    bench = StubBench()
    engine = bench.ready()
    verbs.move_to(engine, 0.5)
    engine.go_to_height(1.95, 0.5)
    bench.force.shows_gwt, bench.force.stable = 0.5, False
    engine.read_force_gwt(PressId(3), "press", contact_height_mm=2.25)
    bench.clock.wait_s(2.0)
    bench.force.shows_gwt, bench.force.stable = 0.25, True
    engine.read_force_gwt(PressId(4, "reference"), "hold")
    first, second = bench.of("sample")[-1], bench.of("reference_sample")[-1]
    assert first == {
        "index": 3, "phase": "press", "x_mm": 0.5, "height_mm": 1.95, "doi_mm": 0.3, "force_gwt": 0.5,
        "stable": False, "contact_s": 0.0,
    }  # fmt: skip
    contact_s = second.pop("contact_s")
    assert second == {
        "index": 4, "phase": "hold", "x_mm": 0.5, "height_mm": 1.95, "doi_mm": None, "force_gwt": 0.25,
        "stable": True,
    }  # fmt: skip
    assert 2.0 <= contact_s <= 2.5
    bench.force.shows_gwt = 0.0
    verbs.retract(engine)
    ended = bench.of("retract")[-1]
    assert (ended["height_mm"], ended["contact"], ended["force_gwt"]) == (2.0, "lifted", 0.0)
    assert ended["contact_s"] >= contact_s
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", 300.0 if bench.stage.at_mm[0] > -29.0 else 0.0)
    if not zeroed:
        engine.sensing.zero = None
    with raises(TripError, "soft_trip"):
        verbs.move_to(engine, 3.0)
    last, trip = bench.of("sample")[-1], bench.of("trip")[-1]
    assert (last["phase"], last["force_gwt"], last["height_mm"]) == ("moving", 300.0, 2.0)
    assert 1.0 < last["x_mm"] < 1.6
    assert trip["force_gwt"] == 300.0
    assert trip["contact_s"] >= contact_s


def test_a_reading_where_the_position_is_unknown_is_recorded_without_one() -> None:
    bench = StubBench()
    engine = bench.engine
    engine.sensing.connect()
    engine.read_force_gwt(NO_PRESS, "moving")
    assert [(e["x_mm"], e["height_mm"]) for e in bench.of("sample")] == [(None, None)]
    with raises(TripError, "for_the_test"):
        engine.trip(TripError("for the test", "for_the_test"))
    engine.record(engine.after_lift())
    assert [e["height_mm"] for e in bench.of("retract")] == [None] * len(bench.of("retract"))
