"""How well a force, or a depth, is known: a band about the middle of what equally likely fingers answer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

Array = NDArray[np.float64]

COVERAGE = 0.9


@dataclass(frozen=True)
class Width:
    """A number that is known to a band, in its own unit."""

    middle: float
    low: float
    high: float

    @property
    def half(self) -> float:
        """Half of the band over the middle."""
        return (self.high - self.low) / (2 * self.middle)


def band(values: Array, own_error: float, coverage: float = COVERAGE) -> Width:
    """Of (n,) equally likely values, widened by a relative error of their own: normal in the logarithm."""
    ln = np.log(values)
    half = standard_deviations(coverage) * np.hypot(ln.std(ddof=1), own_error)
    middle = float(ln.mean())
    return Width(*(float(np.exp(middle + sign * half)) for sign in (0, -1, 1)))


def standard_deviations(coverage: float = COVERAGE) -> float:
    """How many either side of a normal's mean hold so much of it."""
    return float(ndtri(ends(coverage)[1]))


def ends(coverage: float = COVERAGE) -> tuple[float, float]:
    """The shares that lie below a band of so much, and below its upper end."""
    return 0.5 - coverage / 2, 0.5 + coverage / 2
