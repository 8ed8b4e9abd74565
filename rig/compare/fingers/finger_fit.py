"""Fits in which the finger is not known: k, ε₀ and the place of the finger in its plausible ranges, together.

A place has one coordinate for each free parameter, −1 at the lowest and 1 at the highest value. SSRPs at a place are
interpolated between the fingers of the design (`rig/compare/plausible.py`), quadratically in each parameter.
"""

from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.fit import Fit, fit_rates, predicted
from rig.compare.plausible import design_places

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

_STARTS, _STEPS = 3, 12
_DAMPING, _EASED, _RAISED = 1e-2, 0.2, 5.0


class FingerFit(NamedTuple):
    """The best fits of N pairs: places (N, free), k, ε₀ and residual (N,), and the SSRPs (N, p) there."""

    place: Array
    fit: Fit
    eps: Array


def weights(place: Array) -> Array:
    """(…, 3^free) of the design's fingers at places (…, free): Lagrange's quadratics through −1, 0 and 1."""
    return _products(_along(place))


def _slopes(place: Array) -> Array:
    """(…, free, 3^free) derivatives of the weights."""
    values, slopes = _along(place), np.stack([place - 0.5, -2 * place, place + 0.5], axis=-1)
    free = np.arange(place.shape[-1])
    return np.stack([_products(np.where((free == j)[:, None], slopes, values)) for j in free], axis=-2)


def _along(place: Array) -> Array:
    """(…, free, 3) weights of the lowest, middle and highest value of each parameter."""
    return np.stack([place * (place - 1) / 2, 1 - place * place, place * (place + 1) / 2], axis=-1)


def _products(each: Array) -> Array:
    """(…, 3^free) of weights (…, free, 3) of each parameter, the last one fastest."""
    one = np.ones((*each.shape[:-2], 1))
    parts = np.moveaxis(each, -2, 0)
    return reduce(lambda a, b: (a[..., :, None] * b[..., None, :]).reshape(*a.shape[:-1], -1), parts, one)


def fit_with_finger(eps: Array, rate: Array, weight: Array | None = None, *, silent: bool = False) -> FingerFit:
    """The best k, ε₀ and place of each pair, for SSRPs (fingers, N, p) on the design, rates (p,) and weights (p,).

    `silent` as in `fit_rates`.

    From the best few fingers of the design on: variable projection (Golub and Pereyra 1973), that is k and ε₀ exactly
    at every place, and the place by damped Gauss–Newton steps that stay inside the ranges.
    """
    weight = np.ones_like(rate) if weight is None else weight
    found = fit_rates(eps, rate, weight, silent=silent)
    order = np.argsort(np.where(np.isnan(found.rss), np.inf, found.rss), axis=0, kind="stable")
    at = _Rates(rate, weight, silent)
    ended = [_from(first, found, eps, at) for first in order[:_STARTS]]
    return reduce(lambda a, b: _chosen(b.fit.rss < a.fit.rss, b, a), ended)


class _Rates(NamedTuple):
    """What is fitted: rates and weights (p,), and whether k > 0 and ε₀ ≥ 0."""

    rate: Array
    weight: Array
    silent: bool

    def line(self, eps: Array) -> Fit:
        """Of SSRPs (N, p) that rise with the rate."""
        return fit_rates(eps, self.rate, self.weight, sign=1, silent=self.silent)


def _from(first: Ints, found: Fit, eps: Array, rates: _Rates) -> FingerFit:
    """The best near a finger of the design, for each pair its own (N,); k keeps its sign."""
    pair = np.arange(len(first))
    start = Fit(*(value[first, pair] for value in found))
    sign = np.where(start.k < 0, -1.0, 1.0)
    rising = np.moveaxis(sign[:, None] * eps, 0, 1)
    best = FingerFit(design_places(free_of(eps))[first], _signed(sign, start), rising[pair, first])
    if free_of(eps):
        best = _improved(best, rising, rates)
    return FingerFit(best.place, _signed(sign, best.fit), sign[:, None] * best.eps)


