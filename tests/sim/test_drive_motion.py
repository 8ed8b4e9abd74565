"""The motion of one drive's axis: ramps of its own up and down, from any speed to rest."""

from itertools import pairwise

import pytest

from sim.devices.leadshine import DriveAxis, ramps_to_rest

UP, DOWN, CRUISE = 4000.0, 2500.0, 1000.0


@pytest.mark.parametrize("speed", [0.0, 300.0, 900.0, 1000.0, 1500.0])
@pytest.mark.parametrize("length", [700.0, 2000.0, 20_000.0])
@pytest.mark.parametrize("cruise", [CRUISE, 5000.0])
def test_ramps_cover_the_length_from_a_speed_to_rest(cruise: float, length: float, speed: float) -> None:
    ramps = [ramp for ramp in ramps_to_rest(length, speed, cruise, UP, DOWN) if ramp.duration_s > 0]
    ends = [ramp.v0 + ramp.accel * ramp.duration_s for ramp in ramps]
    assert sum(ramp.mm for ramp in ramps) == pytest.approx(length, rel=1e-12)
    assert ramps[0].v0 == speed
    assert [following.v0 for _, following in pairwise(ramps)] == pytest.approx(ends[:-1], rel=1e-9)
    assert ends[-1] == pytest.approx(0.0, abs=1e-9)
    assert max(ramp.v0 for ramp in ramps) <= max(cruise, speed) + 1e-9
    assert {ramp.accel for ramp in ramps} <= {UP, 0.0, -DOWN}


@pytest.mark.parametrize(("length", "speed"), [(10.0, 300.0), (100.0, 1500.0)])
def test_too_short_a_way_is_braked_harder(length: float, speed: float) -> None:
    (ramp,) = ramps_to_rest(length, speed, CRUISE, UP, DOWN)
    assert ramp.mm == pytest.approx(length)
    assert ramp.v0 + ramp.accel * ramp.duration_s == pytest.approx(0.0, abs=1e-9)
    assert ramp.accel < -DOWN


@pytest.mark.parametrize("target", [5000.0, 400.0, 300.0, -3000.0])
def test_a_path_begun_in_motion_ends_at_its_target(target: float) -> None:
    # From 175 at 1 000 pulses/s rest is 200 pulses away: 400 can be reached at once, 300 only by coming back.
    axis = DriveAxis(0)
    axis.go([(100_000.0, CRUISE)], UP, DOWN, 0.0)
    axis.go([(target, CRUISE)], UP, DOWN, 0.3)
    speeds = [abs(axis.velocity_at(0.01 * k)) for k in range(1000)]
    assert axis.position_at(10.0) == target
    assert max(speeds) <= CRUISE + 1e-9
    changes = [b - a for a, b in pairwise(speeds)]
    assert max(changes) <= 0.01 * UP + 1e-9
    assert min(changes) >= -0.01 * DOWN - 1e-9
