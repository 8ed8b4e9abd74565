"""Correlations, intervals and sets, on profiles made by hand; studies.accuracy.interval_coverage has the finger's."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from rig.compare import fit
from rig.compare.fit import chance_correlation, correlation, fit_all, in_play, indistinguishable, interval, not_worse

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


def covered(with_repeats: bool, draws: int) -> tuple[float, float]:
    """Shares of draws in which k and ε₀ lie in their intervals."""
    rng = np.random.default_rng(2)
    eps, k, eps0 = bump(0.3, 0.8) - 0.4 * bump(-1, 0.5), 55.0, 0.15
    mean = np.maximum(0, k * (eps - eps0))
    hits = np.zeros(2)
    for _ in range(draws):
        counts = rng.poisson(mean, size=(5, len(X))).T.astype(float)
        repeats = list(counts) if with_repeats else [row.mean(keepdims=True) for row in counts]
        found = interval(eps, repeats, np.zeros(len(X), dtype=int), 1)
        assert found.over == ("repeats" if with_repeats else "positions")
        hits += [found.k[0] <= k <= found.k[1], found.eps0[0] <= eps0 <= found.eps0[1]]
    return float(hits[0] / draws), float(hits[1] / draws)


def test_intervals_over_repeats_cover_as_they_say() -> None:
    """95 % nominal; 150 draws have a standard error of 1.8 %, so 0.89 is 3.3 of them below."""
    assert min(covered(with_repeats=True, draws=150)) > 0.89


def test_intervals_over_positions_cover_less() -> None:
    """Measured at 0.83–0.98 (docs/comparison_quality.md); 0.75 is two standard errors of 100 draws below that."""
    k, eps0 = covered(with_repeats=False, draws=100)
    assert min(k, eps0) > 0.75


def test_the_same_recording_gives_the_same_interval() -> None:
    repeats = [np.array([1.0, 3.0]), np.array([4.0, 5.0]), np.array([9.0, 8.0]), np.array([0.0, 0.0])]
    eps = np.array([0.2, 0.5, 0.9, 0.0])
    assert interval(eps, repeats, np.zeros(4, dtype=int), 1) == interval(eps, repeats, np.zeros(4, dtype=int), 1)


def test_a_line_that_one_point_carries_has_limits_or_none() -> None:
    """One rate above zero, the next at it: nothing to take a slope from in most draws, and no warning."""
    eps = np.array([0.9, 0.8, 0.5, 0.2, 0.1])
    repeats = [np.array([6.0, 9.0]), *(np.zeros(2) for _ in range(4))]
    found = interval(eps, repeats, np.zeros(5, dtype=int), 1)
    assert np.isnan(found.k).all() or found.k[0] <= 75 <= found.k[1]


def test_intervals_widen_with_noise_and_hold_the_estimate() -> None:
    eps = np.linspace(0, 1, 12)
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(12, 6))
    mean = np.maximum(0, 50 * (eps - 0.3))[:, None]
    quiet, loud = (interval(eps, list(np.maximum(mean + s * noise, 0)), np.zeros(12, dtype=int), 1) for s in (0.5, 3))
    assert loud.k[1] - loud.k[0] > 3 * (quiet.k[1] - quiet.k[0])
    assert quiet.k[0] < 50 < quiet.k[1]


def test_intervals_over_few_repeats_are_wider_as_welch_s_t_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two positions: k is a difference of two means y, with 2 and with 7 repeats, and ε₀ = −y₀/(y₁ − y₀)."""
    few, many = np.array([20.0, 26.0]), np.array([50.0, 53.0, 47.0, 55.0, 49.0, 52.0, 46.0])
    asked = (np.array([0.0, 1.0]), [few, many], np.zeros(2, dtype=int), 1)
    found = interval(*asked)
    monkeypatch.setattr(fit, "_stretch", lambda variance, freedom: 1.0)
    plain = interval(*asked)
    variance = np.array([few.var(ddof=1) / 2, many.var(ddof=1) / 7])
    assert wider(found.k, plain.k) == pytest.approx(t_over_normal(stats.ttest_ind(few, many, equal_var=False).df))
    weighted = variance * np.array([many.mean(), few.mean()]) ** 2
    freedom = weighted.sum() ** 2 / (weighted**2 / np.array([1, 6])).sum()
    assert wider(found.eps0, plain.eps0) == pytest.approx(t_over_normal(freedom))


