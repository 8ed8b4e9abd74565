"""Bands of predicted forces and depths over equally likely fingers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COVERAGE = 0.9


@dataclass(frozen=True)
class Width:
    """Predicted value with its band, in its own unit."""

    middle: float
    low: float
    high: float

    @property
    def half(self) -> float:
        """Half-width of the band relative to its middle."""
        return (self.high - self.low) / (2 * self.middle)


def band(values: Array, own_error: float, coverage: float = COVERAGE) -> Width:
    """Return the log-normal band of (n,) equally likely values, widened by a relative error."""
    ln = np.log(values)
    half = standard_deviations(coverage) * np.hypot(ln.std(ddof=1), own_error)
    middle = float(ln.mean())
    return Width(*(float(np.exp(middle + sign * half)) for sign in (0, -1, 1)))


def parameter_ends(draws: Array, coverage: float = COVERAGE) -> tuple[Array, Array]:
    """Return the (p,) lower and upper ends of the bands of parameters, from (n, p) equally likely fingers."""
    low, high = np.quantile(draws, ends(coverage), axis=0)
    return low, high


def standard_deviations(coverage: float = COVERAGE) -> float:
    """Return the half-width of a band of a normal distribution, in standard deviations."""
    from scipy.special import ndtri  # slow to import, and most fingers are not identified

    return float(ndtri(ends(coverage)[1]))


def ends(coverage: float = COVERAGE) -> tuple[float, float]:
    """Return the quantiles of the lower and upper end of a band."""
    return 0.5 - coverage / 2, 0.5 + coverage / 2
