"""k, ε₀ and the finger fitted together, on profiles that are known functions of the finger."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.fit import fit_all, fit_rates
from rig.compare.plausible_fingers import design_places, fit_all_with_finger, fit_with_finger, weights

Array = NDArray[np.float64]

X = np.linspace(-2, 2, 30)


def profile(centre: float, width: float) -> Array:
    return np.exp(-(((X - centre) / width) ** 2))


def on_design(place: Array, which: int) -> Array:
    """(…, p) measures number `which`; quadratic in both parameters, so that interpolation is exact."""
    u, v = place[..., 0, None], place[..., 1, None]
    shifted, wide = profile(0.4 + 0.3 * which, 0.7), profile(-0.6, 0.5 + 0.2 * which)
    return shifted * (1 + 0.3 * u) + wide * (0.3 * v + 0.1 * u * v) + 0.05 * v * v * X


def design(measures: int = 2) -> Array:
    """(9, measures, p)."""
    return np.stack([on_design(design_places(2), which) for which in range(measures)], axis=1)


def test_weights_interpolate_quadratics_exactly() -> None:
    places = np.random.default_rng(0).uniform(-1, 1, size=(20, 2))
    np.testing.assert_allclose(weights(places).sum(axis=1), 1.0, rtol=1e-12)
    found = np.einsum("nf,fp->np", weights(places), design()[:, 1])
    np.testing.assert_allclose(found, on_design(places, 1), atol=1e-12)
    np.testing.assert_allclose(weights(design_places(2)), np.eye(9), atol=1e-12)


@pytest.mark.parametrize("place", [(0.35, -0.62), (-1.0, -1.0)])
@pytest.mark.parametrize("k", [40.0, -30.0])
def test_a_finger_without_noise_is_found(place: tuple[float, float], k: float) -> None:
    eps = on_design(np.array(place), 0)
    eps0 = float(np.quantile(eps, 0.4))
    found = fit_with_finger(design(1), np.maximum(0, k * (eps - eps0)))
    np.testing.assert_allclose(found.place[0], place, atol=2e-3)
    assert float(found.fit.k[0]) == pytest.approx(k, rel=2e-3)
    assert float(found.fit.eps0[0]) == pytest.approx(eps0, rel=2e-3)
    np.testing.assert_allclose(found.eps[0], eps, atol=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_no_grid_of_fingers_does_better(seed: int) -> None:
    """Rates of a finger within the ranges and noise, fitted by measures that are not the truth, too."""
    rng = np.random.default_rng(seed)
    truth = on_design(rng.uniform(-1, 1, size=2), 0)
    rate = rng.poisson(np.maximum(0, 40 * (truth - 0.2)), size=(3, len(X))).mean(axis=0)
    found = fit_with_finger(design(3), rate)
    places = np.array(list(itertools.product(np.linspace(-1, 1, 21), repeat=2)))
    grid = fit_rates(np.einsum("nf,fmp->nmp", weights(places), design(3)), rate).rss.min(axis=0)
    assert (found.fit.rss <= grid * (1 + 1e-3)).all()
    assert (np.abs(found.place) <= 1).all()


def test_a_finger_that_is_known_gives_the_ordinary_fit() -> None:
    rng = np.random.default_rng(3)
    eps = rng.normal(size=(18, 12, 4))
    eps[:, :3, 1], eps[:, 2:, 2] = np.nan, np.nan
    rate = rng.random(12)
    place, found = fit_all_with_finger(eps[None], rate)
    assert place.shape == (18, 4, 0)
    np.testing.assert_array_equal(np.array(found), np.array(fit_all(eps, rate)))


def test_rates_that_nothing_explains_have_no_fit() -> None:
    assert np.isnan(fit_with_finger(design(2), np.full(len(X), 3.0)).fit.k).all()
