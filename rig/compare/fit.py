"""Fit the rate model R = max(0, k(ε − ε₀)) by least squares, with correlations and intervals."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

Array = NDArray[np.float64]


class Fit(NamedTuple):
    """k (rate per unit of the measure), ε₀ (unit of the measure) and the sum of squared residuals.

    k is negative where the rate falls as the measure rises. All NaN where no line explains more than a constant.
    """

    k: Array
    eps0: Array
    rss: Array

    @property
    def fires_unloaded(self) -> NDArray[np.bool_]:
        """Whether the model fires at ε = 0: for a positive k, whether ε₀ is negative."""
        return self.k * self.eps0 < 0


def predicted(fit: Fit, eps: Array) -> Array:
    """Rates at ε; fit and ε broadcast."""
    return np.maximum(0.0, fit.k * (eps - fit.eps0))


def fit_rates(eps: Array, rate: Array, weight: Array | None = None, sign: int = 0, *, silent: bool = False) -> Fit:
    """The best k and ε₀ for ε (…, n) and non-negative rates (…, n), with weights (…, n), one fit for each row.

    `sign` restricts k to that sign; 0 takes whichever leaves the smaller residual. `silent`: at ε = 0, so that k > 0
    and ε₀ ≥ 0.

    Exact, not iterative: the points with R > 0 are those of the largest ε, so each number of them has one regression
    line, and the best line that is positive on just its own points is the answer. No minimum lies where ε₀ passes a
    point, because a non-negative rate can only pull ε₀ down.
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
    """k > 0 and ε₀ ≥ 0: the best line that ends above zero, or the one through the origin."""
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
    """k > 0, ε₀ ≥ `least`. Row sums over the j largest ε, for every j at once."""
    order = np.argsort(-eps, axis=-1, kind="stable")
    scale, centre = np.ptp(eps, axis=-1, keepdims=True), eps.mean(axis=-1, keepdims=True)
    scale = np.where(scale > 0, scale, 1.0)
    e = (np.take_along_axis(eps, order, -1) - centre) / scale
    y, w = _ordered(rate, order), _ordered(weight, order)
    n, se, sy = (np.cumsum(v, axis=-1) for v in (w, w * e, w * y))
    see, sey, syy = (np.cumsum(v, axis=-1) for v in (w * e * e, w * e * y, w * y * y))
    determinant = n * see - se * se
    flat = _TOLERANCE * y.max(axis=-1, keepdims=True)  # a slope below this is round-off
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
    """Rows in an order of their own; the two broadcast."""
    if order.ndim == 1:
        return values[..., order]
    shape = np.broadcast_shapes(values.shape, order.shape)
    return np.take_along_axis(np.broadcast_to(values, shape), np.broadcast_to(order, shape), -1)


Flags = NDArray[np.bool_]

CONFIDENCE = 0.95
DRAWS = 1000
SET_LEVEL = 0.01
"""One-sided level at which a pair counts as worse than the best. On the right finger 2.5 % would do; at 1 % the truth
stays in the set in 95 % of draws on average when the finger is another one, too (docs/comparison_quality.md)."""

FEWEST_POSITIONS = 5
_COVERED_ENOUGH = 0.8


class Interval(NamedTuple):
    """Confidence limits of k and ε₀, and what was resampled; NaN where a limit does not exist."""

    k: tuple[float, float]
    eps0: tuple[float, float]
    over: Literal["repeats", "positions"]


def correlation(eps: Array, rate: Array) -> Array:
    """Pearson's r (18, receptors) of measures (18, p, receptors) and rates (p,), where both are known.

    NaN with fewer than three positions or where one of the two does not vary.
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
    """The |r| that the largest of `looked_at` unrelated correlations exceeds in 5 % of recordings (Bonferroni)."""
    t = float(stdtrit(positions - 2, 1 - (1 - CONFIDENCE) / (2 * looked_at)))
    return t / float(np.sqrt(positions - 2 + t * t))


def interval(eps: Array, repeats: list[Array], shape_of: NDArray[np.int64], sign: int) -> Interval:
    """Bootstrap limits for one measure at one receptor, ε (n,) and the rates of each of n positions.

    Over repeats, within each position, where every position has two or more; otherwise over positions, within each
    shape, which covers less often than it says (docs/comparison_quality.md). Percentiles of `DRAWS` draws, one seed.
    """
    rng = np.random.default_rng(0)
    if min(len(rates) for rates in repeats) > 1:
        return _over_repeats(eps, repeats, sign, rng)
    weight = np.zeros((DRAWS, len(eps)))
    for shape in np.unique(shape_of):
        mine = np.flatnonzero(shape_of == shape)
        weight[:, mine] = rng.multinomial(len(mine), np.full(len(mine), 1 / len(mine)), size=DRAWS)
    rate = np.broadcast_to([rates.mean() for rates in repeats], weight.shape)
    draws = fit_rates(eps, rate, weight, sign=sign)
    return Interval(_limits(draws.k), _limits(draws.eps0), "positions")


def _over_repeats(eps: Array, repeats: list[Array], sign: int, rng: np.random.Generator) -> Interval:
    """Percentiles, set wider where few repeats carry the estimate: as Student's t is wider than the normal."""
    rate = np.array([rates.mean() for rates in repeats])
    spread = np.array([rates.var(ddof=1) / len(rates) for rates in repeats])
    freedom = np.array([len(rates) - 1 for rates in repeats])
    means = np.stack([_resampled_means(rates, rng) for rates in repeats], axis=1)
    draws, best = fit_rates(eps, np.maximum(means, 0.0), sign=sign), fit_rates(eps, rate, sign=sign)
    stretch = [_stretch(influence**2 * spread, freedom) for influence in _influence(eps, rate, best)]
    return Interval(
        _limits(draws.k, float(best.k), stretch[0]), _limits(draws.eps0, float(best.eps0), stretch[1]), "repeats"
    )


