"""What a script may ask besides pressing: readings at a zero, the way down, places, rests, pauses, notes."""

import math
from collections.abc import Callable
from contextlib import nullcontext
from itertools import pairwise
from typing import Any

import pytest

from rig.devices.base import ForceError
from rig.engine import Engine, NotReadyError, Pause, RunAborted, TripError, verbs
from rig.engine.engine import State
from rig.engine.sensing import ForceZero
from rig.settings import RigSettings
from rig.transport import TransportError
from rig.units import GWT_N
from tests.error_codes import causes, raises
from tests.stub_bench import KeptMemory

Make = Callable[..., Any]


def _heights(bench: Any) -> list[float]:
    """Where each vertical move went, mm above the apex."""
    apex = bench.settings.frame.apex_z_mm
    return [round(move["Z"] - apex, 6) for move in bench.moves() if "Z" in move]


def _homed(spring: Make, **options: Any) -> Any:
    bench = spring(**options)
    verbs.mount(bench.engine, "bar:3.0")
    verbs.home(bench.engine)
    return bench


def _feels(bench: Any, gwt: float, below_mm: float = math.inf) -> None:
    """From now on, and below a height, the sensor shows so much."""
    bench.force_n = lambda t_s: gwt * GWT_N if bench.height_mm < below_mm else 0.0


def _shakes(bench: Any, gwt: float) -> None:
    """From now on the sensor shows so much whenever the stage moves."""

    def force_n(t_s: float) -> float:
        moved = bench.board.carriage_steps_at(t_s) != bench.board.carriage_steps_at(t_s - 0.005)
        return gwt * GWT_N if moved else 0.0

    bench.force_n = force_n


# --- zero ---


def test_a_zero_is_read_once_the_sensor_has_settled(spring: Make) -> None:
    """What it showed before the wait of force.latency_s is not taken for the zero."""
    bench = _homed(spring, settings=RigSettings.model_validate({"force": {"latency_s": 1.5}}))
    asked = len(bench.sent("force"))
    start_s = bench.clock.monotonic_s()
    verbs.zero(bench.engine)
    zeroing_s = next(t_s for t_s, data in bench.sent("force")[asked:] if data.startswith(b"Z"))
    assert zeroing_s - start_s >= 1.5


def test_a_zero_is_recorded_for_the_next_command_at_once(spring: Make) -> None:
    """So that also after kill -9 no force counts from the zero before; without readings after it there is none."""
    bench = _homed(spring)
    engine, left = bench.engine, list[ForceZero | None]()
    engine.memory = KeptMemory(zeros=left)
    verbs.zero(engine)
    assert left == [None, engine.sensing.zero]
    assert (engine.known_contact.kind, engine.known_contact.force_gwt) == ("lifted", 0.0)
    assert engine.sensing.zero is not None
    zero = engine.sensing.sensor.zero

    def falls_silent() -> None:
        zero()
        bench.balance.mute = True

    engine.sensing.sensor.zero = falls_silent  # type: ignore[method-assign]
    with pytest.raises(TripError):
        verbs.zero(engine)
    assert (left[-1], engine.sensing.zero) == (None, None)
    assert engine.known_contact.kind == "raised"


@pytest.mark.parametrize("drift_gwt", [-0.04, -0.03, 0.03, 0.04])
def test_a_zero_drift_beyond_the_band_alarms_in_either_direction(spring: Make, drift_gwt: float) -> None:
    """limits.zero_drift_gwt is 0.03."""
    bench = spring(settings=RigSettings.model_validate({"limits": {"on_alarm": "trip"}}))
    bench.ready()
    _feels(bench, drift_gwt)
    drifted = raises(TripError, "zero_drift", drift_gwt=pytest.approx(drift_gwt, abs=1e-6), band_gwt=0.03)
    with drifted if abs(drift_gwt) > 0.03 else nullcontext():
        verbs.zero(bench.engine)
    assert bench.of("zero")[1]["drift_gwt"] == pytest.approx(drift_gwt, abs=1e-6)
    assert len(bench.of("alarm")) == (abs(drift_gwt) > 0.03)


