"""The condensed fingertip: everything a contact needs, made once from a configuration."""

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig, Tissue
from sim.contact.patch import Patch, X, Y
from sim.fem import pardiso
from sim.fem.assembly import assemble_upper
from sim.fem.elements import stiffness
from sim.fem.pardiso import PardisoFactor
from sim.fem.slabs import SlabFactor
from sim.finger.mesh import FingerMesh, build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet, strain_operator

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class CondensedModel:
    """The patch, and receptors whose strain is linear in the forces on the skin. E(epidermis) = 1 MPa."""

    surface: FingertipSurface
    patch: Patch
    receptor_row: int
    nodes: int
    receptors: ReceptorSet
    receptor_e: Array  # (n_receptors,) E / E(epidermis)
    strain_per_skin_force: Array  # (6 n_receptors, n_z, n_phi, 3) 1/N, forces on all skin nodes
    skin_z_mm: Array  # (n_z,)
    skin_phi: Array  # (n_phi,) rad
    patch_in_skin: Ints  # (n_patch,) numbers of the patch's nodes on that grid
    outside_mm: Array  # (n_outside, 3) skin nodes beside the patch
    outside_neighbour: Ints  # (n_outside,) the rim node each is nearest to
    kind: str = "finger"
    timing_s: dict[str, float] = field(default_factory=dict, compare=False)

    @cached_property
    def strain_per_force(self) -> Array:
        """(6 n_receptors, m n_patch) 1/N, forces on the patch along its axes."""
        by_node = self.strain_per_skin_force.reshape(len(self.strain_per_skin_force), -1, 3)
        on_patch = by_node[:, self.patch_in_skin][:, :, list(self.patch.axes)]
        return np.ascontiguousarray(on_patch.swapaxes(1, 2)).reshape(len(by_node), -1)

    def point_load(self, x_mm: float, z_mm: float) -> Array:
        """(6 n_receptors,) strain per N of an inward force along the skin's normal at (x, z).

        The force is shared between the four skin nodes around the place, by their bilinear shape functions.
        """
        phi = float(self.surface.angle_at(x_mm, z_mm))
        k, across = _cell(self.skin_z_mm, z_mm)
        j, around = _cell(self.skin_phi, phi)
        weights = np.outer([1 - across, across], [1 - around, around])
        corners = self.strain_per_skin_force[:, k : k + 2, j : j + 2]
        return np.einsum("rzpi,zp,i->r", corners, weights, -self.surface.normal(phi, z_mm))


