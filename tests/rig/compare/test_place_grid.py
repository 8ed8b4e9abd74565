"""Ranges in which a receptor is sought, nodes, and the splines between them."""

from typing import Any

import numpy as np
import pytest

from rig.compare.exceptions import ComparisonError
from rig.compare.place_grid import PlaceRange, nodes, place_range, spline_weights
from sim.config import FingertipConfig, Tissue
from tests.error_codes import raises


def test_nodes_go_from_end_to_end_in_equal_steps_that_are_small_enough() -> None:
    np.testing.assert_allclose(nodes((-1.0, 1.0), 0.5), [-1, -0.5, 0, 0.5, 1])
    np.testing.assert_allclose(nodes((0.0, 1.0), 0.4), [0, 1 / 3, 2 / 3, 1])
    where = PlaceRange((-2.0, 2.0), (0.5, 1.1))
    np.testing.assert_allclose(where.x_nodes, np.arange(-2, 2.01, 0.125), atol=1e-12)
    np.testing.assert_allclose(where.depth_nodes, [0.5, 0.65, 0.8, 0.95, 1.1])


def test_the_usual_depths_lie_below_the_epidermis() -> None:
    default = place_range((-2.0, 2.0), None, None, FingertipConfig())
    assert default.depth_mm == pytest.approx((0.5, 1.1))
    assert default.offset_mm == (0.0, 0.0)
    thick = place_range((-2.0, 2.0), None, (-0.2, 0.3), FingertipConfig(tissue=Tissue(epidermis_mm=0.6)))
    assert thick.depth_mm == pytest.approx((0.7, 1.3))
    assert thick.offset_mm == (-0.2, 0.3)


def descending(option: str, low_mm: float, high_mm: float) -> dict[str, Any]:
    return {"option": option, "low_mm,high_mm": f"{low_mm:g},{high_mm:g}"}


@pytest.mark.parametrize(
    ("x_mm", "depth_mm", "offset_mm", "code", "fields"),
    [
        ((-1.0, 1.0), (0.3, 0.9), None, "across_epidermis", {"low_mm": 0.3, "high_mm": 0.9, "epidermis_mm": 0.4}),
        ((-1.0, 1.0), (0.9, 0.5), None, "not_ascending", descending("--depth-range-mm", 0.9, 0.5)),
        ((-1.0, 1.0), None, (np.nan, 0.2), "not_ascending", descending("--offset-mm", np.nan, 0.2)),
        ((1.0, 1.0), None, None, "one_receptor_x", {}),
    ],
)
def test_ranges_that_are_none(
    x_mm: tuple[float, float],
    depth_mm: tuple[float, float] | None,
    offset_mm: tuple[float, float] | None,
    code: str,
    fields: dict[str, Any],
) -> None:
    with raises(ComparisonError, code, **fields):
        place_range(x_mm, depth_mm, offset_mm, FingertipConfig())


def test_splines_are_exact_for_cubics_and_at_nodes() -> None:
    at_nodes = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    at = np.array([0.2, 0.5, 1.9])
    found = spline_weights(at_nodes, at) @ (1 + at_nodes - 2 * at_nodes**3)
    np.testing.assert_allclose(found, 1 + at - 2 * at**3, atol=1e-12)
    np.testing.assert_allclose(spline_weights(at_nodes, at_nodes), np.eye(5), atol=1e-12)
