"""The rig's own compliance: measured on a rigid block, and what it does to a depth."""

import itertools
from collections.abc import Callable
from typing import Any

import pytest

from rig.engine import LimitError, Target, TripError, indent
from rig.engine.pressing.compliance import measure_compliance
from rig.engine.rig_settings import RigSettings

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


@pytest.mark.parametrize("mm_per_n", [0.02, 0.05, 0.2])
@pytest.mark.parametrize("noise_gwt", [0.0, 0.02])
def test_the_truth_lies_within_the_uncertainty(spring: Make, mm_per_n: float, noise_gwt: float) -> None:
    """Three standard deviations; and these are no wider than a tenth of the value, some steps in 1 N."""
    bench = _block(spring, mm_per_n, noise_gwt=noise_gwt)
    found = measure_compliance(bench.ready(), 100.0)
    assert abs(found.mm_per_n - mm_per_n - BLOCK_MM_PER_N) < 3 * found.sd_mm_per_n
    assert found.sd_mm_per_n < 0.1 * mm_per_n
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)


def test_no_step_is_longer_than_the_stages_smallest_near_the_block(spring: Make) -> None:
    """From search_mm above where the block is expected on: 0.0025 mm a move."""
    bench = _block(spring, 0.05)
    measure_compliance(bench.ready(), 100.0)
    heights = [move["Z"] + 25.0 for move in bench.moves() if "Z" in move]
    steps = [a - b for a, b in itertools.pairwise(heights) if b < a < 0.5]
    assert max(steps) <= 0.0025 + 1e-3, "a board prints thousandths"
    assert sum(steps) / len(steps) == pytest.approx(0.0025, abs=1e-4)


def test_a_rig_too_stiff_to_tell(spring: Make) -> None:
    bench = _block(spring, 0.002)
    with pytest.raises(LimitError, match=r"steps of 0\.0025 mm within the force, expected 4"):
        measure_compliance(bench.ready(), 100.0)
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)


def test_no_block(spring: Make) -> None:
    bench = _block(spring, 0.05, top_mm=-3.0)
    with pytest.raises(TripError, match="no block down to -0"):
        measure_compliance(bench.ready(), 100.0)
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)


def test_the_uncertainty_of_a_depth_is_journalled(spring: Make) -> None:
    """0.0025/√12 mm from the step; 0.1 mm/N of uncertainty under some 2.1 gwt, 21 mN, adds 2.1 µm in quadrature."""
    given = {"value": 0.5, "sd": 0.1, "date": "2026-01-01", "expires": "2027-01-01"}
    bench = spring(settings=RigSettings.model_validate({"calibration": {"compliance_mm_per_n": given}}))
    indent(bench.ready(), Target("doi_mm", 0.5), hold_s=0.1)
    (end,) = bench.of("hold_end")
    expected = (0.0025**2 / 12 + (0.1 * end["force_gwt"] * 9.80665e-3) ** 2) ** 0.5
    assert end["doi_sd_mm"] == pytest.approx(expected, abs=2e-6)
    assert end["doi_sd_mm"] > 2e-3
