"""How well anybody could read pressures back: limits beside the decoders' errors.

Two pressures: the least mean error of Eq. 6.8 of a reader who is told which distribution they are from, by Bayes over
a grid of it. Whole profiles: the Cramér–Rao bound of an unbiased reader who knows the indentor and the finger, not
where it presses and how deep.
"""

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import ForwardOperator

Array = NDArray[np.float64]

ACROSS = 61  # values of each of two pressures
_GRIDS = 3
_UNLIKELY = 18.0  # log likelihood below the highest


def bayes_found(operator: ForwardOperator, reading: Array, sd: float, within: tuple[Array, Array]) -> Array:
    """(2,) the pressures whose expected error of Eq. 6.8 is least, if they are even between two (2,) ends.

    The grid is laid anew about what the last one left likely.
    """
    low, high = within
    for _ in range(_GRIDS):
        step = (high - low) / ACROSS
        axes = [first + each * (np.arange(ACROSS) + 0.5) for first, each in zip(low, step, strict=True)]
        both = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
        sed = ((operator.parts @ both) ** 2).sum(axis=0)
        log = -0.5 * (((sed - reading[:, None]) / sd) ** 2).sum(axis=0)
        likely = both[:, log > log.max() - _UNLIKELY]
        low, high = np.maximum(low, likely.min(axis=1) - step), np.minimum(high, likely.max(axis=1) + step)
    weight = np.exp(log - log.max()) / (both**2).sum(axis=0)
    return np.asarray(both @ weight / weight.sum())


def profile_bound(true: Array, true_slope: Array, sed_slope: Array, sd: float) -> float:
    """Relative L2 of (n,) pressures, from their (n, k) slopes by what is not known, and the (m, k) ones of SED."""
    covariance = sd**2 * np.linalg.inv(sed_slope.T @ sed_slope)
    return float(np.sqrt(np.trace(true_slope @ covariance @ true_slope.T)) / np.linalg.norm(true))
