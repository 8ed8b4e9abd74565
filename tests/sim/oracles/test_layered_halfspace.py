"""How SED falls off under a point load: on a half-space, under a stiff layer, and what elements make of it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.coding.point_loaded_finger import energy_density as pseudo_energy
from sim.coding.power_law import fitted
from sim.measures.measures import Elastic
from studies.verification.halfspace import boussinesq_strain
from studies.verification.layer import Layer
from tests.sim.oracles.layered_halfspace import BELOW, SKIN, energy_density, on_elements, strain_below

Array = NDArray[np.float64]
DEPTH_MM = 0.76


def square(half_width_mm: float) -> tuple[Array, Array]:
    """x and z, 0.17 mm apart, about the load and not on its axis."""
    steps = np.arange(-half_width_mm, half_width_mm + 1e-9, 0.17)
    x, z = np.meshgrid(steps, steps)
    return x.ravel() + 1e-6, z.ravel()


@pytest.mark.parametrize(("poisson", "expected"), [(0.4999, 6.0), (0.48, 6.05)])
@pytest.mark.parametrize("kind", ["linear", "logarithmic"])
@pytest.mark.parametrize("half_width_mm", [1.0, 2.0])
def test_sed_on_a_half_space_falls_with_the_sixth_power_of_distance(
    poisson: float, expected: float, kind: str, half_width_mm: float
) -> None:
    # Boussinesq's stress is radial where the tissue keeps its volume: SED ~ depth² / r⁶. Exact to 1 %.
    x, z = square(half_width_mm)
    strain = boussinesq_strain(x, np.full_like(x, DEPTH_MM), z, poisson)
    law = fitted(np.sqrt(x**2 + z**2 + DEPTH_MM**2), pseudo_energy(strain, np.ones(len(x)), poisson), kind)  # type: ignore[arg-type]
    assert law.m == pytest.approx(expected, rel=0.01)
    assert law.r2 > 0.999


def test_a_layer_as_soft_as_the_half_space_changes_no_strain() -> None:
    x, z = square(1.5)
    material = Elastic(BELOW, 0.48)
    layered = strain_below(np.hypot(x, z), DEPTH_MM, Layer(0.4, BELOW, 1), material)
    exact = boussinesq_strain(x, np.full_like(x, DEPTH_MM), z, 0.48) / BELOW
    # 400 wave numbers up to e⁻²⁰: quadrature and cut are below 1e-6 of the largest strain
    invariants = layered[:, 0] + layered[:, 1], layered[:, 2], layered[:, 3] ** 2
    expected = exact[:, 0] + exact[:, 2], exact[:, 1], exact[:, 3] ** 2 + exact[:, 4] ** 2
    for found, right in zip(invariants, expected, strict=True):
        np.testing.assert_allclose(found, right, rtol=0, atol=1e-6 * np.abs(right).max())
    e11, e33, e13 = exact[:, 0], exact[:, 2], exact[:, 5]
    apart = np.hypot(e11 - e33, e13)
    np.testing.assert_allclose(np.abs(layered[:, 0] - layered[:, 1]), apart, rtol=0, atol=1e-6 * apart.max())


@pytest.mark.parametrize(("half_width_mm", "linear", "logarithmic"), [(1.0, 3.82, 3.92), (1.25, 3.86, 4.08)])
def test_sed_under_a_stiff_epidermis_falls_with_about_the_fourth_power(
    half_width_mm: float, linear: float, logarithmic: float
) -> None:
    # An epidermis of 0.4 mm, ten times stiffer: 3.82–3.86 by a linear fit, 3.9–4.2 by a logarithmic one, by range.
    x, z = square(half_width_mm)
    material = Elastic(BELOW, 0.48)
    sed = energy_density(strain_below(np.hypot(x, z), DEPTH_MM, SKIN, material), material)
    r = np.sqrt(x**2 + z**2 + DEPTH_MM**2)
    assert fitted(r, sed, "linear").m == pytest.approx(linear, abs=0.01)
    assert fitted(r, sed, "logarithmic").m == pytest.approx(logarithmic, abs=0.01)


def test_the_sed_exponent_on_elements_converges_with_element_size() -> None:
    # Measured 3.69 at 0.17 mm and 3.81 at 0.1 mm where 3.87 and 3.88 are exact: a force on one node is the worst.
    missed = []
    for spacing in (0.17, 0.1):
        x, z, strain, depth = on_elements(spacing, 8.0, 0.48)
        r = np.sqrt(x**2 + z**2 + depth**2)
        material = Elastic(BELOW, 0.48)
        exact = energy_density(strain_below(np.hypot(x, z), depth, SKIN, material), material)
        found = pseudo_energy(strain, np.full(len(x), BELOW), 0.48)
        missed.append(fitted(r, exact, "linear").m - fitted(r, found, "linear").m)
    assert 0.15 < missed[0] < 0.22
    assert missed[0] / missed[1] > 2.0
