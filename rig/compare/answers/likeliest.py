"""The likeliest rate model of each of many candidates: R = max(0, k(ε − ε₀)), on request saturating.

Quasi-likelihood by reweighting: at given variances the best line is found exactly (`rig/compare/fit.py`), then the
variances follow from its rates; the likeliest of these is kept.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.answers.observed import Observed
from rig.compare.fit import Fit, fit_rates, predicted

Array = NDArray[np.float64]

_ROUNDS = 6
_SATURATIONS = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.7, 0.8, 0.9])  # of 1 over the largest smoothed rate


class Form(NamedTuple):
    """What is asked of the rate model."""

    saturating: bool = False
    silent_at_rest: bool = False

    @property
    def parameters(self) -> int:
        """Of a line."""
        return 3 if self.saturating else 2


@dataclass(frozen=True, eq=False)
class Likeliest:
    """k, ε₀ and saturation (N,), NaN where no line beats a constant; expected rates and deviances (N, p)."""

    k: Array
    eps0: Array
    saturation: Array
    mean: Array
    deviance: Array

    @property
    def total(self) -> Array:
        """(N,) deviance over all positions."""
        return np.asarray(self.deviance.sum(axis=1))

    def rates(self, eps: Array) -> Array:
        """(N, q) expected elsewhere, at ε (N, q); of a constant the same as here."""
        line = _rates(Fit(self.k, self.eps0, self.k), self.saturation, eps)
        return np.where(np.isnan(self.k)[:, None], self.mean[:, :1], line)


def likeliest(eps: Array, observed: Observed, form: Form) -> Likeliest:
    """Of candidates ε (N, p); NaN rows are a constant rate."""
    first, *others = saturations(observed, form)
    found = at_saturation(eps, observed, form, first)
    for saturation in others:
        found = _likelier(at_saturation(eps, observed, form, saturation), found)
    return found


def saturations(observed: Observed, form: Form) -> list[float]:
    """Those that are tried; none but 0 of a line."""
    tried = _SATURATIONS / float(observed.smooth.max() or 1.0)
    return [float(value) for value in tried] if form.saturating else [0.0]


def at_saturation(eps: Array, observed: Observed, form: Form, saturation: float) -> Likeliest:
    """The same at one saturation."""
    level = float(observed.base @ observed.rate / observed.base.sum())
    bent = np.full(len(eps), saturation)
    start = np.broadcast_to(np.minimum(observed.smooth, 0.9 / saturation if saturation else np.inf), eps.shape)
    sign = np.zeros(len(eps))
    best, mean = None, start
    for _ in range(_ROUNDS if observed.kind == "counts" or saturation else 1):
        fit = _round(eps, sign, mean, observed, form, saturation)
        sign = np.where(fit.k < 0, -1.0, 1.0)
        mean = np.where(np.isnan(fit.k)[:, None], level, _rates(fit, bent, eps))
        tried = Likeliest(fit.k, fit.eps0, bent, mean, observed.deviance(mean))
        best = tried if best is None else _likelier(tried, best)
    assert best is not None
    return best


def _round(eps: Array, sign: Array, mean: Array, observed: Observed, form: Form, saturation: float) -> Fit:
    """One weighted fit, of what rates mean where these would not saturate."""
    rate, weight = np.broadcast_to(observed.rate, eps.shape), 1 / observed.variance(mean)
    if saturation:
        drive = mean / (1 - saturation * mean)
        steep = (1 + saturation * drive) ** 2
        rate, weight = np.maximum(drive + (rate - mean) * steep, 0.0), weight / steep**2
    known = np.nan_to_num(eps)
    if form.silent_at_rest:
        return fit_rates(known, rate, weight, silent=True)
    if not sign.any():
        return fit_rates(known, rate, weight)
    fit = fit_rates(sign[:, None] * known, rate, weight, sign=1)
    return Fit(sign * fit.k, sign * fit.eps0, fit.rss)


def _rates(fit: Fit, saturation: Array, eps: Array) -> Array:
    drive = predicted(Fit(fit.k[:, None], fit.eps0[:, None], fit.rss), eps)
    return np.asarray(drive / (1 + saturation[:, None] * drive))


def _likelier(one: Likeliest, other: Likeliest) -> Likeliest:
    """Of each row whichever has the smaller deviance."""
    first = one.total < other.total
    rows = first[:, None]
    return Likeliest(
        *(np.where(first, getattr(one, name), getattr(other, name)) for name in ("k", "eps0", "saturation")),
        *(np.where(rows, getattr(one, name), getattr(other, name)) for name in ("mean", "deviance")),
    )
