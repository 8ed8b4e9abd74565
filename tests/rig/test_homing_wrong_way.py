"""Homing with a z motor that is plugged in the wrong way round, and over a finger that comes up: every stage."""

import pytest

from rig.devices.registry import BUILT_IN
from rig.engine.engine import State
from rig.engine.homing import STEP_MM
from tests.rig.motor_plug import K_GWT, TRIP_GWT, PluggedBench, height_mm

STAGES = BUILT_IN["stage"]
OVERSHOOT_GWT = 0.89
"""What docs/safety_design.md allows beyond a trip."""
TOUCH_GWT = 0.05
HEIGHTS_MM = {"0.2 mm above": 0.2, "1 mm above": 1.0, "at 2 gwt": height_mm(2.0), "at 10 gwt": height_mm(10.0)}
ZEROS = pytest.mark.parametrize("zeroed", [True, False], ids=["zeroed", "unzeroed"])


@pytest.mark.quick(rows=lambda stage, place, zeroed: stage in ("grbl", "zaber") and zeroed == (place != "at 10 gwt"))
@ZEROS
@pytest.mark.parametrize("place", HEIGHTS_MM)
@pytest.mark.parametrize("stage", STAGES)
def test_homing_with_a_reversed_motor_plug_trips_below_the_trip_force_and_takes_back_what_it_pressed(
    stage: str, place: str, zeroed: bool
) -> None:
    bench = PluggedBench(stage, HEIGHTS_MM[place], reversed_plug=True, zeroed=zeroed)
    before_gwt = bench.force_gwt
    homed = bench.home()
    assert homed.code == "homing_wrong_way"
    assert homed.worst_gwt <= TRIP_GWT + OVERSHOOT_GWT
    assert homed.end_gwt < before_gwt + TOUCH_GWT
    assert bench.engine.state is State.TRIPPED
    assert not bench.bench.stage.homed


@pytest.mark.quick(rows=lambda stage: stage in ("grbl", "standa"))
@pytest.mark.parametrize("stage", STAGES)
def test_first_steps_of_homing_press_a_touched_finger_by_at_most_two_steps(stage: str) -> None:
    """The first step, and the one that shows the cause."""
    depth_mm = -height_mm(10.0)
    homed = PluggedBench(stage, -depth_mm, reversed_plug=True, zeroed=True).home()
    assert homed.worst_gwt <= K_GWT * (depth_mm + 2 * STEP_MM + 0.003) ** 1.5


@pytest.mark.quick(rows=lambda stage, place, zeroed: stage in ("grbl", "zaber") and zeroed)
@ZEROS
@pytest.mark.parametrize("place", HEIGHTS_MM)
@pytest.mark.parametrize("stage", STAGES)
def test_homing_lifts_from_any_force(stage: str, place: str, zeroed: bool) -> None:
    """After each controller was switched on, where its limits count from where it stands."""
    bench = PluggedBench(stage, HEIGHTS_MM[place], reversed_plug=False, zeroed=zeroed)
    before_gwt = bench.force_gwt
    homed = bench.home()
    assert (homed.code, homed.end_gwt) == ("", 0.0)
    assert homed.worst_gwt == before_gwt
    assert bench.engine.state is State.READY
    assert bench.bench.stage.homed


@pytest.mark.quick(
    rows=lambda stage, from_s, speed_mm_s: (stage, from_s, speed_mm_s) in (("grbl", 0.9, 2.0), ("zaber", 3.0, 8.0))
)
@pytest.mark.parametrize("speed_mm_s", [2.0, 8.0])
@pytest.mark.parametrize("from_s", [0.3, 0.9, 1.5, 2.1, 2.7, 3.0, 3.3])
@pytest.mark.parametrize("stage", STAGES)
def test_homing_leaves_a_finger_that_comes_up_meanwhile(stage: str, from_s: float, speed_mm_s: float) -> None:
    """By 4 mm, in the first steps or after them. It never presses more than the finger itself does."""
    bench = PluggedBench(stage, 0.2, reversed_plug=False, zeroed=True)
    bench.spring.from_s, bench.spring.by_mm = bench.clock.monotonic_s() + from_s, 4.0
    bench.spring.speed_mm_s = speed_mm_s
    homed = bench.home()
    assert (homed.code, homed.end_gwt) == ("", 0.0)
    assert homed.worst_gwt <= K_GWT * (4.0 - 0.2) ** 1.5
    assert bench.bench.stage.homed


@pytest.mark.quick(rows=lambda stage: stage in ("grbl", "zaber"))
@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_homes_as_soon_as_its_motor_plug_is_put_right(stage: str) -> None:
    """Limits that the first steps have set aside are set again."""
    bench = PluggedBench(stage, 1.0, reversed_plug=True, zeroed=True)
    assert bench.home().code == "homing_wrong_way"
    bench.turn_plug()
    bench.switch_off_and_on()
    assert bench.home().code == ""
    if stage == "grbl":
        assert "$20=1" in bench.bench.board._settings.listing()  # type: ignore[union-attr]
    if stage == "zaber":
        assert bench.bench.board.z.settings["limit.min"] == 0  # type: ignore[union-attr]
