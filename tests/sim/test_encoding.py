"""Pressure to SED to rates: against the press itself, against numpy's convolution, and noise by its own moments."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.coding.encoding import Noise, Receptor, encode, noise_sd
from sim.coding.operators import ForwardOperator, ImpulseResponses, convolution, impulse_responses, influence
from sim.coding.pressure import contact_pressure
from sim.coding.section import Energy, SampledSection, Sampling, sampled_section, sed_of
from sim.config import FingertipConfig
from sim.measures.measures import Elastic
from tests.sim.coarse_mesh import coarse_mesh

MATERIAL = Elastic(1000.0, 0.48)
SHEAR, LAME = 1000 / 2.96, 1000 * 0.48 / (1.48 * 0.04)


@pytest.fixture(scope="module")
def section() -> SampledSection:
    return sampled_section(FingertipConfig(mesh=coarse_mesh(0.2, 0.5)), Sampling(half_length=18))


@pytest.fixture
def responses() -> ImpulseResponses:
    return ImpulseResponses(np.random.default_rng(3).normal(size=(3, 5)), Sampling(half_length=2), MATERIAL)


@pytest.fixture
def plain() -> ForwardOperator:
    """Three receptors, two pressures: S = (p₀², 4 p₁², (p₀ + p₁)²)."""
    parts = np.array([[[1.0, 0.0], [0.0, 2.0], [1.0, 1.0]]])
    return ForwardOperator("convolution", "incompressible", parts, np.array([0.0, 1.0]), np.arange(3.0))


# --- operators ---


@pytest.mark.parametrize("energy", ["incompressible", "finite"])
def test_the_convolution_operator_agrees_with_numpy_and_rajus_block_diagram(
    responses: ImpulseResponses, energy: Energy
) -> None:
    """Raju (1998), Fig. 6-6, by numpy's own convolution."""
    pressure = np.array([20.0, 14.0, 0.0, 3.0])
    h, g, f = (np.convolve(pressure, response) for response in responses.strain)
    expected = SHEAR * (h**2 + g**2 + f**2 / 2) + (0.5 * LAME * (h + g) ** 2 if energy == "finite" else 0.0)
    operator = convolution(responses, 4, energy)
    assert_allclose(operator.sed(pressure), expected)
    assert len(expected) == 4 + 5 - 1  # M = N + length of h − 1
    assert (operator.name, operator.energy) == ("convolution", energy)
    assert_allclose(operator.place_mm, [-0.255, -0.085, 0.085, 0.255])
    assert_allclose(operator.receptor_mm, 0.17 * (np.arange(8) - 3.5))


def test_slope_and_adjoint_of_an_operator_are_its_derivatives(responses: ImpulseResponses) -> None:
    operator = convolution(responses, 3, "finite")
    pressure, weight, step = np.array([1.0, 2.0, -0.5]), np.arange(7.0), 1e-6
    steps = step * np.eye(3)
    # S is a quadratic, so that central differences are exact but for round-off
    by_hand = np.stack([(operator.sed(pressure + s) - operator.sed(pressure - s)) / (2 * step) for s in steps], 1)
    assert_allclose(operator.slope(pressure), by_hand, rtol=1e-6, atol=1e-3)
    assert_allclose(operator.pulled_back(pressure, weight), weight @ operator.slope(pressure))


@pytest.mark.parametrize("shape", ["cylinder:3", "step:1"])
def test_the_influence_operator_reproduces_the_sed_of_a_press(section: SampledSection, shape: str) -> None:
    """Finite elements twice, by the press and node by node: the same to round-off, lateral forces and all."""
    found = section.finger.indent(shape, 0.3, doi_mm=0.5)
    borne = contact_pressure(section, found)
    operator = influence(section, borne.place_mm, borne.width_mm, "finite")
    true = found.receptor_measures["sed"]
    # a spline of 2001 places stands between a node and its place
    assert_allclose(operator.sed(borne.stacked), true, rtol=1e-7, atol=1e-9 * true.max())
    assert (operator.name, operator.energy) == ("influence", "finite")
    assert_allclose(operator.place_mm, np.tile(borne.place_mm, 2))
    assert_allclose(operator.receptor_mm, section.sampling.place_mm)


def test_under_one_central_load_influence_equals_convolution(section: SampledSection) -> None:
    """One load in the middle: the two operators are the same there, and only there."""
    responses = impulse_responses(section)
    one = influence(section, np.array([0.0]), np.array([0.17]), "incompressible")
    assert_allclose(one.sed(np.array([30.0, 0.0])), convolution(responses, 1, "incompressible").sed(np.array([30.0])))
    aside = influence(section, np.array([0.0]), np.array([0.17]), "incompressible").sed(np.array([0.0, 30.0]))
    assert aside.max() > 0.1 * one.sed(np.array([30.0, 0.0])).max()  # pulled aside it is felt as well


def test_finite_and_incompressible_sed_of_a_press_differ(section: SampledSection) -> None:
    """SCIENCE: they differ by 7 to 19 % in plane strain."""
    found = section.finger.indent("cylinder:9", 0.0, doi_mm=0.5)
    strain = section.line.in_axes(found.receptor_strain, section.line.angles(section.sampling.place_mm))
    finite, source = (sed_of(strain, section.material, energy) for energy in ("finite", "incompressible"))
    assert_allclose(finite, found.receptor_measures["sed"])
    assert 0.02 < 1 - (source / finite).min() < 0.25


# --- receptors and noise ---


def test_added_noise_has_the_requested_signal_to_noise_ratio() -> None:
    signal = np.array([0.0, 2.0, 4.0, 2.0])  # variance 2
    assert noise_sd(signal, 0.0) == pytest.approx(np.sqrt(2.0))
    assert noise_sd(signal, 20.0) == pytest.approx(np.sqrt(0.02))


def test_noise_before_the_receptor_passes_through_it(plain: ForwardOperator) -> None:
    pressure, receptor = np.array([1.0, 2.0]), Receptor(2.0, 3.0)
    found = encode(plain, pressure, receptor, Noise(3.0, "receptor", 7))
    sed = np.array([1.0, 16.0, 9.0])
    sd = noise_sd(sed, 3.0)
    assert_allclose(found.rate, receptor.rate(sed + sd * np.random.default_rng(7).normal(size=3)))
    assert (found.noise_sd, found.share_of_peak) == (pytest.approx(sd), pytest.approx(sd / 16))


def test_noise_at_the_output_is_added_to_the_rate_and_censored(plain: ForwardOperator) -> None:
    pressure, receptor = np.array([1.0, 2.0]), Receptor(2.0, 3.0)
    rate = np.array([0.0, 26.0, 12.0])
    sd = noise_sd(rate, -10.0)
    noisy = rate + sd * np.random.default_rng(0).normal(size=3)
    found = encode(plain, pressure, receptor, Noise(-10.0, "output", 0))
    assert_allclose(found.rate, np.maximum(0.0, noisy))
    assert found.share_of_peak == pytest.approx(sd / 26)
    assert_allclose(found.sed, [1.0, 16.0, 9.0])
