"""A finger or its section as unknowns, with an energy: of hyperelastic bricks, or linear on the same mesh."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.fem.elements import stiffness
from studies.finite_strain.solver.bricks import Bricks
from studies.finite_strain.solver.factor import Factor
from studies.finite_strain.solver.pattern import Pattern

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Elements(Protocol):
    """What bricks answer: `Bricks`, or `LinearBricks`."""

    @property
    def elements(self) -> Ints:
        """(n, 8) nodes."""

    def energy(self, u: Array) -> float:
        """N·mm at (n_nodes, 3) mm."""

    def tangent(self, u: Array) -> tuple[Array, Array]:
        """(n, 24) forces and (n, 24, 24) stiffness."""


@dataclass(frozen=True)
class LinearBricks:
    """The same elements at small strain."""

    elements: Ints
    matrices: Array  # (n, 24, 24)

    @classmethod
    def like(cls, bricks: Bricks, nodes: Array, poisson: float) -> "LinearBricks":
        """With the moduli of hyperelastic ones."""
        young = 2 * (1 + poisson) * bricks.mu
        return cls(bricks.elements, stiffness(nodes, bricks.elements, young, poisson, bricks.dilatation))

    def energy(self, u: Array) -> float:
        """N·mm at (n_nodes, 3) mm."""
        v = u[self.elements].reshape(len(self.elements), -1)
        return 0.5 * float(np.einsum("ni,nij,nj->", v, self.matrices, v, optimize=True))

    def tangent(self, u: Array) -> tuple[Array, Array]:
        """(n, 24) forces and (n, 24, 24) stiffness."""
        v = u[self.elements].reshape(len(self.elements), -1)
        return np.einsum("nij,nj->ni", self.matrices, v), self.matrices


@dataclass(frozen=True)
class Body:
    """Elements and the unknown, −1 where it is held, of every node's displacements (n_nodes, 3).

    Energies, forces and stiffness are `share` times those of the elements: a slab in plane strain needs one slice.
    """

    elements: Elements
    unknown: Ints
    share: float = 1.0

    @cached_property
    def size(self) -> int:
        """Of the vector of unknowns."""
        return int(self.unknown.max()) + 1

    def displacement(self, a: Array) -> Array:
        """(n_nodes, 3) from the unknowns (size,)."""
        return np.where(self.unknown >= 0, a[self.unknown], 0.0)

    def energy(self, a: Array) -> float:
        """N·mm."""
        return self.share * self.elements.energy(self.displacement(a))

    def tangent(self, a: Array) -> tuple[Array, Array]:
        """(size,) forces, and the values of the stiffness's upper triangle (`pattern`)."""
        force, matrices = self.elements.tangent(self.displacement(a))
        dof = self._dof
        held = dof < 0
        total = np.bincount(np.where(held, self.size, dof).ravel(), force.ravel(), self.size + 1)[: self.size]
        return self.share * np.asarray(total, float), self.share * self.pattern.summed(matrices)

    @cached_property
    def _dof(self) -> Ints:
        return self.unknown[self.elements.elements].reshape(len(self.elements.elements), -1)

    @cached_property
    def pattern(self) -> Pattern:
        """Where the stiffness is not zero."""
        return Pattern.of(self._dof, self.size)

    @cached_property
    def factor(self) -> Factor:
        """Solves with matrices of that pattern."""
        return Factor(self.pattern)
