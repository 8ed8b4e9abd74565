"""What every model is once it is made: a skin to touch, its compliance, and receptors under it."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.contact.patch import Patch
from sim.finger.mesh import FingerMesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet
from sim.models.inside.columns import Columns

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class CondensedModel:
    """The patch, and receptors whose strain is linear in the forces on the skin. E(epidermis) = 1 MPa."""

    surface: FingertipSurface
    patch: Patch
    receptor_row: int
    nodes: int
    columns: Columns
    skin_z_mm: Array  # (n_z,)
    skin_phi: Array  # (n_phi,) rad
    patch_in_skin: Ints  # (n_patch,) numbers of the patch's nodes on that grid
    outside_mm: Array  # (n_outside, 3) skin nodes beside the patch
    outside_neighbour: Ints  # (n_outside,) the rim node each is nearest to
    kind: str = "finger"
    timing_s: dict[str, float] = field(default_factory=dict, compare=False)

    @property
    def receptors(self) -> ReceptorSet:
        """Where strain is known."""
        return self.columns.receptors

    @cached_property
    def strain_per_force(self) -> Array:
        """(6 n_receptors, m n_patch) 1/N, forces on the patch along its axes."""
        return self.columns.per_force(self.patch_in_skin, self.patch.axes)

    def strain(self, force: Array) -> Array:
        """(n_receptors, 6) strains under (m, n_patch) forces on the patch."""
        return (self.strain_per_force @ force.ravel()).reshape(-1, 6)

    def point_load(self, x_mm: float, z_mm: float) -> Array:
        """(6 n_receptors,) strain per N of an inward force along the skin's normal at (x, z).

        The force is shared between the four skin nodes around the place, by their bilinear shape functions; between
        two on a section.
        """
        phi = float(self.surface.angle_at(x_mm, z_mm))
        force = point_force(self.skin_z_mm, self.skin_phi, (z_mm, phi))
        return np.einsum("rzpi,zp,i->r", self.columns.per_skin_force, force, -self.surface.normal(phi, z_mm))


def point_force(skin_z_mm: Array, skin_phi: Array, place: ArrayLike) -> Array:
    """(…, n_z, n_phi) shares of forces at (…, 2) z and φ, by the bilinear shape functions of a skin's nodes."""
    z_mm, phi = np.moveaxis(np.asarray(place, dtype=float), -1, 0)
    return _shares(skin_z_mm, z_mm)[..., :, None] * _shares(skin_phi, phi)[..., None, :]


def _shares(grid: Array, value: Array) -> Array:
    """(…, n) of the two nodes of an ascending grid beside each value; all of it where there is one node."""
    if len(grid) == 1:
        return np.ones((*value.shape, 1))
    k = np.clip(np.searchsorted(grid, value) - 1, 0, len(grid) - 2)
    along = ((value - grid[k]) / (grid[k + 1] - grid[k]))[..., None]
    away = np.arange(len(grid)) - k[..., None]
    return (away == 0) * (1 - along) + (away == 1) * along


def skin_beside(mesh: FingerMesh, patch: Patch, sections: slice = slice(None)) -> tuple[Array, Ints]:
    """Skin nodes of the pulp's half outside the patch, in some of the sections, and the nearest rim node of each."""
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[sections, :, 0].ravel()
    position = mesh.nodes[np.setdiff1d(skin, mesh.patch_nodes)]
    position = position[position[:, 1] > 0]
    rim = np.flatnonzero(patch.rim)
    distance = ((position[:, None] - patch.position_mm[rim][None]) ** 2).sum(axis=-1)
    return position, rim[np.argmin(distance, axis=1)]


_PLAIN = ("skin_z_mm", "skin_phi", "patch_in_skin", "outside_mm", "outside_neighbour")


def to_arrays(model: CondensedModel) -> dict[str, NDArray[np.generic]]:
    """What is stored on disk but for the columns; the surface is made again in milliseconds."""
    patch = model.patch
    return {
        **{name: getattr(model, name) for name in _PLAIN},
        "position_mm": patch.position_mm,
        "area_mm2": patch.area_mm2,
        "compliance": patch.compliance,
        "shape": np.array(patch.shape),
        "axes": np.array(patch.axes),
        "counts": np.array([model.receptor_row, model.nodes]),
    }


def from_arrays(arrays: dict[str, Any], surface: FingertipSurface, columns: Columns) -> CondensedModel:
    """The model that `to_arrays` stored, with columns."""
    shape = (int(arrays["shape"][0]), int(arrays["shape"][1]))
    axes = tuple(int(axis) for axis in arrays["axes"])
    patch = Patch(arrays["position_mm"], arrays["area_mm2"], shape, axes, compliance=arrays["compliance"])
    row, nodes = (int(n) for n in arrays["counts"])
    plain = {name: arrays[name] for name in _PLAIN}
    return CondensedModel(surface, patch, row, nodes, columns, **plain)
