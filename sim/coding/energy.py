"""Strain energy density in plane strain as a sum of squares of what is linear in the strains."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim.measures.measures import Elastic

Array = NDArray[np.float64]

Energy = Literal["incompressible", "finite"]
ENERGIES: tuple[Energy, ...] = get_args(Energy)
"""incompressible: G (e11² + e22² + ½ e12²), Raju (1998) Eq. 6.1; finite: with ½ λ (e11 + e22)², as Hooke has it."""


def squared_parts(strain: Array, material: Elastic, energy: Energy) -> Array:
    """(3 or 4, …) whose squares sum to the SED, in the unit of E, of (3, …) strains e11 e22 e12 (engineering)."""
    shear = material.young / (2 * (1 + material.poisson))
    parts = np.sqrt(shear) * strain * np.sqrt([1.0, 1.0, 0.5]).reshape(3, *[1] * (strain.ndim - 1))
    if energy == "incompressible":
        return parts
    lame = 2 * shear * material.poisson / (1 - 2 * material.poisson)
    return np.concatenate([parts, np.sqrt(lame / 2) * (strain[:1] + strain[1:2])])


def sed_of(strain: Array, material: Elastic, energy: Energy) -> Array:
    """(…) SED of (3, …) strains e11 e22 e12."""
    return (squared_parts(strain, material, energy) ** 2).sum(axis=0)
