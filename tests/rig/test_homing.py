"""Rules of homing monitored by force, over a stub stage and a stub sensor: first steps, growth, its cause."""

import math
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest

from rig.bench.virtual import looked_after_by
from rig.devices.base import ForceBusy, ForceError, ForceOverload, StageAlarm, StageError, StageRejected, StageStatus
from rig.engine import TripError, verbs
from rig.engine.engine import State
from rig.engine.homing import STEP_MM, STEPS
from rig.engine.sensing import ForceZero
from tests.error_codes import printed, raises
from tests.stub_bench import StubBench, raising

FROM_MM = -20.0
"""Where the stage stands before homing; its switch is at −1 mm, 1.9 s away."""
Force = Callable[[float], float]


def _bench(force_gwt: Force = lambda up_mm: 0.0, *, zeroed: bool = True, **limits: float) -> StubBench:
    """A bench whose force (gwt) follows from the distance above its start (mm)."""
    bench = StubBench({"limits": limits})
    bench.stage.at_mm[2], bench.stage.homing_s = FROM_MM, 1.9
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", force_gwt(bench.stage.at_mm[2] - FROM_MM))
    if zeroed:
        bench.engine.sensing.zero = ForceZero(0.0, 0.0)
    return bench


def _jogs_mm(bench: StubBench) -> list[float]:
    return [told[2] for told in bench.stage.told if told[0] == "jog"]


def _homings(bench: StubBench) -> int:
    return bench.stage.told.count("home")


def _causes(bench: StubBench) -> list[str]:
    return [data["reason"] for data in bench.of("alarm")]


# --- first steps ---


@pytest.mark.parametrize("zeroed", [True, False])
def test_homing_begins_with_steps_up_and_a_reading_after_each(zeroed: bool) -> None:
    bench = _bench(zeroed=zeroed)
    verbs.home(bench.engine)
    assert bench.stage.told == [("jog", "z", STEP_MM)] * STEPS + ["home"]
    assert bench.engine.state is State.READY
    assert _causes(bench) == []


@pytest.mark.parametrize("zeroed", [True, False])
@pytest.mark.parametrize("before_gwt", [0.0, 10.0])
def test_force_that_grows_in_a_first_step_is_taken_back_and_trips(before_gwt: float, zeroed: bool) -> None:
    """The axis goes down where it should go up: the third step touches, or presses more."""
    bench = _bench(lambda up_mm: before_gwt + 4.0 * max(up_mm - 0.13, 0.0), zeroed=zeroed)
    with raises(TripError, "homing_wrong_way"):
        verbs.home(bench.engine)
    assert _homings(bench) == 0
    assert _jogs_mm(bench)[:5] == [STEP_MM] * 3 + [STEP_MM, -STEP_MM]
    assert bench.stage.at_mm[2] == pytest.approx(FROM_MM + (2 * STEP_MM if before_gwt == 0 or not zeroed else 0.0))
    assert bench.engine.state is State.TRIPPED
    assert bench.engine.known_contact.height_mm is None


def test_first_steps_end_where_a_finger_comes_up_and_the_stage_homes() -> None:
    bench = _bench()
    up_s = bench.clock.monotonic_s() + 0.5

    def force_gwt(up_mm: float) -> float:
        return 10.0 - 4.0 * up_mm if bench.clock.monotonic_s() > up_s and up_mm < 2.0 else 0.0

    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", force_gwt(bench.stage.at_mm[2] - FROM_MM))
    verbs.home(bench.engine)
    assert len(_jogs_mm(bench)) < STEPS + 2
    assert _homings(bench) == 1
    assert "a finger came up" in _causes(bench)[0]


@pytest.mark.parametrize(
    "error",
    [
        StageRejected(15, "jog", "beyond the travel"), StageAlarm(1, "limit switch"),
        StageError("short", "jog_cut_short"),
    ],
)  # fmt: skip
def test_stage_that_can_go_up_no_farther_homes_from_there(error: StageError) -> None:
    bench = _bench()
    bench.stage.jog = raising(error)  # type: ignore[method-assign]
    verbs.home(bench.engine)
    assert bench.stage.told == ["unlock"] * isinstance(error, StageAlarm) + ["home"]
    assert "a step of homing ended short" in _causes(bench)[0]


