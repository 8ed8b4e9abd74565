"""One contact: which samples it covers, and what is known of the pressure there beforehand.

Inside, pressure has a level and varies slowly about it. At a blunt end it does little else, at a sharp one, a
corner's, it may stand out by far; the outermost samples are covered in part. Sizes are over a typical pressure.
"""

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky

Array = NDArray[np.float64]

LEVELS = (0.3, 0.7, 1.6)
ENDS = (0.2, 2.0)
SHARP, ALIKE = 0.5, 0.4
"""Levels; sds of blunt and of sharp ends; the probabilities of a sharp one, and that the last end is told to be as
the first. Chosen on other scenes and seeds than those reported (docs/coding.md), as all below."""

_LEVEL_SD = 0.5  # over the level
_SLOW = 0.2  # sd of the slow variation over the level, and its length (Matérn 5/2)
_LENGTH_SAMPLES = 4.0
_COVERED = 0.5  # of an outermost sample, and its sd
_COVERED_SD = 0.3
_FREE = 0.02  # sd of each sample by itself: covariances keep an inverse


class Kind(NamedTuple):
    """Prior mean over the typical pressure; over that mean the sds of two samples at the first end, at the last."""

    level: float
    first_end: float
    last_end: float

    @property
    def sharp(self) -> bool:
        """At some end."""
        return max(ENDS) in self[1:]


KINDS = tuple(Kind(level, *ends) for level in LEVELS for ends in product(ENDS, repeat=2))


def _log_prior(kind: Kind) -> float:
    first, last = (SHARP if end == max(ENDS) else 1 - SHARP for end in kind[1:])
    alike = ALIKE if kind.first_end == kind.last_end else 0.0
    return float(np.log(first * (alike + (1 - ALIKE) * last) / len(LEVELS)))


_LOG_PRIOR = [_log_prior(kind) for kind in KINDS]


class Contact(NamedTuple):
    """Samples first … stop − 1, and a place in KINDS."""

    first: int
    stop: int
    kind: int

    @property
    def samples(self) -> slice:
        """Those it covers."""
        return slice(self.first, self.stop)

    @property
    def log_prior(self) -> float:
        """Log probability of its kind."""
        return _LOG_PRIOR[self.kind]

    @property
    def mean(self) -> Array:
        """(k,) pressures of its k samples beforehand, over the typical pressure."""
        return _beforehand(self.stop - self.first, self.kind)[0]

    @property
    def root(self) -> Array:
        """(k, k) lower triangular; times its transpose the covariance of those pressures."""
        return _beforehand(self.stop - self.first, self.kind)[1]

    @property
    def covariance(self) -> Array:
        """(k, k) of those pressures."""
        return np.asarray(self.root @ self.root.T)


@cache
def _beforehand(samples: int, kind: int) -> tuple[Array, Array]:
    """Mean and root of a contact of so many samples."""
    level, first_end, last_end = KINDS[kind]
    number = np.arange(samples)
    outermost = (number == 0) | (number == samples - 1)
    alone = _FREE**2 + _COVERED_SD**2 * outermost + first_end**2 * (number <= 1)
    alone = alone + last_end**2 * (number >= samples - 2)
    mean = np.where(outermost, _COVERED, 1.0)
    apart = np.abs(np.subtract.outer(number, number)) * (np.sqrt(5) / _LENGTH_SAMPLES)
    alike = _LEVEL_SD**2 + _SLOW**2 * (1 + apart + apart**2 / 3) * np.exp(-apart)
    return level * mean, level * cholesky(np.outer(mean, mean) * alike + np.diag(alone), lower=True)


@cache
def table_of_contacts(most: int) -> tuple[Array, Array, Array]:
    """Means (kinds, most, most) and roots (kinds, most, most, most) of contacts of 1 … most samples of every kind.

    And the (kinds,) log probabilities.
    """
    mean, root = np.zeros((len(KINDS), most, most)), np.zeros((len(KINDS), most, most, most))
    for kind, k in product(range(len(KINDS)), range(most)):
        mean[kind, k, : k + 1], root[kind, k, : k + 1, : k + 1] = _beforehand(k + 1, kind)
    return mean, root, np.array(_LOG_PRIOR)
