"""Nonnegative pressures averaged over models, by truncated normal distributions, and a table of random pressures."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from sim.coding.contact_search import Model, PressureLikelihood, PressurePosterior
from sim.coding.operators import ForwardOperator

Array = NDArray[np.float64]

MOST_MODELS = 40
FROM_BEST = 5.0
"""Log evidence below the best model at which models are dropped."""

_MOST_CUTS = 8
_SURELY_ABOVE = 2.5  # sd: truncation farther out changes nothing
_HALVINGS = 40
_NOTHING = 1e-300  # smallest weight with a finite log


@dataclass(frozen=True)
class Mixture:
    """Models (k,) with means and sds (k, n) of their pressures, sd 0 where a model has no contact."""

    log_weight: Array
    mean: Array
    sd: Array

    @property
    def weight(self) -> Array:
        """(k,) weights that sum to 1."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(weight / weight.sum())

    def moments(self) -> tuple[Array, Array]:
        """Return (n,) mean and standard deviation of each pressure."""
        middle = np.maximum(0.0, self.weight @ self.mean)
        return middle, np.sqrt(self.weight @ (self.sd**2 + (self.mean - middle) ** 2))

    def quantile(self, share: float) -> Array:
        """Return (n,) quantiles of the pressures, not below 0."""
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


def mixed(likelihood: PressureLikelihood, known: dict[Model, float]) -> Mixture:
    """Return the mixture of the most probable models, weighted by evidence and probability of positive pressures."""
    best = max(known.values())
    models = sorted((m for m in known if known[m] > best - FROM_BEST), key=known.__getitem__, reverse=True)
    models = models[:MOST_MODELS]
    found = likelihood.posterior(models)
    mean, covariance, above = cut_off(found.mean, found.covariance)
    mean, variance = PressurePosterior(found.at, mean, covariance).over(len(likelihood.towards))
    sd = np.sqrt(np.maximum(variance, 0.0))
    return Mixture(np.array([known[m] for m in models]) + above, likelihood.typical * mean, likelihood.typical * sd)


def together(mixtures: list[Mixture]) -> Mixture:
    """Return a mixture of all models of several."""
    return Mixture(*(np.concatenate([getattr(m, name) for m in mixtures]) for name in ("log_weight", "mean", "sd")))


def pooled(first: Mixture, second: Mixture, share: float) -> Mixture:
    """Return both mixtures, the first with a share < 1 of the probability; its models come first."""
    weight = np.concatenate([share * first.weight, (1 - share) * second.weight])
    both = (np.concatenate([getattr(m, name) for m in (first, second)]) for name in ("mean", "sd"))
    return Mixture(np.log(np.maximum(weight, _NOTHING)), *both)


