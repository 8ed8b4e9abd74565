"""The likelihood of a recording under the rate model: its noise, and the maximum-likelihood parameters.

Counts are quasi-Poisson: variance = dispersion × mean, with a free dispersion. Half a spike is added to observed and
expected counts at each position (as Jeffreys's prior does), so that a spike where a model is silent is costly but not
infinitely so. Rates with an sd are normal; rates alone are normal with one variance for all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import xlogy

from rig.compare.fit import Fit, fit_rates, predicted
from rig.compare.recordings.recording import Recording
from rig.compare.verdict import RecordingNoise

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FEWEST_REPEATED = 3
"""Degrees of freedom within positions from which the noise is estimated from repeats."""

FEWEST_SPIKES = 5
"""Number of spikes in all windows together from which measures are compared, as for a χ² test (Cochran 1954)."""

_HALF_A_SPIKE = 0.5
_LEAST_NOISE = 1e-6  # relative to the largest rate, so that data without noise can be fitted
_NEIGHBOURS_COUNT = 18 / 35  # degrees of freedom per position of (½, −1, ½) differences (Gasser et al. 1986)


@dataclass(frozen=True, eq=False)
class Observed:
    """Recorded positions (p,): stimulus number, mm, mean rate, presses, sum of squares, exposure and sd.

    `within` is the sum of squared deviations of presses from their mean; `exposure_s` is presses × window, NaN if
    only rates are known; `sd` is that of the mean rate, if stated.
    """

    kind: Literal["counts", "sd", "rates"]
    stimulus: NDArray[np.int64]
    position_mm: Array
    rate: Array
    presses: Array
    within: Array
    exposure_s: Array
    sd: Array

    def at(self, chosen: Flags | NDArray[np.int64]) -> "Observed":
        """Return some of the positions, by flags or numbers."""
        return Observed(self.kind, *(getattr(self, field.name)[chosen] for field in fields(self)[1:]))

    @property
    def base(self) -> Array:
        """Weights (p,) of a constant rate."""
        if self.kind == "sd":
            return np.asarray(self.sd**-2)
        return self.exposure_s if self.kind == "counts" else self.presses

    @property
    def spikes(self) -> int | None:
        """Number of spikes in all windows together; None where only rates are known."""
        return round(float((self.rate * self.exposure_s).sum())) if self.kind == "counts" else None

    @property
    def silent(self) -> bool:
        """Whether the afferent fired too little to support a verdict."""
        spikes = self.spikes
        return not self.rate.any() if spikes is None else spikes < FEWEST_SPIKES

    @cached_property
    def _half(self) -> Array:
        return _HALF_A_SPIKE / self.exposure_s

    def variance(self, mean: Array) -> Array:
        """Return the variance (…, p) at expected rates (…, p), relative to the dispersion."""
        more = mean + self._half if self.kind == "counts" else np.ones_like(mean)
        return np.asarray(more / self.base)

    def deviance(self, mean: Array) -> Array:
        """Return the deviance (…, p) of each position under expected rates (…, p), not divided by the dispersion."""
        if self.kind != "counts":
            return np.asarray(self.base * (self.rate - mean) ** 2)
        y, mu = self.rate + self._half, mean + self._half
        return np.asarray(np.maximum(2 * self.exposure_s * (xlogy(y, y / mu) - (y - mu)), 0.0))

    def share(self, mean: Array) -> Array:
        """Return the degrees of freedom (…, p) that each position adds: none where no count is expected."""
        return np.asarray(mean / (mean + self._half)) if self.kind == "counts" else np.ones_like(mean)

    @cached_property
    def smooth(self) -> Array:
        """Rates (p,) averaged with those of the neighbors; fits start from them."""
        total, count = self.base * self.rate, self.base.copy()
        same = self.stimulus[1:] == self.stimulus[:-1]
        for of, value in ((total, self.base * self.rate), (count, self.base)):
            of[1:] += np.where(same, value[:-1], 0.0)
            of[:-1] += np.where(same, value[1:], 0.0)
        return total / count

    @cached_property
    def noise(self) -> RecordingNoise:
        """Size of the noise, and how it was estimated."""
        if self.kind == "sd":
            return RecordingNoise("sd", "sd", 1.0, np.inf)
        within = (self.presses - 1).sum() >= FEWEST_REPEATED
        dispersion, freedom = self._between_presses() if within else self._between_neighbours()
        least = _LEAST_NOISE * (1.0 if self.kind == "counts" else float(self.rate.max()) or 1.0) ** 2
        return RecordingNoise(
            self.kind, "repeats" if within else "neighbours", max(dispersion, least), max(freedom, 1.0)
        )

    @cached_property
    def evenness(self) -> float:
        """Share of the degrees of freedom that is left if noise differs between positions (Box 1954); at most 1.

        Only for rates with repeats; the scatter of the variances themselves, σ⁴ (1 + 2/freedom), is subtracted.
        """
        freedom = self.presses - 1
        if self.noise.kind != "rates" or self.noise.source != "repeats":
            return 1.0
        here = freedom > 0
        variance, freedom = self.within[here] / freedom[here], freedom[here]
        fourth = (variance**2 * freedom / (freedom + 2)).sum()
        return float(min(variance.sum() ** 2 / (here.sum() * fourth), 1.0)) if fourth > 0 else 1.0

    def _between_presses(self) -> tuple[float, float]:
        """Estimate noise from squares within positions over Poisson's, both weighted by neighboring rates."""
        freedom, weight = self.presses - 1, self.base / self.presses
        if self.kind != "counts":
            return float((weight * self.within).sum() / freedom.sum()), float(freedom.sum())
        weight = weight / (self.smooth + self._half)
        poisson = freedom * weight * self.rate / (self.base / self.presses)
        dispersion = float((weight * self.within).sum() / max(poisson.sum(), np.finfo(float).tiny))
        return dispersion, float((freedom * self.share(self.rate)).sum())

    def _between_neighbours(self) -> tuple[float, float]:
        """Estimate noise from the distance of each rate to the line through its neighbors; curvature counts as
        noise.
        """
        one = np.arange(1, len(self.rate) - 1)
        one = one[(self.stimulus[one - 1] == self.stimulus[one]) & (self.stimulus[one + 1] == self.stimulus[one])]
        sides = (self.at(one - 1), self.at(one), self.at(one + 1))
        before, here, after = sides
        right = (here.position_mm - before.position_mm) / (after.position_mm - before.position_mm)
        mean = (before.rate + here.rate + after.rate) / 3
        off = (1 - right) * before.rate + right * after.rate - here.rate
        parts = ((1 - right) ** 2, np.ones(len(one)), right**2)
        variance = sum(part * side.variance(mean) for part, side in zip(parts, sides, strict=True))
        worth = float(here.share(mean).sum())
        return float((off**2 / variance).sum()) / max(worth, 1.0), _NEIGHBOURS_COUNT * worth


