"""Pressures within contacts: prior, evidence, climb, mixtures and the table of imagined pressures."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.stats import multivariate_normal, norm, truncnorm

from sim.coding.bayes import decode_profile
from sim.coding.contact_search import (
    KINDS,
    ContactInterval,
    ContactPrior,
    Model,
    PressureLikelihood,
    PressurePosterior,
    Sort,
    alone,
    climbed,
    linearised,
    neighbours,
    sort_of,
)
from sim.coding.decoder_results import decoding_errors
from sim.coding.encoding import noise_sd
from sim.coding.model_averaging import Mixture, cut_off, imagined, mixed, pooled, together
from sim.coding.operators import ForwardOperator, centred
from sim.coding.pressure import Frictionless
from sim.coding.receptor_readings import Readings

Array = NDArray[np.float64]

BLUNT, SHARP = KINDS.index(ContactPrior(0.7, 0.2, 0.2)), KINDS.index(ContactPrior(0.7, 0.2, 2.0))
TWO: Model = (ContactInterval(0, 2, BLUNT), ContactInterval(4, 7, SHARP))


@pytest.fixture
def seven() -> PressureLikelihood:
    """Five readings of seven samples whose true pressures lie within samples 2 … 4."""
    rng = np.random.default_rng(2)
    slope = rng.normal(size=(5, 7))
    true = 40.0 * np.array([0, 0, 0.5, 1.0, 0.6, 0, 0])
    return linearised(slope, slope @ true + rng.normal(size=5), np.eye(5), 40.0)


# --- evidence and posterior ---


def test_the_log_evidence_of_a_contact_model_agrees_with_scipy() -> None:
    """Against scipy, in the readings' own space: but for the constant of the normal density, nothing is left out."""
    rng = np.random.default_rng(0)
    slope, value, root = rng.normal(size=(9, 7)), 30 * rng.normal(size=9), rng.normal(size=(9, 9))
    noise, typical = root @ root.T + np.eye(9), 25.0
    models: list[Model] = [
        (ContactInterval(1, 4, 3),),
        TWO,
        (ContactInterval(0, 1, 0), ContactInterval(2, 3, 1), ContactInterval(5, 6, 11)),
    ]
    found = linearised(slope, value, noise, typical).log_evidence(models)
    for model, evidence in zip(models, found, strict=True):
        mean, prior = _of(model)
        density = multivariate_normal(slope @ mean * typical, noise + typical**2 * slope @ prior @ slope.T)
        places = sum(contact.log_prior - np.log(28) for contact in model)  # 28 places of a contact in 7 samples
        assert evidence == pytest.approx(density.logpdf(value) + 4.5 * np.log(2 * np.pi) + places)


def test_the_posterior_of_pressures_is_the_gaussian_of_linear_readings(seven: PressureLikelihood) -> None:
    models: list[Model] = [(ContactInterval(2, 5, BLUNT),), TWO]
    found = seven.posterior(models)
    means, variances = found.over(7)
    for k, model in enumerate(models):
        before, prior = _of(model)
        on = np.diag(prior) > 0
        inside, size = np.ix_(on, on), int(on.sum())
        covariance = np.linalg.inv(np.linalg.inv(prior[inside]) + seven.precision[inside])
        assert_allclose(found.covariance[k, :size, :size], covariance, atol=1e-9)
        left = seven.towards - seven.precision @ before
        assert_allclose(means[k, on], before[on] + covariance @ left[on])
        assert_allclose(variances[k, on], np.diag(covariance))
        assert not means[k, ~on].any()
        assert not variances[k, ~on].any()


def _of(model: Model) -> tuple[Array, Array]:
    mean, prior = np.zeros(7), np.zeros((7, 7))
    for contact in model:
        mean[contact.samples] = contact.mean
        prior[contact.samples, contact.samples] = contact.covariance
    return mean, prior


# --- the climb ---