def wider(one: tuple[float, float], other: tuple[float, float]) -> float:
    return (one[1] - one[0]) / (other[1] - other[0])


def t_over_normal(freedom: float) -> float:
    return float(stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975))


def test_no_limits_where_one_draw_in_four_has_no_fit() -> None:
    """Of two repeats 0 and 9 a quarter of the draws is 0 twice: silence everywhere, no line."""
    found = interval(np.array([1.0, 0.0]), [np.array([0.0, 9.0]), np.zeros(2)], np.zeros(2, dtype=int), 1)
    assert np.isnan([*found.k, *found.eps0]).all()


def test_a_resampled_mean_is_never_below_silence() -> None:
    """Of 0 and 1 the mean 0.5 is spread by √2 to −0.21; a rate below zero would leave no line for a quarter."""
    repeats = [np.array([10.0, 10.0]), np.array([0.0, 1.0]), np.zeros(2)]
    found = interval(np.array([2.0, 1.0, 0.0]), repeats, np.zeros(3, dtype=int), 1)
    assert np.isfinite([*found.k, *found.eps0]).all()


def test_resampled_repeats_spread_as_their_mean_does() -> None:
    """k of a line through two exact points and a repeated one: its bootstrap spread is the repeats' s/√m."""
    repeats = [np.array([10.0, 10.0]), np.array([50.0, 56.0, 47.0])]
    low, high = interval(np.array([0.0, 1.0]), repeats, np.zeros(2, dtype=int), 1).k
    s = np.std(repeats[1], ddof=1) / np.sqrt(3)
    # the limits of three repeats lie on a lattice, of 27 draws with a few distinct means: a tenth is what it can miss
    assert high - low == pytest.approx(2 * stats.t.ppf(0.975, 2) * s, rel=0.1)


def profiles() -> Array:
    """(3, 25, 1): a truth, one that is the truth by another name, and one that is something else."""
    truth = bump(0.3, 0.7)
    return np.stack([truth, 2 - 3 * truth, bump(-0.8, 0.7)])[:, :, None]


def test_collinear_measures_cannot_be_told_apart_and_others_can() -> None:
    rng = np.random.default_rng(3)
    eps = profiles()
    rate = rng.poisson(np.maximum(0, 60 * (eps[0, :, 0] - 0.2)), size=(5, 25)).mean(axis=0)
    flags = indistinguishable(eps, rate)
    assert flags is not None
    np.testing.assert_array_equal(flags[:, 0], [True, True, False])


def test_the_truth_stays_in_the_set() -> None:
    """Nearly collinear rivals; at least 95 % of 300 draws is asked, 99 % was measured on the finger's profiles."""
    rng = np.random.default_rng(4)
    rivals = [bump(0.3 + d, 0.7 + w) for d in (-0.1, 0, 0.1) for w in (-0.1, 0, 0.1)]
    eps = np.stack(rivals)[:, :, None]
    mean = np.maximum(0, 40 * (rivals[4] - 0.2))
    kept = 0
    for _ in range(300):
        flags = indistinguishable(eps, rng.poisson(mean, size=(3, 25)).mean(axis=0))
        assert flags is not None
        kept += int(flags[4, 0])
    assert kept >= 0.95 * 300


@pytest.mark.parametrize("level", [0.01, 0.025])
def test_not_worse_is_a_one_sided_t_test_on_the_differences(level: float) -> None:
    rng = np.random.default_rng(5)
    residual, best = rng.exponential(size=(2000, 6)), rng.exponential(0.3, size=6)
    p = stats.ttest_1samp(residual - best, 0.0, axis=1, alternative="greater").pvalue
    np.testing.assert_array_equal(not_worse(residual, best, level), p >= level)
    assert 0.1 < np.mean(p >= level) < 0.99


def test_receptors_that_cover_too_little_do_not_compete() -> None:
    eps = np.concatenate([profiles(), profiles()], axis=2)
    eps[:, :10, 1] = np.nan
    rate = np.maximum(0, 60 * (eps[0, :, 0] - 0.2))
    np.testing.assert_array_equal(in_play(eps), [True, False])
    flags = indistinguishable(eps, rate)
    assert flags is not None
    assert not flags[:, 1].any()
    assert np.isfinite(fit_all(eps, rate).k[0, 1])  # it is fitted over what it covers all the same


def test_too_few_positions_say_nothing() -> None:
    assert indistinguishable(profiles()[:, :4], np.arange(4.0)) is None
