"""The eighteen candidate measures of Raju (1998, ch. 5) from the six strains at a point."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.units import PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]

STRAINS = ("e11", "e22", "e33", "e12", "e23", "e13", "ep1", "ep2", "ep3")
"""Strain components and principal strains; shear strains are engineering strains (e12 = s12/G)."""

STRESSES = ("s11", "s22", "s33", "sp1", "sp2", "sp3", "mean", "sed", "third")
"""Stress measures in the unit of E; `third` in its cube."""

MEASURES = (*STRAINS, *STRESSES)
"""All 18 measures, in the order of `measures_from_strain`."""

PLOTTED_AS_MAGNITUDE = frozenset({"e22", "ep1", "s11", "s22", "s33", "sp1", "sp2", "sp3", "mean", "third"})
"""Measures that are negative under every indentor here; profiles show their magnitude. e13 keeps its sign."""


def shown(measure: str, values: Array) -> Array:
    """Return a measure with the sign in which profiles show it.

    Measures that are compressive under every indentor (`PLOTTED_AS_MAGNITUDE`) change sign, so that more compression
    is a larger value. All others, e13 among them, keep their sign.
    """
    return -values if measure in PLOTTED_AS_MAGNITUDE else values


@dataclass(frozen=True)
class Elastic:
    """Isotropic material; E in the unit of the stresses."""

    young: float
    poisson: float


def stress_from_strain(strain: Array, material: Elastic) -> Array:
    """Return (…, 6) stresses s11 s22 s33 s12 s23 s13 from (…, 6) engineering strains (Hooke)."""
    mu = material.young / (2 * (1 + material.poisson))
    lam = 2 * mu * material.poisson / (1 - 2 * material.poisson)
    stress = mu * strain
    stress[..., :3] = 2 * mu * strain[..., :3] + lam * strain[..., :3].sum(axis=-1, keepdims=True)
    return stress


def measures_from_strain(strain: Array, material: Elastic) -> dict[str, Array]:
    """Return the 18 measures at points with (…, 6) engineering strains; tension positive, stresses in the unit of E.

    ep1 ≤ ep2 ≤ ep3 and sp1 ≤ sp2 ≤ sp3, so that 1 is the most compressive; sed = ½ σ:ε; third = det σ.
    """
    stress = stress_from_strain(strain, material)
    ep = np.linalg.eigvalsh(_tensor(strain, shear=0.5))
    sp = np.linalg.eigvalsh(_tensor(stress, shear=1.0))
    sed = 0.5 * np.einsum("...k,...k->...", stress, strain)
    columns = [*np.moveaxis(strain, -1, 0), *np.moveaxis(ep, -1, 0), *np.moveaxis(stress[..., :3], -1, 0)]
    columns += [*np.moveaxis(sp, -1, 0), stress[..., :3].mean(axis=-1), sed, np.prod(sp, axis=-1)]
    return dict(zip(MEASURES, columns, strict=True))


def measures_in_layers(strain: Array, young_ratio: Array, poisson: float) -> dict[str, Array]:
    """Return the 18 measures (n,) from (n, 6) strains and (n,) E / E(epidermis); stresses in pseudo-units."""
    values = {name: np.empty(len(strain)) for name in MEASURES}
    for ratio in np.unique(young_ratio):
        here = young_ratio == ratio
        material = Elastic(PSEUDO_E_EPIDERMIS * float(ratio), poisson)
        for name, value in measures_from_strain(strain[here], material).items():
            values[name][here] = value
    return values


def _tensor(v: Array, shear: float) -> Array:
    """Return (…, 3, 3) symmetric tensors from (…, 6) components 11 22 33 12 23 13."""
    scaled = v * np.array([1, 1, 1, shear, shear, shear])
    return scaled[..., [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(*v.shape[:-1], 3, 3)
