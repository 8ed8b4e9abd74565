"""R = max(0, k(ε − ε₀)) by least squares, exactly."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rig.compare.fit import fit_rates, predicted

Array = NDArray[np.float64]

EPS = np.array([0.1, 0.5, 0.2, 0.9, 0.7, 0.3, 0.0, 0.6])


@pytest.mark.parametrize(("k", "eps0"), [(40.0, 0.25), (40.0, -0.5), (-30.0, 0.65), (1e-6, 0.1), (3e7, 0.25)])
def test_a_line_without_noise_is_found(k: float, eps0: float) -> None:
    fit = fit_rates(EPS, np.maximum(0.0, k * (EPS - eps0)))
    assert float(fit.k) == pytest.approx(k, rel=1e-9)
    assert float(fit.eps0) == pytest.approx(eps0, rel=1e-9)
    assert float(fit.rss) == pytest.approx(0.0, abs=1e-12 * k * k)
    assert bool(fit.fires_unloaded) is (k * eps0 < 0)


@settings(max_examples=25, deadline=None)
@given(st.integers(4, 20), st.integers(0, 2**32 - 1))
def test_no_search_does_better(n: int, seed: int) -> None:
    """Against a local search from a grid of starts, in both signs."""
    rng = np.random.default_rng(seed)
    eps = rng.normal(size=n)
    rate = rng.poisson(np.maximum(0, rng.normal() * 8 * (eps - rng.normal()))) + rng.random(n) * (rng.random() < 0.5)
    assume((rate > 0).sum() > 1)
    fit = fit_rates(eps, rate)
    assert float(fit.rss) == pytest.approx(float(((predicted(fit, eps) - rate) ** 2).sum()), rel=1e-6, abs=1e-9)

    def residual(p: Array) -> Array:
        return np.maximum(0.0, p[0] * (eps - p[1])) - rate

    starts = [(k, e) for k in (-20.0, -3.0, 3.0, 20.0) for e in (-1.5, 0.0, 1.5)]
    found = min(2 * least_squares(residual, start).cost for start in starts)
    assert float(fit.rss) <= found * (1 + 1e-6) + 1e-9


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_weight_counts_as_so_many_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rate = rng.poisson(10 * EPS).astype(float)
    weight = rng.integers(0, 4, size=len(EPS))
    assume(np.count_nonzero(rate[weight > 0]) > 2)
    weighted = fit_rates(EPS, rate, weight.astype(float), sign=1)
    repeated = fit_rates(np.repeat(EPS, weight), np.repeat(rate, weight), sign=1)
    assert float(weighted.rss) == pytest.approx(float(repeated.rss), rel=1e-6, abs=1e-9, nan_ok=True)
    # Of fits with the same sum of squares, either may be found.
    for fit in (weighted, repeated):
        left = float((weight * (predicted(fit, EPS) - rate) ** 2).sum())
        assert left == pytest.approx(float(weighted.rss), rel=1e-6, abs=1e-9, nan_ok=True)


def test_rows_are_fitted_apart() -> None:
    rates = np.array([np.maximum(0, 10 * (EPS - 0.2)), np.maximum(0, -5 * (EPS - 0.8)), np.zeros(len(EPS))])
    fit = fit_rates(EPS, rates)
    np.testing.assert_allclose(fit.k, [10, -5, np.nan], rtol=1e-9)
    np.testing.assert_allclose(fit.eps0, [0.2, 0.8, np.nan], rtol=1e-9)


@pytest.mark.parametrize(("eps", "rate"), [(EPS, np.full(8, 3.0)), (np.ones(8), EPS)])
def test_nothing_better_than_a_constant_is_no_fit(eps: Array, rate: Array) -> None:
    assert np.isnan(np.array(fit_rates(eps, rate))).all()


def test_scale_and_origin_of_the_measure_are_free() -> None:
    rate = np.array([1.0, 7, 2, 14, 9, 3, 0, 8])
    plain, shifted = fit_rates(EPS, rate), fit_rates(1e6 * EPS + 3e6, rate)
    assert float(shifted.k) == pytest.approx(float(plain.k) / 1e6, rel=1e-9)
    assert float(shifted.eps0) == pytest.approx(1e6 * float(plain.eps0) + 3e6, rel=1e-9)


def test_silent_at_rest_is_the_best_of_what_is_allowed() -> None:
    """Against every k and ε₀ ≥ 0 of a fine grid; half of the fits end at the origin."""
    rng = np.random.default_rng(7)
    eps, weight = rng.normal(0.5, 0.5, size=(40, 9)), rng.uniform(0.5, 2, size=9)
    rate = np.maximum(0, 8 * (eps - rng.uniform(-0.8, 0.8, size=(40, 1)))) + rng.random((40, 9))
    found = fit_rates(eps, rate, weight, silent=True)
    assert (found.k > 0).all()
    assert (found.eps0 >= 0).all()
    assert 5 < (found.eps0 == 0).sum() < 35
    for row, y, rss in zip(eps, rate, found.rss, strict=True):
        k, eps0 = np.meshgrid(np.linspace(0.1, 40, 200), np.linspace(0, row.max(), 80))
        left = (weight * (y - np.maximum(0, k[..., None] * (row - eps0[..., None]))) ** 2).sum(axis=-1)
        assert rss <= left.min() * (1 + 1e-9)


def test_silent_at_rest_has_no_fit_where_nothing_rises() -> None:
    eps = np.array([[-3.0, -2.0, -1.0], [1.0, 2.0, 3.0]])
    found = fit_rates(eps, np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]), silent=True)
    assert np.isnan(found.k).all()
    assert np.isnan(found.eps0).all()
