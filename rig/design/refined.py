"""Evidence of one candidate when few draws from the prior count: draws that are refined around the best of them.

After a long session, hardly any draw from the prior comes near the fiber. Draws are then made around the best, at
first as if the counts said less, and each has the weight prior × likelihood / density (adaptive importance sampling:
Cappé et al., J. Comput. Graph. Stat. 13, 907, 2004). Their mean weight estimates the evidence without bias.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from rig.design.counts import CountModel, CountSums
from rig.design.fibers import fibers_at, log_rates, relative_rates
from rig.design.response_table import ResponseTable

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Ints = NDArray[np.int64]

FEW = 10.0
"""Effective draws from which the evidence of a candidate is accurate enough (a third, as a standard error)."""

BEST = 256
"""Draws from the prior that the first round begins with."""

_MADE = 256  # draws of a round
_CENTERS = 48
_BROAD = 30.0  # effective draws to which a round is tempered
_ENOUGH = 40.0
_ROUNDS = 6
_FREEDOM = 5.0  # of Student's t, whose tails are wider than a posterior's


class Refined(NamedTuple):
    """Log evidence of a candidate, and the effective number of draws."""

    log_evidence: float
    effective: float


def best_draws(log_likelihood: Floats) -> Ints:
    """Return (…, BEST) numbers of the draws with the largest likelihood, from (…, draws)."""
    best = min(BEST, log_likelihood.shape[-1])
    return np.argpartition(log_likelihood, -best, axis=-1)[..., -best:]


def effective_draws(log_weight: Array) -> float:
    """Return the effective number of weighted draws."""
    weight = np.exp(log_weight - log_weight.max())
    return float(weight.sum() ** 2 / (weight**2).sum())


def refined_evidence(
    table: ResponseTable,
    candidate: str,
    model: CountModel,
    sums: CountSums,
    z: Array,
    log_likelihood: Floats,
    chance: np.random.Generator,
    used: Ints | None = None,
) -> Refined:
    """Return the evidence of a candidate for one data set, whose presses are `used` (default: all).

    `table` has all presses on the bench, as the rates are relative to the strongest. `z` (n, unknowns) and
    `log_likelihood` (n,) are the best draws from the prior.
    """
    best = Refined(-np.inf, 0.0)
    log_weight = np.asarray(log_likelihood, dtype=float)
    for _ in range(_ROUNDS):
        z, log_density = _around(z, _tempered(log_weight), chance)
        fibers = fibers_at(z, table, model.unknowns)
        rates = relative_rates(table, candidate, fibers)
        log_rate = log_rates(rates if used is None else rates[:, used])
        log_likelihood = model.log_likelihood(sums, log_rate, fibers)[0]
        log_weight = log_likelihood + _log_normal(z) - log_density
        found = Refined(float(logsumexp(log_weight) - np.log(len(z))), effective_draws(log_weight))
        best = max(best, found, key=lambda one: one.effective)
        if found.effective >= _ENOUGH:
            break
    return best


def _tempered(log_weight: Array) -> Array:
    """Return weights to the power at most 1 that leaves `_BROAD` effective draws."""
    log_weight = log_weight - log_weight.max()
    low, high = 0.0, 1.0
    if effective_draws(log_weight) < _BROAD:
        for _ in range(20):
            power = (low + high) / 2
            low, high = (power, high) if effective_draws(power * log_weight) > _BROAD else (low, power)
    weight = np.exp(high * log_weight)
    return np.asarray(weight / weight.sum())


def _around(z: Array, weight: Array, chance: np.random.Generator) -> tuple[Array, Array]:
    """Return draws around weighted draws, and their log density: a mixture of Student's t with the kernel's width."""
    n, k = z.shape
    at = (np.arange(_CENTERS) + chance.random()) / _CENTERS
    center = z[np.minimum(np.searchsorted(np.cumsum(weight), at), n - 1)]
    apart = z - weight @ z
    spread = (apart * weight[:, None]).T @ apart + 1e-6 * np.eye(k)
    width = (4 / ((k + 2) * min(1 / (weight**2).sum(), _CENTERS))) ** (1 / (k + 4))
    root = np.linalg.cholesky(spread) * width
    scale = np.sqrt(_FREEDOM / chance.chisquare(_FREEDOM, _MADE))
    step = (chance.standard_normal((_MADE, k)) * scale[:, None]) @ root.T
    made = center[np.arange(_MADE) % _CENTERS] + step
    white, of_center = (np.linalg.solve(root, one.T).T for one in (made, center))
    distance = (white**2).sum(axis=1)[:, None] + (of_center**2).sum(axis=1) - 2 * white @ of_center.T
    kernel = -(_FREEDOM + k) / 2 * np.log1p(np.maximum(distance, 0.0) / _FREEDOM)
    constant = (
        gammaln((_FREEDOM + k) / 2)
        - gammaln(_FREEDOM / 2)
        - k / 2 * np.log(_FREEDOM * np.pi)
        - np.log(np.diag(root)).sum()
    )
    top = kernel.max(axis=1)
    mixture = top + np.log(np.exp(kernel - top[:, None]).mean(axis=1))
    return made, mixture + constant


def _log_normal(z: Array) -> Array:
    return np.asarray(-0.5 * (z**2).sum(axis=1) - z.shape[1] / 2 * np.log(2 * np.pi))
