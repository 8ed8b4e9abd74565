"""Energy, forces and tangent stiffness of hyperelastic bricks of eight nodes at finite strain.

Per reference volume W = μ w(Ī₁ − 3) + ½ κ (J − 1)², CalculiX's neo-Hookean if w is. "bbar": J is the element's mean
(Simo, Taylor & Pister 1985), at small strain that of `sim/fem/elements.py`; "full": J is the point's.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.fem.shape_functions import gauss_points, gradients
from studies.finite_strain.solver.laws import Law

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
        self.w = bricks.law.energy(self.shrunk * self.i1 - 3)

    @property
    def energy(self) -> float:
        if self.turned:
            return np.inf
        per_volume = self.mu * self.w.value + 0.5 * self.kappa * (self.j_bar - 1) ** 2
        return float((self.weight * per_volume).sum())

    def tangent(self) -> tuple[Array, Array]:
        """Rows (a, i): with g = F⁻ᵀ ∂N/∂X and q = F ∂N/∂X, δĪ₁ = J^{−2/3} (2 q − ⅔ I₁ g) · δu and δJ = J g · δu."""
        n, points = self.weight.shape
        inverse = np.linalg.inv(self.f)
        g = (self.gradient @ inverse).reshape(n, points, 24)
        q = (self.gradient @ self.f.swapaxes(-1, -2)).reshape(n, points, 24)
        d = self.shrunk[..., None] * (2 * q - (2 / 3) * self.i1[..., None] * g)
        pressure = self.kappa * (self.j_bar - 1)
        first, second = self.weight * self.mu * self.w.first, self.weight * self.mu * self.w.second
        volume_j = self.weight * self.j
        force = _sum(first, d) + _sum(volume_j * pressure, g)
        c = first * self.shrunk
        own = (4 / 9) * c * self.i1 + volume_j * pressure
        if not self.mean:
            own = own + self.kappa * volume_j * self.j
        crossed = (2 / 3) * c * self.i1 - volume_j * pressure
        gq = _outer(c, g, q)
        matrix = _outer(own, g, g) - (4 / 3) * (gq + gq.swapaxes(1, 2)) + _swapped(_outer(crossed, g, g))
        if self.w.second.any():
            matrix += _outer(second, d, d)
        if self.mean:
            whole = _sum(volume_j, g)
            matrix += (self.kappa / self.volume)[..., None] * whole[:, :, None] * whole[:, None]
        laplace = 2 * np.einsum("ng,ngai,ngbi->nab", c, self.gradient, self.gradient, optimize=True)
        blocks = matrix.reshape(n, 8, 3, 8, 3)
        for i in range(3):
            blocks[:, :, i, :, i] += laplace
        return force, matrix


def _sum(weight: Array, rows: Array) -> Array:
    return np.einsum("ng,ngk->nk", weight, rows)


def _outer(weight: Array, left: Array, right: Array) -> Array:
    return np.asarray((left * weight[..., None]).swapaxes(1, 2) @ right)


def _swapped(matrix: Array) -> Array:
    """(b, i), (a, k) in place of (a, i), (b, k)."""
    n = len(matrix)
    return matrix.reshape(n, 8, 3, 8, 3).swapaxes(2, 4).reshape(n, 24, 24)
