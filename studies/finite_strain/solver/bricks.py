"""Energy, forces and tangent stiffness of hyperelastic bricks of eight nodes at finite strain.

Per reference volume W = μ w + ½ κ (J − 1)² with a law's w, CalculiX's neo-Hookean if w is. "bbar": J is the element's
mean (Simo, Taylor & Pister 1985), at small strain that of `sim/fem/elements.py`; "full": J is the point's.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.fem.elements import gauss_points, gradients
from studies.finite_strain.solver.laws import Law, StrainEnergy
from studies.finite_strain.solver.ogden import Ogden, Stretched

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Dilatation = Literal["bbar", "full"]

_CHUNK = 2000


@dataclass(frozen=True)
class Bricks:
    """(n, 8) elements, their reference gradients (n, 8, 8, 3) and weights (n, 8), moduli (n,) in MPa."""

    elements: Ints
    gradient: Array
    weight: Array
    mu: Array
    kappa: Array
    law: Law
    dilatation: Dilatation = "bbar"

    def energy(self, u: Array) -> float:
        """N·mm at (n_nodes, 3) mm; infinite where an element is turned inside out."""
        return sum((float(_State(self, part, u).energy) for part in self._parts()), 0.0)

    def tangent(self, u: Array) -> tuple[Array, Array]:
        """(n, 24) forces and (n, 24, 24) stiffness, degrees of freedom node by node."""
        n = len(self.elements)
        force, stiffness = np.empty((n, 24)), np.empty((n, 24, 24))
        for part in self._parts():
            force[part], stiffness[part] = _State(self, part, u).tangent()
        return force, stiffness

    def _parts(self) -> list[slice]:
        return [slice(start, start + _CHUNK) for start in range(0, len(self.elements), _CHUNK)]


class Moduli(NamedTuple):
    """Shear and bulk modulus of each element, MPa."""

    mu: Array
    kappa: Array


def bricks(nodes: Array, elements: Ints, moduli: Moduli, law: Law, dilatation: Dilatation = "bbar") -> Bricks:
    """Those of a mesh: (n_nodes, 3) mm, (n, 8) in VTK order."""
    points, weights = gauss_points(2)
    gradient, det, _ = gradients(nodes[elements], points)
    return Bricks(elements, gradient, det * weights, moduli.mu, moduli.kappa, law, dilatation)


def deformation(gradient: Array, u: Array) -> Array:
    """(…, 3, 3) F = 1 + ∂u/∂X from (…, k, 3) gradients and (…, k, 3) displacements."""
    return np.asarray(u.swapaxes(-1, -2) @ gradient + np.eye(3))


class _State:
    """Some elements at a displacement."""

    def __init__(self, bricks: Bricks, part: slice, u: Array) -> None:
        self.gradient, self.weight = bricks.gradient[part], bricks.weight[part]
        self.mu, self.kappa = bricks.mu[part, None], bricks.kappa[part, None]
        self.f = deformation(self.gradient, u[bricks.elements[part]][:, None])
        self.j = np.linalg.det(self.f)
        self.volume = self.weight.sum(axis=1, keepdims=True)
        self.mean = bricks.dilatation == "bbar"
        self.turned = bool((self.j <= 0).any())
        j = np.where(self.j > 0, self.j, 1.0)
        self.j_bar = (self.weight * self.j).sum(axis=1, keepdims=True) / self.volume if self.mean else self.j
        self.i1 = (self.f**2).sum(axis=(-2, -1))
        self.shrunk = j ** (-2 / 3)
        self.w = _tissue(bricks.law, self.f, self.shrunk * self.i1 - 3)

    @property
    def energy(self) -> float:
        if self.turned:
            return np.inf
        per_volume = self.mu * self.w.value + 0.5 * self.kappa * (self.j_bar - 1) ** 2
        return float((self.weight * per_volume).sum())

    def tangent(self) -> tuple[Array, Array]:
        """With g = F⁻ᵀ ∂N/∂X, rows (a, i), δJ = J g · δu."""
        n, points = self.weight.shape
        g = (self.gradient @ np.linalg.inv(self.f)).reshape(n, points, 24)
        pressure, volume_j = self.kappa * (self.j_bar - 1), self.weight * self.j
        pushed = volume_j * pressure
        own = pushed if self.mean else pushed + self.kappa * volume_j * self.j
        if isinstance(self.w, Stretched):
            force, matrix = self.w.tangent(self.gradient, self.weight * self.mu)
            crossed = -pushed
        else:
            force, matrix, ci = self._by_invariant(self.w, g)
            own, crossed = own + (4 / 9) * ci, (2 / 3) * ci - pushed
        force += summed(pushed, g)
        matrix += outer(own, g, g)
        matrix += swapped(outer(crossed, g, g))
        if self.mean:
            whole = summed(volume_j, g)
            matrix += (self.kappa / self.volume)[..., None] * whole[:, :, None] * whole[:, None]
        return force, matrix

    def _by_invariant(self, w: StrainEnergy, g: Array) -> tuple[Array, Array, Array]:
        """Of w(Ī₁ − 3), and what it adds to terms in g: with q = F ∂N/∂X, δĪ₁ = J^{−2/3} (2 q − ⅔ I₁ g) · δu."""
        n, points = self.weight.shape
        q = (self.gradient @ self.f.swapaxes(-1, -2)).reshape(n, points, 24)
        d = self.shrunk[..., None] * (2 * q - (2 / 3) * self.i1[..., None] * g)
        first, second = self.weight * self.mu * w.first, self.weight * self.mu * w.second
        c = first * self.shrunk
        gq = outer(c, g, q)
        matrix = (-4 / 3) * (gq + gq.swapaxes(1, 2))
        if w.second.any():
            matrix += outer(second, d, d)
        laplace = 2 * np.einsum("ng,ngai,ngbi->nab", c, self.gradient, self.gradient, optimize=True)
        blocks = matrix.reshape(n, 8, 3, 8, 3)
        for i in range(3):
            blocks[:, :, i, :, i] += laplace
        return summed(first, d), matrix, c * self.i1


def _tissue(law: Law, f: Array, i: Array) -> StrainEnergy | Stretched:
    """What a law says at deformation gradients with so much Ī₁ − 3."""
    return Stretched(law, f) if isinstance(law, Ogden) else law.energy(i)


def summed(weight: Array, rows: Array) -> Array:
    """(n, k) of (n, g) weights and (n, g, k) rows."""
    return np.einsum("ng,ngk->nk", weight, rows)


def outer(weight: Array, left: Array, right: Array) -> Array:
    """(n, k, k) sums of products of (n, g, k) rows with (n, g) weights."""
    return np.asarray((left * weight[..., None]).swapaxes(1, 2) @ right)


def swapped(matrix: Array) -> Array:
    """(b, i), (a, k) in place of (a, i), (b, k)."""
    n = len(matrix)
    return matrix.reshape(n, 8, 3, 8, 3).swapaxes(2, 4).reshape(n, 24, 24)