def observed(recordings: Sequence[Recording], known: Flags) -> Observed:
    """Return the recordings, in the order of their stimuli, at the positions that `known` selects.

    Counts if every recording has a window, sd if every rate has one and none is repeated, otherwise rates.
    """
    each = [rates for one in recordings for rates in one.repeats]
    presses = np.array([len(rates) for rates in each], dtype=float)
    number = np.repeat(np.arange(len(recordings)), [len(one.repeats) for one in recordings])
    windows = np.array([np.nan if one.window_s is None else one.window_s for one in recordings])[number]
    sd = np.concatenate([one.sd for one in recordings])
    kind: Literal["counts", "sd", "rates"] = "rates"
    if np.isfinite(windows).all():
        kind = "counts"
    elif (presses == 1).all() and np.isfinite(sd[known]).all() and (sd[known] > 0).any():
        kind = "sd"
        sd = np.where(sd > 0, sd, sd[known & (sd > 0)].min())  # no rate has zero error
    return Observed(
        kind,
        number,
        np.concatenate([one.position_mm for one in recordings]),
        np.array([rates.mean() for rates in each]),
        presses,
        np.array([((rates - rates.mean()) ** 2).sum() for rates in each]),
        windows * presses,
        sd,
    ).at(known)


# Maximum-likelihood rate models of many candidates: R = max(0, k(ε − ε₀)), saturating on request.
#
# Quasi-likelihood by reweighting: with fixed variances the best line is found exactly (`rig/compare/fit.py`), then
# variances are updated from its rates; the most likely iterate is used.

_ROUNDS = 6
_COARSE = 0.15  # step of the saturation, relative to 1 / largest smoothed rate
_HALVED = 4  # number of halvings of the step around the best value
_MOST = 0.96
_BELOW_SATURATION = 1 - 1e-6  # rounding may carry a rate to its largest, where the drive is infinite


class Form(NamedTuple):
    """Options of the rate model."""

    saturating: bool = False
    silent_at_rest: bool = False

    @property
    def parameters(self) -> int:
        """Return the number of parameters of a line."""
        return 3 if self.saturating else 2