def test_other_errors_of_a_first_step_stop_the_stage() -> None:
    bench = _bench()
    bench.stage.jog = raising(StageError("broken", "broken"))  # type: ignore[method-assign]
    with raises(StageError, "broken"):
        verbs.home(bench.engine)
    assert bench.stage.told == ["stop"]


def test_alarm_of_the_stage_is_left_to_homing() -> None:
    bench = _bench()
    bench.stage.state = "Alarm"
    verbs.home(bench.engine)
    assert bench.stage.told == ["home"]


def test_stage_that_strays_in_a_first_step_is_stopped() -> None:
    bench = _bench()
    bench.stage.status = lambda: StageStatus("Idle", -7.0, -3.0, 30.0 * len(bench.stage.told))  # type: ignore[method-assign]
    with raises(StageError, "off_its_way"):
        verbs.home(bench.engine)
    assert bench.stage.told[-1] == "stop"
    assert _homings(bench) == 0


@pytest.mark.parametrize(
    ("error", "zeroed"), [(ForceOverload("over"), True), (ForceOverload("over"), False), (ForceError("dead"), True)]
)
def test_homing_that_needs_no_force_makes_no_first_steps_without_one(error: ForceError, zeroed: bool) -> None:
    """It is read again as soon as the stage moves."""
    bench = _bench(zeroed=zeroed)
    bench.force.at_read = raising(error)
    bench.stage.at_look = lambda: setattr(bench.force, "at_read", lambda: None)
    verbs.home(bench.engine)
    assert bench.stage.told == ["home"]


def test_nothing_moves_without_force_before_the_first_zero() -> None:
    bench = _bench(zeroed=False)
    bench.force.at_read = raising(ForceError("dead"))
    with raises(TripError, "no_reading"):
        verbs.home(bench.engine)
    assert bench.stage.told == []


def test_sensor_that_a_first_step_overloads_counts_as_growth() -> None:
    bench = _bench()

    def read() -> None:
        bench.force.shows_gwt = 9.0
        if bench.stage.at_mm[2] > FROM_MM + 1.5 * STEP_MM:
            raise ForceOverload("over")

    bench.force.at_read = read
    with raises(TripError, "homing_wrong_way", grown_to="beyond the range of the sensor"):
        verbs.home(bench.engine)
    assert _homings(bench) == 0
    assert bench.of("trip")[0]["force_gwt"] is None


def test_stop_input_ends_the_first_steps() -> None:
    bench = _bench()
    bench.engine.stop_inputs = lambda engine, *, at_rest: (
        TripError("button", code="button") if len(_jogs_mm(bench)) == 2 else None
    )
    with raises(TripError, "button"):
        verbs.home(bench.engine)
    assert len(_jogs_mm(bench)) == 2
    assert _homings(bench) == 0


@pytest.mark.parametrize(
    ("noise_gwt", "growth_gwt"), [(0.0, 0.05), (0.005, 0.05), (0.04, 0.24), (0.08, 0.48), (0.3, 0.5)]
)
@pytest.mark.parametrize("more_gwt", [-0.005, 0.005])
def test_before_the_first_zero_a_growth_counts_beyond_touch_force_and_six_times_the_noise(
    noise_gwt: float, growth_gwt: float, more_gwt: float
) -> None:
    """Up to half a gram-weight of noise: more is a finger that moves."""
    bench = _bench(zeroed=False)
    noise = [noise_gwt, -noise_gwt] * 6
    bench.force.at_read = lambda: setattr(
        bench.force, "shows_gwt", noise.pop() if noise else (growth_gwt + more_gwt) * (_homings(bench) > 0)
    )
    verbs.home(bench.engine)
    assert bool(_causes(bench)) is (more_gwt > 0)
    assert _homings(bench) == (2 if more_gwt > 0 else 1)


