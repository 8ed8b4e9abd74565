"""Receptors anywhere, noise that differs, receptors that were fitted: against even samples, closed forms, presses."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from sim.coding.bayes import FittedReceptor, Profile, decode_profile, decode_through
from sim.coding.decoder_results import DecodingError
from sim.coding.encoding import Receptor
from sim.coding.operators import ForwardOperator, influence, normal_influence
from sim.coding.pressure import ContactPressure
from sim.coding.receptor_readings import QUIET_SD, Readings
from sim.coding.section import ReceptorSection, SampledSection, Sampling, receptor_section, sampled_section, skin_of
from sim.config import FingertipConfig
from sim.errors import ModelRangeError
from sim.measures.receptors import ReceptorError
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

Decode = Callable[[Receptor], Profile]
COARSE = FingertipConfig(mesh=coarse_mesh(0.3, 0.5))


@pytest.fixture(scope="module")
def sampled() -> SampledSection:
    return sampled_section(COARSE, Sampling(half_length=12))


@pytest.fixture(scope="module")
def scattered() -> ReceptorSection:
    """Three receptors, not in order and at three depths; the second is the sampled section's first."""
    return receptor_section(COARSE, np.array([1.1, -2.04, 0.4]), np.array([0.5, 0.76, 1.4]))


@pytest.fixture
def two() -> ForwardOperator:
    """Four receptors of two pressures, each SED a sum of squares of one part."""
    parts = np.array([[[1.0, 0.5], [0.5, 1.0], [1.0, 1.0], [0.2, 0.9]]])
    return ForwardOperator("influence", "finite", parts, np.arange(2.0), np.arange(4.0))


# --- receptors anywhere ---


def test_receptors_anywhere_feel_what_even_ones_do(sampled: SampledSection, scattered: ReceptorSection) -> None:
    assert_allclose(scattered.strain_per_node[:, 1], sampled.strain_per_node[:, 0])
    assert_allclose(scattered.place_mm, [1.1, -2.04, 0.4])
    assert scattered.material == sampled.material
    felt = influence(scattered, np.array([0.3]), np.array([0.17]), "finite")
    even = influence(sampled, np.array([0.3]), np.array([0.17]), "finite")
    assert_allclose(felt.receptor_mm, scattered.place_mm)
    assert_allclose(felt.parts[:, 1], even.parts[:, 0])


@pytest.mark.parametrize(("place", "depth"), [(-3.0, 0.5), (0.0, 0.76), (2.0, 1.5), (5.7, 0.3)])
def test_the_place_above_a_point_is_where_it_was_put_from(place: float, depth: float) -> None:
    line = skin_of(COARSE)
    x_mm = line.below(line.angles(place), depth)[0, 0]
    assert line.above(x_mm, depth) == pytest.approx(place, abs=1e-5)  # linear in a table of 2001 places


def test_receptors_in_two_layers_are_refused() -> None:
    with raises(ModelRangeError, "several_layers", depths="0.2 … 0.76"):
        receptor_section(COARSE, np.array([0.0, 1.0]), np.array([0.76, 0.2]))
    with raises(ReceptorError, "depth_outside", depth_mm=5.0, low_mm=0.0):
        receptor_section(COARSE, np.array([0.0]), np.array([5.0]))


# --- operators ---


def test_few_pressures_stand_for_lines_between_them(sampled: SampledSection) -> None:
    few = np.array([-1.7, 0.0, 1.7])
    operator = normal_influence(sampled, few, 0.17, "finite")
    fine = np.linspace(-1.7, 1.7, 21)
    as_lines = np.interp(fine, few, [10.0, 30.0, 5.0])
    both = influence(sampled, fine, np.full(21, 0.17), "finite")
    assert_allclose(operator.sed(np.array([10.0, 30.0, 5.0])), both.sed(np.append(as_lines, np.zeros(21))))
    assert_allclose(operator.place_mm, few)
    assert operator.name == "influence"
    assert operator.parts.shape == (4, 25, 3)