@dataclass(frozen=True, eq=False)
class MaximumLikelihoodFits:
    """k, ε₀ and saturation (N,), NaN if no line beats a constant; expected rates and deviances (N, p)."""

    k: Array
    eps0: Array
    saturation: Array
    mean: Array
    deviance: Array

    @property
    def total(self) -> Array:
        """Deviance (N,) over all positions."""
        return np.asarray(self.deviance.sum(axis=1))

    def rates(self, eps: Array) -> Array:
        """Return rates (N, q) at other ε (N, q); a constant keeps its rate."""
        line = _rates(Fit(self.k, self.eps0, self.k), self.saturation, eps)
        return np.where(np.isnan(self.k)[:, None], self.mean[:, :1], line)


def maximum_likelihood(eps: Array, observed: Observed, form: Form) -> MaximumLikelihoodFits:
    """Return the maximum-likelihood fits of candidates ε (N, p); a constant candidate is a constant rate."""
    none = np.zeros(len(eps))
    found = at_saturation(eps, observed, form, none)
    if not form.saturating:
        return found
    for saturation in saturations(observed, _COARSE)[1:]:
        found = _likelier(at_saturation(eps, observed, form, none + saturation), found)
    for step in _COARSE / 2.0 ** np.arange(1, _HALVED + 1) / _largest(observed):
        for near in (found.saturation - step, found.saturation + step):
            tried = np.clip(near, 0.0, _MOST / _largest(observed))
            found = _likelier(at_saturation(eps, observed, form, tried), found)
    return found


def saturations(observed: Observed, step: float) -> Array:
    """Return the possible saturations, in steps relative to 1 / largest smoothed rate."""
    return np.arange(0.0, _MOST, step) / _largest(observed)


def _largest(observed: Observed) -> float:
    return float(observed.smooth.max()) or 1.0


def at_saturation(eps: Array, observed: Observed, form: Form, saturation: Array) -> MaximumLikelihoodFits:
    """Return the maximum-likelihood fits at saturations (N,)."""
    level = float(observed.base @ observed.rate / observed.base.sum())
    bent = saturation[:, None]
    mean = np.where(bent > 0, np.minimum(observed.smooth, 0.98 / np.maximum(bent, 1e-300)), observed.smooth)
    sign = np.zeros(len(eps))
    best = None
    for _ in range(_ROUNDS if observed.kind == "counts" or bent.any() else 1):
        fit = _round(eps, sign, mean, observed, form, bent)
        sign = np.where(fit.k < 0, -1.0, 1.0)
        mean = np.where(np.isnan(fit.k)[:, None], level, _rates(fit, saturation, eps))
        tried = MaximumLikelihoodFits(fit.k, fit.eps0, saturation, mean, observed.deviance(mean))
        best = tried if best is None else _likelier(tried, best)
    assert best is not None
    return best


def _round(eps: Array, sign: Array, mean: Array, observed: Observed, form: Form, bent: Array) -> Fit:
    """Return one weighted fit to the rates, with saturation inverted."""
    mean = np.where(bent > 0, np.minimum(mean, _BELOW_SATURATION / np.maximum(bent, 1e-300)), mean)
    drive = mean / (1 - bent * mean)
    steep = (1 + bent * drive) ** 2
    rate = np.maximum(drive + (observed.rate - mean) * steep, 0.0)
    weight = 1 / observed.variance(mean) / steep**2
    if form.silent_at_rest:
        return fit_rates(eps, rate, weight, silent=True)
    if not sign.any():
        return fit_rates(eps, rate, weight)
    fit = fit_rates(sign[:, None] * eps, rate, weight, sign=1)
    return Fit(sign * fit.k, sign * fit.eps0, fit.rss)


def _rates(fit: Fit, saturation: Array, eps: Array) -> Array:
    drive = predicted(Fit(fit.k[:, None], fit.eps0[:, None], fit.rss), eps)
    return np.asarray(drive / (1 + saturation[:, None] * drive))


def _likelier(one: MaximumLikelihoodFits, other: MaximumLikelihoodFits) -> MaximumLikelihoodFits:
    """Return, for each row, the fit with the smaller deviance."""
    first = one.total < other.total
    rows = first[:, None]
    return MaximumLikelihoodFits(
        *(np.where(first, getattr(one, name), getattr(other, name)) for name in ("k", "eps0", "saturation")),
        *(np.where(rows, getattr(one, name), getattr(other, name)) for name in ("mean", "deviance")),
    )
