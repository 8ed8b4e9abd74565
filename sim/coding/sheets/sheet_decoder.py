"""Pressures over x and z from a noisy sheet of receptors: not negative, smooth by the evidence, with a band.

SED is made linear about the pressures found so far, and readings are whitened by their noise and the model's error;
the likeliest pressures that are not negative are then those of a least-squares problem (Lawson and Hanson's), round
by round. The prior is of differences between neighbours along x and along z, its weight λ where Laplace's evidence
is highest; and exponential, so that little is borne where nothing says that more is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import nnls

from sim.coding.decoded import checked_readings
from sim.coding.operators import Operator
from sim.coding.profile_decoder import ModelError, Profile
from sim.coding.readings import Readings

Array = NDArray[np.float64]

FEWEST_READINGS = 9

_DECADES = np.arange(1.0, -4.1, -0.5)  # of λ, over the data's own curvature; from smooth to rough
_LEVEL = 0.1  # of the prior: the pressures' own squares beside their differences
_TYPICAL = 2.0  # mean of the exponential prior, over the even pressure that explains the readings best
_MOST_ROUNDS = 12
_SETTLED = 0.01  # of the pressures, in relative L2
_HALVINGS = 5
_DEAF = 1e-6  # least weight of a reading, over that of one that is not silent


def decode_sheet(
    operator: Operator, readings: Readings, shape: tuple[int, int], error: ModelError | None = None
) -> Profile:
    """Of (n_x, n_z) pressures, z going fastest. Raises DecodingError for readings that cannot be meant."""
    checked_readings(operator, readings.sed, FEWEST_READINGS)
    root, pressure = _differences(shape), _even(operator, readings)
    rarity = 1 / (_TYPICAL * float(pressure[0]))
    search = _Search(operator, readings, ModelError() if error is None else error, rarity)
    slope, _, _ = search.seen_from(pressure)
    scale = (slope**2).sum() / (root**2).sum()
    fits: list[_Fit] = []
    for smoothing in (scale * 10**_DECADES).tolist():
        fits.append(search.fitted(smoothing, root, pressure))
        pressure = fits[-1].pressure if fits[-1].pressure.any() else pressure
    best = max(fits, key=lambda fit: fit.evidence)
    covariance = cho_solve(cho_factor(best.curvature), np.eye(len(pressure)))
    left = (operator.sed(best.pressure) - readings.sed) / readings.sd
    misfit = float((left[~readings.silent] ** 2).sum())
    return Profile(best.pressure, np.sqrt(np.diag(covariance)), best.smoothing, misfit, best.converged)


@dataclass(frozen=True)
class _Fit:
    """The likeliest pressures of one λ."""

    pressure: Array
    smoothing: float
    curvature: Array  # (n, n) of the cost
    evidence: float  # log, by Laplace, of the pressures above 0; but for what is the same for all
    converged: bool


@dataclass(frozen=True)
class _Search:
    """Pressures that explain readings, by an operator that is wrong by so much."""

    operator: Operator
    readings: Readings
    error: ModelError
    rarity: float  # of the exponential prior, per pseudo-unit

    def seen_from(self, pressure: Array) -> tuple[Array, Array, float]:
        """(m, n) white slopes, (m,) what is left of the readings (of silent ones Newton's), log of their spread."""
        there = self.operator.leaning(pressure)
        sed, slope = there.sed(pressure), there.slope(pressure)
        _, first, second = self.readings.cost(sed)
        second = np.maximum(second, _DEAF / self.readings.sd**2)
        at = self.operator.receptor_mm
        apart = np.linalg.norm(at[:, None] - at, axis=-1) / self.error.length_mm
        wrong = self.error.share**2 * np.outer(sed, sed) * np.exp(-0.5 * apart**2)
        lower = cholesky(np.diag(1 / second) + wrong, lower=True)
        white = solve_triangular(lower, np.column_stack([slope, -first / second]), lower=True)
        return white[:, :-1], white[:, -1], float(np.log(np.diag(lower)).sum())

    def fitted(self, smoothing: float, root: Array, start: Array) -> _Fit:
        """From a start, round by round until it stays."""
        pressure, still, root = start, False, np.sqrt(smoothing) * root
        for _ in range(_MOST_ROUNDS):
            moved = self._step(root, pressure)
            still = bool(np.linalg.norm(moved - pressure) <= _SETTLED * np.linalg.norm(moved))
            pressure = moved
            if still:
                break
        slope, _, _ = self.seen_from(pressure)
        penalty = root.T @ root
        curvature = slope.T @ slope + penalty
        free = np.ix_(pressure > 0, pressure > 0)
        evidence = 0.5 * (_log_det(penalty[free]) - _log_det(curvature[free])) - self._cost(root, pressure)
        return _Fit(pressure, smoothing, curvature, evidence, still)

    def _step(self, root: Array, pressure: Array) -> Array:
        """To the likeliest pressures as seen from these, or so much of the way that the cost falls."""
        slope, left, _ = self.seen_from(pressure)
        factor = cholesky(slope.T @ slope + root.T @ root, lower=True)
        towards = slope.T @ (left + slope @ pressure) - self.rarity
        aim, _ = nnls(factor.T, solve_triangular(factor, towards, lower=True))
        now = self._cost(root, pressure)
        for halving in range(_HALVINGS):
            moved = pressure + 0.5**halving * (aim - pressure)
            if self._cost(root, moved) < now:
                return moved
        return pressure

    def _cost(self, root: Array, pressure: Array) -> float:
        _, left, log_spread = self.seen_from(pressure)
        prior = 0.5 * ((root @ pressure) ** 2).sum() + self.rarity * pressure.sum()
        return float(0.5 * left @ left + log_spread + prior)


def _differences(shape: tuple[int, int]) -> Array:
    """Rows whose squares are the prior: differences along x and along z, and a little of the pressures themselves."""
    (n_x, n_z), (along_x, along_z) = shape, (np.diff(np.eye(n), axis=0) for n in shape)
    level = np.sqrt(_LEVEL) * np.eye(n_x * n_z)
    return np.concatenate([np.kron(along_x, np.eye(n_z)), np.kron(np.eye(n_x), along_z), level])


def _even(operator: Operator, readings: Readings) -> Array:
    """An even pressure of the readings' size."""
    even = np.ones(operator.parts.shape[2])
    sed = operator.sed(even)
    return even * float(np.sqrt(max(readings.sed @ sed, readings.sd * sed.max()) / (sed @ sed)))


def _log_det(matrix: Array) -> float:
    return 2 * float(np.log(np.diag(cholesky(matrix))).sum()) if len(matrix) else 0.0