@pytest.mark.parametrize(
    ("habits", "from_mm", "heights_mm"),
    [
        ({}, 2.0, [10.0, 10.3, 2.0]),
        ({}, 10.0, [10.3, 10.0]),
        ({}, 12.0, [12.3, 12.0]),
        ({"park_height_mm": 35.0}, 2.0, [25.0, 24.7, 25.0, 2.0]),
    ],
)
def test_a_zero_drift_as_large_as_a_touch_is_measured_again_at_park_height(
    spring: Make, habits: dict[str, float], from_mm: float, heights_mm: list[float]
) -> None:
    """And zeroed there: the stage goes up to habits.park_height_mm, at most as high as it can, and slowly back.

    From there or higher only the lift after the zero moves it.
    """
    bench = spring(settings=RigSettings.model_validate({"habits": habits}))
    engine = bench.ready()
    engine.lift(from_mm)
    _feels(bench, 0.3)
    before = len(_heights(bench))
    verbs.zero(engine)
    assert _heights(bench)[before:] == heights_mm
    assert bench.of("zero")[-1]["drift_gwt"] == pytest.approx(0.3)
    verbs.move_to(engine, 1.0)
    assert engine.x_mm == 1.0


@pytest.mark.parametrize("above_mm", [0.05, 0.5, 1.5])
def test_the_zero_verb_never_hides_a_finger_that_came_up(spring: Make, above_mm: float) -> None:
    """A zero in that touch would hide as much of every later force. On the way back down it trips."""
    bench = spring(contact_mm=-0.3)
    engine = bench.ready()
    bench.contact_mm = 2.0 + above_mm
    with raises(TripError, "touch_at_clearance"):
        verbs.zero(engine)
    assert bench.of("zero")[-1]["drift_gwt"] == pytest.approx(0.0, abs=1e-6), "measured in the air"
    assert engine.known_contact.kind == "lifted"
    assert abs(engine.sensing.settled().force_n) < 0.01 * GWT_N


# --- home ---


def test_homing_is_refused_without_a_sensor(spring: Make) -> None:
    bench = spring()
    bench.balance.mute = True
    with pytest.raises(ForceError):
        verbs.home(bench.engine)
    assert not any(b"$H" in data for _, data in bench.sent("stage"))


def test_with_a_sensor_beyond_its_range_homing_is_allowed_and_a_descent_is_not(spring: Make) -> None:
    """And nothing else: the way down is refused."""
    bench = spring()
    bench.force_n = lambda t_s: 1e6 * GWT_N
    verbs.home(bench.engine)
    assert bench.engine.state is State.READY
    with raises(TripError, "no_reading") as tripped:
        verbs.move_to(bench.engine, 0.0)
    assert "overload" in causes(tripped.value)


@pytest.mark.parametrize("mounted", ["step:3", "bar:3.0"])
def test_mounting_another_indentor_than_requested_is_refused(
    spring: Make, monkeypatch: pytest.MonkeyPatch, mounted: str
) -> None:
    bench = spring()
    engine = bench.ready()
    monkeypatch.setattr(bench, "mount", lambda indentor, meanwhile: mounted)
    with raises(NotReadyError, "wrong_indentor", mounted=mounted, indentor="step:1"):
        verbs.mount(engine, "step:1")
    assert engine.indentor is None
    assert len(bench.of("mount")) == 1