def test_the_model_search_ends_at_the_highest_evidence_of_its_kind(seven: PressureLikelihood) -> None:
    climb = climbed(seven, alone(7), 3)
    assert climb.at_top
    (top,) = climb.best(1)
    evidence = climb.known[top]
    assert evidence == max(climb.known.values())
    assert evidence >= seven.log_evidence(list(neighbours(top, 7))).max()
    assert (top[0].first, top[0].stop) == (2, 5)
    blunt = climbed(
        seven, [(ContactInterval(0, 2, BLUNT),), (ContactInterval(0, 2, SHARP),)], sort=Sort(1, sharp=False)
    )
    assert {sort_of(model) for model in blunt.known} == {Sort(1, sharp=False)}
    assert blunt.at_top


# --- what is not negative ---


def test_one_truncated_pressure_has_the_moments_of_the_truncated_normal() -> None:
    mean, covariance, above = cut_off(np.array([[-1.0, 9.0]]), np.array([np.diag([4.0, 1.0])]))
    exact = truncnorm(0.5, np.inf, -1.0, 2.0)
    assert_allclose(mean, [[exact.mean(), 9.0]])
    assert_allclose(covariance, [np.diag([exact.var(), 1.0])], atol=1e-12)
    assert above[0] == pytest.approx(norm.logcdf(-0.5))


def test_correlated_truncated_pressures_agree_with_sampling() -> None:
    """Against samples: two pressures of which one is mostly negative and pulls the other with it.

    Each is cut off once, so that what the second cut does to the first is missed: some 10 % of an sd.
    """
    mean, covariance = np.array([-0.5, 2.0, 5.0]), np.array([[1.0, -0.9, 0.0], [-0.9, 1.5, 0.0], [0.0, 0.0, 0.01]])
    drawn = np.random.default_rng(1).multivariate_normal(mean, covariance, 200_000)
    kept = drawn[(drawn >= 0).all(axis=1)]
    found, spread, above = cut_off(mean[None], covariance[None])
    assert_allclose(found[0], kept.mean(axis=0), atol=0.08)
    assert_allclose(np.sqrt(np.diag(spread[0])), kept.std(axis=0), atol=0.07)
    assert above[0] == pytest.approx(np.log(len(kept) / len(drawn)), abs=0.05)


# --- mixtures ---


def test_the_moments_and_quantiles_of_a_mixture_are_exact() -> None:
    mixture = Mixture(
        np.log([3.0, 1.0]) - 500.0, np.array([[2.0, 0.0], [6.0, 5.0]]), np.array([[1.0, 0.0], [1.0, 2.0]])
    )
    assert_allclose(mixture.weight, [0.75, 0.25])
    mean, sd = mixture.moments()
    assert_allclose(mean, [3.0, 1.25])
    assert_allclose(sd**2, [1 + 0.75 * 1 + 0.25 * 9, 0.25 * 4 + 0.75 * 1.25**2 + 0.25 * 3.75**2])
    for share in (0.1, 0.6, 0.9):
        at = mixture.quantile(share)[0]
        assert 0.75 * norm.cdf(at - 2) + 0.25 * norm.cdf(at - 6) == pytest.approx(share)
    assert mixture.quantile(0.7)[1] == pytest.approx(0.0, abs=1e-9)  # three quarters lie outside all contacts
    assert norm.cdf((mixture.quantile(0.9)[1] - 5) / 2) == pytest.approx(0.6)


def test_contact_models_are_weighted_by_evidence_and_probability_of_positive_pressure(
    seven: PressureLikelihood,
) -> None:
    good, bad, far = (ContactInterval(2, 5, BLUNT),), (ContactInterval(0, 2, BLUNT),), (ContactInterval(5, 7, BLUNT),)
    mixture = mixed(seven, {good: -1.0, bad: -2.0, far: -90.0})
    assert len(mixture.log_weight) == 2
    found = seven.posterior([good, bad])
    inside, covariances, above = cut_off(found.mean, found.covariance)
    means, variances = PressurePosterior(found.at, inside, covariances).over(7)
    assert_allclose(mixture.log_weight, np.array([-1.0, -2.0]) + above)
    assert_allclose(mixture.mean, 40.0 * means)
    assert_allclose(mixture.sd**2, 1600.0 * variances, atol=1e-9)
    both = together([mixture, mixture])
    assert_allclose(both.moments()[0], mixture.moments()[0])
    assert both.mean.shape == (4, 7)


