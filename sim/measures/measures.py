"""The eighteen candidate measures of Raju (1998, ch. 5) from the six strains at a point."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig_shared.outputs import listed
from sim.units import PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]


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


def strain_energy_density(stress: Array, strain: Array) -> Array:
    """Return ½ σ:ε (…) of (…, 6) stresses and engineering strains, in the unit of the stresses."""
    return 0.5 * np.einsum("...k,...k->...", stress, strain)


class StressState(NamedTuple):
    """Strain and stress at points, (…, 6) each, with their principal values (…, 3) in ascending order."""

    strain: Array
    stress: Array
    principal_strain: Array
    principal_stress: Array


class MeasureKind(NamedTuple):
    """How a measure scales, strain^`strain_power` · stress^`stress_power`, and its unit; stresses have that of E."""

    strain_power: int
    stress_power: int
    unit: str


STRAIN, STRESS = MeasureKind(1, 0, "1"), MeasureKind(0, 1, "pseudo-unit")
ENERGY, STRESS_CUBED = MeasureKind(1, 1, "pseudo-unit"), MeasureKind(0, 3, "pseudo-unit³")


class Measure(NamedTuple):
    """A candidate measure: how it is defined, and computed from a state.

    `as_magnitude`: it is negative under every indentor here, and profiles show it with the other sign, so that more
    compression is a larger value.
    """

    name: str
    kind: MeasureKind
    meaning: str
    value: Callable[[StressState], Array]
    as_magnitude: bool = False

    @property
    def symbol(self) -> str:
        """Name in figures and tables."""
        return "SED" if self.name == "sed" else self.name

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return self.kind.unit


BY_NAME = {measure.name: measure for measure in (
    Measure("e11", STRAIN, "normal strain across the finger (x)",
            lambda at: at.strain[..., 0]),
    Measure("e22", STRAIN, "normal strain along the normal of the pulp (y)",
            lambda at: at.strain[..., 1], as_magnitude=True),
    Measure("e33", STRAIN, "normal strain along the finger (z)",
            lambda at: at.strain[..., 2]),
    Measure("e12", STRAIN, "shear strain between x and y, engineering (γ = s12 / G)",
            lambda at: at.strain[..., 3]),
    Measure("e23", STRAIN, "shear strain between y and z, engineering",
            lambda at: at.strain[..., 4]),
    Measure("e13", STRAIN, "shear strain between x and z, engineering",
            lambda at: at.strain[..., 5]),
    Measure("ep1", STRAIN, "smallest principal strain: the largest compression in any direction",
            lambda at: at.principal_strain[..., 0], as_magnitude=True),
    Measure("ep2", STRAIN, "middle principal strain",
            lambda at: at.principal_strain[..., 1]),
    Measure("ep3", STRAIN, "largest principal strain: the largest extension in any direction",
            lambda at: at.principal_strain[..., 2]),
    Measure("s11", STRESS, "normal stress across the finger (x)",
            lambda at: at.stress[..., 0], as_magnitude=True),
    Measure("s22", STRESS, "normal stress along the normal of the pulp (y)",
            lambda at: at.stress[..., 1], as_magnitude=True),
    Measure("s33", STRESS, "normal stress along the finger (z)",
            lambda at: at.stress[..., 2], as_magnitude=True),
    Measure("sp1", STRESS, "smallest principal stress: the most compressive",
            lambda at: at.principal_stress[..., 0], as_magnitude=True),
    Measure("sp2", STRESS, "middle principal stress",
            lambda at: at.principal_stress[..., 1], as_magnitude=True),
    Measure("sp3", STRESS, "largest principal stress: the least compressive",
            lambda at: at.principal_stress[..., 2], as_magnitude=True),
    Measure("mean", STRESS, "mean normal stress, (s11 + s22 + s33) / 3: minus the hydrostatic pressure",
            lambda at: at.stress[..., :3].mean(axis=-1), as_magnitude=True),
    Measure("sed", ENERGY, "strain energy density, ½ σ:ε, of the changes of shape and volume; never negative",
            lambda at: strain_energy_density(at.stress, at.strain)),
    Measure("third", STRESS_CUBED, "third invariant of stress, det σ: the product of the principal stresses",
            lambda at: np.prod(at.principal_stress, axis=-1), as_magnitude=True),
)}  # fmt: skip
"""All measures. Shear strains are engineering strains; principal values ascend, so that 1 is the most compressive."""

MEASURES = tuple(BY_NAME)
MeasureName = Annotated[str, listed(MEASURES)]


def shown(measure: str, values: Array) -> Array:
    """Return a measure with the sign in which profiles show it."""
    return -values if BY_NAME[measure].as_magnitude else values


def measures_from_strain(strain: Array, material: Elastic) -> dict[str, Array]:
    """Return all measures at points with (…, 6) engineering strains; tension positive, stresses in the unit of E."""
    stress = stress_from_strain(strain, material)
    principal = [
        np.asarray(np.linalg.eigvalsh(_tensor(v, shear)), float) for v, shear in ((strain, 0.5), (stress, 1.0))
    ]
    state = StressState(strain, stress, *principal)
    return {name: measure.value(state) for name, measure in BY_NAME.items()}


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