@pytest.mark.parametrize(
    ("gwt_mm", "code", "cause"),
    [
        (0.55, "homing_wrong_way", "the z axis runs the wrong way"),
        (0.45, "homing_disturbed", "does not depend on the height"),
        (-0.45, None, "does not depend on the height"),
        (-0.55, None, "a finger came up"),
    ],
)
def test_a_force_depends_on_the_height_if_a_step_changes_it_by_half_a_touch(
    gwt_mm: float, code: str | None, cause: str
) -> None:
    """0.025 gwt in 0.05 mm; less may be drift."""
    bench, halted_mm = _bench(), list[float]()
    bench.stage.at_stop = lambda: halted_mm.append(bench.stage.at_mm[2])
    bench.force.at_read = lambda: setattr(
        bench.force,
        "shows_gwt",
        5.0 + gwt_mm * (bench.stage.at_mm[2] - halted_mm[-1]) if halted_mm else 0.3 * (_homings(bench) > 0),
    )
    with raises(TripError, code) if code else nullcontext():
        verbs.home(bench.engine)
    assert cause in [*_causes(bench), *(trip["reason"] for trip in bench.of("trip"))][0]


def test_a_finger_that_moves_while_the_noise_is_read_does_not_hide_the_wrong_way() -> None:
    bench = _bench(zeroed=False)
    values = iter(range(10_000))

    def read() -> None:
        moving_gwt = min(next(values), 12) * 1.0
        bench.force.shows_gwt = moving_gwt + 20.0 * max(bench.stage.at_mm[2] - FROM_MM, 0.0)

    bench.force.at_read = read
    with raises(TripError, "homing_wrong_way"):
        verbs.home(bench.engine)
    assert _homings(bench) == 0


def test_a_sensor_that_is_busy_while_the_stage_homes_loses_no_heartbeat() -> None:
    bench = _bench(heartbeat_s=0.5)
    engine, busy_s, beats = bench.engine, list[float](), list[int]()
    engine.contact = replace(engine.contact, may_touch=True)
    promised = bench.promises()

    def read() -> None:
        if _jogs_mm(bench):
            busy_s.append(bench.clock.monotonic_s())
            if busy_s[-1] < busy_s[0] + 0.9:
                beats.append(len(promised))
                raise ForceBusy("no value now")

    bench.force.at_read = read
    with looked_after_by(bench.clock, engine.heartbeat):
        verbs.home(engine)
    assert busy_s[-1] > busy_s[0] + 0.9
    assert beats == sorted(set(beats)), "one before each reading"
    assert not engine.heartbeat.lost


def test_homing_out_of_an_overload_has_no_heartbeat_before_its_first_status() -> None:
    """Nothing may hold the indentor on the finger: a controller that is silent while it begins is not stopped."""
    bench = _bench(heartbeat_s=0.5)
    engine, homing = bench.engine, bench.stage.homing
    engine.contact = replace(engine.contact, may_touch=True)
    bench.force.at_read = raising(ForceOverload("over"))

    def begins_silently() -> Iterator[StageStatus | None]:
        bench.clock.wait_s(2.0)
        bench.force.at_read = lambda: None
        yield from homing()

    bench.stage.homing = begins_silently  # type: ignore[method-assign]
    with looked_after_by(bench.clock, engine.heartbeat):
        verbs.home(engine)
    assert not engine.heartbeat.lost
    assert engine.state is State.READY


# --- growth during homing ---

BEYOND_MM = STEPS * STEP_MM + 0.2
"""Above the start, farther than the first steps go."""


@pytest.mark.parametrize("before_gwt", [0.0, 10.0, 30.0])
@pytest.mark.parametrize("zeroed", [True, False])
def test_growth_by_the_touch_threshold_halts_homing_at_the_next_look(before_gwt: float, zeroed: bool) -> None:
    """Also far below, and far above, the trips. The stage makes 1 mm from look to look."""
    bench = _bench(lambda up_mm: before_gwt + 0.5 * max(up_mm - BEYOND_MM, 0.0), zeroed=zeroed)
    halted_mm: list[float] = []
    bench.stage.at_stop = lambda: halted_mm.append(bench.stage.at_mm[2] - FROM_MM)
    with raises(TripError, "homing_wrong_way"):
        verbs.home(bench.engine)
    assert bench.stage.told[STEPS : STEPS + 2] == ["home", "stop"]
    assert BEYOND_MM < halted_mm[0] <= BEYOND_MM + 0.1 + 1.0


def test_pull_that_grows_halts_homing_as_a_push_does() -> None:
    bench = _bench(lambda up_mm: -3.0 * max(up_mm - BEYOND_MM, 0.0))
    with raises(TripError, "homing_wrong_way"):
        verbs.home(bench.engine)


