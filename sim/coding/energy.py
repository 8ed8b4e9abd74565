"""Strain energy density as a sum of squares of what is linear in the strains: all six, or those of plane strain."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim.measures.measures import Elastic

Array = NDArray[np.float64]

Energy = Literal["incompressible", "finite"]
ENERGIES: tuple[Energy, ...] = get_args(Energy)
"""incompressible: G (e11² + e22² + ½ e12²), Raju (1998) Eq. 6.1; finite: with ½ λ (e11 + e22)², as Hooke has it.

Of six strains all normal and all shear ones alike."""

_WEIGHT = {3: [1.0, 1.0, 0.5], 6: [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]}


def squared_parts(strain: Array, material: Elastic, energy: Energy) -> Array:
    """(3 … 7, …) whose squares sum to the SED, in the unit of E, of engineering strains e11 e22 e12, or all six.

    The six are e11 e22 e33 e12 e23 e13.
    """
    shear, n = material.young / (2 * (1 + material.poisson)), len(strain)
    parts = np.sqrt(shear) * strain * np.sqrt(_WEIGHT[n]).reshape(n, *[1] * (strain.ndim - 1))
    if energy == "incompressible":
        return parts
    lame = 2 * shear * material.poisson / (1 - 2 * material.poisson)
    return np.concatenate([parts, np.sqrt(lame / 2) * strain[: 2 if n == 3 else 3].sum(axis=0, keepdims=True)])


def sed_of(strain: Array, material: Elastic, energy: Energy) -> Array:
    """(…) SED of (3 or 6, …) strains."""
    return (squared_parts(strain, material, energy) ** 2).sum(axis=0)
