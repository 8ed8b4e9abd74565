"""The maximum-likelihood fit: against the deviance minimized by brute force; saturating, silent at rest, constant."""

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.fit import fit_rates
from rig.compare.likelihood import Form, MaximumLikelihoodFits, Observed, maximum_likelihood, observed
from rig.compare.recordings.recording import recording

Array = NDArray[np.float64]
EPS = np.linspace(-1, 2, 16)


def seen(rates: Array, window_s: float | None = None) -> Observed:
    rows = [(float(n), float(rate), np.nan) for n, rate in enumerate(rates)]
    return observed([recording("x", rows, window_s)], np.ones(len(rates), dtype=bool))


def counted(mean: Array, seed: int) -> Observed:
    return seen(np.random.default_rng(seed).poisson(2.0 * mean) / 2.0, 2.0)


def brute(eps: Array, given: Observed) -> float:
    """The least deviance over a fine grid of ε₀, each with its k from a fine grid."""
    best = np.inf
    for eps0 in np.linspace(eps.min() - 2, eps.max(), 300):
        k = np.linspace(0.5, 30, 400)
        mean = np.maximum(k[:, None] * (eps - eps0), 0.0)
        best = min(best, float(given.deviance(mean).sum(axis=1).min()))
    return best


@pytest.mark.parametrize("seed", range(4))
def test_counts_are_fitted_by_quasi_likelihood(seed: int) -> None:
    given = counted(np.maximum(12 * (EPS - 0.2), 0), seed)
    found = maximum_likelihood(EPS[None], given, Form())
    assert float(found.total[0]) <= brute(EPS, given) * 1.02 + 0.05
    np.testing.assert_allclose(found.mean[0], np.maximum(found.k[0] * (EPS - found.eps0[0]), 0))


def test_counts_weigh_what_fires_little_more_than_least_squares_do() -> None:
    """Two readings at each of two ε: the line goes through both means, whatever the weights."""
    eps, rates = np.array([1.0, 1.0, 2.0, 2.0]), np.array([3.0, 5.0, 20.0, 30.0])
    found = maximum_likelihood(eps[None], seen(rates, 1.0), Form())
    assert (float(found.k[0]), float(found.eps0[0])) == pytest.approx((21.0, 1 - 4 / 21), rel=1e-6)


def test_rates_alone_are_fitted_by_least_squares() -> None:
    rng = np.random.default_rng(0)
    eps, rates = rng.normal(size=(30, 16)), rng.gamma(2, 5, size=16)
    found, least = maximum_likelihood(eps, seen(rates), Form()), fit_rates(eps, rates)
    np.testing.assert_allclose(found.k, least.k, rtol=1e-9)
    np.testing.assert_allclose(found.total[np.isfinite(least.rss)], least.rss[np.isfinite(least.rss)], rtol=1e-9)


@pytest.mark.parametrize("window_s", [None, 2.0])
def test_a_falling_candidate_has_a_negative_k(window_s: float | None) -> None:
    rates = np.maximum(10 * (EPS - 0.4), 0)
    found = maximum_likelihood(np.stack([EPS, -EPS]), seen(rates, window_s), Form())
    np.testing.assert_allclose(found.k, [10, -10], rtol=1e-3)
    np.testing.assert_allclose(found.eps0, [0.4, -0.4], atol=1e-3)


@pytest.mark.parametrize("window_s", [None, 0.5])
def test_a_candidate_without_a_value_is_a_constant_rate(window_s: float | None) -> None:
    rates = np.array([1.0, 2.0, 9.0])
    found = maximum_likelihood(np.zeros((1, 3)), seen(rates, window_s), Form())
    assert np.isnan(found.k[0])
    np.testing.assert_allclose(found.mean, [[4, 4, 4]])
    np.testing.assert_allclose(found.rates(np.zeros((1, 2))), [[4, 4]])


def test_a_constant_of_unequal_presses_is_their_mean() -> None:
    rows = [(0.0, 2.0, np.nan), (0.0, 4.0, np.nan), (1.0, 9.0, np.nan)]
    given = observed([recording("x", rows, 1.0)], np.ones(2, dtype=bool))
    assert maximum_likelihood(np.zeros((1, 2)), given, Form()).mean[0, 0] == pytest.approx(5.0)


@pytest.mark.parametrize("window_s", [None, 3.0])
def test_rates_that_level_off(window_s: float | None) -> None:
    """40 at most, half of it at a drive of 40."""
    eps = np.linspace(0, 4, 30)
    drive = np.maximum(30 * (eps - 0.5), 0)
    rates = drive / (1 + drive / 40)
    given = seen(rates, window_s)
    line, bent = (
        maximum_likelihood(eps[None], given, Form()),
        maximum_likelihood(eps[None], given, Form(saturating=True)),
    )
    assert (line.saturation[0], Form().parameters, Form(saturating=True).parameters) == (0, 2, 3)
    assert float(bent.saturation[0]) == pytest.approx(1 / 40, rel=0.35)
    assert float(bent.total[0]) < 0.02 * float(line.total[0])
    again = drive_of(bent, eps)
    np.testing.assert_allclose(bent.mean[0], again / (1 + bent.saturation[0] * again))
    np.testing.assert_allclose(bent.rates(eps[None, :3]), bent.mean[:, :3])


def drive_of(found: MaximumLikelihoodFits, eps: Array) -> Array:
    return np.maximum(found.k[0] * (eps - found.eps0[0]), 0)


def test_a_line_is_kept_where_nothing_levels_off() -> None:
    rates = np.maximum(10 * (EPS - 0.4), 0)
    assert maximum_likelihood(EPS[None], seen(rates), Form(saturating=True)).saturation[0] == 0


@pytest.mark.parametrize("window_s", [None, 2.0])
def test_silent_at_rest_keeps_k_and_eps0_from_below_zero(window_s: float | None) -> None:
    eps = np.linspace(0.1, 1, 10)
    given = seen(5 + 10 * eps, window_s)
    free, silent = (maximum_likelihood(eps[None], given, Form(silent_at_rest=kept)) for kept in (False, True))
    assert float(free.eps0[0]) == pytest.approx(-0.5, abs=0.01)
    assert float(silent.eps0[0]) == 0
    assert silent.total[0] > free.total[0]
    falling = maximum_likelihood(-eps[None], given, Form(silent_at_rest=True))
    assert np.isnan(falling.k[0])


@pytest.mark.parametrize("silent", [False, True])
def test_a_rate_at_its_largest_is_fitted_without_a_warning(silent: bool) -> None:
    """Where few places fire, all alike, the drive grows from round to round until rounding makes it infinite."""
    eps = np.array([-1, 1, 2, 56, 398, 512, 121, 4, 0, -1, -1, 0, 1]) / 1000
    given = seen(np.array([0, 0, 0, 1 / 3, 60, 60, 0, 0, 0, 0, 0, 0, 0]), 3.0)
    found = maximum_likelihood(eps[None], given, Form(saturating=True, silent_at_rest=silent))
    assert np.isfinite(found.mean).all()
    assert float(found.mean.max()) < 1 / float(found.saturation[0])
