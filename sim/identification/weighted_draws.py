"""Weighted draws of a posterior density: its mode by Gauss-Newton, importance sampling, then resample and move.

Parameters are standard normal under the prior, so that none has a bound. Where the weights of the draws lie on too
few, they are tempered, and the ensemble moves towards the density step by step (sequential Monte Carlo, Del Moral et
al. 2006, J. R. Stat. Soc. B 68, 411).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from sim.identification.prior import Kind

Array = NDArray[np.float64]

_STEPS, _STEP, _MOST_MOVED, _FARTHEST = 40, 1e-3, 1.0, 6.0  # of Gauss-Newton, in sd of the prior
_WIDER, _FREEDOM, _ROUNDS, _MOST_ROUNDS = 1.3, 6.0, 3, 6
_ENOUGH = 0.1  # share of effective draws with which importance sampling ends
_TEMPERED = 0.5  # share of effective draws of a tempered step
_MOVES, _MOST_LEVELS, _SCALE = 6, 40, 2.38


@dataclass(frozen=True)
class PosteriorDensity:
    """Posterior density of normal values (n, k) of one kind of tissue."""

    off: Callable[[Array], Array]  # (n, r + k) standardized residuals of readings and prior
    fingers: Callable[[Array], Array]  # (n, p) parameters
    kind: Kind
    ln_chance: float  # of the kind

    def ln(self, normal: Array) -> Array:
        """Return the (n,) logarithms of the density; its integral is the evidence."""
        constant = self.ln_chance - 0.5 * normal.shape[1] * np.log(2 * np.pi)
        return np.asarray(constant - 0.5 * np.square(self.off(normal)).sum(axis=1))


@dataclass(frozen=True)
class Mode:
    """Most likely normal values, their linearized covariance, and the evidence of a normal distribution there."""

    normal: Array  # (k,)
    covariance: Array  # (k, k)
    ln_evidence: float


@dataclass(frozen=True)
class WeightedDraws:
    """Draws of a posterior with weights that sum to 1."""

    normal: Array  # (n, k)
    weights: Array  # (n,)
    ln_evidence: float
    effective: float  # effective number of draws


def climbed(target: PosteriorDensity, start: Array) -> Mode:
    """Return the mode (Levenberg-Marquardt)."""
    at, damping = start, 1e-2
    off = target.off(at[None])[0]
    for _ in range(_STEPS):
        slope = _slopes(target, at)
        normal = slope.T @ slope
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope.T @ off)
        step *= min(1.0, _MOST_MOVED / max(float(np.abs(step).max()), 1e-12))
        tried = np.clip(at + step, -_FARTHEST, _FARTHEST)
        tried_off = target.off(tried[None])[0]
        gained = float(off @ off - tried_off @ tried_off)
        if gained > 0:
            at, off, damping = tried, tried_off, damping / 5
        else:
            damping *= 5
        if 0 <= gained < 1e-3 or damping > 1e6:
            break
    slope = _slopes(target, at)
    covariance = np.asarray(np.linalg.inv(slope.T @ slope))
    half = 0.5 * float(np.linalg.slogdet(covariance)[1]) + 0.5 * len(at) * np.log(2 * np.pi)
    return Mode(at, covariance, float(target.ln(at[None])[0]) + half)


def _slopes(target: PosteriorDensity, at: Array) -> Array:
    """Return the (r, k) derivatives of the residuals."""
    step = _STEP * np.eye(len(at))
    off = target.off(np.concatenate([at + step, at - step]))
    return np.asarray((off[: len(at)] - off[len(at) :]).T / (2 * _STEP))


def weighted_draws(target: PosteriorDensity, mode: Mode, n: int, chance: np.random.Generator) -> WeightedDraws:
    """Return n draws, by importance sampling around the mode where that suffices, else moved towards the density."""
    middle, covariance = mode.normal, _WIDER * mode.covariance
    for done in range(1, _MOST_ROUNDS + 1):
        proposal = Student.of(middle, covariance)
        normal = proposal.draws(n, chance)
        ln = target.ln(normal) - proposal.ln(normal)
        weights, effective = _normalized(ln)
        if done >= _ROUNDS and effective >= _ENOUGH * n:
            return WeightedDraws(normal, weights, _ln_mean(ln), effective)
        middle, covariance = _moments(normal, _normalized(_tempering(ln, _ENOUGH * n) * ln)[0])
        covariance = _WIDER * covariance
    return _moved(target, proposal, normal, ln, chance)


@dataclass(frozen=True)
class Student:
    """Multivariate Student's t distribution."""

    middle: Array  # (k,)
    root: Array  # (k, k) Cholesky factor of its scale

    @classmethod
    def of(cls, middle: Array, covariance: Array) -> "Student":
        """Return the distribution about a mean, with a scale matrix."""
        return cls(middle, np.asarray(np.linalg.cholesky(covariance + 1e-12 * np.eye(len(middle))), dtype=float))

    def draws(self, n: int, chance: np.random.Generator) -> Array:
        """Return (n, k) draws."""
        normal = chance.standard_normal((n, len(self.middle)))
        z = normal / np.sqrt(chance.chisquare(_FREEDOM, n) / _FREEDOM)[:, None]
        return np.asarray(self.middle + z @ self.root.T)

    def ln(self, normal: Array) -> Array:
        """Return the (n,) logarithms of the normalized density."""
        k = len(self.middle)
        z = np.linalg.solve(self.root, (normal - self.middle).T)
        constant = gammaln(0.5 * (_FREEDOM + k)) - gammaln(0.5 * _FREEDOM) - 0.5 * k * np.log(_FREEDOM * np.pi)
        constant -= np.log(np.diag(self.root)).sum()
        return np.asarray(constant - 0.5 * (_FREEDOM + k) * np.log1p((z**2).sum(axis=0) / _FREEDOM))


