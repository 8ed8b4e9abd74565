"""Tissue of Ogden's law, an energy of the principal stretches (Ogden 1972): its value, forces and stiffness.

Derivatives are taken in the principal frame, where those of an isotropic energy are known in closed form (Smith,
de Goes & Kim 2019); quotients of differences are written so that equal stretches are nothing special.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import exprel

Array = NDArray[np.float64]

_ROUND_OFF = 1e-12


@dataclass(frozen=True)
class Ogden:
    """w = Σ 2 s / α² (λ̄₁^α + λ̄₂^α + λ̄₃^α − 3), of terms (s, α) with shares s of μ; α = 2: neo-Hookean."""

    terms: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if abs(sum(share for share, _ in self.terms) - 1) > _ROUND_OFF or any(not alpha for _, alpha in self.terms):
            raise ValueError(f"{self.terms}: expected shares of the shear modulus that sum up to 1, exponents not 0")

    @classmethod
    def of(cls, alpha: float) -> "Ogden":
        """One term."""
        return cls(((1.0, alpha),))


class Stretched:
    """Ogden tissue at (…, 3, 3) deformation gradients with positive determinants; energies over the shear modulus."""

    def __init__(self, law: Ogden, f: Array) -> None:
        self._f = f
        square, self._right = np.linalg.eigh(f.swapaxes(-1, -2) @ f)
        self._ln = 0.5 * np.log(square)
        isochoric = self._ln - self._ln.mean(axis=-1, keepdims=True)
        self._terms = [(share, alpha, np.exp(alpha * isochoric)) for share, alpha in law.terms]

    @property
    def value(self) -> Array:
        """(…) w."""
        return np.asarray(sum(2 * s / alpha**2 * (power.sum(axis=-1) - 3) for s, alpha, power in self._terms))

    @cached_property
    def principal(self) -> Array:
        """(…, 3) ∂w/∂ln λ: principal Kirchhoff stresses over the shear modulus, without trace."""
        return np.asarray(
            sum(2 * s / alpha * (power - power.mean(axis=-1, keepdims=True)) for s, alpha, power in self._terms)
        )

    @property
    def deviator(self) -> Array:
        """(…, 3, 3) Kirchhoff stress over the shear modulus, without trace."""
        return np.asarray((self._left * self.principal[..., None, :]) @ self._left.swapaxes(-1, -2))

    def tangent(self, gradient: Array, weight: Array) -> tuple[Array, Array]:
        """(n, 3k) forces and (n, 3k, 3k) stiffness at (n, g) points from (n, g, k, 3) ∂N/∂X and (n, g) weights.

        Rows (a, b) of `moved` are what displacements add to F seen from the frames of b and C.
        """
        n, points, k, _ = gradient.shape
        own = gradient @ self._right
        moved = np.einsum("ngia,ngkb->ngabki", self._left, own, optimize=True).reshape(n, points, 3, 3, 3 * k)
        along = np.einsum("ngaax->ngax", moved)
        force = np.einsum("ng,nga,ngax->nx", weight, self.principal / self._stretch, along, optimize=True)
        straight, same, crossed = self._second
        resisted = same[..., None] * moved + crossed[..., None] * moved.swapaxes(2, 3)
        np.einsum("ngaax->ngax", resisted)[...] = straight @ along
        resisted *= weight[..., None, None, None]
        flat = (n, points * 9, 3 * k)
        return force, np.asarray(moved.reshape(flat).swapaxes(1, 2) @ resisted.reshape(flat))

    @property
    def _second(self) -> tuple[Array, Array, Array]:
        """(…, 3, 3) of w in the principal frame: by F_aa and F_bb, twice by F_ab, and by F_ab and F_ba (a ≠ b)."""
        stretch, beta = self._stretch, self.principal
        by_ln = sum(s * _second_by_ln(power) for s, _, power in self._terms)
        product = stretch[..., :, None] * stretch[..., None, :]
        straight = (by_ln - beta[..., :, None] * np.eye(3)) / product
        apart = self._ln[..., :, None] - self._ln[..., None, :]
        chord = sum(
            2 * s * power[..., None, :] * exprel(alpha * apart) / exprel(apart) for s, alpha, power in self._terms
        )
        sheared = (chord - beta[..., None, :]) / product
        bears = beta / stretch
        turned = (bears[..., :, None] + bears[..., None, :]) / (stretch[..., :, None] + stretch[..., None, :])
        return straight, 0.5 * (sheared + turned), 0.5 * (sheared - turned)

    @cached_property
    def _stretch(self) -> Array:
        return np.exp(self._ln)

    @cached_property
    def _left(self) -> Array:
        return np.asarray(self._f @ self._right / self._stretch[..., None, :])


def _second_by_ln(power: Array) -> Array:
    """(…, 3, 3) second derivatives of 2 / α² Σ λ̄^α by the logarithms of the stretches."""
    third = power / 3
    mixed = third.mean(axis=-1)[..., None, None] - third[..., :, None] - third[..., None, :]
    return np.asarray(2 * (mixed + power[..., :, None] * np.eye(3)))
