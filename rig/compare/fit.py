"""Least-squares fit of the rate model R = max(0, k(ε − ε₀)), and correlations."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]


class Fit(NamedTuple):
    """k (rate per unit of the measure), ε₀ (unit of the measure) and the sum of squared residuals.

    k is negative if the rate falls as the measure rises. All are NaN if no line is better than a constant.
    """

    k: Array
    eps0: Array
    rss: Array

    @property
    def fires_unloaded(self) -> NDArray[np.bool_]:
        """Whether the model fires at ε = 0; for a positive k, ε₀ < 0."""
        return self.k * self.eps0 < 0


def predicted(fit: Fit, eps: Array) -> Array:
    """Return the rates at ε; fit and ε broadcast."""
    return np.maximum(0.0, fit.k * (eps - fit.eps0))


def fit_rates(eps: Array, rate: Array, weight: Array | None = None, sign: int = 0, *, silent: bool = False) -> Fit:
    """Return the best k and ε₀ for ε (…, n) and non-negative rates (…, n) with weights (…, n), one fit per row.

    `sign` restricts k to that sign; 0 allows both and takes the smaller residual. `silent` requires a rate of zero at
    ε = 0, so that k > 0 and ε₀ ≥ 0.

    The result is exact, not iterative. Points with R > 0 are those of the largest ε, so each number of them has one
    regression line, and the best line that is positive on exactly its own points is the answer. No minimum lies where
    ε₀ passes a point, because a non-negative rate can only pull ε₀ down.
    """
    weight = np.ones_like(eps) if weight is None else weight
    if silent:
        return _silent(eps, rate, weight)
    if sign:
        fit = _rising(sign * eps, rate, weight)
        return Fit(sign * fit.k, sign * fit.eps0, fit.rss)
    up, down = (fit_rates(eps, rate, weight, s) for s in (1, -1))
    better_up = ~(down.rss < up.rss) & ~np.isnan(up.rss)
    return Fit(*(np.where(better_up, a, b) for a, b in zip(up, down, strict=True)))


_TOLERANCE = 1e-9


def _silent(eps: Array, rate: Array, weight: Array) -> Fit:
    """Return the best fit with k > 0 and ε₀ ≥ 0: a line that ends above zero, or the one through the origin."""
    above, up = _rising(eps, rate, weight, 0.0), np.maximum(eps, 0.0)
    square = (weight * up * up).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        k = np.where(square > 0, (weight * up * rate).sum(axis=-1) / square, np.nan)
    k = np.where(k > 0, k, np.nan)
    rss = (weight * (rate - k[..., None] * up) ** 2).sum(axis=-1)
    better = np.isnan(above.rss) | (rss < above.rss)
    origin = Fit(k, np.where(np.isnan(k), np.nan, 0.0), rss)
    return Fit(*(np.where(better, a, b) for a, b in zip(origin, above, strict=True)))


def _rising(eps: Array, rate: Array, weight: Array, least: float = -np.inf) -> Fit:
    """Return the best fit with k > 0 and ε₀ ≥ `least`, from sums over the j largest ε for every j at once."""
    order = np.argsort(-eps, axis=-1, kind="stable")
    scale, centre = np.ptp(eps, axis=-1, keepdims=True), eps.mean(axis=-1, keepdims=True)
    scale = np.where(scale > 0, scale, 1.0)
    e = (np.take_along_axis(eps, order, -1) - centre) / scale
    y, w = _ordered(rate, order), _ordered(weight, order)
    n, se, sy = (np.cumsum(v, axis=-1) for v in (w, w * e, w * y))
    see, sey, syy = (np.cumsum(v, axis=-1) for v in (w * e * e, w * e * y, w * y * y))
    determinant = n * see - se * se
    flat = _TOLERANCE * y.max(axis=-1, keepdims=True)  # a smaller slope is round-off
    next_e = np.concatenate([e[..., 1:], np.full_like(e[..., :1], -np.inf)], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        k = np.where(determinant > _TOLERANCE * n * n, (n * sey - se * sy) / determinant, np.nan)
        eps0 = (se - sy / k) / n
        good = (k > flat) & (eps0 <= e + _TOLERANCE) & (eps0 >= next_e - _TOLERANCE)
        good &= centre + scale * eps0 >= least
        rss = np.where(good, syy[..., -1:] - k * (sey - eps0 * sy), np.inf)
    best = np.argmin(rss, axis=-1)[..., None]
    k, eps0, rss = (np.take_along_axis(v, best, axis=-1)[..., 0] for v in (k, eps0, rss))
    found = np.isfinite(rss)
    scale, centre = scale[..., 0], centre[..., 0]
    return Fit(*(np.where(found, v, np.nan) for v in (k / scale, centre + scale * eps0, np.maximum(rss, 0.0))))


def _ordered(values: Array, order: NDArray[np.int64]) -> Array:
    """Return rows sorted by their own orders; the two broadcast."""
    if order.ndim == 1:
        return values[..., order]
    shape = np.broadcast_shapes(values.shape, order.shape)
    return np.take_along_axis(np.broadcast_to(values, shape), np.broadcast_to(order, shape), -1)


Flags = NDArray[np.bool_]

CONFIDENCE = 0.95
FEWEST_POSITIONS = 5
_COVERED_ENOUGH = 0.8


def correlation(eps: Array, rate: Array) -> Array:
    """Return Pearson's r (18, receptors) of measures (18, p, receptors) and rates (p,), where both are known.

    NaN with fewer than three positions or if one of the two is constant.
    """
    known = ~np.isnan(eps)
    n = known.sum(axis=1)
    y = np.where(known, rate[:, None], 0.0)
    e = np.where(known, eps, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        e = np.where(known, e - (e.sum(axis=1) / n)[:, None], 0.0)
        y = np.where(known, y - (y.sum(axis=1) / n)[:, None], 0.0)
        r = (e * y).sum(axis=1) / np.sqrt((e * e).sum(axis=1) * (y * y).sum(axis=1))
    return np.where((n >= 3) & np.isfinite(r), r, np.nan)


def chance_correlation(positions: int, looked_at: int) -> float:
    """Return the |r| that the largest of `looked_at` random correlations exceeds in 5 % of cases (Bonferroni)."""
    t = float(stdtrit(positions - 2, 1 - (1 - CONFIDENCE) / (2 * looked_at)))
    return t / float(np.sqrt(positions - 2 + t * t))


def compared(eps: Array) -> tuple[Flags, Flags] | None:
    """Return the receptors in play and the positions that all of them cover, or None if these are too few."""
    receptors = in_play(eps)
    common = ~np.isnan(eps[0][:, receptors]).any(axis=1)
    return (receptors, common) if receptors.any() and common.sum() >= FEWEST_POSITIONS else None


def by_pair(eps: Array) -> Array:
    """Reshape SSRPs (…, 18, p, receptors) to (…, 18 × receptors, p)."""
    moved = np.moveaxis(eps, -1, -2)
    return np.ascontiguousarray(moved.reshape(*eps.shape[:-3], -1, eps.shape[-2]))


def in_play(eps: Array) -> Flags:
    """Return (receptors,) flags of receptors that cover 80 % of the recorded positions."""
    return np.asarray((~np.isnan(eps[0])).mean(axis=0) >= _COVERED_ENOUGH)


def fit_all(eps: Array, rate: Array) -> Fit:
    """Return the fit (18, receptors) of every pair over the positions that it covers; NaN below three."""
    values = np.full((3, eps.shape[0], eps.shape[2]), np.nan)
    for j in range(eps.shape[2]):
        known = ~np.isnan(eps[0, :, j])
        if known.sum() >= 3:
            values[:, :, j] = fit_rates(eps[:, known, j], rate[known])
    return Fit(*values)
