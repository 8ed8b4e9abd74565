"""The likeliest smooth pressures that are not negative, as smooth as the evidence has it.

The cost is the readings' negative log likelihood plus ½ λ Pᵀ L P, with L of squared differences between neighbours.
For each λ it is minimised by projected Gauss–Newton steps; λ is where Laplace's evidence is highest, no farther below
the λ of the discrepancy principle than `EVIDENCE_DECADES`, since evidence alone may fall to 0. SED does not tell a
pressure from its negative: it is searched for from several starts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky

from sim.coding.operators import Operator
from sim.coding.readings import Readings

Array = NDArray[np.float64]

EVIDENCE_DECADES = 3.0
"""How far below the discrepancy principle's λ evidence may go."""

_DECADES = np.arange(2.0, -8.1, -0.5)  # of λ, over the data's own curvature; from smooth to rough
_WHOLE_DECADES = np.arange(0.0, -3.1, -1.0)
_ENOUGH = 1.5
_LEVEL = 0.1  # of L: the pressures' own squares beside their differences, chosen on two samples (docs/coding.md)
_MOST_STEPS = 60
_SETTLED = 1e-9
_NEAR = 1e-3  # the same of where to begin
_HALVINGS = 30
_STARTS = 3


@dataclass(frozen=True)
class _Fit:
    pressure: Array
    cost: float
    converged: bool


@dataclass(frozen=True)
class SmoothFit:
    """The likeliest pressures of one λ, and the (n, n) penalty it stands for."""

    pressure: Array
    smoothing: float  # λ
    penalty: Array
    converged: bool


def smooth_fit(operator: Operator, readings: Readings, seed: int) -> SmoothFit:
    """By the λ of the highest evidence."""
    prior = _prior(operator.parts.shape[2])
    fits = _over_smoothing(operator, readings, prior, seed)
    smoothing = _chosen(operator, readings, prior, fits)
    best = fits[smoothing]
    return SmoothFit(best.pressure, smoothing, smoothing * prior, best.converged)


def smooth_start(operator: Operator, readings: Readings) -> SmoothFit:
    """By the λ of the discrepancy principle, in whole decades: where to begin, quickly.

    An even pressure where all fell to 0.
    """
    prior = _prior(operator.parts.shape[2])
    even, as_root, *_ = _starts(operator, readings, 0)
    curvature = np.trace(_curvature(operator, readings, even)) / np.trace(prior)
    start = as_root
    for smoothing in (curvature * 10**_WHOLE_DECADES).tolist():
        fit = _fitted(operator, readings, smoothing * prior, start, _NEAR)
        start = fit.pressure if fit.pressure.any() else even
        if chi2(operator, readings, fit.pressure) <= _ENOUGH * (~readings.silent).sum():
            break
    return SmoothFit(start, smoothing, smoothing * prior, fit.converged)


def spread(operator: Operator, readings: Readings, fit: SmoothFit, wrong: Array) -> Array:
    """(n,) standard deviations: Laplace's covariance, and what a wrong model adds through the readings' gain.

    `wrong` is the (m, m) covariance of the model's SED.
    """
    slope, sed = operator.slope(fit.pressure), operator.sed(fit.pressure)
    _, _, second = readings.cost(sed)
    factor = cho_factor((slope.T * second) @ slope + fit.penalty)
    noise = np.diag(cho_solve(factor, np.eye(len(fit.pressure))))
    gain = cho_solve(factor, slope.T * second)
    return np.asarray(np.sqrt(noise + np.einsum("nm,mk,nk->n", gain, wrong, gain)))


def _prior(n: int) -> Array:
    difference = np.diff(np.eye(n), axis=0)
    return np.asarray(difference.T @ difference + _LEVEL * np.eye(n))


def _over_smoothing(operator: Operator, readings: Readings, prior: Array, seed: int) -> dict[float, _Fit]:
    """Fits by λ, from smooth to rough: the first from several starts, others from where the last one ended.

    Under a large λ all may have fallen to 0, where SED has no slope: each is begun from an even pressure too.
    """
    starts = _starts(operator, readings, seed)
    even = starts[0]
    curvature = np.trace(_curvature(operator, readings, starts[0])) / np.trace(prior)
    fits: dict[float, _Fit] = {}
    for smoothing in (curvature * 10**_DECADES).tolist():
        tried = [_fitted(operator, readings, smoothing * prior, start) for start in starts]
        fits[smoothing] = min(tried, key=lambda fit: fit.cost)
        starts = [fits[smoothing].pressure, even]
    return fits


