"""One contact: which samples it covers, and what is known of the pressure there beforehand.

Inside, pressure has a level and varies slowly about it. At a blunt end it does little else, at a sharp one, a
corner's, it may stand out by far; the outermost samples are covered in part. Sizes are over a typical pressure.
"""

from collections.abc import Sequence
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
        return self._alone()[0]

    @property
    def covariance(self) -> Array:
        """(k, k) of those pressures."""
        mean, alone = self._alone()
        return np.asarray(np.outer(mean, mean) * alike(len(mean)) + np.diag(alone))

    def _alone(self) -> tuple[Array, Array]:
        samples = self.stop - self.first
        mean, alone = side_by_side([Contact(0, samples, self.kind)], samples)
        return mean[0], alone[0]


@cache
def alike(samples: int) -> Array:
    """(samples, samples) covariance of levels and slow variation, over the mean."""
    number = np.arange(samples)
    apart = np.abs(np.subtract.outer(number, number)) * (np.sqrt(5) / _LENGTH_SAMPLES)
    return np.asarray(_LEVEL_SD**2 + _SLOW**2 * (1 + apart + apart**2 / 3) * np.exp(-apart))


def side_by_side(contacts: Sequence[Contact], samples: int) -> tuple[Array, Array]:
    """(k, samples) means of k contacts' pressures, and variances of each sample by itself; 0 outside a contact.

    With them the covariance is `alike` times the means' products, and those variances.
    """
    first, stop, kind = np.array(contacts)[:, :, None].transpose(1, 0, 2)
    level, first_end, last_end = np.array(KINDS)[kind].transpose(2, 0, 1)
    number = np.arange(samples)
    from_first, from_last = number - first, stop - 1 - number
    inside = (from_first >= 0) & (from_last >= 0)
    outermost = (from_first == 0) | (from_last == 0)
    alone = _FREE**2 + _COVERED_SD**2 * outermost
    alone = alone + first_end**2 * (from_first <= 1) + last_end**2 * (from_last <= 1)
    return level * np.where(outermost, _COVERED, 1.0) * inside, level**2 * alone * inside
