"""Pressures read back from SED: against the truth they were made from, and against scipy on the same cost."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import norm

from sim.coding import bayes
from sim.coding import decoders_by_search as univariate
from sim.coding.bayes import FittedReceptor, ModelError, Profile, decode_profile, decode_through
from sim.coding.decoder_results import DecodingError, decoding_errors, misfit
from sim.coding.decoders_by_search import (
    PressureRange,
    converged_search,
    error_surface,
    global_search,
    grid_search,
    quartic_along,
    table_search,
)
from sim.coding.encoding import Noise, Receptor, encode
from sim.coding.operators import ForwardOperator, convolution, impulse_responses, influence, normal_influence
from sim.coding.pressure import ContactPressure
from sim.coding.receptor_readings import QUIET_SD, Readings, sd_at_rest
from sim.coding.section import ReceptorSection, SampledSection, Sampling, receptor_section, sampled_section, skin_of
from sim.config import FingertipConfig
from sim.errors import ModelRangeError
from sim.measures.receptors import ReceptorError
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

Array = NDArray[np.float64]

TRUE, START, WITHIN = np.array([20.0, 14.0]), np.array([10.0, 10.0]), PressureRange(0.0, 30.0)


@pytest.fixture(scope="module")
def two(section: SampledSection) -> ForwardOperator:
    """Two samples by the project's own h, g, f and the source's Eq. 6.1."""
    return convolution(impulse_responses(section), 2, "incompressible")


@pytest.fixture
def small() -> ForwardOperator:
    """Random parts: six receptors of three pressures."""
    parts = np.random.default_rng(5).normal(size=(2, 6, 3))
    return ForwardOperator("influence", "finite", parts, np.arange(3.0), np.arange(6.0))


# --- what an answer is measured by ---


def test_the_three_decoding_errors_follow_their_formulas() -> None:
    found = decoding_errors(np.array([3.0, 4.0]), np.array([3.0, 2.0]))
    assert found == (pytest.approx(4 / 25), pytest.approx(2 / 5), pytest.approx(np.sqrt(2) / 4))


@pytest.mark.parametrize(
    ("reading", "code", "fields"),
    [
        (np.zeros(5), "not_one_each", {"readings": 5, "receptors": 6}),
        (np.array([0, 0, np.nan, 0, 0, 0]), "not_a_number", {"number": 3}),
        (np.array([0, np.inf, 0, 0, 0, 0]), "not_a_number", {"number": 2, "value": np.inf}),
    ],
)
def test_every_decoder_refuses_malformed_readings(
    small: ForwardOperator, reading: Array, code: str, fields: dict[str, Any]
) -> None:
    for decode in (
        lambda: converged_search(small, reading, np.ones(3), WITHIN),
        lambda: grid_search(small, reading, np.ones(3), WITHIN, 1.0),
        lambda: table_search(small, reading, WITHIN, 10),
        lambda: global_search(small, reading, WITHIN),
        lambda: decode_profile(small, Readings.of_sed(reading, 1.0)),
    ):
        with raises(DecodingError, code, **fields):
            decode()


# --- the source's decoder ---


@pytest.mark.parametrize("k", [0, 1, 2])
def test_the_squared_error_along_one_pressure_is_a_quartic(small: ForwardOperator, k: int) -> None:
    pressure, reading = np.array([1.0, 0.3, 2.0]), np.arange(6.0)
    quartic = quartic_along(small, reading, pressure, k)
    for t in (-0.7, 0.0, 1.9):
        assert np.polyval(quartic, t) == pytest.approx(misfit(small, pressure + t * np.eye(3)[k], reading))


def test_univariate_search_zigzags_to_the_answer_of_rajus_worked_example(two: ForwardOperator) -> None:
    """Raju (1998, §6.7): [20 14] from [10 10]. It prints [24 10] first, on a coarse grid; a half-space gives 23.8."""
    found = converged_search(two, two.sed(TRUE), START, WITHIN)
    assert found.converged
    # what a sweep moves shrinks by less than 1 % each, so that 1e-9 of the range leaves 1e-6 of it
    assert_allclose(found.pressure, TRUE, atol=3e-5)
    assert_allclose(found.path[0], START)
    assert_allclose(found.path[1], [23.93, 10.0], atol=0.05)
    assert_allclose(found.path[2, 0], found.path[1, 0])
    assert len(found.path) > 1000
    assert_allclose(found.path[-1], found.pressure)
    costs = [misfit(two, place, two.sed(TRUE)) for place in found.path[:50]]
    assert (np.diff(costs) <= 0).all()
    assert found.misfit == pytest.approx(0.0, abs=1e-12 * float(two.sed(TRUE) @ two.sed(TRUE)))


@pytest.mark.parametrize(("step", "stuck"), [(3.0, [24.0, 9.0]), (0.01, [21.16, 12.83])])
def test_grid_search_ends_short_of_the_answer_in_a_narrow_valley(
    two: ForwardOperator, step: float, stuck: list[float]
) -> None:
    """SCIENCE: steps of 0.001 of the range stick at [21.4, 12.6] on a half-space."""
    found = grid_search(two, two.sed(TRUE), START, WITHIN, step)
    assert found.converged
    assert_allclose(found.pressure, stuck, atol=0.05)
    assert_allclose(found.pressure / step, np.round(found.pressure / step), atol=1e-9)
    assert (found.pressure != START).any()


def test_a_univariate_search_that_is_cut_off_is_not_converged(
    two: ForwardOperator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(univariate, "MOST_SWEEPS", 3)
    found = converged_search(two, two.sed(TRUE), START, WITHIN)
    assert not found.converged
    assert len(found.path) == 7  # the start, and two moves a sweep


# --- a table, a global optimiser ---


def test_the_table_decoder_returns_the_entry_of_least_misfit(two: ForwardOperator) -> None:
    coarse, fine = (table_search(two, two.sed(TRUE), WITHIN, entries, seed=1) for entries in (10, 3000))
    assert fine.misfit < 0.01 * coarse.misfit
    assert fine.misfit == pytest.approx(misfit(two, fine.pressure, two.sed(TRUE)))
    assert decoding_errors(TRUE, fine.pressure).relative_l2 < 0.1
    again = table_search(two, two.sed(TRUE), WITHIN, 10, seed=1)
    assert (again.pressure == coarse.pressure).all()
    assert (table_search(two, two.sed(TRUE), WITHIN, 10, seed=2).pressure != coarse.pressure).any()
    drawn = np.random.default_rng(1).uniform(0, 30, (10, 2))
    assert (coarse.pressure == min(drawn, key=lambda p: misfit(two, p, two.sed(TRUE)))).all()


def test_global_search_finds_the_true_pressures(two: ForwardOperator) -> None:
    found = global_search(two, two.sed(TRUE), WITHIN, seed=3)
    assert found.converged
    assert_allclose(found.pressure, TRUE, atol=0.02)
    assert (global_search(two, two.sed(TRUE), WITHIN, seed=3).pressure == found.pressure).all()
    assert found.misfit == misfit(two, found.pressure, two.sed(TRUE))


def test_the_error_surface_holds_the_misfit_at_each_pair_of_pressures(two: ForwardOperator) -> None:
    reading, first, second = two.sed(TRUE), np.array([0.0, 1.0, 5.0]), np.array([2.0, 3.0])
    expected = [[misfit(two, np.array([a, b]), reading) for b in second] for a in first]
    assert_allclose(error_surface(two, reading, first, second), expected)


# --- readings ---


def test_decoding_measures_noise_from_receptors_at_rest() -> None:
    assert sd_at_rest(np.array([1.0, 2.0, 3.0])) == pytest.approx(1.0)
    for bad in (np.array([1.0, 2.0]), np.array([1.0, 2.0, np.nan])):
        with raises(DecodingError, "too_few_at_rest", readings=len(bad), fewest=3):
            sd_at_rest(bad)
    with raises(DecodingError, "noise_not_positive", sd=0.0):
        sd_at_rest(np.ones(5))
    with raises(DecodingError, "below_noise", number=2, sed=-3.1):
        Readings.of_sed(np.array([0.0, -3.1]), 0.5)


def test_the_likelihood_is_gaussian_and_censored_where_a_receptor_is_silent() -> None:
    readings = Readings.of_rates(np.array([4.0, 0.0]), Receptor(2.0, 3.0), 0.5)
    assert_allclose(readings.sed, [5.0, 3.0])
    assert readings.silent.tolist() == [False, True]
    sed, step = np.array([5.4, 3.3]), 1e-4
    cost, first, second = readings.cost(sed)
    assert_allclose(cost, [0.5 * 0.8**2, -norm.logcdf(-0.6)])
    above, below = readings.cost(sed + step)[0], readings.cost(sed - step)[0]
    # central differences of step 1e-4: their error is below 1e-6
    assert_allclose(first, (above - below) / (2 * step), rtol=1e-6)
    assert_allclose(second, (above - 2 * cost + below) / step**2, rtol=1e-4)
    far = readings.cost(np.array([5.0, 3.0 + 0.5 * 40]))  # forty sd above a threshold at which it was silent
    assert np.isfinite(far).all()
    assert far[1][1] == pytest.approx(40.025 / 0.5, rel=1e-4)


# --- ours ---


def _profile(two: ForwardOperator, snr_db: float, seed: int, true: Array = TRUE) -> Profile:
    said = encode(two, true, None, Noise(snr_db, seed=seed))
    return decode_profile(two, Readings.of_sed(said.rate, said.noise_sd))


def test_the_bayes_decoder_reaches_the_same_minimum_as_scipy(small: ForwardOperator) -> None:
    true = np.array([2.0, 0.0, 1.0])
    reading = small.sed(true) + 0.3 * np.random.default_rng(1).normal(size=6)
    readings = Readings(reading, 0.3, np.array([False, True, False, False, False, False]))
    penalty = 0.5 * bayes._prior(3)
    found = bayes._fitted(small, readings, penalty, np.ones(3))

    def cost(pressure: Array) -> float:
        return float(readings.cost(small.sed(pressure))[0].sum() + 0.5 * pressure @ penalty @ pressure)

    other = minimize(cost, np.ones(3), bounds=[(0, None)] * 3, tol=1e-14)
    assert found.converged
    assert found.cost == pytest.approx(cost(found.pressure))
    assert found.cost <= other.fun + 1e-7 * abs(other.fun)
    assert_allclose(found.pressure, other.x, atol=2e-3)  # a flat bottom: 1e-7 in cost is 1e-3 in place


def test_bayes_pressures_are_never_negative_and_lie_in_their_band(two: ForwardOperator) -> None:
    true = np.array([12.0, 0.0])
    found = _profile(two, 5.0, 4, true)
    low, high = found.band()
    assert (found.pressure >= 0).all()
    assert (low >= 0).all()
    assert_allclose(high, found.pressure + 1.645 * found.sd)
    assert_allclose(found.band(1.0)[0], np.maximum(0.0, found.pressure - found.sd))


def test_the_bayes_band_widens_with_noise_and_with_model_error(two: ForwardOperator) -> None:
    quiet, loud = (_profile(two, snr, 0) for snr in (40.0, 20.0))
    assert (loud.sd > quiet.sd).all()
    readings = Readings.of_sed(two.sed(TRUE), 1e-4 * two.sed(TRUE).max())
    exact, default, wrong = (
        decode_profile(two, readings, error) for error in (ModelError(0.0), None, ModelError(0.08))
    )
    assert_allclose(exact.pressure, wrong.pressure)
    assert_allclose(wrong.sd**2 - exact.sd**2, 4 * (default.sd**2 - exact.sd**2), rtol=1e-6)
    # one factor on all SED is its root on all pressures: 4 % of SED is 2 % of pressure
    everywhere = decode_profile(two, readings, ModelError(0.04, 1e3))
    assert_allclose(everywhere.sd / TRUE, 0.02, rtol=0.02)


def test_the_bayes_band_covers_two_pressures_as_often_as_stated(two: ForwardOperator) -> None:
    rng, held = np.random.default_rng(6), []
    for seed in range(40):
        true = rng.uniform(5.0, 30.0, 2)
        low, high = _profile(two, 20.0, seed, true).band()
        held.append((low <= true) & (true <= high))
    # 90 % meant; of 80 numbers in pairs 0.9 ± 0.05, and the prior makes it a little more
    assert 0.8 <= np.mean(held) <= 1.0


def test_bayes_beats_the_univariate_search_in_loud_noise(
    two: ForwardOperator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Paired draws of U(0, 30)², to which neither is told, at 0 dB over M = 50 samples: mean of Eq. 6.8."""
    monkeypatch.setattr(univariate, "STAGNANT", 1e-5)  # far below the noise, and quick
    rng, ours, theirs = np.random.default_rng(0), [], []
    for seed in range(12):
        true = rng.uniform(0.0, 30.0, 2)
        said = encode(two, true, None, Noise(0.0, seed=seed))
        ours.append(decoding_errors(true, _profile(two, 0.0, seed, true).pressure).eq_6_8)
        search = converged_search(two, said.rate, START, PressureRange(0.0, 60.0))
        theirs.append(decoding_errors(true, search.pressure).eq_6_8)
    assert np.mean(ours) < 0.7 * np.mean(theirs)