def test_pressures_on_samples_carry_the_force_that_the_nodes_bore() -> None:
    borne = ContactPressure(np.array([-0.3, 0.0, 0.3]), np.full(3, 0.3), np.array([6.0, 12.0, 0.0]), np.zeros(3))
    means = borne.means(np.array([-0.375, -0.225, -0.075, 0.075, 0.225]))
    assert_allclose(means, [6.0, 6.0, 12.0, 12.0, 0.0])
    wide = borne.means(np.array([-0.3, 0.3]))  # samples of 0.6 mm: −0.6 … 0 … 0.6
    assert_allclose(wide, [(6 * 0.3 + 12 * 0.15) / 0.6, 12 * 0.15 / 0.6])
    uneven = ContactPressure(
        np.array([-0.3, 0.0, 0.4]), np.array([0.2, 0.4, 0.4]), np.array([6.0, 12.0, 9.0]), np.zeros(3)
    )
    assert_allclose(uneven.means(np.arange(-0.5, 0.8, 0.2)), [0, 6, 12, 12, 9, 9, 0], atol=1e-12)


# --- readings ---


def test_noisy_rates_near_nothing_are_taken_together() -> None:
    receptor, sd = Receptor(2.0, 3.0), 0.5
    rate = np.array([0.0, QUIET_SD * sd, QUIET_SD * sd + 0.01, 8.0])
    readings = Readings.of_noisy_rates(rate, receptor, sd)
    assert readings.silent.tolist() == [True, True, False, False]
    assert_allclose(readings.sed, [3.75, 3.75, 3.0 + 1.51 / 2, 7.0])
    assert readings.sd == 0.25
    # the chance of a rate of 3 sd or less, R = 2 (S − 3) + noise, at a SED above the threshold
    cost, _, _ = readings.cost(np.full(4, 3.6))
    assert_allclose(cost[:2], -norm.logcdf((1.5 - 1.2) / 0.5))
    with raises(DecodingError, "negative_rate", rate=-1.0):
        Readings.of_noisy_rates(np.array([0.0, -1.0]), receptor, sd)
    with raises(DecodingError, "noise_not_positive", sd=0.0):
        Readings.of_noisy_rates(rate, receptor, 0.0)


# --- a receptor that was fitted ---


def _told(pressures: dict[tuple[float, float], float], *, wrong: tuple[float, float] = (0.0, 0.0)) -> Decode:
    def decode(receptor: Receptor) -> Profile:
        key = receptor.gain, receptor.threshold
        one = np.array([pressures[key]])
        return Profile(one, np.array([3.0]), 1.0, 0.0, converged=key != wrong)

    return decode


ANSWERS = {(30.0, 1.0): 10.0, (32.0, 1.0): 9.0, (28.0, 1.0): 17.0, (30.0, 1.5): 26.0, (30.0, 0.5): 2.0}


@pytest.mark.parametrize(
    ("gain_se", "threshold_se", "sd"),
    [(0.0, 0.0, 3.0), (2.0, 0.0, 5.0), (0.0, 0.5, np.hypot(3.0, 12.0)), (2.0, 0.5, 13.0)],
)
def test_a_band_carries_what_the_receptors_errors_move(gain_se: float, threshold_se: float, sd: float) -> None:
    found = decode_through(FittedReceptor(Receptor(30.0, 1.0), gain_se, threshold_se), _told(ANSWERS))
    assert_allclose(found.pressure, [10.0])
    assert_allclose(found.sd, [sd])
    assert found.converged


def test_a_gain_wrong_by_a_share_makes_pressures_wrong_by_half_of_it(two: ForwardOperator) -> None:
    """SED is a quadratic of the pressures: R = k S says P to half the relative error of k."""
    true, k = np.array([20.0, 14.0]), 30.0
    rate = k * two.sed(true)

    def decode(receptor: Receptor) -> Profile:
        return decode_profile(two, Readings.of_rates(rate, receptor, 1e-3 * rate.max() / k))

    plain = decode(Receptor(k))
    found = decode_through(FittedReceptor(Receptor(k), gain_se=2.0), decode)
    assert_allclose(found.pressure, plain.pressure)
    assert_allclose(np.sqrt(found.sd**2 - plain.sd**2), true * 2.0 / (2 * k), rtol=0.02)
