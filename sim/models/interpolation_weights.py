"""Weights of full builds at a few moduli for a finger of other moduli.

The work of forces, fᵀCf, is a positive combination of 1 / (λ + E) with λ ≥ 0 in each layer's E, since the stiffness
is affine in it and semi-definite (Stieltjes). Weights that are exact for λ = 0, ∞ and two values between are close
for all others; `StiffnessAxis.error` bounds the error for any finger. Only ratios to E(epidermis) count:
C(sE) = C(E) / s.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.config import Tissue

Array = NDArray[np.float64]

_LOG_POLES = (
    -1.0,
    1.0,
)  # relative to the middle of the range; they minimize the error for a 16-fold range to within 0.1
_NODES = 2 + len(_LOG_POLES)
_OF_NO_BUILD = {"stiffness": 1.0, "strain": "small", "stiffening": 0.0}  # E(epidermis) is 1 MPa in all builds
_TRIED_VALUES, _TRIED_POLES = 201, np.append(0.0, np.geomspace(1e-4, 1e4, 161))


@dataclass(frozen=True)
class StiffnessAxis:
    """Range of E / E(epidermis) of a layer, with Chebyshev nodes in its logarithm."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """Geometric mean of the range."""
        return float(np.sqrt(self.low * self.high))

    @cached_property
    def nodes(self) -> Array:
        """(4,) ascending values at which fingers are built."""
        angle = np.pi * (np.arange(_NODES) + 0.5) / _NODES
        return np.asarray(self.middle * (self.high / self.low) ** (-np.cos(angle) / 2))

    def weights(self, value: ArrayLike) -> Array:
        """Return (…, 4) weights of the nodes for values in the range."""
        return np.asarray(self._functions(value) @ self._inverse)

    @cached_property
    def error(self) -> float:
        """Largest relative error of any 1 / (λ + E)."""
        values = np.geomspace(self.low, self.high, _TRIED_VALUES)[:, None]
        poles = _TRIED_POLES * self.middle
        found = self.weights(values[:, 0]) @ (1 / (poles + self.nodes[:, None]))
        return float(np.abs(found * (poles + values) - 1).max())

    @cached_property
    def growth(self) -> float:
        """Largest growth of a nodal error between the nodes, relative to a compliance there."""
        values = np.geomspace(self.low, self.high, _TRIED_VALUES)
        softer = np.maximum(1, values[:, None] / self.nodes)  # C(E') ≤ C(E) E / E' for E' < E, and ≤ C(E) otherwise
        return float((np.abs(self.weights(values)) * softer).sum(axis=1).max())

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self._functions(self.nodes)), dtype=float)

    def _functions(self, value: ArrayLike) -> Array:
        """Return (…, 4) values of 1, 1 / E and two poles between."""
        e = np.asarray(value, dtype=float)
        poles = self.middle * np.exp(_LOG_POLES)
        return np.stack([np.ones_like(e), 1 / e, *(1 / (e + pole) for pole in poles)], axis=-1)


DERMIS, FAT = StiffnessAxis(0.04, 0.64), StiffnessAxis(0.02, 0.32)
"""E / E(epidermis) of fingers that can be interpolated; the default has 0.1 for dermis and fat."""

FULL_BUILDS = _NODES**2
"""Number of fingers that are built for interpolation."""


def in_range(tissue: Tissue) -> bool:
    """Return whether a finger of such layers can be interpolated."""
    return DERMIS.low <= tissue.e_dermis <= DERMIS.high and FAT.low <= tissue.e_fat <= FAT.high


def node_tissues(tissue: Tissue) -> list[Tissue]:
    """Return the layers of the 16 built fingers, the fat's modulus varying fastest."""
    linear = tissue.model_copy(update=_OF_NO_BUILD)
    return [
        linear.model_copy(update={"e_dermis": e_dermis, "e_fat": e_fat})
        for e_dermis in DERMIS.nodes.tolist()
        for e_fat in FAT.nodes.tolist()
    ]


def node_weights(tissue: Tissue) -> Array:
    """Return (16,) weights of the built fingers; they sum to 1."""
    return np.outer(DERMIS.weights(tissue.e_dermis), FAT.weights(tissue.e_fat)).ravel()


def largest_error() -> float:
    """Return a bound of |fᵀ(C′ − C)f| / fᵀCf for the interpolated compliance C′, any forces f and any finger.

    Below 1 it implies that C′ is positive definite: I_d I_f C − C = I_d(I_f C − C) + (I_d C − C).
    """
    return min(DERMIS.error + DERMIS.growth * FAT.error, FAT.error + FAT.growth * DERMIS.error)
