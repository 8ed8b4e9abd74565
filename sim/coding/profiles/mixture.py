"""Pressures averaged over models, none below 0: what would lie there is cut off, and the others give way."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from sim.coding.profiles.seen import Model, Posterior, Seen

Array = NDArray[np.float64]

MOST_MODELS = 40
FROM_BEST = 5.0
"""In log evidence: models farther below the best are left out."""

_MOST_CUTS = 8
_SURELY_ABOVE = 2.5  # sd: what is cut off so far out moves nothing
_HALVINGS = 40
_NOTHING = 1e-300  # a weight whose log is still a number


@dataclass(frozen=True)
class Mixture:
    """(k,) models; (k, n) means and sds of each model's pressures, sd 0 where it has no contact."""

    log_weight: Array
    mean: Array
    sd: Array

    @property
    def weight(self) -> Array:
        """(k,) that sum to 1."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(weight / weight.sum())

    def moments(self) -> tuple[Array, Array]:
        """(n,) mean and standard deviation of each pressure."""
        middle = np.maximum(0.0, self.weight @ self.mean)
        return middle, np.sqrt(self.weight @ (self.sd**2 + (self.mean - middle) ** 2))

    def quantile(self, share: float) -> Array:
        """(n,) the lowest pressure below which so much of the probability lies; not below 0."""
        low, high = np.zeros(self.mean.shape[1]), np.maximum(0.0, (self.mean + 8 * self.sd).max(axis=0))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            beyond = self.weight @ self._below(middle) >= share
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        return np.asarray(high)

    def _below(self, value: Array) -> Array:
        spread = self.sd > 0
        z = (value - self.mean) / np.where(spread, self.sd, 1.0)
        return np.where(spread, ndtr(z), 1.0)


def mixed(seen: Seen, known: dict[Model, float]) -> Mixture:
    """Of the likeliest models, each weighed by its evidence and by how probably its pressures all lie above 0."""
    best = max(known.values())
    models = sorted((m for m in known if known[m] > best - FROM_BEST), key=known.__getitem__, reverse=True)
    models = models[:MOST_MODELS]
    found = seen.posterior(models)
    mean, covariance, above = cut_off(found.mean, found.covariance)
    mean, variance = Posterior(found.at, mean, covariance).over(len(seen.towards))
    sd = np.sqrt(np.maximum(variance, 0.0))
    return Mixture(np.array([known[m] for m in models]) + above, seen.typical * mean, seen.typical * sd)


def together(mixtures: list[Mixture]) -> Mixture:
    """All of their models."""
    return Mixture(*(np.concatenate([getattr(m, name) for m in mixtures]) for name in ("log_weight", "mean", "sd")))


def pooled(first: Mixture, second: Mixture, share: float) -> Mixture:
    """Both, the first having so much of the probability, less than 1; its models come first."""
    weight = np.concatenate([share * first.weight, (1 - share) * second.weight])
    both = (np.concatenate([getattr(m, name) for m in (first, second)]) for name in ("mean", "sd"))
    return Mixture(np.log(np.maximum(weight, _NOTHING)), *both)


def cut_off(mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Moments of (k, n) normal pressures that are not negative, and the (k,) log probabilities that they are not.

    By assumed-density filtering: time after time the pressure that is least surely above 0 is cut off there, and all
    move with it as they go together.
    """
    models = np.arange(len(mean))
    todo, above = np.diagonal(covariance, axis1=1, axis2=2) > 0, np.zeros(len(mean))
    for _ in range(_MOST_CUTS):
        variance = np.diagonal(covariance, axis1=1, axis2=2)
        z = np.where(todo, mean / np.sqrt(np.where(todo, variance, 1.0)), np.inf)
        cut = z.argmin(axis=1)
        lowest = z[models, cut]
        cutting = lowest < _SURELY_ABOVE
        if not cutting.any():
            break
        log_share = np.where(cutting, log_ndtr(np.where(cutting, lowest, 0.0)), 0.0)
        at = np.where(cutting, lowest, 0.0)
        mills = np.where(cutting, np.exp(-0.5 * at**2 - log_share) / np.sqrt(2 * np.pi), 0.0)
        along = covariance[models, :, cut] / np.sqrt(np.where(cutting, variance[models, cut], 1.0))[:, None]
        mean = mean + mills[:, None] * along
        covariance = covariance - (mills * (mills + at))[:, None, None] * along[:, :, None] * along[:, None, :]
        todo[models[cutting], cut[cutting]] = False
        above += log_share
    return mean, covariance, above