def test_a_board_slow_to_home_does_not_lose_the_heartbeat(spring: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """limits.heartbeat_s is 3: a board that takes 10 s to answer, with the finger below, is waited for."""
    bench = spring()
    engine = bench.ready()
    engine.go_to_height(1.96, 0.5)
    connect = bench.stage.connect

    def slow() -> str:
        bench.clock.wait_s(10.0)
        return str(connect())

    monkeypatch.setattr(bench.stage, "connect", slow)
    verbs.home(engine)
    assert engine.state is State.READY
    assert not engine.heartbeat.lost


# --- move_to and the way down ---


def test_after_homing_the_descent_is_one_move_at_the_descent_speed(spring: Make) -> None:
    bench = _homed(spring, settings=RigSettings.model_validate({"habits": {"descent_speed_mm_s": 0.7}}))
    verbs.zero(bench.engine)
    before = len(_heights(bench))
    verbs.move_to(bench.engine, 0.0)
    assert [move["F"] for move in bench.moves() if "Z" in move][before:] == [pytest.approx(60 * 0.7)]
    assert _heights(bench)[before:] == [2.0]
    assert len(bench.of("sample")) == 1  # at clearance; those on the way are looked at only


@pytest.mark.parametrize("k_gwt", [6.0, 60.0])
@pytest.mark.parametrize("weight_gwt", [0.0, 30.0])
def test_before_the_first_zero_a_touch_ends_the_descent(spring: Make, k_gwt: float, weight_gwt: float) -> None:
    """The finger lies 1.5 mm above clearance; the sensor shows the weight of the indentor."""
    bench = _homed(spring, k_gwt=k_gwt, contact_mm=3.5)
    truth_n, worst_gwt = bench.force_n, 0.0
    bench.force_n = lambda t_s: truth_n(t_s) + weight_gwt * GWT_N

    def sample() -> None:
        nonlocal worst_gwt
        worst_gwt = max(worst_gwt, truth_n(bench.clock.monotonic_s()) / GWT_N)
        bench.clock.call_at(bench.clock.monotonic_s() + 0.002, sample)

    sample()
    with raises(TripError, "touch_at_clearance"):
        verbs.move_to(bench.engine, 0.0)
    assert worst_gwt < k_gwt * 0.35**1.5, "v · (a look, a reading, the stop) at 0.8 mm/s"
    assert bench.engine.sensing.zero is None, "readings before the descent are no zero for the next command"


def test_no_move_sideways_begins_at_a_finger_that_came_up(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    verbs.rest(engine, 3.0)
    bench.contact_mm = 2.2
    with raises(TripError, "touch_at_clearance", height_mm=2.0):
        verbs.move_to(engine, 1.0)
    assert not [move for move in bench.moves()[-1:] if "X" in move]
    assert bench.true_pose()[0] == pytest.approx(0.0, abs=1e-6)


def test_a_force_in_motion_that_vanishes_at_rest_is_passed_in_descent_steps(spring: Make) -> None:
    """A cell that shows a touch whenever the stage moves, and none at rest: one habits.descent_step_mm at a time."""
    habits = {"descent_step_mm": 0.7, "clearance_mm": 2.0}
    bench = _homed(spring, settings=RigSettings.model_validate({"habits": habits}))
    verbs.zero(bench.engine)
    _shakes(bench, 0.06)
    before = len(_heights(bench))
    verbs.move_to(bench.engine, 0.0)
    assert bench.engine.height_mm == 2.0
    stops = [height for height in _heights(bench)[before:] if height > 2.0]
    assert all(upper - lower >= 0.7 - 1e-9 for upper, lower in pairwise(stops))
    assert len(stops) > 10


def test_a_touch_at_rest_after_a_descent_step_ends_the_descent(spring: Make) -> None:
    """Felt at rest where the step ends, which is farther down than the shake was felt."""
    habits = {"descent_step_mm": 0.7, "clearance_mm": 2.0}
    bench = _homed(spring, settings=RigSettings.model_validate({"habits": habits}))
    verbs.zero(bench.engine)
    _shakes(bench, 0.06)
    shaken, from_mm, before = bench.force_n, bench.height_mm, len(_heights(bench))
    bench.force_n = lambda t_s: shaken(t_s) if from_mm - bench.height_mm < 0.7 else 0.1 * GWT_N
    with raises(TripError, "touch_at_clearance", force_gwt=pytest.approx(0.1, abs=1e-6)):
        verbs.move_to(bench.engine, 0.0)
    _, stepped_mm, lifted_mm = _heights(bench)[before:]
    assert lifted_mm > stepped_mm > 20.0


@pytest.mark.parametrize(("gwt", "below_mm"), [(0.06, 8.2), (-0.06, 8.2), (0.4, 2.2)])
def test_a_force_above_clearance_ends_the_descent(spring: Make, gwt: float, below_mm: float) -> None:
    """habits.touch_force_gwt is 0.05: where that is felt, push or pull, is no air; it goes on by 0.1 mm."""
    bench = _homed(spring)
    verbs.zero(bench.engine)
    _feels(bench, gwt, below_mm)
    felt = {"force_gwt": pytest.approx(gwt, abs=1e-6), "height_mm": pytest.approx(below_mm, abs=0.1)}
    with raises(TripError, "touch_at_clearance", **felt):
        verbs.move_to(bench.engine, 0.0)
    assert bench.of("trip")[0]["force_gwt"] == pytest.approx(gwt, abs=1e-6)
    assert not bench.engine.placed


# --- rests, pauses, notes ---


def test_a_pause_during_a_rest_takes_effect_at_once(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    start_s = bench.clock.monotonic_s()
    asked: list[bool] = []
    bench.clock.call_at(start_s + 3.0, lambda: asked.append(True))
    bench.interrupt = lambda: bool(asked)
    with raises(RunAborted, "stopped_at_a_safe_point"):
        verbs.rest(engine, 600.0)
    assert bench.clock.monotonic_s() - start_s == pytest.approx(3.0, abs=0.1)
    assert bench.of("paused") == [{"reason": "operator"}]
    assert bench.of("rest") == []


@pytest.mark.parametrize("lost", ["stage", "force", "neither"])
def test_a_device_lost_during_a_rest_is_detected_at_the_next_poll(spring: Make, lost: str) -> None:
    """Every second; then nothing moves if the stage is lost."""
    bench = spring()
    engine = bench.ready()
    at_s = bench.clock.monotonic_s() + 10.3
    if lost == "stage":
        bench.clock.call_at(at_s, bench.stage.close)
    elif lost == "force":
        bench.clock.call_at(at_s, lambda: setattr(bench.balance, "mute", True))
    error: Any = {"stage": TransportError, "force": TripError}.get(lost)
    with pytest.raises(error) if error else nullcontext():
        verbs.rest(engine, 600.0)
    if error:
        assert 0.0 < bench.clock.monotonic_s() - at_s < verbs.REST_LOOK_S + 5.0
        assert bench.of("rest") == []


def test_a_stop_input_pressed_briefly_during_a_rest_trips(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    from_s = bench.clock.monotonic_s() + 10.3

    def pressed(engine: Engine, *, at_rest: bool) -> TripError | None:
        now = from_s <= bench.clock.monotonic_s() < from_s + 0.15
        return TripError("pressed", "hardware_trip") if now else None

    engine.stop_inputs = pressed
    with raises(TripError, "hardware_trip"):
        verbs.rest(engine, 600.0)


@pytest.mark.parametrize("wait", ["pause", "mount"])
def test_the_stop_button_of_the_participant_acts_during_a_pause_or_a_mount(spring: Make, wait: str) -> None:
    """However short it is pressed; a force from the hand that works there neither trips nor lifts."""
    bench = spring()
    engine = bench.ready()
    from_s = bench.clock.monotonic_s() + 10.3

    def pressed(engine: Engine, *, at_rest: bool) -> TripError | None:
        if from_s <= bench.clock.monotonic_s() < from_s + 0.15:
            raise RunAborted("pressed", "stop_button")
        return TripError("by the relay", "hardware_trip")

    def waits(meanwhile: Callable[[], object]) -> bool:
        for _ in range(600):
            meanwhile()
            bench.clock.wait_s(0.05)
        return True

    engine.stop_inputs = pressed
    bench.pause = Pause(lambda: True, waits)
    bench.mount = lambda indentor, meanwhile: indentor if waits(meanwhile) else ""  # type: ignore[method-assign]
    height_mm = engine.height_mm
    with raises(RunAborted, "stop_button"):
        verbs.safe_point(engine) if wait == "pause" else verbs.mount(engine, "bar:3.0")
    assert bench.clock.monotonic_s() - from_s < 0.15
    assert engine.height_mm == height_mm
