"""Fibers that a design must allow for: draws of all that is unknown, and the rates of a candidate.

A fiber fires at R = k · g, with g = max(0, ε − ε₀) relative to its value at the strongest possible press. The gain k
is thus the rate at that press, and the threshold is a share of ε there, so that both have the same meaning for every
candidate. All candidates share the draws, so that differences between them are not differences of draws.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from rig.compare.place_grid import spline_weights
from rig.compare.plausible_fingers import weights
from rig.design.response_table import CANDIDATES, ResponseTable

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Range = tuple[float, float]

SIGNED = frozenset({"e12", "e23", "e13"})
"""Shear strains, whose sign no convention prefers: a fiber may fire at either."""

FLOOR = 0.005
"""Rate at rest that a candidate allows for, relative to the strongest press, so that no spike is impossible."""

_OF_FIBER = 6  # unknowns but those of the finger
_AT_ONCE = 2048  # fibers in a product of matrices
_LEVELS = 3  # values of an unknown dispersion


class Unknowns(NamedTuple):
    """Ranges of the unknown parameters of a fiber.

    Lowest and highest rate at the strongest press (1/s), threshold (share of ε there), receptor x (mm), its depth
    below the epidermis (mm), dispersion; and the standard deviation of the drift of ln k in ten minutes.
    """

    rate_per_s: Range = (20.0, 100.0)
    threshold: Range = (0.0, 0.5)
    x_mm: Range = (-0.5, 0.5)
    below_mm: Range = (0.1, 0.7)
    dispersion: Range = (1.5, 1.5)
    drift: float = 0.1

    @property
    def gain_shape(self) -> float:
        """Shape of the gamma distribution with the mean and variance of a uniform k."""
        low, high = self.rate_per_s
        return 3.0 * ((low + high) / max(high - low, 0.05 * high)) ** 2

    @property
    def gain_mean_per_s(self) -> float:
        """Mean of k (1/s)."""
        return sum(self.rate_per_s) / 2

    @property
    def dispersions(self) -> Array:
        """Values of the dispersion, evenly spaced in its logarithm."""
        low, high = self.dispersion
        if low == high:
            return np.array([low])
        return np.asarray(low * (high / low) ** ((np.arange(_LEVELS) + 0.5) / _LEVELS))


@dataclass(frozen=True, eq=False)
class FiberDraws:
    """Fibers (n,) without their gain.

    `place` (n, nodes) and `finger` (n, fingers of the design) are weights of the table; `level` (n,) says which
    dispersion. `z` (n, unknowns) has the same fibers as independent standard normal numbers.
    """

    threshold: Array
    place: Floats
    finger: Floats
    drift: Array
    level: Ints
    sign: Array
    z: Array

    def __len__(self) -> int:
        """Return the number of fibers."""
        return len(self.threshold)


def draw_fibers(n: int, table: ResponseTable, unknowns: Unknowns, seed: int, *, evenly: bool = True) -> FiberDraws:
    """Return n fibers; `evenly` spread by a scrambled Sobol sequence, which integrates better, or independent."""
    from scipy.stats import qmc  # slow to import, and a help does not need it

    chance = np.random.default_rng(seed)
    each = _OF_FIBER + table.free
    u = qmc.Sobol(each, seed=chance).random(n) if evenly else chance.random((n, each))
    return fibers_at(ndtri(np.clip(u, 1e-6, 1 - 1e-6)), table, unknowns)


def fibers_at(z: Array, table: ResponseTable, unknowns: Unknowns) -> FiberDraws:
    """Return the fibers at standard normal numbers (n, unknowns)."""
    u = ndtr(z)
    x, below = (low + (high - low) * u[:, k] for k, (low, high) in enumerate((unknowns.x_mm, unknowns.below_mm), 1))
    place = spline_weights(table.below_mm, below)[:, :, None] * spline_weights(table.x_mm, x)[:, None, :]
    low, high = unknowns.threshold
    return FiberDraws(
        low + (high - low) * u[:, 0],
        place.reshape(len(z), -1).astype(np.float32),
        weights(2 * u[:, _OF_FIBER:] - 1).astype(np.float32),
        unknowns.drift * z[:, 3],
        np.minimum(u[:, 4] * len(unknowns.dispersions), len(unknowns.dispersions) - 1).astype(np.int64),
        np.where(u[:, 5] < 0.5, -1.0, 1.0),
        z,
    )


def relative_rates(table: ResponseTable, candidate: str, draws: FiberDraws) -> Floats:
    """Return (n, presses) rates relative to that at the strongest press; zero below threshold."""
    values = table.values[:, :, CANDIDATES.index(candidate)]  # (fingers, presses, nodes)
    of_both = values.transpose(0, 2, 1).reshape(-1, values.shape[1])
    eps = np.empty((len(draws), values.shape[1]), dtype=np.float32)
    for first in range(0, len(draws), _AT_ONCE):
        mine = slice(first, first + _AT_ONCE)
        both = draws.finger[mine, :, None] * draws.place[mine, None, :]
        eps[mine] = both.reshape(len(both), -1) @ of_both
    if candidate in SIGNED:
        eps *= draws.sign[:, None]
    top = eps.max(axis=1, keepdims=True)
    eps0 = draws.threshold[:, None] * top
    reach = np.where(top > 0, top - eps0, np.inf)
    return np.maximum((eps - eps0) / reach, 0.0).astype(np.float32)


def log_rates(relative: Floats) -> Floats:
    """Return ln of relative rates above a floor."""
    return np.log((relative + np.float32(FLOOR)) / np.float32(1 + FLOOR))
