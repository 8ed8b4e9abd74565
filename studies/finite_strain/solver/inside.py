"""The 18 measures at receptors of a body at finite strain.

Strains are the right stretch's, U − 1, in the material's axes, shear twice the tensor's; stresses are Cauchy's,
turned back by the rotation; SED is per undeformed volume. At small strain all are the linear ones.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.fem.elements import gauss_points, gradients, lame
from sim.finger.mesh import FingerMesh
from sim.measures.measures import MEASURES, measures_in_layers
from sim.measures.receptors import blended, located
from sim.models.condensed import young_ratios
from sim.units import PSEUDO_E_EPIDERMIS
from studies.finite_strain.solver.bricks import Moduli, deformation
from studies.finite_strain.solver.laws import Law
from studies.finite_strain.solver.ogden import Ogden, Stretched

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class InteriorPoints:
    """Points (n, 3) mm inside a mesh, where deformation is recovered as the project's models recover strain."""

    config: FingertipConfig
    mesh: FingerMesh
    points_mm: Array

    def gradients(self, u: Array) -> Array:
        """(n, 3, 3) ∂u/∂X at (n_nodes, 3) mm; the dilatation of each sample is its element's mean."""
        elements, ours, weights = self._samples
        hexes = self.mesh.hexes[elements]
        corners = self.mesh.nodes[hexes]
        points, gauss = gauss_points(2)
        gradient, det, _ = gradients(corners, points)
        weight = det * gauss
        j = np.linalg.det(deformation(gradient, u[hexes][:, None]))
        mean = (weight * j).sum(axis=1) / weight.sum(axis=1)
        centre = deformation(gradients(corners, np.zeros((1, 3)))[0][:, 0], u[hexes])
        swollen = centre * np.cbrt(mean / np.linalg.det(centre))[:, None, None]
        out = np.zeros((len(self.points_mm), 3, 3))
        np.add.at(out, ours, weights[:, None, None] * (swollen - np.eye(3)))
        return out

    def measures(self, u: Array, law: Law | None) -> dict[str, Array]:
        """The 18, each (n,): tension positive, stresses in pseudo-units; those of small strain if there is no law."""
        ratio, poisson = young_ratios(self.config.tissue)[self._layer], self.config.tissue.poisson
        moved = self.gradients(u)
        if law is None:
            return measures_in_layers(_engineering(0.5 * (moved + moved.swapaxes(-1, -2))), ratio, poisson)
        moduli = Moduli(*lame(PSEUDO_E_EPIDERMIS * ratio, poisson))
        return finite_measures(moved + np.eye(3), moduli, law)

    @cached_property
    def _samples(self) -> tuple[Ints, Ints, Array]:
        """Elements, the receptor of each, and its weight."""
        found = [blended(self.mesh, located(self.mesh, point), point) for point in self.points_mm]
        ours = np.repeat(np.arange(len(found)), [len(one.weights) for one in found])
        return np.concatenate([one.elements for one in found]), ours, np.concatenate([one.weights for one in found])

    @cached_property
    def _layer(self) -> Ints:
        return self.mesh.layer[[located(self.mesh, point).element for point in self.points_mm]]


def finite_measures(f: Array, moduli: Moduli, law: Law) -> dict[str, Array]:
    """The 18 measures, each (n,), at (n, 3, 3) deformation gradients."""
    left, stretch, right = np.linalg.svd(f)
    strain = right.swapaxes(-1, -2) @ ((stretch - 1)[..., None] * right)
    j = np.linalg.det(f)
    stress = _turned_back(cauchy(f, moduli, law), left @ right)
    ep, sp = np.linalg.eigvalsh(strain), np.linalg.eigvalsh(stress)
    sed = moduli.mu * isochoric(f, law)[0] + 0.5 * moduli.kappa * (j - 1) ** 2
    normal = np.moveaxis(_engineering(stress)[..., :3], -1, 0)
    columns = [
        *np.moveaxis(_engineering(strain), -1, 0),
        *ep.T,
        *normal,
        *sp.T,
        normal.mean(axis=0),
        sed,
        sp.prod(axis=-1),
    ]
    return dict(zip(MEASURES, columns, strict=True))


def cauchy(f: Array, moduli: Moduli, law: Law) -> Array:
    """(n, 3, 3) true stress, in the unit of the moduli (n,)."""
    j, (_, deviator) = np.linalg.det(f), isochoric(f, law)
    return np.asarray((moduli.mu / j)[:, None, None] * deviator + (moduli.kappa * (j - 1))[:, None, None] * np.eye(3))


def isochoric(f: Array, law: Law) -> tuple[Array, Array]:
    """(n,) energy and (n, 3, 3) Kirchhoff stress without trace, over the shear modulus."""
    if isinstance(law, Ogden):
        stretched = Stretched(law, f)
        return stretched.value, stretched.deviator
    b = (np.linalg.det(f) ** (-2 / 3))[:, None, None] * f @ f.swapaxes(-1, -2)
    i = np.trace(b, axis1=-2, axis2=-1)
    w = law.energy(i - 3)
    return w.value, (2 * w.first)[:, None, None] * (b - i[:, None, None] / 3 * np.eye(3))


def _turned_back(tensor: Array, rotation: Array) -> Array:
    return np.asarray(rotation.swapaxes(-1, -2) @ tensor @ rotation)


def _engineering(tensor: Array) -> Array:
    """(n, 6) components 11 22 33 12 23 13, shear doubled, of symmetric (n, 3, 3)."""
    flat = tensor[..., [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    return np.asarray(flat * np.array([1, 1, 1, 2, 2, 2]))
