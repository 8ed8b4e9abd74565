"""Candidates of a verdict, their maximum-likelihood fits, and their goodness of fit."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, fdtri, ncfdtr

from rig.compare.likelihood import Form, MaximumLikelihoodFits, Observed, maximum_likelihood
from rig.compare.plausible_fingers import fit_with_finger, free_of, weights
from rig.compare.verdict import LEVEL

Array = NDArray[np.float64]

SEEN = 0.8
"""Power at which a misfit counts as detectable."""

_KNOWN = 1e9  # degrees of freedom from which a variance counts as known
_CERTAIN = 12.0
_FOLDS = 5


def lack_of_fit(
    observed: Observed, mean: Array, deviance: Array, parameters: float, discrepancy: Array | float = 0.0
) -> tuple[Array, Array]:
    """Return F (N,) of deviances (N, p) against the noise, and the probability of a larger one if the model is right.

    `discrepancy` (N, p): variance, in rate², by which the right model may be wrong on another finger.
    """
    noise = observed.noise
    variance = noise.dispersion * observed.variance(mean)
    scaled = (deviance / noise.dispersion * variance / (variance + discrepancy)).sum(axis=1)
    freedom = np.maximum(observed.share(mean).sum(axis=1) - parameters, 1.0)
    ratio, even = scaled / freedom, observed.evenness
    return ratio, tail(ratio, even * freedom, even * noise.freedom)


def tail(ratio: Array, freedom: Array, of_noise: float) -> Array:
    """Return the probability of a larger F."""
    known = of_noise > _KNOWN
    return np.asarray(chdtrc(freedom, ratio * freedom) if known else fdtrc(freedom, of_noise, ratio))


def rejected(misfit: Array, freedom: float, of_noise: float) -> Array:
    """Return the probability that a misfit (…,), in deviance over the dispersion, is rejected."""
    of_noise = min(of_noise, _KNOWN)
    limit = fdtri(freedom, of_noise, 1 - LEVEL)
    certain = misfit > _CERTAIN * freedom * limit  # ncfdtr is undefined for some of these
    return np.where(certain, 1.0, 1 - ncfdtr(freedom, of_noise, np.where(certain, 0.0, misfit), limit))


def detectable(observed: Observed, parameters: float) -> float:
    """Return the rms misfit, relative to the largest rate, that is rejected in a share `SEEN` of recordings."""
    even, noise = observed.evenness, observed.noise
    worth = observed.share(observed.smooth)
    freedom = max(float(worth.sum()) - parameters, 1.0)
    low, high = 0.0, 1e4
    for _ in range(60):
        middle = 0.5 * (low + high)
        detected = rejected(np.array(even * middle), even * freedom, even * noise.freedom) >= SEEN
        low, high = (low, middle) if detected else (middle, high)
    variance = noise.dispersion * float((worth * observed.variance(observed.smooth)).sum()) / max(worth.sum(), 1e-9)
    return float(np.sqrt(high / max(worth.sum(), 1.0) * variance)) / (float(observed.rate.max()) or 1.0)


def by_repeats(observed: Observed) -> float:
    """Return the share of the variance of mean rates that is not noise: split halves, corrected by Spearman–Brown.

    Averaged over all splits, this is 1 − noise / variance between positions.
    """
    noise = observed.noise.dispersion * observed.variance(observed.rate)
    total = float(((observed.rate - observed.rate.mean()) ** 2).sum()) / max(len(observed.rate) - 1, 1)
    return float(np.clip(1 - noise.mean() / total, 0.0, 1.0)) if total > 0 else 0.0


def by_monotone(eps: Array, observed: Observed) -> float:
    """Return the held-out share of variance that the best monotone function of any candidate ε (N, p) explains.

    Blocks of positions are left out in turn. This is an upper bound for the rate model, since it takes the best of
    many functions with any number of steps.
    """
    fold = blocks(observed, _FOLDS)
    nothing = ((observed.rate - observed.rate.mean()) ** 2).sum()
    if nothing == 0:
        return 0.0
    left = [min(_left(sign * row, observed.rate, fold) for sign in (1, -1)) for row in eps if np.isfinite(row).all()]
    return float(np.clip(1 - min(left, default=nothing) / nothing, 0.0, 1.0))


def _left(eps: Array, rate: Array, fold: NDArray[np.int64]) -> float:
    from scipy.optimize import isotonic_regression  # slow to import, and not needed if there are repeats

    left = 0.0
    for number in np.unique(fold):
        out = fold == number
        order = np.argsort(eps[~out], kind="stable")
        steps = isotonic_regression(rate[~out][order]).x
        left += float(((rate[out] - np.interp(eps[out], eps[~out][order], steps)) ** 2).sum())
    return left


def blocks(observed: Observed, folds: int) -> NDArray[np.int64]:
    """Return (p,) cross-validation folds: blocks of neighboring positions, `folds` in each stimulus."""
    number = np.empty(len(observed.rate), dtype=np.int64)
    for stimulus in np.unique(observed.stimulus):
        mine = np.flatnonzero(observed.stimulus == stimulus)
        number[mine] = stimulus * folds + np.arange(len(mine)) * min(folds, len(mine)) // len(mine)
    return np.unique(number, return_inverse=True)[1]


Flags = NDArray[np.bool_]

DISCREPANCY = 0.5
"""Allowed discrepancy of a true measure on a finger between the simulated ones, relative to the spread of these."""

OF_THE_MESH = 0.02
"""Allowed discrepancy between meshes, relative to the largest rate (docs/statistics.md)."""


class Fitted(NamedTuple):
    """Fits of all candidates, with ε (N, p) on the best finger and the coordinates (N, free) of that finger."""

    found: MaximumLikelihoodFits
    eps: Array
    place: Array


@dataclass(frozen=True, eq=False)
class Candidates:
    """ε (fingers, N, p) of measures and controls on one finger, or on the design of plausible ones."""

    eps: Array
    form: Form

    @property
    def free(self) -> int:
        """Number of fitted parameters of the finger."""
        return free_of(self.eps)

    @property
    def parameters(self) -> int:
        """Number of fitted parameters of a candidate."""
        return self.form.parameters + self.free

    def only(self, chosen: Flags | NDArray[np.int64]) -> "Candidates":
        """Return a subset of the candidates."""
        return replace(self, eps=self.eps[:, chosen])

    def fitted(self, observed: Observed, at: Flags | None = None) -> Fitted:
        """Return the fits to all positions, or to some; ε of the result covers every position."""
        at = np.ones(len(observed.rate), dtype=bool) if at is None else at
        some = observed.at(at)
        if not self.free:
            return Fitted(
                maximum_likelihood(self.eps[0][:, at], some, self.form), self.eps[0], np.zeros((self.eps.shape[1], 0))
            )
        weight = 1 / some.variance(some.smooth)
        place = fit_with_finger(self.eps[:, :, at], some.rate, weight, silent=self.form.silent_at_rest).place
        eps = np.einsum("nf,fnp->np", weights(place), self.eps)
        return Fitted(maximum_likelihood(eps[:, at], some, self.form), eps, place)

    def discrepancy(self, fit: Fitted) -> Array:
        """Return the (N, p) variance of rates between fingers and meshes; zero without plausible fingers.

        It is a share of the differences between fingers of the design, after refitting k and ε₀, plus a share of the
        largest rate.
        """
        if not self.free:
            return np.zeros_like(fit.found.mean)
        own = fit.eps - fit.eps.mean(axis=1, keepdims=True)
        all_ = self.eps - self.eps.mean(axis=2, keepdims=True)
        slope = (all_ * own).sum(axis=2) / np.maximum((own * own).sum(axis=1), np.finfo(float).tiny)
        spread = ((all_ - slope[..., None] * own) ** 2).mean(axis=0)
        fires = fit.found.mean > 0
        of_finger = DISCREPANCY**2 * np.nan_to_num(fit.found.k)[:, None] ** 2 * spread
        of_mesh = (OF_THE_MESH * fit.found.mean.max(axis=1, keepdims=True)) ** 2
        return np.where(fires, of_finger + of_mesh, 0.0)

    def tested(self, observed: Observed, fit: Fitted) -> tuple[Array, Array]:
        """Return F and p (N,) of each candidate's fit."""
        found = fit.found
        return lack_of_fit(observed, found.mean, found.deviance, self.parameters, self.discrepancy(fit))
