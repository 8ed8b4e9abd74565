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
_COARSE = 0.15  # steps of the saturation, of 1 over the largest smoothed rate
_HALVED = 4  # times, around the best
_MOST = 0.96


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
    """Of candidates ε (N, p); one that does not vary is a constant rate."""
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
    """Those that are possible, in steps of a part of 1 over the largest smoothed rate."""
    return np.arange(0.0, _MOST, step) / _largest(observed)


def _largest(observed: Observed) -> float:
    return float(observed.smooth.max()) or 1.0


def at_saturation(eps: Array, observed: Observed, form: Form, saturation: Array) -> Likeliest:
    """The same at saturations (N,)."""
    level = float(observed.base @ observed.rate / observed.base.sum())
    bent = saturation[:, None]
    mean = np.where(bent > 0, np.minimum(observed.smooth, 0.98 / np.maximum(bent, 1e-300)), observed.smooth)
    sign = np.zeros(len(eps))
    best = None
    for _ in range(_ROUNDS if observed.kind == "counts" or bent.any() else 1):
        fit = _round(eps, sign, mean, observed, form, bent)
        sign = np.where(fit.k < 0, -1.0, 1.0)
        mean = np.where(np.isnan(fit.k)[:, None], level, _rates(fit, saturation, eps))
        tried = Likeliest(fit.k, fit.eps0, saturation, mean, observed.deviance(mean))
        best = tried if best is None else _likelier(tried, best)
    assert best is not None
    return best


def _round(eps: Array, sign: Array, mean: Array, observed: Observed, form: Form, bent: Array) -> Fit:
    """One weighted fit, of what rates mean where these would not saturate."""
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


def _likelier(one: Likeliest, other: Likeliest) -> Likeliest:
    """Of each row whichever has the smaller deviance."""
    first = one.total < other.total
    rows = first[:, None]
    return Likeliest(
        *(np.where(first, getattr(one, name), getattr(other, name)) for name in ("k", "eps0", "saturation")),
        *(np.where(rows, getattr(one, name), getattr(other, name)) for name in ("mean", "deviance")),
    )