# --- simulated pressures ---

PLACES = centred(39, 0.17)


def _said(operator: ForwardOperator, true: Array, snr_db: float, seed: int) -> Readings:
    sed = operator.sed(true)
    sd = noise_sd(sed, snr_db)
    return Readings.of_sed(sed + sd * np.random.default_rng(seed).normal(size=len(sed)), sd)


def _contacts(pressure: Array) -> Array:
    """How many runs of samples above 0 each has."""
    on = np.concatenate([np.zeros((len(pressure), 1)), pressure > 0], axis=1)
    return np.asarray((np.diff(on, axis=1) > 0).sum(axis=1))


def test_simulated_pressures_have_one_to_three_contacts_and_are_never_negative() -> None:
    drawn = imagined(4000, 39)
    assert drawn.shape == (4000, 39)
    assert (drawn >= 0).all()
    assert (drawn.max(axis=1) > 0).all()
    assert set(_contacts(drawn)) == {1, 2, 3}
    assert (imagined(50, 39) == imagined(50, 39)).all()
    assert (imagined(50, 39, seed=1) != imagined(50, 39)).any()


# --- beside a search ---


def test_pooling_two_mixtures_shares_the_probability() -> None:
    one = Mixture(np.array([-700.0]), np.array([[2.0, 0.0]]), np.array([[1.0, 0.0]]))
    two = Mixture(np.log([3.0, 1.0]), np.array([[4.0, 4.0], [8.0, 0.0]]), np.ones((2, 2)))
    both = pooled(one, two, 0.2)
    assert_allclose(both.weight, [0.2, 0.6, 0.2])
    assert_allclose(both.moments()[0], [0.4 + 2.4 + 1.6, 2.4])
    assert_allclose(pooled(one, two, 0.0).weight, [0.0, 0.75, 0.25], atol=1e-200)


@pytest.fixture
def flat() -> Array:
    """Contact of 2 mm."""
    return np.where(np.abs(PLACES) < 1, 300.0, 0.0)


def test_the_pressure_band_always_contains_the_decoded_pressure(operator: Frictionless, flat: Array) -> None:
    """Though the mean of a mixture can lie outside its quantiles: where one model in a hundred has a contact."""
    rare = Mixture(np.log([0.99, 0.01]), np.array([[0.0], [500.0]]), np.array([[0.0], [1.0]]))
    mean, sd = rare.moments()
    assert rare.quantile(0.95)[0] < mean[0]
    found = decode_profile(operator, _said(operator, flat, 20.0, 0))
    said = replace(found, pressure=mean, sd=sd, mixture=rare)
    assert_allclose(said.band(), [[0.0], [5.0]], atol=1e-9)
    for one in (found, decode_profile(operator, _said(operator, flat, 5.0, 0))):
        low, high = one.band()
        assert (low <= one.pressure).all()
        assert (one.pressure <= high).all()


@pytest.mark.parametrize("snr_db", [0.0, 10.0])
@pytest.mark.parametrize("peak", [0.0, 900.0])
def test_pressure_bands_cover_the_truth_in_loud_noise_with_and_without_corners(
    operator: Frictionless, flat: Array, snr_db: float, peak: float
) -> None:
    """90 % told; over six draws three quarters are asked for."""
    edges = np.flatnonzero(flat)[[0, -1]]
    true = flat.copy()
    true[edges] += peak
    found = [decode_profile(operator, _said(operator, true, snr_db, seed)) for seed in range(6)]
    held = [(low <= true) & (true <= high) for low, high in (one.band() for one in found)]
    assert np.mean(np.array(held)[:, flat > 0]) > 0.75
    assert np.mean([decoding_errors(true, one.pressure).relative_l2 for one in found]) < 0.85