def test_axis_that_homes_the_wrong_way_goes_back_until_the_touch_ends() -> None:
    bench = _bench(lambda up_mm: 3.0 * max(up_mm - BEYOND_MM, 0.0))
    with raises(TripError, "homing_wrong_way") as caught:
        verbs.home(bench.engine)
    bench.force.at_read()
    assert 0.0 <= bench.force.shows_gwt < 0.05
    assert printed(caught.value, "moved back by ", " mm") == pytest.approx(
        -sum(_jogs_mm(bench)[STEPS + 2 :]), abs=0.005
    )


def test_axis_that_homes_the_wrong_way_goes_back_by_no_more_than_it_made() -> None:
    """In contact, the force of before remains."""
    bench = _bench(lambda up_mm: 5.0 + 3.0 * max(up_mm - STEPS * STEP_MM, 0.0))
    with raises(TripError, "homing_wrong_way"):
        verbs.home(bench.engine)
    assert FROM_MM + STEPS * STEP_MM - 1e-9 <= bench.stage.at_mm[2] < FROM_MM + STEPS * STEP_MM + STEP_MM


def test_stage_that_lost_its_position_goes_back_by_no_more_than_it_can_have_made() -> None:
    """A board that counts from the beginning of its homing: the time bounds the way."""
    bench = _bench(lambda up_mm: 20.0)
    jogs = list[float]()
    bench.force.at_read = lambda: setattr(
        bench.force, "shows_gwt", 5.0 + (10.0 + 1.0 * sum(jogs)) * (_homings(bench) > 0)
    )
    jog = bench.stage.jog

    def counted(axis: str, mm: float, speed_mm_s: float) -> None:
        jogs.append(mm * (_homings(bench) > 0))
        jog(axis, mm, speed_mm_s)

    bench.stage.jog = counted  # type: ignore[method-assign]
    bench.stage.at_stop = lambda: bench.stage.at_mm.__setitem__(2, 500.0)
    with raises(TripError, "homing_wrong_way"):
        verbs.home(bench.engine)
    assert -10.0 < sum(jogs) < 0.0


def test_going_back_ends_where_the_force_grows() -> None:
    """What it met there, too, is not pressed: the last step is undone."""
    bench = _bench(lambda up_mm: 3.0 * abs(up_mm - BEYOND_MM) if up_mm > 0.4 else 0.0)
    with raises(TripError, "homing_wrong_way"):
        verbs.home(bench.engine)
    assert bench.stage.at_mm[2] - FROM_MM == pytest.approx(BEYOND_MM, abs=2 * STEP_MM)


@pytest.mark.parametrize("below_gwt_mm", [3.0, 0.4])
def test_going_back_ends_where_a_force_grows_that_never_vanished(below_gwt_mm: float) -> None:
    """Also where it grows by less than a step shows."""

    def force_gwt(up_mm: float) -> float:
        past_mm = up_mm - BEYOND_MM
        return 4.0 + max(3.0 * past_mm, -below_gwt_mm * past_mm) if up_mm > 0.4 or _homings(bench) else 0.0

    bench = _bench(force_gwt)
    with raises(TripError, "homing_wrong_way"):
        verbs.home(bench.engine)
    assert bench.stage.at_mm[2] - FROM_MM == pytest.approx(BEYOND_MM, abs=3 * STEP_MM)


def test_force_that_grows_either_way_from_where_homing_halted_is_no_wrong_way() -> None:
    bench, halted_mm = _bench(), list[float]()
    bench.stage.at_stop = lambda: halted_mm.append(bench.stage.at_mm[2])

    def read() -> None:
        growing_gwt = 0.3 * (_homings(bench) > 0)
        bench.force.shows_gwt = 5.0 + 4.0 * abs(bench.stage.at_mm[2] - halted_mm[-1]) if halted_mm else growing_gwt

    bench.force.at_read = read
    with raises(TripError, "homing_disturbed"):
        verbs.home(bench.engine)
    assert bench.stage.at_mm[2] == pytest.approx(halted_mm[0], abs=1e-9), "each step is undone"