def fit_all_with_finger(eps: Array, rate: Array) -> tuple[Array, Fit]:
    """Places (18, receptors, free) and fits (18, receptors) of every pair, over the positions that it covers.

    eps is (fingers, 18, p, receptors), rate (p,). NaN below three positions.
    """
    place = np.full((eps.shape[1], eps.shape[3], free_of(eps)), np.nan)
    values = np.full((3, eps.shape[1], eps.shape[3]), np.nan)
    for j in range(eps.shape[3]):
        known = ~np.isnan(eps[0, 0, :, j])
        if known.sum() >= 3:
            found = fit_with_finger(eps[:, :, known, j], rate[known])
            place[:, j], values[:, :, j] = found.place, found.fit
    return place, Fit(*values)


def _improved(best: FingerFit, eps: Array, rates: _Rates) -> FingerFit:
    """For SSRPs (N, fingers, p) of k > 0."""
    damping = np.full(len(eps), _DAMPING)
    for _ in range(_STEPS):
        place = np.clip(best.place + _step(best, eps, rates, damping), -1, 1)
        there = np.einsum("nf,nfp->np", weights(place), eps)
        tried = FingerFit(place, rates.line(there), there)
        better = tried.fit.rss < best.fit.rss
        damping *= np.where(better, _EASED, _RAISED)
        best = _chosen(better, tried, best)
    return best


def _chosen(first: Flags, a: FingerFit, b: FingerFit) -> FingerFit:
    fit = Fit(*(np.where(first, x, y) for x, y in zip(a.fit, b.fit, strict=True)))
    rows = first[:, None]
    return FingerFit(np.where(rows, a.place, b.place), fit, np.where(rows, a.eps, b.eps))


def _step(at: FingerFit, eps: Array, given: _Rates, damping: Array) -> Array:
    """(N, free) damped Gauss–Newton step of the place, zero along ranges whose end is in the way."""
    rates = predicted(Fit(*(value[:, None] for value in at.fit)), at.eps)
    fires = rates > 0
    jacobian = np.einsum("ndf,nfp->ndp", _slopes(at.place), eps) * np.nan_to_num(at.fit.k)[:, None, None]
    jacobian = _without_line(np.where(fires[:, None], jacobian, 0.0), at.eps, np.where(fires, given.weight, 0.0))
    descent = np.einsum("ndp,np->nd", jacobian, given.weight * (given.rate - np.nan_to_num(rates)))
    blocked = (np.abs(at.place) >= 1) & (at.place * descent > 0)
    jacobian, descent = np.where(blocked[..., None], 0.0, jacobian), np.where(blocked, 0.0, descent)
    curvature = (given.weight * jacobian) @ jacobian.swapaxes(1, 2)
    size = np.maximum(np.trace(curvature, axis1=1, axis2=2), np.finfo(float).tiny ** 0.5)
    damped = curvature + (damping * size)[:, None, None] * np.eye(descent.shape[1])
    return np.linalg.solve(damped, descent[..., None])[..., 0]


def _without_line(jacobian: Array, eps: Array, weight: Array) -> Array:
    """What is left of (N, free, p) columns when k and ε₀ follow: nothing of 1 and ε, at weights (N, p)."""
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    fires = weight > 0
    centred = np.where(fires, eps - ((weight * eps).sum(axis=1) / total)[:, None], 0.0)
    square = (weight * centred * centred).sum(axis=1)
    unit = centred / np.sqrt(np.where(square > 0, square, 1.0))[:, None]
    mean = (weight[:, None] * jacobian).sum(axis=2, keepdims=True) / total[:, None, None]
    jacobian = np.where(fires[:, None], jacobian - mean, 0.0)
    return jacobian - (jacobian @ (weight * unit)[..., None]) * unit[:, None]


def _signed(sign: Array, fit: Fit) -> Fit:
    return Fit(sign * fit.k, sign * fit.eps0, fit.rss)


def free_of(eps: Array) -> int:
    """Free parameters of SSRPs (3^free, …) on a design."""
    return round(np.log(len(eps)) / np.log(3))
