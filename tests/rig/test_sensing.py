"""What a sensor's readings are taken for: waits, zero, noise, and what is felt while something moves."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from rig.devices.base import ForceBroken, ForceBusy, ForceOverload, ForceTimeout, ForceUnderload
from rig.engine.sensing import ForceZero, MotionForce, NoReadingError, Sensing, read
from rig.settings import RigSettings
from rig.transport.wire import TransportError
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.error_codes import causes, raises
from tests.stub_bench import StubSensor, raising


def _sensing(**tables: Any) -> tuple[StubSensor, Sensing]:
    clock = VirtualClock(1.7e9, 100.0)
    sensor = StubSensor(clock)
    return sensor, Sensing(RigSettings.model_validate(tables), clock, sensor)


# --- one reading ---


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ForceTimeout("no answer to SI"), "no_reply"),
        (ForceTimeout("a: no reply", "no_device"), "no_device"),
        (TransportError("force is closed"), "wire_failed"),
    ],
)
def test_a_sensor_that_fails_gives_no_reading(error: Exception, code: str) -> None:
    sensor, _ = _sensing()
    sensor.at_read = raising(error)
    with raises(NoReadingError, "no_reading", error=str(error)) as found:
        read(sensor, sensor.clock, 0.0)
    assert causes(found.value)[0] == code


def test_after_a_reading_that_failed_an_earlier_one_is_no_new_one() -> None:
    sensor, sensing = _sensing()
    sensing.now()
    assert sensing.has_new_reading
    sensor.at_read = raising(ForceTimeout("no answer"))
    with raises(NoReadingError, "no_reading", error="no answer"):
        sensing.now()
    assert not sensing.has_new_reading


@pytest.mark.parametrize("shown", [math.nan, math.inf, -math.inf])
def test_a_force_of_nan_or_infinity_gives_no_reading(shown: float) -> None:
    sensor, _ = _sensing()
    sensor.shows_gwt = shown
    with raises(NoReadingError, "not_a_number", force_n=str(shown)):
        read(sensor, sensor.clock, 0.0)


def test_a_force_older_than_its_request_gives_no_reading() -> None:
    """Waited for 0.2 s and then asked: a reading of 0.1 s ago is from before the question."""
    sensor, _ = _sensing()
    sensor.age_s = 0.1
    with raises(NoReadingError, "stale_reading", older_s=0.1):
        read(sensor, sensor.clock, 0.2)


# --- how long is waited ---


@pytest.mark.parametrize(
    ("settle_readings", "latency_s", "settle_s"), [(1, 0.0, 0.05), (1, 0.08, 0.13), (3, 0.08, 0.23), (20, 0.0, 1.0)]
)
def test_the_first_reading_after_a_move_waits_for_the_sensor_to_settle(
    settle_readings: int, latency_s: float, settle_s: float
) -> None:
    """Sample periods of 0.05 s, as many as are asked for, and what the sensor is late by."""
    sensor, sensing = _sensing(habits={"settle_readings": settle_readings}, force={"latency_s": latency_s})
    for _ in range(2):
        begun_s = sensor.clock.monotonic_s()
        sensor.read_s.clear()
        assert (sensing.settle_s, sensing.wait_s) == pytest.approx((settle_s, settle_s))
        sensing.settled()
        assert sensing.wait_s == 0.05
        sensing.raw()
        assert sensor.read_s == pytest.approx([begun_s + settle_s, begun_s + settle_s + 0.05])
        sensing.take_zero([0.0])
        sensing.begin_motion(away=False)


@pytest.mark.parametrize(("busy_s", "answers"), [(1.0, True), (1.12, True), (1.25, False)])
def test_a_busy_sensor_is_queried_again_for_one_second(busy_s: float, answers: bool) -> None:
    """Waits of 0.13 s: until 1.13 s after the question."""
    sensor, sensing = _sensing(force={"latency_s": 0.08})
    sensing.begin_motion(away=True)
    begun_s = sensor.clock.monotonic_s()

    def busy() -> None:
        if sensor.clock.monotonic_s() < begun_s + busy_s:
            raise ForceBusy("no value now")

    sensor.at_read = busy
    if answers:
        sensing.raw()
    else:
        with raises(NoReadingError, "no_reading") as found:
            sensing.raw()
        assert causes(found.value)[0] == "busy"


@pytest.mark.parametrize("shows_gwt", [0.0, 3.0])
@pytest.mark.parametrize("latency_s", [0.0, 0.7])
def test_each_wait_for_a_force_at_rest_is_announced_with_its_length(shows_gwt: float, latency_s: float) -> None:
    """So that a heartbeat covers it: the waits for readings, and the pause between them in steps of 0.1 s."""
    sensor, sensing = _sensing(force={"latency_s": latency_s})
    sensor.shows_gwt = shows_gwt
    sensing.take_zero([0.0])
    begun_s, told = sensor.clock.monotonic_s(), list[tuple[float, float]]()
    sensing.at_rest_gwt(lambda seconds: told.append((sensor.clock.monotonic_s(), seconds)))
    times = [*(at_s for at_s, _ in told), sensor.clock.monotonic_s()]
    assert times[0] == begun_s
    assert [after - before for before, after in pairwise(times)] == pytest.approx([seconds for _, seconds in told])
    assert max(seconds for _, seconds in told[1:]) == pytest.approx(0.05 if shows_gwt else 0.1)


# --- zero and noise ---


def test_forces_count_from_the_mean_of_the_zero_readings() -> None:
    sensor, sensing = _sensing()
    sensor.shows_gwt = 7.0
    assert not sensing.zeroed
    assert sensing.settled().force_n == pytest.approx(7.0 * GWT_N)
    zero = sensing.take_zero([1.9, 2.0, 2.1])
    assert sensing.zeroed
    assert sensing.absolute, "a zero is taken in the air unless it says otherwise"
    assert (zero.offset_n, zero.noise_gwt) == pytest.approx((2.0 * GWT_N, math.sqrt(0.02 / 3)))
    assert sensing.settled().force_n == pytest.approx(5.0 * GWT_N)
    assert sensing.raw().force_n == pytest.approx(7.0 * GWT_N)
    assert _in_motion_gwt(sensing, sensing.begin_motion(away=False)) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("noise_gwt", "least_gwt", "touch_gwt"),
    [
        (None, 0.01, 0.05),
        (0.0, 0.01, 0.05),
        (0.001, 0.01, 0.05),
        (0.005, 0.03, 0.05),
        (0.02, 0.12, 0.12),
        (0.5, 0.6, 0.6),
    ],
)
def test_the_touch_threshold_is_the_largest_of_6_sd_one_step_and_the_configured_force(
    noise_gwt: float | None, least_gwt: float, touch_gwt: float
) -> None:
    """A step is 0.01 gwt, configured are 0.05. Noise counts up to ten steps: a finger may have moved."""
    _, sensing = _sensing()
    if noise_gwt is not None:
        sensing.take_zero([1.0 - noise_gwt, 1.0 + noise_gwt])
    assert sensing.noise_gwt == pytest.approx(min(noise_gwt or 0.0, 0.1))
    assert sensing.resolution_gwt == 0.01
    assert (sensing.least_gwt, sensing.touch_gwt) == pytest.approx((least_gwt, touch_gwt))


@pytest.mark.parametrize(
    ("noise_gwt", "apart_gwt", "agree"),
    [(0.0, 0.0249, True), (0.0, 0.0251, False), (0.01, 0.0599, True), (0.01, 0.0601, False)],
)
def test_readings_at_rest_agree_within_half_a_touch_or_the_noise(
    noise_gwt: float, apart_gwt: float, agree: bool
) -> None:
    """Half a touch is 0.025 gwt, six times the noise 0.06 gwt."""
    _, sensing = _sensing()
    sensing.zero = ForceZero(0.0, noise_gwt)
    assert sensing.agree((0.01, 0.01 - apart_gwt)) is sensing.agree((0.01 - apart_gwt, 0.0, 0.01)) is agree


# --- while something moves ---


def _in_motion_gwt(sensing: Sensing, begun: MotionForce) -> float:
    reading = sensing.read_in_motion(begun)
    assert reading is not None
    return reading.force_n / GWT_N


def test_without_a_zero_a_force_counts_from_the_reading_before_the_motion() -> None:
    """A new reading: the last one at rest may be from long ago."""
    sensor, sensing = _sensing()
    sensor.shows_gwt = 70.0
    sensing.settled()
    sensor.shows_gwt = 80.0
    begun = sensing.begin_motion(away=False)
    sensor.shows_gwt = 83.0
    assert _in_motion_gwt(sensing, begun) == pytest.approx(3.0)
    assert sensing.moved


def test_with_a_zero_no_reading_precedes_a_motion() -> None:
    sensor, sensing = _sensing()
    sensor.shows_gwt = 3.0
    sensing.begin_motion(away=False)
    sensing.take_zero([1.0])
    sensor.read_s.clear()
    begun = sensing.begin_motion(away=False)
    assert not sensor.read_s
    assert _in_motion_gwt(sensing, begun) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("before_gwt", "force_gwt", "goes_on"),
    [
        (8.0, 0.0, True), (8.0, 8.04, True), (8.0, 8.06, False), (8.0, -0.04, True), (8.0, -0.06, False),
        (-8.0, 0.0, True), (-8.0, -8.04, True), (-8.0, -8.06, False), (-8.0, 0.04, True), (-8.0, 0.06, False),
    ],
)  # fmt: skip
def test_a_motion_away_from_the_finger_ends_if_the_force_grows_in_either_sign(
    before_gwt: float, force_gwt: float, goes_on: bool
) -> None:
    """A touch is 0.05 gwt. Towards it nothing unloads; where the stage shakes by 0.1 gwt, so much more may be."""
    _, sensing = _sensing()
    sensing.take_zero([0.0])
    begun = MotionForce(away=True, before_gwt=before_gwt)
    assert sensing.unloads(begun, force_gwt) is goes_on
    assert not sensing.unloads(replace(begun, away=False), force_gwt)
    assert sensing.unloads(replace(begun, shakes_gwt=0.1), force_gwt)


BEYOND = [ForceOverload("overloaded"), ForceUnderload("underloaded"), ForceBusy("busy")]
BROKEN = [ForceBroken("the cell is broken"), ForceTimeout("no answer"), TransportError("closed")]


@pytest.mark.parametrize("error", BEYOND, ids=lambda e: type(e).__name__)
def test_with_a_sensor_beyond_its_range_only_a_lift_may_move(error: Exception) -> None:
    sensor, sensing = _sensing()
    sensor.at_read = raising(error)
    with raises(NoReadingError, "no_reading", error=str(error)):
        sensing.begin_motion(away=False)
    assert sensing.read_in_motion(sensing.begin_motion(away=True)) is None


@pytest.mark.parametrize("away", [False, True])
@pytest.mark.parametrize("error", BROKEN, ids=lambda e: type(e).__name__)
def test_with_a_broken_sensor_no_motion_begins(error: Exception, away: bool) -> None:
    sensor, sensing = _sensing()
    sensor.at_read = raising(error)
    with raises(NoReadingError, "no_reading", error=str(error)):
        sensing.begin_motion(away=away)
