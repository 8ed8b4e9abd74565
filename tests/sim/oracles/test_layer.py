"""Layers on a rigid base under a sinusoidal pressure: the transfer function, one layer and skin on dermis."""

import numpy as np
import pytest

from studies.verification.layer import TISSUE, Layer, compliance, layers_compliance, one_layer_compliance

SIXTEEN_ROWS = (Layer(1.0, 1.0, 16),)


@pytest.mark.parametrize("poisson", [0.3, 0.48, 0.4999])
@pytest.mark.parametrize("k", [0.5, 2.0, 10.0])
def test_closed_form_and_propagator_agree_on_one_layer(k: float, poisson: float) -> None:
    # Two derivations; round-off grows as exp(2kH) κ/μ: up to 5e8 · 5e3 · 1e-16 in the worst corner, measured 1e-13.
    closed = one_layer_compliance(k, SIXTEEN_ROWS[0], poisson)
    assert layers_compliance(k, SIXTEEN_ROWS, poisson) == pytest.approx(closed, rel=1e-10)


def test_the_layer_solution_has_its_half_space_and_split_layer_limits() -> None:
    # 2 / (E* k) for a half-space (Johnson 1985, §13.2); kH = 10 leaves exp(−20) · 4 (kH)² ~ 1e-6.
    layer = SIXTEEN_ROWS[0]
    assert one_layer_compliance(10.0, layer, 0.48) == pytest.approx(2 * (1 - 0.48**2) / 10, rel=2e-6)
    halves = (Layer(0.5, 1.0, 8), Layer(0.5, 1.0, 8))
    assert layers_compliance(2.0, halves, 0.48) == pytest.approx(layers_compliance(2.0, (layer,), 0.48), rel=1e-12)


@pytest.mark.parametrize("poisson", [0.3, 0.48, 0.4999])
@pytest.mark.parametrize(("k", "bound"), [(0.5, 1e-3), (2.0, 1e-3), (5.0, 0.01), (10.0, 0.04)])
def test_the_compliance_of_one_layer_agrees_with_the_closed_form(k: float, bound: float, poisson: float) -> None:
    # 16 rows of 1/16 mm; 200, 50, 20 and 10 elements a wavelength. Measured at most 0.07, 0.05, 0.7 and 2.8 %.
    exact = one_layer_compliance(k, SIXTEEN_ROWS[0], poisson)
    assert compliance(k, SIXTEEN_ROWS, poisson, 1 / 16) == pytest.approx(exact, rel=bound)


def test_the_compliance_of_one_layer_converges_at_second_order() -> None:
    # A smooth solution and linear elements: a factor of 4 at each halving, from 1/8 to 1/16 to 1/32 mm.
    exact = one_layer_compliance(5.0, SIXTEEN_ROWS[0], 0.48)
    errors = [abs(compliance(5.0, (Layer(1.0, 1.0, n),), 0.48, 1 / n) / exact - 1) for n in (8, 16, 32)]
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(order, 2.0, atol=0.25)


def test_full_integration_locks_in_a_thin_layer() -> None:
    # ν = 0.4999, kH = 2: measured 0.32 of the exact compliance; B-bar is right to 1e-4.
    exact = one_layer_compliance(2.0, SIXTEEN_ROWS[0], 0.4999)
    assert compliance(2.0, SIXTEEN_ROWS, 0.4999, 1 / 16, "full") < 0.4 * exact


@pytest.mark.parametrize("wavelength_mm", [1.4, 2.8, 5.6, 11.2])
def test_the_compliance_of_skin_on_dermis_converges(wavelength_mm: float) -> None:
    # Three meshes, the first near that of the finger (0.2 mm): second order unless the error is already small.
    # 1 %: the shortest wave has 28 elements of the finest mesh (measured 0.64 %).
    k = 2 * np.pi / wavelength_mm
    exact = layers_compliance(k, TISSUE, 0.48)
    errors = [abs(compliance(k, tuple(c.refined(n) for c in TISSUE), 0.48, 0.4 / n) / exact - 1) for n in (2, 4, 8)]
    assert errors[2] < 0.01, errors
    assert errors[1] < 0.4 * errors[0] or errors[0] < 1e-3, errors
    assert errors[2] < 0.4 * errors[1] or errors[1] < 1e-3, errors
