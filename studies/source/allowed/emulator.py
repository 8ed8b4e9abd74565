"""A Gaussian process for one fact over the design's parameters: a linear trend, a smooth rest, and scatter.

Rasmussen & Williams (2006), ch. 2.7, 5.4. Inputs (n, d) in units of the ranges, 0 … 1; outputs (n,) of one fact.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

Array = NDArray[np.float64]

SCATTER = 1e-3
"""Least standard deviation of the scatter, over that of the outputs."""

HELD_BACK = 5
"""One part in so many is held back, in turn, to see how far off the emulator is."""

_LENGTHS, _SCATTERS = (0.15, 30.0), (SCATTER, 2.0)  # a length of 30 ranges: the parameter does nothing


@dataclass(frozen=True)
class Emulator:
    """What it learnt; `lengths` (d,) in units of the ranges, `rest` and `scatter` as standard deviations."""

    x: Array
    mean: float
    size: float
    lengths: Array
    rest: float
    scatter: float
    factor: Array  # lower Cholesky of the outputs' covariance, the trend given
    weights: Array
    trend: Array
    trend_factor: tuple[Array, bool]
    whitened: Array  # the trend's columns, whitened

    def predict(self, x: Array) -> tuple[Array, Array]:
        """(m,) means and (m,) standard deviations at places (m, d); scatter, being the model's own, is counted."""
        k, h = self.rest**2 * _correlation(x, self.x, self.lengths), _columns(x)
        mean = h @ self.trend + k @ self.weights
        v = solve_triangular(self.factor, k.T, lower=True)
        r = h.T - self.whitened.T @ v
        variance = (
            self.rest**2 + self.scatter**2 - (v**2).sum(axis=0) + (r * cho_solve(self.trend_factor, r)).sum(axis=0)
        )
        return self.mean + self.size * mean, self.size * np.sqrt(np.maximum(variance, self.scatter**2))


def learn(x: Array, y: Array) -> Emulator:
    """By maximum likelihood, the trend integrated out; constant outputs are a trend without a rest."""
    mean, size = float(y.mean()), float(y.std()) or 1.0
    target, d = (y - mean) / size, x.shape[1]
    starts = [np.log([*np.full(d, length), 0.7, 0.2]) for length in (1.0, 4.0)]
    bounds = [*[np.log(_LENGTHS)] * d, np.log([1e-3, 10.0]), np.log(_SCATTERS)]
    found = [
        minimize(_cost, s, (x, target), "L-BFGS-B", True, bounds=bounds, options={"maxiter": 120}) for s in starts
    ]
    best = min(found, key=lambda one: one.fun).x
    return _given(x, target, best, mean, size)


def _given(x: Array, target: Array, logs: Array, mean: float, size: float) -> Emulator:
    *lengths, rest, scatter = np.exp(logs)
    covariance = _covariance(x, np.array(lengths), rest, scatter)
    factor = np.asarray(np.linalg.cholesky(covariance), dtype=float)
    whitened = solve_triangular(factor, _columns(x), lower=True)
    normal = cho_factor(whitened.T @ whitened)
    trend = cho_solve(normal, whitened.T @ solve_triangular(factor, target, lower=True))
    weights = cho_solve((factor, True), target - _columns(x) @ trend)
    return Emulator(x, mean, size, np.array(lengths), rest, scatter, factor, weights, trend, normal, whitened)


def _columns(x: Array) -> Array:
    """(n, 1 + d) of the trend."""
    return np.column_stack([np.ones(len(x)), x - 0.5])


def _correlation(a: Array, b: Array, lengths: Array) -> Array:
    scaled_a, scaled_b = a / lengths, b / lengths
    squared = (scaled_a**2).sum(1)[:, None] + (scaled_b**2).sum(1) - 2 * scaled_a @ scaled_b.T
    return np.exp(-0.5 * np.maximum(squared, 0.0))


def _covariance(x: Array, lengths: Array, rest: float, scatter: float) -> Array:
    return np.asarray(rest**2 * _correlation(x, x, lengths) + scatter**2 * np.eye(len(x)))


def _cost(logs: Array, x: Array, y: Array) -> tuple[float, Array]:
    """−log of the likelihood of residuals from the trend (restricted), and its slope by the logs."""
    *lengths, rest, scatter = np.exp(logs)
    smooth = rest**2 * _correlation(x, x, np.array(lengths))
    factor = np.linalg.cholesky(smooth + scatter**2 * np.eye(len(x)))
    inverse = cho_solve((factor, True), np.eye(len(x)))
    h = _columns(x)
    k_h = inverse @ h
    normal = h.T @ k_h
    projected = inverse - k_h @ np.linalg.solve(normal, k_h.T)
    weights = projected @ y
    cost = 0.5 * y @ weights + np.log(np.diag(factor)).sum() + 0.5 * np.linalg.slogdet(normal)[1]
    slope = 0.5 * (projected - np.outer(weights, weights))  # by the covariance
    by_smooth = slope * smooth
    row = by_smooth.sum(axis=1)
    by_length = np.array([2 * (row @ x[:, j] ** 2 - x[:, j] @ by_smooth @ x[:, j]) for j in range(x.shape[1])])
    by_scatter = 2 * scatter**2 * np.trace(slope)
    return float(cost), np.array([*(by_length / np.square(lengths)), 2 * by_smooth.sum(), by_scatter])


@dataclass(frozen=True)
class HeldBack:
    """How far off it was where it had not learnt: rms, rms over the outputs' deviation, rms over what it expected."""

    rms: float
    relative: float
    expected: float


def held_back(x: Array, y: Array, learnt: Emulator) -> HeldBack:
    """Each fifth in turn; lengths and sizes stay, trend and weights are learnt anew from the others."""
    logs = np.log([*learnt.lengths, learnt.rest, learnt.scatter])
    off, expected = np.zeros(len(x)), np.zeros(len(x))
    for part in range(HELD_BACK):
        out = np.arange(len(x)) % HELD_BACK == part
        again = _given(x[~out], (y[~out] - learnt.mean) / learnt.size, logs, learnt.mean, learnt.size)
        mean, deviation = again.predict(x[out])
        off[out], expected[out] = y[out] - mean, deviation
    rms, spread = float(np.sqrt(np.mean(off**2))), float(y.std())
    return HeldBack(rms, rms / spread if spread else 0.0, float(np.sqrt(np.mean((off / expected) ** 2))))