def cut_off(mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Return moments of (k, n) normal pressures truncated at 0, and (k,) log probabilities of being positive.

    Assumed-density filtering: repeatedly, the pressure that is least surely positive is truncated, and all others
    change by their correlation with it.
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


# --- prior samples ---
#
# Random pressures of one to three contacts with ends anywhere, a level and slow variation inside. At a sharp end, a
# corner's, pressure rises as one over the root of the distance, with an amplitude unknown to a factor; the ends of
# one contact are usually of the same kind.

HOW_MANY = (0.2, 0.5, 0.3)
"""Probabilities of one, two and three contacts. These and all values below were chosen on other scenes and seeds than
those reported (docs/validation/coding.md)."""

SHARP, ALIKE = 0.6, 0.6
"""Probabilities of a sharp end, and that both ends are of the same kind."""

_LEVEL_SD = 0.6  # sd of log levels between contacts
_SLOW, _LENGTH_SAMPLES = 0.2, 4.0  # variation inside relative to the level: sd and length (Matérn 5/2)
_PEAK, _PEAK_SD = 1.3, 0.8  # log amplitude of a sharp end / level
_FADES_SAMPLES = 1.0
_NARROWEST = 0.7  # samples


def imagined(count: int, samples: int, seed: int = 0) -> Array:
    """Return (count, samples) random pressures, not negative; about 1 inside contacts."""
    rng = np.random.default_rng(seed)
    found = np.zeros((count, samples))
    several = rng.choice(len(HOW_MANY), count, p=HOW_MANY) + 1
    for contacts in range(1, len(HOW_MANY) + 1):
        at = np.flatnonzero(several == contacts)
        ends = np.sort(rng.uniform(0.0, samples, (len(at), 2 * contacts)), axis=1)
        for first, last in ends.reshape(len(at), contacts, 2).transpose(1, 2, 0):
            level = np.exp(_LEVEL_SD * rng.normal(size=(len(at), 1)))
            found[at] += level * _contact(first, np.maximum(last, first + _NARROWEST), samples, rng)
    return found


def _contact(first: Array, last: Array, samples: int, rng: np.random.Generator) -> Array:
    """Return (count, samples) pressures of contacts between (count,) positions, in samples."""
    number = np.arange(samples)
    covered = np.clip(np.minimum(number + 1, last[:, None]) - np.maximum(number, first[:, None]), 0.0, 1.0)
    apart = np.abs(np.subtract.outer(number, number)) * (np.sqrt(5) / _LENGTH_SAMPLES)
    alike = np.linalg.cholesky((1 + apart + apart**2 / 3) * np.exp(-apart) + 1e-6 * np.eye(samples))
    inside = np.maximum(0.0, 1 + _SLOW * rng.normal(size=covered.shape) @ alike.T)
    sharp = rng.random((2, len(first))) < SHARP
    sharp[1] = np.where(rng.random(len(first)) < ALIKE, sharp[0], sharp[1])
    peaks = np.zeros_like(covered)
    for is_sharp, from_end in zip(sharp, (number - first[:, None], last[:, None] - number - 1), strict=True):
        height = np.where(is_sharp, np.exp(_PEAK + _PEAK_SD * rng.normal(size=len(first))), 0.0)
        peaks += height[:, None] * _peak(from_end)
    return np.asarray(covered * inside + np.where(covered > 0, peaks, 0.0))


def _peak(from_end: Array) -> Array:
    """Return the mean of 1 / √distance over a sample at a distance from the end, with a decay; in samples."""
    begins, ends = np.maximum(0.0, from_end), np.maximum(0.0, from_end + 1)
    return np.asarray(2 * (np.sqrt(ends) - np.sqrt(begins)) * np.exp(-begins / _FADES_SAMPLES))


# --- table ---
#
# A table of random pressures with their SED is weighted by the likelihood of the readings at any size. With loud
# noise, hundreds of tens of thousands of entries explain the readings, without linearization or search. With less
# noise too few do. The likelihood is then raised to a power below 1, as if noise were louder, until enough do; that
# power is the fraction of the readings' information that the table uses.

Singles = NDArray[np.float32]

ENTRIES = 40_000
ENOUGH = 100.0
"""Effective number of entries required."""

_DRAWS = 400  # draws that represent the weighted entries
_SIZE_SD = 0.8  # sd of the log size of an entry, about that of the readings' SED
_STEPS = np.arange(-3.0, 3.01, 0.25)  # of that size, in sd
_WEAKER = 0.8  # ratio of successive powers
_UNLIKELY = 8.0  # log likelihood below the best at which entries are dropped


class Weighed(NamedTuple):
    """Weighted table entries, and the power of the likelihood."""

    mixture: Mixture
    power: float


class _Likelihood(NamedTuple):
    """Log likelihoods of an entry's SED times u: along · u − ½ square · u²."""

    along: Array  # (k,)
    square: Array  # (k,)


@dataclass(frozen=True)
class ProfileTable:
    """Pressures (k, n), not negative, and their normalized SED (k, m); forces normal to the undeformed skin."""

    pressure: Singles
    sed: Singles
    squared: Singles  # squared SED

    def weighed(self, value: Array, variance: Array, size: float) -> Weighed:
        """Weight the entries by (m,) SED readings, their variances, and the norm of SED."""
        along = size * (self.sed @ (value / variance).astype(np.float32)).astype(np.float64)
        square = size**2 * (self.squared @ (1 / variance).astype(np.float32)).astype(np.float64)
        at, share, power = _until_enough(_Likelihood(along, square))
        entry, step = _spread_over(share)
        scale = np.sqrt(size) * np.exp(_SIZE_SD * _STEPS[step])
        mean = scale[:, None] * self.pressure[at[entry]].astype(np.float64)
        between = _SIZE_SD * (_STEPS[1] - _STEPS[0]) / 2
        return Weighed(Mixture(np.zeros(_DRAWS), mean, between * mean), power)


def _until_enough(likelihood: _Likelihood) -> tuple[NDArray[np.intp], Array, float]:
    """Return probable entries, their weights at each size, and the highest sufficient power."""
    along, square = likelihood
    best = np.where(along > 0, 0.5 * along**2 / square, 0.0)
    best -= best.max()
    larger, power = np.exp(2 * _SIZE_SD * _STEPS), 1.0
    while True:
        at = np.flatnonzero(power * best > -_UNLIKELY)
        log = larger * along[at, None] - 0.5 * larger**2 * square[at, None]
        share = np.exp(power * (log - log.max()) - 0.5 * _STEPS**2)
        of_entry = share.sum(axis=1)
        if of_entry.sum() ** 2 >= min(ENOUGH, 0.5 * len(best)) * (of_entry**2).sum():
            return at, share, power
        power *= _WEAKER


def _spread_over(share: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of draws in proportion to their shares."""
    rising = np.cumsum(share)
    picked = np.searchsorted(rising, (np.arange(_DRAWS) + 0.5) / _DRAWS * rising[-1])
    row, column = np.unravel_index(picked, share.shape)
    return row, column


class _Same:
    """Operator compared by identity."""

    def __init__(self, operator: ForwardOperator) -> None:
        self.operator = operator

    def __hash__(self) -> int:
        return id(self.operator.parts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.operator.parts is self.operator.parts


def table_of(operator: ForwardOperator) -> ProfileTable:
    """Return an operator's table, made in some tenths of a second; the last few are cached."""
    return _made(_Same(operator))


@lru_cache(maxsize=4)
def _made(same: _Same) -> ProfileTable:
    samples = same.operator.parts.shape[2]
    upright = same.operator.leaning(np.zeros(samples)).parts.astype(np.float32)
    pressure = _drawn(ENTRIES, samples)
    sed = np.zeros((len(pressure), upright.shape[1]), np.float32)
    for part in upright:
        sed += (pressure @ part.T) ** 2
    size = np.linalg.norm(sed, axis=1, keepdims=True)
    sed /= size
    return ProfileTable(pressure / np.sqrt(size), sed, sed**2)


@lru_cache(maxsize=2)
def _drawn(entries: int, samples: int) -> Singles:
    """Return the random pressures that all operators of this size share."""
    return imagined(entries, samples).astype(np.float32)
