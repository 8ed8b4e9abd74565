"""The planner against closed form: times, stop distances, junctions, and no jumps."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.devices.grbl.planner import AxisLimits, Counts, MotionPlanner, Share, Track, trapezoid

PER_MM = 400
LIMITS = AxisLimits((400.0, 400.0, 400.0), (10.0, 10.0, 5.0), (50.0, 50.0, 50.0), 0.01)
HOME: Counts = (0, 0, 0)


def planner(limits: AxisLimits = LIMITS) -> MotionPlanner:
    return MotionPlanner(limits, HOME)


def steps(x_mm: float, y_mm: float = 0.0, z_mm: float = 0.0) -> Counts:
    return (round(x_mm * PER_MM), round(y_mm * PER_MM), round(z_mm * PER_MM))


def queue_path(plan: MotionPlanner, points: list[Counts], speed: float, now_s: float = 0.0) -> None:
    start = HOME
    for point in points:
        plan.queue(start, point, speed, now_s)
        start = point


def test_the_planner_stops_at_a_reversal_and_slows_to_the_junction_speed_at_a_corner() -> None:
    back, corner = planner(), planner()
    queue_path(back, [steps(1.0), HOME], 5.0)
    assert back.end_s == pytest.approx(2 * (1.0 / 5 + 5 / 50), rel=1e-12)
    queue_path(corner, [steps(1.0), steps(1.0, 1.0)], 5.0)
    # A right angle: v² = a·d·sin(θ/2)/(1 − sin(θ/2)), with the axes' a along the bisector.
    sine = math.sqrt(0.5)
    junction = math.sqrt(50 / sine * 0.01 * sine / (1 - sine))
    half_s = (2 * 5 - junction) / 50 + (1 - (2 * 25 - junction**2) / 100) / 5
    assert corner.end_s == pytest.approx(2 * half_s, rel=1e-12)


@pytest.mark.parametrize("speed", [0.05, 1.0, 10.0])
@pytest.mark.parametrize("phase_s", [0.0, 0.0033, 0.0099])
def test_a_feed_hold_takes_effect_after_five_prepared_segments(speed: float, phase_s: float) -> None:
    """The one being stepped has been stepped in part already; at 0.05 mm/s a segment takes 70 ms."""
    plan = planner()
    queue_path(plan, [steps(10.0)], speed)
    segment_s = max(0.01 * math.ceil(1.25 / PER_MM / speed / 0.01), 0.01)
    t_s = math.ceil(0.5 / segment_s) * segment_s + phase_s
    at = plan.track.position_at(t_s)[0]
    plan.hold(t_s)
    travel_mm = speed * (5 * segment_s - phase_s) + speed**2 / (2 * 50)
    assert plan.track.position_at(plan.end_s)[0] - at == pytest.approx(travel_mm * PER_MM, rel=1e-6)


def test_an_abrupt_stop_of_the_planner_keeps_whole_steps_and_drops_the_queue() -> None:
    plan = planner()
    queue_path(plan, [steps(10.0), steps(10.0, 5.0)], 10.0)
    before = plan.track.counts_at(0.5)
    assert plan.halt(0.5) == (0, 0, 0)
    assert plan.track.position_at(0.5) == before
    assert plan.unfinished(0.5) == 0
    assert not plan.resume(1.0)


@pytest.mark.parametrize(("to_mm", "slip"), [((5.0, 5.0, -4.0), (3, 3, -3)), ((-5.0, -5.0, 4.0), (-3, -3, 3))])
def test_an_abrupt_stop_slips_each_axis_in_its_direction_of_motion(
    to_mm: tuple[float, float, float], slip: Counts
) -> None:
    plan = planner()
    queue_path(plan, [steps(*to_mm)], 5.0)
    before = plan.track.counts_at(0.5)
    assert plan.halt(0.5, slip_steps=3) == slip
    assert plan.track.counts_at(0.6) == tuple(at + gone for at, gone in zip(before, slip, strict=True))


@given(
    mm=st.floats(1e-6, 100.0),
    v0=st.floats(0.0, 10.0),
    v1=st.floats(0.0, 10.0),
    cruise=st.floats(0.01, 10.0),
    accel=st.floats(1.0, 500.0),
)
@settings(max_examples=60, deadline=None)
def test_a_trapezoid_covers_its_length_within_speed_and_acceleration(
    mm: float, v0: float, v1: float, cruise: float, accel: float
) -> None:
    v0, v1 = min(v0, cruise), min(v1, cruise)
    if abs(v0 * v0 - v1 * v1) > 2 * accel * mm:
        v1 = v0
    ramps = trapezoid(mm, v0, v1, cruise, accel)
    assert sum(ramp.mm for ramp in ramps) == pytest.approx(mm, rel=1e-9, abs=1e-9)
    speed = v0
    for ramp in ramps:
        assert ramp.v0 == pytest.approx(speed, abs=1e-6)
        assert abs(ramp.accel) <= accel * (1 + 1e-6)
        speed = ramp.v0 + ramp.accel * ramp.duration_s
    assert speed == pytest.approx(v1, abs=1e-5)


@pytest.mark.parametrize(("share", "mm_s"), [(2.0, 2.0), (0.5, 0.5), (0.1, 0.1), (20.0, 10.0)])
def test_a_feed_override_changes_the_speed_of_the_current_and_the_next_move(share: float, mm_s: float) -> None:
    """From 1 mm/s, once the prepared segments have run out, at 50 mm/s²; never beyond what the axis allows."""
    plan = planner()
    queue_path(plan, [steps(6.0), steps(12.0)], 1.0)
    plan.override(Share(feed=share), 1.0, moving=True)
    assert plan.track.speed_at(1.049) == pytest.approx(1.0)
    assert plan.track.speed_at(1.05 + abs(mm_s - 1.0) / 50 + 1e-6) == pytest.approx(mm_s)
    assert plan.track.speed_at(plan.next_end_s() + 0.1) == pytest.approx(mm_s)
    assert plan.track.position_at(plan.end_s) == steps(12.0)


EVENTS = st.lists(
    st.tuples(
        st.floats(0.0, 0.5),  # seconds until it happens
        st.sampled_from(["move", "move", "move", "hold", "override"]),
        st.tuples(st.integers(-2000, 2000), st.integers(-2000, 2000), st.integers(-2000, 2000)),
        st.floats(0.1, 10.0),
    ),
    min_size=1,
    max_size=15,
)


@given(EVENTS)
@settings(max_examples=40, deadline=None)
def test_any_sequence_of_moves_and_holds_is_smooth_and_ends_at_its_target(
    events: list[tuple[float, str, Counts, float]],
) -> None:
    plan = planner()
    now_s, last = 0.0, HOME
    for pause_s, kind, target, speed in events:
        then_s = now_s + pause_s
        _check_smooth(plan.track, now_s, then_s)
        now_s = then_s
        if kind == "move":
            plan.queue(last, target, speed, now_s)
            last = target
        elif kind == "override":
            plan.override(Share(speed / 5, min(speed / 10, 1.0)), now_s, moving=now_s < plan.end_s)
        else:
            plan.hold(now_s)
            _check_smooth(plan.track, now_s, plan.end_s)
            now_s = plan.end_s
            plan.resume(now_s)
    _check_smooth(plan.track, now_s, plan.end_s)
    assert plan.track.position_at(plan.end_s) == last
    assert plan.unfinished(plan.end_s) == 0


def _check_smooth(track: Track, t0_s: float, t1_s: float) -> None:
    """No axis may go faster than its limit between any two instants."""
    count = 60
    dt_s = (t1_s - t0_s) / count
    if dt_s <= 1e-6:
        return
    at = [track.position_at(t0_s + i * dt_s) for i in range(count + 1)]
    for axis, most in enumerate(LIMITS.max_speed):
        for before, after in pairwise(at):
            assert abs(after[axis] - before[axis]) <= most * PER_MM * dt_s * (1 + 1e-6) + 1e-6


PLAY = (8.0, 0.0, 20.0)


def test_a_nut_with_backlash_follows_the_screw_only_once_the_backlash_is_taken_up() -> None:
    """12 steps of play: 40 down, 10 up (nothing follows), 30 more up (28 follow), 5 down (nothing)."""
    plan = MotionPlanner(LIMITS, HOME, (0.0, 0.0, 12.0))
    z, now_s = 0, 0.0
    for by, nut in ((-40, -40), (10, -40), (30, -12), (-5, -12), (-10, -15)):
        plan.queue((0, 0, z), (0, 0, z + by), 1.0, now_s)
        z, now_s = z + by, plan.end_s
        assert plan.track.counts_at(now_s) == (0, 0, z)
        assert plan.track.nut_at(now_s) == (0, 0, nut)


@given(EVENTS)
@settings(max_examples=30, deadline=None)
def test_backlash_equals_a_step_by_step_simulation(events: list[tuple[float, str, Counts, float]]) -> None:
    """Whatever is queued and held: sampled finely, the nut is dragged along by whichever flank it meets.

    Sampling may miss the tip of a turn by what a motor moves between two samples, at its fastest: that, and a step
    for rounding, is the tolerance.
    """
    plan, now_s, last = MotionPlanner(LIMITS, HOME, PLAY), 0.0, HOME
    dragged, coarse = [float(c) for c in HOME], 0.0
    for pause_s, kind, target, speed in events:
        for fraction in np.linspace(0, 1, 200):
            _drag(dragged, plan.track.position_at(now_s + fraction * pause_s))
        coarse = max(coarse, max(LIMITS.max_speed) * PER_MM * pause_s / 200)
        now_s += pause_s
        assert plan.track.nut_at(now_s) == pytest.approx(dragged, abs=coarse + 1)
        if kind == "move":
            plan.queue(last, target, speed, now_s)
            last = target
        else:
            plan.hold(now_s)
    lag = [s - n for s, n in zip(plan.track.counts_at(plan.end_s), plan.track.nut_at(plan.end_s), strict=True)]
    assert all(-1 <= behind <= play + 1 for behind, play in zip(lag, PLAY, strict=True))


def _drag(nut: list[float], screw: tuple[float, float, float]) -> None:
    for axis, (at, play) in enumerate(zip(screw, PLAY, strict=True)):
        nut[axis] = min(max(nut[axis], at - play), at)