# --- receptors anywhere, receptors that were fitted ---

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
def four() -> ForwardOperator:
    """Four receptors of two pressures, each SED a sum of squares of one part."""
    parts = np.array([[[1.0, 0.5], [0.5, 1.0], [1.0, 1.0], [0.2, 0.9]]])
    return ForwardOperator("influence", "finite", parts, np.arange(2.0), np.arange(4.0))


# --- receptors anywhere ---


def test_scattered_receptors_have_the_strain_of_evenly_spaced_ones(
    sampled: SampledSection, scattered: ReceptorSection
) -> None:
    assert_allclose(scattered.strain_per_node[:, 1], sampled.strain_per_node[:, 0])
    assert_allclose(scattered.place_mm, [1.1, -2.04, 0.4])
    assert scattered.material == sampled.material
    felt = influence(scattered, np.array([0.3]), np.array([0.17]), "finite")
    even = influence(sampled, np.array([0.3]), np.array([0.17]), "finite")
    assert_allclose(felt.receptor_mm, scattered.place_mm)
    assert_allclose(felt.parts[:, 1], even.parts[:, 0])


@pytest.mark.parametrize(("place", "depth"), [(-3.0, 0.5), (0.0, 0.76), (2.0, 1.5), (5.7, 0.3)])
def test_the_skin_place_above_a_point_inverts_the_point_below_a_place(place: float, depth: float) -> None:
    line = skin_of(COARSE)
    x_mm = line.below(line.angles(place), depth)[0, 0]
    assert line.above(x_mm, depth) == pytest.approx(place, abs=1e-5)  # linear in a table of 2001 places