def _starts(operator: Operator, readings: Readings, seed: int) -> list[Array]:
    """An even pressure of the readings' size, one as their root, and random ones."""
    shown = np.sqrt(np.maximum(readings.sed, readings.sd))
    n = operator.parts.shape[2]
    as_root = np.interp(np.linspace(0, 1, n), np.linspace(0, 1, len(shown)), shown)
    shapes = [np.ones(n), as_root, *np.random.default_rng(seed).uniform(0.1, 1.0, (_STARTS, n))]
    return [shape * _size(operator, readings, shape) for shape in shapes]


def _size(operator: Operator, readings: Readings, shape: Array) -> float:
    sed = operator.sed(shape)
    return float(np.sqrt(max(readings.sed @ sed, readings.sd * sed.max()) / (sed @ sed)))


def _fitted(
    operator: Operator, readings: Readings, penalty: Array, start: Array, settled_at: float = _SETTLED
) -> _Fit:
    """Projected Gauss–Newton (Bertsekas 1982): pressures at 0 that would fall stay, the others step together."""
    pressure, cost = start, _cost(operator, readings, penalty, start)
    for _ in range(_MOST_STEPS):
        slope = operator.slope(pressure)
        _, first, second = readings.cost(operator.sed(pressure))
        gradient = first @ slope + penalty @ pressure
        free = (pressure > 0) | (gradient < 0)
        curvature = (slope.T * second) @ slope + penalty
        step = np.zeros_like(pressure)
        step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], gradient[free])
        moved, lower = _searched(operator, readings, penalty, pressure, step, cost)
        settled = cost - lower <= settled_at * (1 + abs(cost))
        pressure, cost = moved, lower
        if settled:
            return _Fit(pressure, cost, converged=True)
    return _Fit(pressure, cost, converged=False)


def _searched(
    operator: Operator, readings: Readings, penalty: Array, pressure: Array, step: Array, cost: float
) -> tuple[Array, float]:
    """The first of ever shorter steps that lowers the cost; the place itself where none does."""
    for halving in range(_HALVINGS):
        moved = np.maximum(0.0, pressure + 0.5**halving * step)
        lower = _cost(operator, readings, penalty, moved)
        if lower < cost:
            return moved, lower
    return pressure, cost


def _cost(operator: Operator, readings: Readings, penalty: Array, pressure: Array) -> float:
    return float(readings.cost(operator.sed(pressure))[0].sum() + 0.5 * pressure @ penalty @ pressure)


def _curvature(operator: Operator, readings: Readings, pressure: Array) -> Array:
    slope = operator.slope(pressure)
    _, _, second = readings.cost(operator.sed(pressure))
    return np.asarray((slope.T * second) @ slope)


def chi2(operator: Operator, readings: Readings, pressure: Array) -> float:
    """Σ ((SED − reading) / sd)² over receptors that are not silent."""
    left = (operator.sed(pressure) - readings.sed) / readings.sd
    return float((left[~readings.silent] ** 2).sum())


def _chosen(operator: Operator, readings: Readings, prior: Array, fits: dict[float, _Fit]) -> float:
    """λ of the highest evidence, from that of the discrepancy principle down to `EVIDENCE_DECADES` below it."""
    expected = float((~readings.silent).sum())
    misfits = {smoothing: chi2(operator, readings, fit.pressure) for smoothing, fit in fits.items()}
    enough = max(expected, 1.05 * min(misfits.values()))
    discrepancy = max(smoothing for smoothing, found in misfits.items() if found <= enough)
    floor = discrepancy / 10**EVIDENCE_DECADES
    allowed = [smoothing for smoothing in fits if floor <= smoothing <= discrepancy]
    return max(allowed, key=lambda smoothing: _evidence(operator, readings, smoothing * prior, fits[smoothing]))


def _evidence(operator: Operator, readings: Readings, penalty: Array, fit: _Fit) -> float:
    """Laplace's log evidence of a penalty, but for what is the same for all; of the pressures above 0."""
    free = np.flatnonzero(fit.pressure > 0)
    if not len(free):
        return -fit.cost
    among = np.ix_(free, free)
    data = _curvature(operator, readings, fit.pressure)[among]
    return -fit.cost + 0.5 * (_log_det(penalty[among]) - _log_det(data + penalty[among]))


def _log_det(matrix: Array) -> float:
    return 2 * float(np.log(np.diag(cholesky(matrix))).sum())
