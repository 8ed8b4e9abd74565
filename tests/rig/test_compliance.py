"""The rig's own compliance: measured on a rigid block, and what it does to a depth."""

from collections.abc import Callable
from typing import Any

import pytest
from scipy.stats import linregress

from rig.engine import LimitError, RunAborted, TripError
from rig.engine.engine import State
from rig.engine.reference import measure_compliance
from rig.settings import RigSettings
from rig.units import GWT_N
from tests.error_codes import raises
from tests.rig.plain_bench import PlainBench

Make = Callable[..., Any]
BLOCK_MM_PER_N = 2e-5  # 50 kN/mm: a steel block of some cm


def _block(spring: Make, rig_mm_per_n: float, top_mm: float = 0.1, noise_gwt: float = 0.0) -> Any:
    """A bench on which the rig gives and the block does not; readings with a noise of its own."""
    bench = spring(settings=RigSettings.model_validate({"limits": {"soft_trip_n": 5.0}}))
    wobble = iter([noise_gwt * (-1) ** n for n in range(100_000)])

    def force_n(t_s: float) -> float:
        height_mm = bench.board.carriage_steps_at(t_s)[2] / 400 - bench.settings.frame.apex_z_mm
        way_mm = max(top_mm - height_mm, 0.0)
        pressed_n = way_mm / (rig_mm_per_n + BLOCK_MM_PER_N)
        return pressed_n and pressed_n + next(wobble) * 9.80665e-3

    bench.force_n = force_n
    return bench


@pytest.mark.parametrize(("mm_per_n", "noise_gwt"), [(0.02, 0.0), (0.2, 0.02)])
def test_the_true_compliance_lies_within_three_sd_of_the_measured_one(
    spring: Make, mm_per_n: float, noise_gwt: float
) -> None:
    """Three standard deviations; and these are no wider than a tenth of the value, some steps in 1 N."""
    bench = _block(spring, mm_per_n, noise_gwt=noise_gwt)
    found = measure_compliance(bench.ready(), 100.0)
    assert abs(found.mm_per_n - mm_per_n - BLOCK_MM_PER_N) < 3 * found.sd_mm_per_n
    assert found.sd_mm_per_n < 0.1 * mm_per_n
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)


# --- to the letter, on a bench without a wire ---

PER_STEP_N = 0.05  # of a rig of 0.05 mm/N under a step of 0.0025 mm


def _steps_block(
    off_n: Callable[[int], float] = lambda step: 0.0,
    top_mm: float = 0.1,
    settings: dict[str, Any] | None = None,
) -> PlainBench:
    def felt(bench: PlainBench) -> float:
        steps = round((top_mm - bench.height_mm) / 0.0025)
        return (steps * PER_STEP_N + off_n(steps)) / GWT_N if steps > 0 else 0.0

    bench = PlainBench(felt, settings or {})
    bench.ready()
    return bench


@pytest.mark.parametrize(("to_n", "readings"), [(0.94, 16), (0.44, 8), (0.69, 12)])
def test_compliance_is_fitted_to_readings_of_at_least_a_fifth_of_the_force(to_n: float, readings: int) -> None:
    """19 steps of 0.05 N to 0.95 N, the first three below 0.19 N: n equal steps, the last where the force is reached.

    A step of the stage is known to 0.0025 mm / √12, and n of them with 0.05 N between them spread by
    0.05 N · √(n (n² - 1) / 12).
    """
    bench = _steps_block()
    found = measure_compliance(bench.engine, to_n / GWT_N)
    n = readings
    assert found.readings == n
    assert found.mm_per_n == pytest.approx(0.05, rel=1e-5)
    assert found.sd_mm_per_n == pytest.approx(0.0025 / (0.05 * (n * (n * n - 1)) ** 0.5), rel=1e-4)
    assert bench.height_mm == pytest.approx(2.0)
    assert bench.engine.state is State.READY


def test_the_uncertainty_of_the_compliance_is_that_of_a_regression_where_readings_scatter() -> None:
    bench = _steps_block(lambda step: 0.04 * (-1) ** step)
    found = measure_compliance(bench.engine, 0.44 / GWT_N)
    readings = [(height, force) for height, force in bench.readings("compliance") if force > 0.2 * 0.44 / GWT_N]
    line = linregress([force * GWT_N for _, force in readings], [height for height, _ in readings])
    assert found.readings == len(readings)
    assert found.mm_per_n == pytest.approx(-line.slope, rel=1e-4)
    assert found.sd_mm_per_n == pytest.approx(line.stderr, rel=1e-4)


@pytest.mark.parametrize(("to_n", "readings"), [(0.19, 4), (0.14, 3)])
def test_measuring_compliance_needs_four_steps_within_the_force(to_n: float, readings: int) -> None:
    bench = _steps_block()
    if readings >= 4:
        assert measure_compliance(bench.engine, to_n / GWT_N).readings == readings
    else:
        with raises(LimitError, "too_few_steps", steps=3, step_mm=0.0025, fewest=4):
            measure_compliance(bench.engine, to_n / GWT_N)
    assert bench.height_mm == pytest.approx(2.0)


def test_the_rigid_block_is_approached_by_increments_over_the_search_range_of_a_finger() -> None:
    """limits.search_mm above and below where it should be; single steps in between."""
    bench = _steps_block(top_mm=-3.0, settings={"limits": {"search_mm": 0.481}})
    with raises(TripError, "no_block", lowest_mm=-0.481):
        measure_compliance(bench.engine, 5.0)
    heights = [height for height, _ in bench.readings("compliance")]
    assert heights[:31] == pytest.approx([2.0 - 0.05 * k for k in range(1, 32)])
    assert heights[31:] == pytest.approx([0.45 - 0.0025 * k for k in range(1, 373)])


def test_an_operator_stops_the_compliance_measurement_between_two_steps() -> None:
    bench = _steps_block()
    bench.goes_on = False
    bench.wants_pause = lambda: len(bench.readings("compliance")) >= 40
    with raises(RunAborted, "stopped_at_a_safe_point"):
        measure_compliance(bench.engine, 50.0)
    assert len(bench.readings("compliance")) == 40
    assert bench.height_mm == pytest.approx(2.0)