def test_receptors_in_two_layers_are_refused() -> None:
    with raises(ModelRangeError, "several_layers", depths="0.2 … 0.76"):
        receptor_section(COARSE, np.array([0.0, 1.0]), np.array([0.76, 0.2]))
    with raises(ReceptorError, "depth_outside", depth_mm=5.0, low_mm=0.0):
        receptor_section(COARSE, np.array([0.0]), np.array([5.0]))


# --- operators ---


def test_pressures_at_few_places_are_interpolated_linearly(sampled: SampledSection) -> None:
    few = np.array([-1.7, 0.0, 1.7])
    operator = normal_influence(sampled, few, 0.17, "finite")
    fine = np.linspace(-1.7, 1.7, 21)
    as_lines = np.interp(fine, few, [10.0, 30.0, 5.0])
    both = influence(sampled, fine, np.full(21, 0.17), "finite")
    assert_allclose(operator.sed(np.array([10.0, 30.0, 5.0])), both.sed(np.append(as_lines, np.zeros(21))))
    assert_allclose(operator.place_mm, few)
    assert operator.name == "influence"
    assert operator.parts.shape == (4, 25, 3)


def test_sampled_pressures_carry_the_force_of_the_nodes() -> None:
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


def test_noisy_rates_near_zero_count_as_silent() -> None:
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
def test_the_band_includes_the_errors_of_the_receptor_fit(gain_se: float, threshold_se: float, sd: float) -> None:
    found = decode_through(FittedReceptor(Receptor(30.0, 1.0), gain_se, threshold_se), _told(ANSWERS))
    assert_allclose(found.pressure, [10.0])
    assert_allclose(found.sd, [sd])
    assert found.converged


def test_a_relative_error_of_the_gain_halves_in_the_pressures(four: ForwardOperator) -> None:
    """SED is a quadratic of the pressures: R = k S says P to half the relative error of k."""
    true, k = np.array([20.0, 14.0]), 30.0
    rate = k * four.sed(true)

    def decode(receptor: Receptor) -> Profile:
        return decode_profile(four, Readings.of_rates(rate, receptor, 1e-3 * rate.max() / k))

    plain = decode(Receptor(k))
    found = decode_through(FittedReceptor(Receptor(k), gain_se=2.0), decode)
    assert_allclose(found.pressure, plain.pressure)
    assert_allclose(np.sqrt(found.sd**2 - plain.sd**2), true * 2.0 / (2 * k), rtol=0.02)
