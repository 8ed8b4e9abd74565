"""Correlations, chance, and which receptors and positions are compared, on profiles made by hand."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from rig.compare.fit import chance_correlation, compared, correlation, fit_all, in_play

Array = NDArray[np.float64]

X = np.linspace(-2, 2, 25)


def bump(centre: float, width: float) -> Array:
    return np.exp(-(((X - centre) / width) ** 2))


def test_correlation_is_pearson_s_where_both_are_known() -> None:
    rng = np.random.default_rng(0)
    eps, rate = rng.normal(size=(2, 9, 3)), rng.random(9)
    eps[:, 6:, 1] = np.nan
    eps[:, 2:, 2] = np.nan
    eps[1, :, 0] = 5.0
    r = correlation(eps, rate)
    assert r[0, 0] == pytest.approx(np.corrcoef(eps[0, :, 0], rate)[0, 1])
    assert r[1, 1] == pytest.approx(np.corrcoef(eps[1, :6, 1], rate[:6])[0, 1])
    assert np.isnan(r[:, 2]).all()  # two positions
    assert np.isnan(r[1, 0])  # does not vary


def test_a_constant_recording_correlates_with_nothing() -> None:
    assert np.isnan(correlation(np.random.default_rng(0).normal(size=(1, 9, 1)), np.full(9, 3.0))).all()


def test_the_largest_of_many_unrelated_correlations() -> None:
    """White noise: the bound is exceeded in 5 % of recordings, a little less for Bonferroni; 600 draws, ± 3 sd."""
    rng = np.random.default_rng(1)
    bound = chance_correlation(positions=12, looked_at=40)
    exceeded = [
        np.abs(correlation(rng.normal(size=(40, 12, 1)), rng.normal(size=12))).max() > bound for _ in range(600)
    ]
    assert 0.023 < np.mean(exceeded) < 0.077


def test_the_chance_of_one_unrelated_correlation_beyond_the_bound_is_its_share() -> None:
    """Exactly: (1 + r)/2 of n unrelated normal pairs has a beta distribution with n/2 − 1 twice."""
    bound, half = chance_correlation(positions=9, looked_at=180), 9 / 2 - 1
    beyond = 2 * stats.beta.sf((1 + bound) / 2, half, half)
    assert beyond == pytest.approx(0.05 / 180, rel=1e-6)


def test_receptors_that_cover_too_little_do_not_compete() -> None:
    eps = np.stack([bump(0.3, 0.7), bump(-0.8, 0.7)])[:, :, None].repeat(2, axis=2)
    eps[:, :10, 1] = np.nan
    np.testing.assert_array_equal(in_play(eps), [True, False])
    which = compared(eps)
    assert which is not None
    np.testing.assert_array_equal(which[0], [True, False])
    assert which[1].all()
    rate = np.maximum(0, 60 * (eps[0, :, 0] - 0.2))
    assert np.isfinite(fit_all(eps, rate).k[0, 1])  # it is fitted over what it covers all the same


def test_too_few_positions_say_nothing() -> None:
    assert compared(bump(0.3, 0.7)[None, :5, None]) is not None
    assert compared(bump(0.3, 0.7)[None, :4, None]) is None
