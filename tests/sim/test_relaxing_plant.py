"""A finger that relaxes, under a stage and in a process of its own."""

import math

import pytest

from sim.carriage import Carriage, Placement, Pose, Screws, Truth, Turn
from sim.config import FingertipConfig
from sim.devices.clock import VirtualClock
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.relaxation import Prony, PronyTerm
from sim.models.viscoelastic import InTime
from sim.plant import RelaxingPlant, RelaxingPress
from sim.serve.force_process import Going, Leg, TrajectoryProcess, TrajectoryUpdate
from sim.serve.prefetch import TrajectoryPrefetcher
from sim.serve.real_time_loop import WallScheduler
from tests.error_codes import raises
from tests.waiting import until

TERMS = (PronyTerm(0.3, 0.5), PronyTerm(0.15, 4.0))
PERIOD_S = 0.05
SHAPE = "cylinder:9"


def deep(halfspace: Fingertip, doi_mm: float) -> Pose:
    return Pose(0.0, halfspace.touch_height_mm(SHAPE, 0.0) - halfspace.apex_height_mm - doi_mm)


DEPTHS_MM = (-0.1, 0.1, 0.3, 0.3, 0.3, 0.1, -0.1, 0.2)


def test_a_relaxing_press_of_a_virtual_bench_equals_that_of_the_library(halfspace: Fingertip) -> None:
    """To what contact is solved to: a bench asks for 1e-8, the library for 1e-10."""
    press, library = RelaxingPress(halfspace, SHAPE, TERMS, Truth(2.0)), InTime(halfspace, SHAPE, Prony(TERMS))
    for doi_mm in DEPTHS_MM:
        expected = 2.0 * library.to_depth(0.2, doi_mm).force_n
        assert press.moved_to(deep(halfspace, doi_mm), 0.2) == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert expected > 0


def test_skin_below_an_indentor_that_it_does_not_reach_recovers_as_in_air(halfspace: Fingertip) -> None:
    def again(between_mm: float) -> list[float]:
        press = RelaxingPress(halfspace, SHAPE, TERMS)
        return [press.moved_to(deep(halfspace, mm), s) for s, mm in ((5.0, 0.4), (1.0, between_mm), (0.1, 0.4))]

    assert again(0.05)[1] == 0.0
    assert again(0.05) == pytest.approx(again(-0.1), rel=1e-9)


def test_a_compliant_virtual_rig_shares_the_travel_with_the_relaxed_skin(halfspace: Fingertip) -> None:
    compliance = 0.5
    press = RelaxingPress(halfspace, SHAPE, TERMS, Truth(compliance_mm_per_n=compliance))
    library, pose, at_first_n = InTime(halfspace, SHAPE, Prony(TERMS)), deep(halfspace, 0.4), 0.0
    for step_s in (0.0, 0.5, 0.5):
        force_n = press.moved_to(pose, step_s)
        doi_mm = press.doi_mm(pose)
        assert doi_mm + compliance * force_n == pytest.approx(0.4, abs=1e-6)
        assert force_n == pytest.approx(library.to_depth(step_s, doi_mm).force_n, rel=1e-4)
        at_first_n = at_first_n or force_n
    assert force_n < 0.8 * at_first_n


def test_a_relaxing_rotated_finger_accepts_spheres_only(halfspace: Fingertip) -> None:
    with raises(ModelRangeError, "turned_finger", indentor=SHAPE):
        RelaxingPress(halfspace, SHAPE, TERMS, Truth(turn=Turn(roll_deg=3.0)))


def test_the_plant_advances_a_relaxing_finger_by_the_sample_period(halfspace: Fingertip) -> None:
    clock, at = VirtualClock(), [-0.1]
    steps_per_mm = 1e6

    def steps(t_s: float) -> tuple[int, int, int]:
        return 0, 0, round(steps_per_mm * deep(halfspace, at[0]).above_apex_mm)

    carriage = Carriage(steps, Screws(z_steps_per_mm=steps_per_mm), Placement(0.0, 0.0))
    plant = RelaxingPlant(halfspace, carriage, TERMS, Truth(2.0), clock, PERIOD_S)
    clock.wait_s(1.0)
    assert plant.force_n(1.0) == 0.0, "nothing is mounted"
    plant.mount(SHAPE)
    clock.wait_s(1.01)
    at[0] = 0.3
    press = RelaxingPress(halfspace, SHAPE, TERMS, Truth(2.0))
    for _ in range(4):
        expected = press.moved_to(deep(halfspace, 0.3), PERIOD_S)
        clock.wait_s(PERIOD_S)
        assert plant.force_n(clock.monotonic_s()) == pytest.approx(expected, rel=1e-6)
    assert plant.pose_at(clock.monotonic_s()).doi_mm == pytest.approx(0.3, abs=2e-6)
    plant.mount(SHAPE)
    clock.wait_s(PERIOD_S)
    fresh = RelaxingPress(halfspace, SHAPE, TERMS, Truth(2.0)).moved_to(deep(halfspace, 0.3), PERIOD_S)
    assert plant.force_n(clock.monotonic_s()) == pytest.approx(fresh, rel=1e-6)