def test_force_that_vanished_at_rest_is_reported_and_the_stage_homes_again() -> None:
    bench = _bench()
    moving: list[bool] = []
    bench.stage.at_look = lambda: moving.append(True)
    bench.stage.at_stop = moving.clear
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", 0.3 * bool(moving))
    verbs.home(bench.engine)
    assert _homings(bench) == 2
    assert "vanished" in _causes(bench)[0]
    assert min(_jogs_mm(bench)) > 0, "nothing to go back from"


@pytest.mark.parametrize("jogs", [True, False])
def test_force_that_vanishes_again_and_again_trips(jogs: bool) -> None:
    """Where the controller refuses steps nothing tells a finger from a disturbance."""
    bench = _bench()
    if not jogs:
        bench.stage.allow_unhomed_jogs = raising(StageRejected(9, "jog", "locked"))  # type: ignore[method-assign]
    moving: list[float] = []
    bench.stage.at_look = lambda: moving.append(2.0 * (_homings(bench)))
    bench.stage.at_stop = moving.clear
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", moving[-1] if moving else 0.0)
    with raises(TripError, "homing_disturbed"):
        verbs.home(bench.engine)
    assert _homings(bench) == 4
    assert bool(_jogs_mm(bench)) is jogs


@pytest.mark.parametrize(("then_mm", "follows"), [(math.inf, False), (4.0, False), (4.0, True)])
def test_finger_that_came_up_is_left_and_one_that_comes_up_twice_trips_lifted(then_mm: float, follows: bool) -> None:
    """The second time it comes up again where the stage then is; one that follows is left by the travel."""
    skin_mm = [-1.0]
    bench = _bench()

    def come_up() -> None:
        up_mm = bench.stage.at_mm[2] - FROM_MM
        if _homings(bench) == 1 and 1.0 < up_mm < 3.0:
            skin_mm[0] = 4.0
        if _homings(bench) == 2 and up_mm > then_mm + 1.0:
            skin_mm[0] = 9.0

    def read() -> None:
        up_mm = bench.stage.at_mm[2] - FROM_MM
        if follows and max(_jogs_mm(bench), default=0.0) > STEP_MM:
            skin_mm[0] = up_mm + 1.0
        bench.force.shows_gwt = 4.0 * max(skin_mm[0] - up_mm, 0.0)

    bench.stage.at_look, bench.force.at_read = come_up, read
    if then_mm == math.inf:
        verbs.home(bench.engine)
        assert bench.engine.state is State.READY
    else:
        with raises(TripError, "finger_moves"):
            verbs.home(bench.engine)
        assert bench.stage.at_mm[2] - FROM_MM > 9.0 - 0.05
        lifted_mm = sum(mm for mm in _jogs_mm(bench) if mm > STEP_MM)
        assert (lifted_mm >= bench.settings.stage.travel_mm[2]) is follows
        assert lifted_mm < bench.settings.stage.travel_mm[2] + 1.0
    assert _homings(bench) == 2
    assert "a finger came up" in _causes(bench)[0]


@pytest.mark.parametrize(("weight_gwt", "code"), [(60.0, "soft_trip"), (1.0, "")])
def test_force_that_does_not_depend_on_the_height_trips_only_beyond_a_trip(weight_gwt: float, code: str) -> None:
    bench = _bench(soft_trip_n=0.2)
    bench.force.at_read = lambda: setattr(bench.force, "shows_gwt", weight_gwt * (_homings(bench) > 0))
    if code:
        with raises(TripError, code):
            verbs.home(bench.engine)
        assert _homings(bench) == 1
    else:
        verbs.home(bench.engine)
        assert _homings(bench) == 2
        assert "does not depend on the height" in _causes(bench)[0]
        assert bench.engine.known_contact.kind == "disagreement"


def test_stop_input_during_homing_trips_as_before() -> None:
    bench = _bench()
    bench.engine.stop_inputs = lambda engine, *, at_rest: None if at_rest else TripError("button", code="button")
    with raises(TripError, "button"):
        verbs.home(bench.engine)
    assert bench.stage.told[-1] == "stop"


def test_errors_of_the_stage_while_it_homes_are_raised() -> None:
    bench: Any = _bench()
    bench.stage.at_look = raising(StageError("lost", "lost"))
    with raises(StageError, "lost"):
        verbs.home(bench.engine)
    assert bench.engine.state is State.UNHOMED