def _moved(
    target: PosteriorDensity, proposal: Student, normal: Array, ln_ratio: Array, chance: np.random.Generator
) -> WeightedDraws:
    """Return draws that were resampled and moved (random-walk Metropolis) from the proposal to the target.

    ln_ratio: of target over proposal. The effective number is that of different draws in the end.
    """
    n, reached, ln_evidence, scale = len(normal), 0.0, 0.0, _SCALE / np.sqrt(normal.shape[1])
    for _ in range(_MOST_LEVELS):
        step = _tempering(ln_ratio, _TEMPERED * n, 1.0 - reached)
        reached = min(reached + step, 1.0)
        ln_evidence += _ln_mean(step * ln_ratio)
        weights, _ = _normalized(step * ln_ratio)
        root = np.linalg.cholesky(_moments(normal, weights)[1] + 1e-12 * np.eye(normal.shape[1]))
        kept = systematic(weights, n, chance)
        normal, ln_ratio = normal[kept], ln_ratio[kept]
        ln_from = proposal.ln(normal)
        for _ in range(_MOVES):
            tried = normal + scale * chance.standard_normal(normal.shape) @ root.T
            tried_from = proposal.ln(tried)
            tried_ratio = target.ln(tried) - tried_from
            gained = tried_from - ln_from + reached * (tried_ratio - ln_ratio)
            moves = np.log(chance.random(n)) < gained
            normal = np.where(moves[:, None], tried, normal)
            ln_ratio, ln_from = np.where(moves, tried_ratio, ln_ratio), np.where(moves, tried_from, ln_from)
            scale *= float(np.exp(np.mean(moves) - 0.25))
        if reached >= 1.0:
            break
    different = len(np.unique(normal, axis=0)) if reached >= 1.0 else 1
    return WeightedDraws(normal, np.full(n, 1 / n), ln_evidence, float(different))


def _tempering(ln: Array, least_effective: float, most: float = 1.0) -> float:
    """Return the largest power of the weights that leaves so many effective draws, at most `most`."""
    if _normalized(most * ln)[1] >= least_effective:
        return most
    low, high = 0.0, most
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _normalized(middle * ln)[1] >= least_effective else (low, middle)
    return max(low, 1e-9)


def _normalized(ln: Array) -> tuple[Array, float]:
    """Return weights that sum to 1, and their effective number."""
    weights = np.exp(ln - ln.max())
    weights /= weights.sum()
    return weights, float(1 / np.square(weights).sum())


def _ln_mean(ln: Array) -> float:
    most = float(ln.max())
    return most + float(np.log(np.mean(np.exp(ln - most))))


def _moments(normal: Array, weights: Array) -> tuple[Array, Array]:
    """Return mean and covariance of weighted draws."""
    middle = weights @ normal
    return np.asarray(middle), np.asarray((weights[:, None] * (normal - middle)).T @ (normal - middle))


def systematic(weights: Array, n: int, chance: np.random.Generator) -> NDArray[np.intp]:
    """Return (n,) indices by systematic resampling."""
    at = (np.arange(n) + chance.random()) / max(n, 1)
    return np.minimum(np.searchsorted(np.cumsum(weights), at), len(weights) - 1)
