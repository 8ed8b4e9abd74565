"""A table of imagined pressures with their SED: each weighed by how well it explains readings, whatever its size.

Where noise is loud, hundreds of tens of thousands of entries explain the readings: nothing is made linear, nothing is
searched for. Where it is quiet too few do. The likelihood is then taken to a power below 1, as if noise were louder,
until enough do; that power says how much of what the readings tell the table takes in.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import Operator
from sim.coding.profiles.imagined import imagined
from sim.coding.profiles.mixture import Mixture

Array = NDArray[np.float64]
Singles = NDArray[np.float32]

ENTRIES = 40_000
ENOUGH = 100.0
"""Effective entries."""

_DRAWS = 400  # that stand for the weighed entries
_SIZE_SD = 0.8  # of the log of an entry's pressures, about those whose SED is as large as the readings'
_STEPS = np.arange(-3.0, 3.01, 0.25)  # of that, in sd
_WEAKER = 0.8  # each power over the one before
_UNLIKELY = 8.0  # log likelihood below the best: left out


class Weighed(NamedTuple):
    """What explains readings, and the power that its likelihood was taken to."""

    mixture: Mixture
    power: float


class _Likelihood(NamedTuple):
    """Logs, of an entry's SED times u: along · u − ½ square · u²."""

    along: Array  # (k,)
    square: Array  # (k,)


@dataclass(frozen=True)
class ProfileTable:
    """(k, n) pressures, not negative, and their (k, m) SED, whose squares sum to 1; forces upright."""

    pressure: Singles
    sed: Singles
    squared: Singles  # SED

    def weighed(self, value: Array, variance: Array, size: float) -> Weighed:
        """By (m,) readings of SED, their variances, and about how large SED is: the root of its sum of squares."""
        along = size * (self.sed @ (value / variance).astype(np.float32)).astype(np.float64)
        square = size**2 * (self.squared @ (1 / variance).astype(np.float32)).astype(np.float64)
        at, share, power = _until_enough(_Likelihood(along, square))
        entry, step = _spread_over(share)
        scale = np.sqrt(size) * np.exp(_SIZE_SD * _STEPS[step])
        mean = scale[:, None] * self.pressure[at[entry]].astype(np.float64)
        between = _SIZE_SD * (_STEPS[1] - _STEPS[0]) / 2
        return Weighed(Mixture(np.zeros(_DRAWS), mean, between * mean), power)


def _until_enough(likelihood: _Likelihood) -> tuple[NDArray[np.intp], Array, float]:
    """Entries that are not unlikely, the share of each at each step of size, and the highest power that will do."""
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
    """Rows and columns of draws, as many of each as its share has it."""
    rising = np.cumsum(share)
    picked = np.searchsorted(rising, (np.arange(_DRAWS) + 0.5) / _DRAWS * rising[-1])
    row, column = np.unravel_index(picked, share.shape)
    return row, column


class _Same:
    """An operator by identity."""

    def __init__(self, operator: Operator) -> None:
        self.operator = operator

    def __hash__(self) -> int:
        return id(self.operator.parts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.operator.parts is self.operator.parts


def table_of(operator: Operator) -> ProfileTable:
    """Made once for an operator, in some tenths of a second; the last few are kept."""
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
    """The same for every operator of so many pressures."""
    return imagined(entries, samples).astype(np.float32)
