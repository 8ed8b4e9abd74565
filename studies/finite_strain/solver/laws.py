"""Isochoric energies of tissue, over its shear modulus, as functions of Ī₁ − 3 or Ogden's; linear at small strain."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from studies.finite_strain.solver.ogden import Ogden

Array = NDArray[np.float64]


class StrainEnergy(NamedTuple):
    """w(Ī₁ − 3) and its first and second derivative."""

    value: Array
    first: Array
    second: Array


class OfInvariant(Protocol):
    """An isochoric energy with w(0) = 0 and w′(0) = ½."""

    def energy(self, i: Array) -> StrainEnergy:
        """At (…) values of Ī₁ − 3."""


Law = OfInvariant | Ogden


@dataclass(frozen=True)
class NeoHookean:
    """w = ½ (Ī₁ − 3)."""

    def energy(self, i: Array) -> StrainEnergy:
        """At (…) values of Ī₁ − 3."""
        return StrainEnergy(0.5 * i, np.full_like(i, 0.5), np.zeros_like(i))


@dataclass(frozen=True)
class Yeoh:
    """w = ½ (i + a i² + b i³) with i = Ī₁ − 3: tissue that stiffens (Yeoh 1993)."""

    a: float
    b: float = 0.0

    def energy(self, i: Array) -> StrainEnergy:
        """At (…) values of Ī₁ − 3."""
        a, b = self.a, self.b
        return StrainEnergy(
            0.5 * i * (1 + i * (a + b * i)), 0.5 * (1 + i * (2 * a + 3 * b * i)), 0.5 * (2 * a + 6 * b * i)
        )