# --- ways, in another process ---


def legs(halfspace: Fingertip, *doi_mm: float, step_s: float = PERIOD_S) -> tuple[Leg, ...]:
    return tuple(Leg(step_s, deep(halfspace, depth)) for depth in doi_mm)


def alone(halfspace: Fingertip, way: tuple[Leg, ...]) -> list[float]:
    press = RelaxingPress(halfspace, SHAPE, TERMS)
    return [press.moved_to(leg.pose, leg.step_s) for leg in way]


def test_a_planned_trajectory_that_did_not_happen_is_forgotten(halfspace: Fingertip) -> None:
    going = Going(RelaxingPress(halfspace, SHAPE, TERMS))
    going(TrajectoryUpdate(legs(halfspace, 0.1), legs(halfspace, 0.8, 1.2)))
    came = legs(halfspace, 0.1, 0.15, 0.15)
    assert going(TrajectoryUpdate(came[1:2], came[2:])).forces_n == pytest.approx(
        alone(halfspace, came)[1:], rel=1e-6
    )
    later = Leg(3 * PERIOD_S, deep(halfspace, 0.15))  # the same place, but not the same time
    assert going(TrajectoryUpdate((later,))).forces_n == pytest.approx(
        alone(halfspace, (*came[:2], later))[2:], rel=1e-6
    )


def test_a_trajectory_leg_beyond_the_model_is_reported_and_forgotten(halfspace: Fingertip) -> None:
    going = Going(RelaxingPress(halfspace, SHAPE, TERMS))
    way = (*legs(halfspace, 0.2), Leg(PERIOD_S, deep(halfspace, 2.5)), *legs(halfspace, 0.2))
    answer = going(TrajectoryUpdate(way))
    assert math.isnan(answer.forces_n[1])
    assert "DOI 2.5 mm: must be more than 0 and at most 2 mm" in answer.problem
    assert answer.forces_n[2] == pytest.approx(alone(halfspace, (way[0], way[2]))[1], rel=1e-6)
    assert going(TrajectoryUpdate(legs(halfspace, 0.2))).problem == ""


def test_a_hold_on_a_served_finger_relaxes_in_real_time(finger: Fingertip) -> None:
    """On the wall clock, in a process of its own: pressed at once, the force falls as G while nothing moves."""
    scheduler, height = WallScheduler(), finger.touch_height_mm("bar:3.0", 0.0) - finger.apex_height_mm
    at = [height + 1.0]
    carriage = Carriage(lambda t_s: (0, 0, round(400 * at[0])), Screws(), Placement(0.0, 0.0))
    told: list[str] = []
    process = TrajectoryProcess(FingertipConfig(), "bar:3.0", TERMS)
    ahead = TrajectoryPrefetcher(scheduler, carriage, process, PERIOD_S, told.append)
    try:
        at[0] = height - 0.3
        seen: dict[int, float] = {}

        def enough() -> bool:
            end_s = scheduler.monotonic_s() + PERIOD_S
            while scheduler.monotonic_s() < end_s:
                scheduler.run_once(end_s)
            index = math.floor(scheduler.monotonic_s() / PERIOD_S)
            if ahead.fresh(index * PERIOD_S) and ahead.force_n(index * PERIOD_S) > 0:
                seen[index] = ahead.force_n(index * PERIOD_S)
            return len(seen) > 8

        until(enough)
        series, (first, *later) = Prony(TERMS), sorted(seen)
        # how long before the first it was pressed is not known: between nothing and what the lost samples took
        fallen = [seen[index] / seen[first] for index in later]
        assert fallen == sorted(fallen, reverse=True)
        assert 0.55 < fallen[-1] < float(series.relaxed(0.0))
        assert told == []
    finally:
        ahead.close()
        scheduler.close()