def _resampled_means(rates: Array, rng: np.random.Generator) -> Array:
    """(DRAWS,) means of resampled repeats, spread by √(m / (m − 1)), by which a bootstrap's spread is too small."""
    m = len(rates)
    means = rng.choice(rates, size=(DRAWS, m)).mean(axis=1)
    return np.asarray(rates.mean() + np.sqrt(m / (m - 1)) * (means - rates.mean()))


def _influence(eps: Array, rate: Array, fit: Fit) -> tuple[Array, Array]:
    """(n,) derivatives of k and ε₀ by each rate, on the line through the points that fire; zero without one."""
    fires = predicted(fit, eps) > 0
    if len(np.unique(eps[fires])) < 2:
        return np.zeros_like(eps), np.zeros_like(eps)
    e = np.where(fires, eps - eps[fires].mean(), 0.0)
    of_k = e / (e @ e)
    of_eps0 = rate[fires].mean() / fit.k**2 * of_k - np.where(fires, 1 / (fit.k * fires.sum()), 0.0)
    return of_k, of_eps0


def _stretch(variance: Array, freedom: NDArray[np.int64]) -> float:
    """t over normal quantile at the degrees of freedom of a sum of estimated variances (Satterthwaite 1946)."""
    total = variance.sum()
    if total == 0:
        return 1.0
    level = (1 + CONFIDENCE) / 2
    return float(stdtrit(total**2 / (variance**2 / freedom).sum(), level) / ndtri(level))


def _limits(values: Array, best: float = 0.0, stretch: float = 1.0) -> tuple[float, float]:
    found = values[np.isfinite(values)]
    if len(found) < CONFIDENCE * len(values):
        return (np.nan, np.nan)
    low, high = np.quantile(found, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return best + stretch * float(low - best), best + stretch * float(high - best)


def indistinguishable(eps: Array, rate: Array) -> Flags | None:
    """(18, receptors) flags of the pairs whose fit is not worse than the best one's; None with too few positions.

    Vuong's test (1989) on squared residuals at the positions that all receptors in play cover. eps is
    (18, p, receptors), rate (p,).
    """
    which = compared(eps)
    if which is None:
        return None
    receptors, common = which
    pairs = by_pair(eps[:, common][:, :, receptors])
    residual = squared_residuals(fit_rates(pairs, rate[common]), pairs, rate[common])
    flags = np.zeros((len(eps), len(receptors)), dtype=bool)
    best = residual[np.argmin(residual.sum(axis=1))]
    flags[:, receptors] = not_worse(residual, best, SET_LEVEL).reshape(len(eps), -1)
    return flags


def compared(eps: Array) -> tuple[Flags, Flags] | None:
    """Receptors in play, and the positions that all of them cover; None where these are too few."""
    receptors = in_play(eps)
    common = ~np.isnan(eps[0][:, receptors]).any(axis=1)
    return (receptors, common) if receptors.any() and common.sum() >= FEWEST_POSITIONS else None


def by_pair(eps: Array) -> Array:
    """(…, 18 × receptors, p) of SSRPs (…, 18, p, receptors)."""
    moved = np.moveaxis(eps, -1, -2)
    return np.ascontiguousarray(moved.reshape(*eps.shape[:-3], -1, eps.shape[-2]))


def not_worse(residual: Array, best: Array, level: float) -> Flags:
    """(N,) which squared residuals (N, p) are not significantly above the best one's (p,), by Vuong's test."""
    worse = residual - best
    n = worse.shape[-1]
    limit = stdtrit(n - 1, 1 - level) * worse.std(axis=-1, ddof=1) / np.sqrt(n)
    return np.asarray(worse.mean(axis=-1) <= limit)


def in_play(eps: Array) -> Flags:
    """(receptors,) those that cover 80 % of the recorded positions."""
    return np.asarray((~np.isnan(eps[0])).mean(axis=0) >= _COVERED_ENOUGH)


def squared_residuals(fit: Fit, eps: Array, rate: Array) -> Array:
    """(N, p) of fits (N,) to SSRPs (N, p); of the mean where no fit beats it."""
    rates = predicted(Fit(fit.k[:, None], fit.eps0[:, None], fit.rss), eps)
    return np.asarray((rate - np.where(np.isnan(rates), rate.mean(), rates)) ** 2)


def fit_all(eps: Array, rate: Array) -> Fit:
    """The fit (18, receptors) of every pair, over the positions that it covers; NaN below three."""
    values = np.full((3, eps.shape[0], eps.shape[2]), np.nan)
    for j in range(eps.shape[2]):
        known = ~np.isnan(eps[0, :, j])
        if known.sum() >= 3:
            values[:, :, j] = fit_rates(eps[:, known, j], rate[known])
    return Fit(*values)