@dataclass(frozen=True)
class FiniteElements:
    """The uncondensed problem: mesh, upper triangle of the free stiffness, and its unknowns."""

    mesh: FingerMesh
    upper: sp.csr_array  # (n_free, n_free) N/mm per MPa of E(epidermis)
    free: Ints  # (n_free,) degree of freedom 3·node + component
    kept: Ints  # ascending positions in `free` of the patch's displacements along its axes

    @property
    def slabs(self) -> Ints:
        """First unknown of each axial slab: a row of nodes, or of quadratic elements two."""
        per_slab = 3 * self.mesh.order * self.mesh.grid[1] * self.mesh.grid[2]
        return np.searchsorted(self.free // per_slab, np.arange(-(-self.mesh.grid[0] // self.mesh.order)))


def young_ratios(tissue: Tissue) -> Array:
    """E / E(epidermis) of epidermis, dermis, fat and bone."""
    return np.array([1.0, tissue.e_dermis, tissue.e_fat, tissue.e_bone])


def _cell(grid: Array, value: float) -> tuple[int, float]:
    """The interval of an ascending grid that holds a value, and how far along it."""
    k = int(np.clip(np.searchsorted(grid, value) - 1, 0, len(grid) - 2))
    return k, float((value - grid[k]) / (grid[k + 1] - grid[k]))


def assembled(config: FingertipConfig, mesh: FingerMesh) -> sp.csr_array:
    """(3 n_nodes, 3 n_nodes) upper triangle of the stiffness for E(epidermis) = 1 MPa."""
    young = young_ratios(config.tissue)[mesh.layer]
    matrices = stiffness(mesh.nodes, mesh.hexes, young, config.tissue.poisson, config.mesh.element)
    return assemble_upper(matrices, mesh.hexes, len(mesh.nodes))


def discretise(config: FingertipConfig, mesh: FingerMesh, axes: tuple[int, ...] = (X, Y)) -> FiniteElements:
    """Assemble the stiffness of the free degrees of freedom for E(epidermis) = 1 MPa, to keep the patch's `axes`."""
    upper = assembled(config, mesh)
    free = np.flatnonzero(np.repeat(~mesh.fixed, 3))
    patch = np.sort((3 * mesh.patch_nodes + np.array(axes)[:, None]).ravel())
    return FiniteElements(mesh, upper[free][:, free], free, np.searchsorted(free, patch))


def factorise(problem: FiniteElements, solver: str = "auto") -> PardisoFactor | SlabFactor:
    """Condense onto the patch: by MKL PARDISO where it exists ("pardiso"), else slab by slab ("slabs")."""
    return condensed(problem.upper, problem.kept, problem.slabs, solver)


def condensed(upper: sp.csr_array, kept: Ints, slabs: Ints, solver: str = "auto") -> PardisoFactor | SlabFactor:
    """The same for any symmetric matrix of slabs that touch only their neighbours."""
    if solver == "pardiso" or (solver == "auto" and pardiso.available()):
        return PardisoFactor(upper, kept)
    return SlabFactor(upper, kept, slabs)


def build_model(
    config: FingertipConfig,
    surface: FingertipSurface,
    receptors: ReceptorSet,
    slopes: tuple[int, ...] = (X,),
    solver: str = "auto",
) -> CondensedModel:
    """Mesh, assemble, condense for indentors that slope along some axes; `timing_s` says how long each took."""
    clock = _Stopwatch()
    mesh = build_mesh(meshed_for(config, slopes), surface)
    clock.lap("mesh")
    axes = (*slopes, Y)
    problem = discretise(config, mesh, axes)
    clock.lap("assembly")
    with factorise(problem, solver) as factor:
        clock.lap("condensation")
        compliance = factor.compliance
        clock.lap("inverse")
        operator, layers = strain_operator(mesh, receptors)
        strain = factor.solve(operator.tocsc()[:, problem.free].toarray())
    clock.lap("receptors")
    n_z, n_phi, _ = mesh.grid
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[:, :, 0].ravel()
    everywhere = np.zeros((len(strain), 3 * len(mesh.nodes)))
    everywhere[:, problem.free] = strain
    order = by_axis(axes, len(mesh.patch_nodes))
    patch = Patch(
        position_mm=mesh.nodes[mesh.patch_nodes],
        area_mm2=mesh.patch_area_mm2,
        compliance=compliance[order].take(order, axis=1),
        shape=mesh.patch_shape,
        axes=axes,
    )
    outside, neighbour = skin_beside(mesh, patch)
    clock.lap("ordering")
    return CondensedModel(
        surface=surface,
        patch=patch,
        receptor_row=mesh.receptor_row,
        nodes=len(mesh.nodes),
        receptors=receptors,
        receptor_e=young_ratios(config.tissue)[layers],
        strain_per_skin_force=everywhere.reshape(len(strain), -1, 3)[:, skin].reshape(-1, n_z, n_phi, 3),
        skin_z_mm=mesh.z_mm,
        skin_phi=mesh.phi,
        patch_in_skin=np.searchsorted(skin, mesh.patch_nodes),
        outside_mm=outside,
        outside_neighbour=neighbour,
        timing_s=clock.laps,
    )


def meshed_for(config: FingertipConfig, slopes: tuple[int, ...]) -> FingertipConfig:
    """The mesh for indentors that slope along some axes: longer elements are for shapes prismatic along the finger.

    Under round shapes and the line the spacing is even, unless given; round shapes have a patch of their own.
    """
    if slopes == (X,):
        return config
    mesh = config.mesh
    other: dict[str, float] = {}
    if mesh.axial_spacing_mm is None:
        other["axial_spacing_mm"] = mesh.spacing_mm
    if len(slopes) > 1:
        other |= {"patch_x_mm": mesh.round_patch_mm, "patch_z_mm": mesh.round_patch_mm}
    return config.model_copy(update={"mesh": mesh.model_copy(update=other)})


def by_axis(axes: tuple[int, ...], n: int) -> Ints:
    """Kept unknowns, node by node with ascending components, in the order axis by axis."""
    rank = np.argsort(np.argsort(axes))
    return (len(axes) * np.arange(n) + rank[:, None]).ravel()


def skin_beside(mesh: FingerMesh, patch: Patch, sections: slice = slice(None)) -> tuple[Array, Ints]:
    """Skin nodes of the pulp's half outside the patch, in some of the sections, and the nearest rim node of each."""
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[sections, :, 0].ravel()
    position = mesh.nodes[np.setdiff1d(skin, mesh.patch_nodes)]
    position = position[position[:, 1] > 0]
    rim = np.flatnonzero(patch.rim)
    distance = ((position[:, None] - patch.position_mm[rim][None]) ** 2).sum(axis=-1)
    return position, rim[np.argmin(distance, axis=1)]


_PLAIN = (
    *("receptor_e", "strain_per_skin_force", "skin_z_mm", "skin_phi", "patch_in_skin"),
    *("outside_mm", "outside_neighbour"),
)


def to_arrays(model: CondensedModel) -> dict[str, NDArray[np.generic]]:
    """What is stored on disk: surface and receptors are made again in milliseconds."""
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


def from_arrays(arrays: dict[str, Any], surface: FingertipSurface, receptors: ReceptorSet) -> CondensedModel:
    """The model that `to_arrays` stored."""
    shape = (int(arrays["shape"][0]), int(arrays["shape"][1]))
    axes = tuple(int(axis) for axis in arrays["axes"])
    patch = Patch(arrays["position_mm"], arrays["area_mm2"], arrays["compliance"], shape, axes)
    row, nodes = (int(n) for n in arrays["counts"])
    plain = {name: arrays[name] for name in _PLAIN}
    return CondensedModel(surface, patch, row, nodes, receptors, **plain)


class _Stopwatch:
    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = now - self._last
        self._last = now
