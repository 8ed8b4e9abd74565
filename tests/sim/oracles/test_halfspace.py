"""Strain inside a half-space under a line load (Flamant) and a point load (Boussinesq), as recovered at receptors."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from studies.verification.halfspace import (
    POISSON,
    boussinesq_strain,
    flamant_strain,
    largest_error,
)
from studies.verification.halfspace import line_load as solved_line_load
from studies.verification.halfspace import point_load as solved_point_load

Array = NDArray[np.float64]
line_load, point_load = cache(solved_line_load), cache(solved_point_load)  # the same boxes serve several tests


def boussinesq_displacement(p: Array) -> Array:
    """(3,) mm at a point (x, y, z), y < 0; Johnson (1985), Eq. 3.18."""
    x, y, z = p
    r, rho, down = np.hypot(x, z), float(np.linalg.norm(p)), -y
    c = (1 + POISSON) / (2 * np.pi)
    lateral = c * (r * down / rho**3 - (1 - 2 * POISSON) * r / (rho * (rho + down)))
    return np.array([lateral * x / r, -c * (down**2 / rho**3 + 2 * (1 - POISSON) / rho), lateral * z / r])


def test_the_boussinesq_strain_is_the_gradient_of_the_boussinesq_displacement() -> None:
    # Central differences of 1e-4 mm: truncation (1e-4 / 0.8)² ~ 1e-8, round-off 1e-12.
    p, h = np.array([0.4, -0.7, 0.3]), 1e-4
    g = np.array(
        [(boussinesq_displacement(p + h * e) - boussinesq_displacement(p - h * e)) / (2 * h) for e in np.eye(3)]
    )
    by_hand = [g[0, 0], g[1, 1], g[2, 2], g[0, 1] + g[1, 0], g[1, 2] + g[2, 1], g[0, 2] + g[2, 0]]
    strain = boussinesq_strain(p[:1], -p[1:2], p[2:])
    np.testing.assert_allclose(strain[0], by_hand, rtol=0, atol=1e-6 * np.abs(by_hand).max())


def test_the_flamant_strain_is_the_boussinesq_strain_summed_along_a_line() -> None:
    # Superposition of point loads over |z| ≤ 400 mm: the rest is of order (0.9 / 400)².
    z = np.sinh(np.linspace(-7, 7, 4001)) * 0.73
    x, depth = np.full_like(z, 0.5), np.full_like(z, 0.75)
    summed = np.trapezoid(boussinesq_strain(x, depth, z), z, axis=0)
    np.testing.assert_allclose(summed, flamant_strain(x[:1], depth[:1])[0], rtol=0, atol=1e-4)


def test_line_load_converges_at_second_order() -> None:
    # Measured at 0.17, 0.085 and 0.0425 mm in a box of 80 mm: 6.0, 1.3 and 0.35 % of the largest strain, the force
    # of one node being 4.5, 9 and 18 elements above. Second order is a factor of 4; 3.5 leaves room for truncation.
    errors = [largest_error(*line_load(h, 80.0)) for h in (0.17, 0.085, 0.0425)]
    assert errors[0] < 0.07, errors
    assert errors[0] / errors[1] > 3.5, errors
    assert errors[1] / errors[2] > 3.5, errors


def test_the_truncation_error_of_a_line_load_falls_with_the_box_size() -> None:
    # With 0.02 mm discretisation leaves 0.1 %. Boxes of 20 and 40 mm miss 0.67 and 0.41 %: first order in depth over
    # size, with a second-order part; extrapolating the two (twice the larger minus the smaller) leaves 0.14 %.
    (small, exact), (large, _) = line_load(0.02125, 20.0), line_load(0.02125, 40.0)
    assert largest_error(small, exact) / largest_error(large, exact) > 1.5
    assert largest_error(2 * large - small, exact) < 0.002


def test_full_integration_errs_more_than_bbar_under_a_line_load() -> None:
    # ν = 0.48; measured 4.0 % against 1.3 %.
    assert largest_error(*line_load(0.085, 40.0, "full")) > 2.5 * largest_error(*line_load(0.085, 40.0, "bbar"))


def test_point_load_strain_converges_with_element_size() -> None:
    # Measured 16.7 % at 0.17 mm and 5.8 % at 0.1 mm of the largest strain, which lies below the load: order 2.
    coarse, fine = (largest_error(*point_load(h, 5.0)) for h in (0.17, 0.1))
    assert fine < 0.07
    assert np.log(coarse / fine) / np.log(1.7) > 1.8


def test_the_truncation_error_of_a_point_load_falls_with_the_box_size() -> None:
    # The change from 5 to 10 mm is 0.35 % of the largest strain, from 10 to 20 mm 0.06 %.
    s5, s10, s20 = (point_load(0.17, size) for size in (5.0, 10.0, 20.0))
    first, second = (largest_error(a[0], b[0]) for a, b in ((s5, s10), (s10, s20)))
    assert second < 0.4 * first
    assert second < 1e-3


@pytest.mark.parametrize("poisson", [0.49, 0.499, 0.4999])
def test_bbar_strain_stays_accurate_towards_incompressibility(poisson: float) -> None:
    # Measured 1.31 % at ν = 0.48, 1.43, 1.63, 1.65 % here; full integration 11, 67, 53 %.
    assert largest_error(*line_load(0.085, 40.0, "bbar", poisson)) < 0.018
    assert largest_error(*line_load(0.085, 40.0, "full", poisson)) > 0.1
