"""Condensed models: a skin to touch, its compliance, and receptors under it."""

import logging
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from sim.config import EVEN_LEVELS, MESH_LEVELS, FingertipConfig, Tissue
from sim.contact.patch import Patch, X, Y
from sim.fem.dissection import DissectionFactor
from sim.fem.elements import assemble_upper, stiffness
from sim.finger.mesh import FingerMesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet

# --- discretization ---

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LONG = 50_000
"""Number of unknowns from which condensing takes seconds; the default finger has twice as many."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FiniteElements:
    """Uncondensed problem: mesh, upper triangle of the free stiffness, and its unknowns."""

    mesh: FingerMesh
    upper: sp.csr_array  # (n_free, n_free) N/mm per MPa of E(epidermis)
    free: Ints  # (n_free,) degree of freedom 3·node + component
    kept: Ints  # ascending positions in `free` of the patch's displacements along its axes

    @property
    def places(self) -> Ints:
        """(n_free, 3) indices of each unknown's node on the mesh grid."""
        return np.column_stack(np.unravel_index(self.free // 3, self.mesh.grid))


def young_ratios(tissue: Tissue) -> Array:
    """Return E / E(epidermis) of epidermis, dermis, fat and bone."""
    return np.array([1.0, tissue.e_dermis, tissue.e_fat, tissue.e_bone])


def meshed_for(config: FingertipConfig, slopes: tuple[int, ...]) -> FingertipConfig:
    """Return the configuration with the mesh for indentors that slope along some axes.

    Shapes prismatic along the finger allow longer elements. Under round shapes and the line the spacing is even
    unless it is configured, not by its level; round shapes have a patch of their own.
    """
    if slopes == (X,):
        return config
    mesh = config.mesh
    other: dict[str, float] = {}
    if mesh.axial_spacing_mm is None:
        other["axial_spacing_mm"] = mesh.spacing_mm
    even = EVEN_LEVELS.get(mesh.level, {})
    if even and all(getattr(mesh, name) == MESH_LEVELS[mesh.level][name] for name in even):
        other |= even
    if len(slopes) > 1 and mesh.round_patch_mm:  # 0 after `sim/models/sources.py` has widened the patch
        other |= {"patch_x_mm": mesh.round_patch_mm, "patch_z_mm": mesh.round_patch_mm}
    return config.model_copy(update={"mesh": mesh.model_copy(update=other)})


def assembled(config: FingertipConfig, mesh: FingerMesh) -> sp.csr_array:
    """Assemble the (3 n_nodes, 3 n_nodes) upper triangle of the stiffness for E(epidermis) = 1 MPa."""
    young = young_ratios(config.tissue)[mesh.layer]
    matrices = stiffness(mesh.nodes, mesh.hexes, young, config.tissue.poisson, config.mesh.element)
    return assemble_upper(matrices, mesh.hexes, len(mesh.nodes))


def discretise(config: FingertipConfig, mesh: FingerMesh, axes: tuple[int, ...] = (X, Y)) -> FiniteElements:
    """Assemble the stiffness of the free degrees of freedom for E(epidermis) = 1 MPa, to keep the patch's `axes`."""
    upper = assembled(config, mesh)
    free = np.flatnonzero(np.repeat(~mesh.fixed, 3))
    patch = np.sort((3 * mesh.patch_nodes + np.array(axes)[:, None]).ravel())
    return FiniteElements(mesh, upper[free][:, free], free, np.searchsorted(free, patch))


def factorise(problem: FiniteElements) -> DissectionFactor:
    """Condense onto the patch."""
    return condense(problem.upper, problem.kept, problem.places)


def condense(upper: sp.csr_array, kept: Ints, places: Ints) -> DissectionFactor:
    """Condense any symmetric matrix whose unknowns have positions (n, d), logging where that takes long."""
    unknowns = upper.shape[0]
    level = logging.INFO if unknowns >= LONG else logging.DEBUG
    _log.log(level, "building a model: factorizing a stiffness of %d unknowns …", unknowns)
    return DissectionFactor(upper, kept, places)


# --- columns ---

STORED = ("young_ratio", "per_skin_force")
"""Fields of columns that are stored on disk."""


@dataclass(frozen=True)
class Columns:
    """Strain at receptors per unit force on the skin nodes. E(epidermis) = 1 MPa."""

    receptors: ReceptorSet
    young_ratio: Array  # (n,) E / E(epidermis) at the receptors
    per_skin_force: Array  # (6 n, n_z, n_phi, 3) 1/N, forces on all skin nodes

    def per_force(self, nodes: Ints, axes: tuple[int, ...]) -> Array:
        """Return (6 n, m k) strains per N on k skin nodes along m axes, ordered by axis."""
        n, n_z, n_phi, _ = self.per_skin_force.shape
        on_nodes = self.per_skin_force.reshape(n, n_z * n_phi, 3)[:, nodes][:, :, list(axes)]
        return np.ascontiguousarray(on_nodes.swapaxes(1, 2)).reshape(n, len(axes) * len(nodes))

    def as_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays that are stored on disk; the caller knows the receptors."""
        return {name: np.ascontiguousarray(getattr(self, name)) for name in STORED}


@dataclass(frozen=True)
class CondensedModel:
    """Patch, and receptors whose strain is linear in the forces on the skin. E(epidermis) = 1 MPa."""

    surface: FingertipSurface
    patch: Patch
    receptor_row: int
    nodes: int
    columns: Columns
    skin_z_mm: Array  # (n_z,)
    skin_phi: Array  # (n_phi,) rad
    patch_in_skin: Ints  # (n_patch,) numbers of the patch's nodes on that grid
    outside_mm: Array  # (n_outside, 3) skin nodes beside the patch
    outside_neighbour: Ints  # (n_outside,) nearest rim node of each
    kind: str = "finger"
    timing_s: dict[str, float] = field(default_factory=dict, compare=False)

    @property
    def receptors(self) -> ReceptorSet:
        """Receptor locations."""
        return self.columns.receptors

    @cached_property
    def strain_per_force(self) -> Array:
        """(6 n_receptors, m n_patch) strains per N on the patch along its axes."""
        return self.columns.per_force(self.patch_in_skin, self.patch.axes)

    def strain(self, force: Array) -> Array:
        """Return (n_receptors, 6) strains under (m, n_patch) forces on the patch."""
        return (self.strain_per_force @ force.ravel()).reshape(-1, 6)

    def point_load(self, x_mm: float, z_mm: float) -> Array:
        """Return (6 n_receptors,) strain per N of an inward force along the skin's normal at (x, z).

        Bilinear shape functions share the force between the four skin nodes around the point; two on a section.
        """
        phi = float(self.surface.angle_at(x_mm, z_mm))
        force = point_force(self.skin_z_mm, self.skin_phi, (z_mm, phi))
        return np.einsum("rzpi,zp,i->r", self.columns.per_skin_force, force, -self.surface.normal(phi, z_mm))


def point_force(skin_z_mm: Array, skin_phi: Array, at: ArrayLike) -> Array:
    """Return (…, n_z, n_phi) nodal weights of forces at (…, 2) z and φ, by bilinear shape functions."""
    z_mm, phi = np.moveaxis(np.asarray(at, dtype=float), -1, 0)
    return _shares(skin_z_mm, z_mm)[..., :, None] * _shares(skin_phi, phi)[..., None, :]


def _shares(grid: Array, value: Array) -> Array:
    """Return (…, n) linear weights of an ascending grid's nodes for each value; all ones for a single node."""
    if len(grid) == 1:
        return np.ones((*value.shape, 1))
    k = np.clip(np.searchsorted(grid, value) - 1, 0, len(grid) - 2)
    along = ((value - grid[k]) / (grid[k + 1] - grid[k]))[..., None]
    away = np.arange(len(grid)) - k[..., None]
    return (away == 0) * (1 - along) + (away == 1) * along


def skin_beside(mesh: FingerMesh, patch: Patch, sections: slice = slice(None)) -> tuple[Array, Ints]:
    """Return skin nodes of the pulp's half outside the patch, in some sections, and the nearest rim node of each."""
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[sections, :, 0].ravel()
    position = mesh.nodes[np.setdiff1d(skin, mesh.patch_nodes)]
    position = position[position[:, 1] > 0]
    rim = np.flatnonzero(patch.rim)
    distance = ((position[:, None] - patch.position_mm[rim][None]) ** 2).sum(axis=-1)
    return position, rim[np.argmin(distance, axis=1)]


_PLAIN = ("skin_z_mm", "skin_phi", "patch_in_skin", "outside_mm", "outside_neighbour")


def to_arrays(model: CondensedModel) -> dict[str, NDArray[np.generic]]:
    """Return the arrays that are stored on disk, except for columns and surface, which takes milliseconds to fit."""
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
    """Restore the model from the arrays of `to_arrays`, with columns."""
    shape = (int(arrays["shape"][0]), int(arrays["shape"][1]))
    axes = tuple(int(axis) for axis in arrays["axes"])
    patch = Patch(arrays["position_mm"], arrays["area_mm2"], shape, axes, compliance=arrays["compliance"])
    row, nodes = (int(n) for n in arrays["counts"])
    plain = {name: arrays[name] for name in _PLAIN}
    return CondensedModel(surface, patch, row, nodes, columns, **plain)
