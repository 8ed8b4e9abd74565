"""The least of a deviance and the region about it, on deviances that are known."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.receptor_place import least, region

Array = NDArray[np.float64]

LOW, HIGH, STEPS = np.array([-2.0, 0.5, -0.4]), np.array([2.0, 1.1, 0.4]), np.array([0.05, 0.15, 0.05])
FLAT_LOW, FLAT_HIGH = np.array([-2.0, 0.5, 0.0]), np.array([2.0, 1.1, 0.0])
CENTRE = np.array([0.313, 0.777, -0.123])
SLANTING = np.array([[900.0, 700.0, 300.0], [700.0, 600.0, 200.0], [300.0, 200.0, 400.0]])


def parabola(centre: Array = CENTRE, curved: Array = SLANTING) -> Callable[[Array], Array]:
    return lambda place: np.einsum("ni,ij,nj->n", place - centre, curved, place - centre) + 7


def narrow(place: Array) -> Array:
    """A hole a tenth of a millimetre wide in a plain that leads elsewhere, and a shallower one there."""
    away = ((place - CENTRE) / 0.05) ** 2
    other = ((place - [-1.5, 0.6, 0.3]) / 0.2) ** 2
    return 100 + 5 * place[:, 0] - 90 * np.exp(-away.sum(axis=1)) - 50 * np.exp(-other.sum(axis=1))


def test_the_bottom_of_a_slanting_valley() -> None:
    np.testing.assert_allclose(least(parabola(), LOW, HIGH, STEPS), CENTRE, atol=3e-3)
    flat = least(parabola(np.array([0.313, 0.777, 0.0])), FLAT_LOW, FLAT_HIGH, STEPS)
    np.testing.assert_allclose(flat, [0.313, 0.777, 0.0], atol=2e-3)


def test_a_narrow_hole_is_found_beside_a_wide_one() -> None:
    np.testing.assert_allclose(least(narrow, LOW, HIGH, STEPS), CENTRE, atol=3e-3)


def test_the_least_may_lie_at_an_end() -> None:
    found = least(parabola(np.array([2.5, 0.8, 0.0]), np.diag([100.0, 100.0, 100.0])), LOW, HIGH, STEPS)
    np.testing.assert_allclose(found, [2.0, 0.8, 0.0], atol=2e-3)


@pytest.mark.parametrize("room", [0.5, 2.0, 3.84])
def test_the_region_of_a_parabola_is_an_ellipsoid(room: float) -> None:
    """It reaches as far as the square root of room × the inverse's diagonal."""
    reach = np.sqrt(room * np.diag(np.linalg.inv(SLANTING)))
    low, high = region(parabola(), CENTRE, LOW, HIGH, 7 + room)
    np.testing.assert_allclose(low, CENTRE - reach, rtol=0.03)
    np.testing.assert_allclose(high, CENTRE + reach, rtol=0.03)


def test_what_is_not_free_stays() -> None:
    centre = np.array([0.313, 0.777, 0.0])
    reach = np.sqrt(3.84 * np.diag(np.linalg.inv(SLANTING[:2, :2])))
    low, high = region(parabola(centre), centre, FLAT_LOW, FLAT_HIGH, 7 + 3.84)
    np.testing.assert_allclose(high, [*(centre[:2] + reach), 0], rtol=0.03)
    np.testing.assert_allclose(low, [*(centre[:2] - reach), 0], rtol=0.03)


def test_a_region_ends_at_the_box_and_goes_on_along_it() -> None:
    """The least lies at the deep end; the region is cut there, and as wide in x as on that face."""
    centre, curved = np.array([0.0, 1.1, 0.0]), np.diag([100.0, 100.0, 100.0])
    low, high = region(parabola(centre, curved), centre, FLAT_LOW, FLAT_HIGH, 7 + 4.0)
    assert high[1] == 1.1
    assert low[1] == pytest.approx(0.9, abs=5e-3)
    np.testing.assert_allclose([low[0], high[0]], [-0.2, 0.2], atol=5e-3)


def test_where_nothing_is_known_the_region_is_the_box() -> None:
    low, high = region(lambda place: np.full(len(place), 3.0), CENTRE, LOW, HIGH, 4.0)
    np.testing.assert_array_equal(low, LOW)
    np.testing.assert_array_equal(high, HIGH)
