"""One contact: which samples it covers, and what is known of the pressure there beforehand.

Inside, pressure has a level and varies slowly about it. At a blunt end it does little else, at a sharp one, a
corner's, it may stand out by far; the outermost samples are covered in part. Sizes are over a typical pressure.
"""

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVELS = (0.3, 0.7, 1.6)
ENDS = (0.15, 2.0)
SHARP = 0.3
"""Levels, sds of blunt and of sharp ends, the probability of a sharp one: chosen on other scenes and seeds than those
reported (docs/coding.md), as all below."""

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


KINDS = tuple(Kind(level, *ends) for level in LEVELS for ends in product(ENDS, repeat=2))


def _log_prior(kind: Kind) -> float:
    sharp = sum(end == max(ENDS) for end in kind[1:])
    return float(np.log(SHARP) * sharp + np.log(1 - SHARP) * (2 - sharp) - np.log(len(LEVELS)))


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
        return KINDS[self.kind].level * _covered(self.stop - self.first)

    @property
    def covariance(self) -> Array:
        """(k, k) of those pressures."""
        return _covariance(self.stop - self.first, self.kind)


@cache
def _covered(samples: int) -> Array:
    covered = np.ones(samples)
    covered[[0, -1]] = _COVERED
    return covered


@cache
def _covariance(samples: int, kind: int) -> Array:
    level, first_end, last_end = KINDS[kind]
    number = np.arange(samples)
    apart = np.abs(np.subtract.outer(number, number)) * (np.sqrt(5) / _LENGTH_SAMPLES)
    slow = _SLOW**2 * (1 + apart + apart**2 / 3) * np.exp(-apart)
    from_first, from_last = number, number[::-1]
    alone = _FREE**2 + np.where((from_first == 0) | (from_last == 0), _COVERED_SD**2, 0.0)
    alone = alone + np.where(from_first <= 1, first_end**2, 0.0) + np.where(from_last <= 1, last_end**2, 0.0)
    covered = _covered(samples)
    return np.asarray(level**2 * (np.outer(covered, covered) * (_LEVEL_SD**2 + slow) + np.diag(alone)))
