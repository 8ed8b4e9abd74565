"""The condensed fingertip: everything a contact needs, made once from a configuration."""

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.config import FingertipConfig, Tissue
from sim.contact.patch import Patch
from sim.fem import pardiso
from sim.fem.assembly import assemble_upper
from sim.fem.elements import hex8_stiffness
from sim.fem.pardiso import PardisoFactor
from sim.fem.slabs import SlabFactor
from sim.finger.mesh import FingerMesh, build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet, strain_operator

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class CondensedModel:
    """The patch, and receptors whose strain is linear in the patch's forces. E(epidermis) = 1 MPa."""

    surface: FingertipSurface
    patch: Patch
    receptor_row: int
    nodes: int
    receptors: ReceptorSet
    receptor_e: Array  # (n_receptors,) E / E(epidermis)
    strain_per_force: Array  # (6 n_receptors, 2 n_patch) 1/N
    outside_mm: Array  # (n_outside, 3) skin nodes beside the patch
    outside_neighbour: Ints  # (n_outside,) the rim node each is nearest to
    timing_s: dict[str, float] = field(default_factory=dict, compare=False)


@dataclass(frozen=True)
class FiniteElements:
    """The uncondensed problem: mesh, upper triangle of the free stiffness, and its unknowns."""

    mesh: FingerMesh
    upper: sp.csr_array  # (n_free, n_free) N/mm per MPa of E(epidermis)
    free: Ints  # (n_free,) degree of freedom 3·node + component
    kept: Ints  # ascending positions in `free` of the patch's x and y

    @property
    def slabs(self) -> Ints:
        """First unknown of each axial slab."""
        per_slab = 3 * self.mesh.grid[1] * self.mesh.grid[2]
        return np.searchsorted(self.free // per_slab, np.arange(self.mesh.grid[0]))


def young_ratios(tissue: Tissue) -> Array:
    """E / E(epidermis) of epidermis, dermis, fat and bone."""
    return np.array([1.0, tissue.e_dermis, tissue.e_fat, tissue.e_bone])


def discretise(config: FingertipConfig, mesh: FingerMesh) -> FiniteElements:
    """Assemble the stiffness of the free degrees of freedom for E(epidermis) = 1 MPa."""
    young = young_ratios(config.tissue)[mesh.layer]
    stiffness = hex8_stiffness(mesh.nodes, mesh.hexes, young, config.tissue.poisson, config.mesh.element)
    upper = assemble_upper(stiffness, mesh.hexes, len(mesh.nodes))
    free = np.flatnonzero(np.repeat(~mesh.fixed, 3))
    patch = np.sort(np.concatenate([3 * mesh.patch_nodes, 3 * mesh.patch_nodes + 1]))
    return FiniteElements(mesh, upper[free][:, free], free, np.searchsorted(free, patch))


def factorise(problem: FiniteElements, solver: str = "auto") -> PardisoFactor | SlabFactor:
    """Condense onto the patch: by MKL PARDISO where it exists ("pardiso"), else slab by slab ("slabs")."""
    if solver == "pardiso" or (solver == "auto" and pardiso.available()):
        return PardisoFactor(problem.upper, problem.kept)
    return SlabFactor(problem.upper, problem.kept, problem.slabs)


def build_model(
    config: FingertipConfig, surface: FingertipSurface, receptors: ReceptorSet, solver: str = "auto"
) -> CondensedModel:
    """Mesh, assemble, condense; `timing_s` says how long each took."""
    clock = _Stopwatch()
    mesh = build_mesh(config, surface)
    clock.lap("mesh")
    problem = discretise(config, mesh)
    clock.lap("assembly")
    with factorise(problem, solver) as factor:
        clock.lap("condensation")
        compliance = factor.compliance
        clock.lap("inverse")
        operator, layers = strain_operator(mesh, receptors)
        strain = factor.kept_response(operator.tocsc()[:, problem.free].toarray())
    clock.lap("receptors")
    xy = np.concatenate([np.arange(0, len(compliance), 2), np.arange(1, len(compliance), 2)])
    patch = Patch(
        position_mm=mesh.nodes[mesh.patch_nodes],
        area_mm2=mesh.patch_area_mm2,
        compliance=compliance[xy].take(xy, axis=1),
        shape=mesh.patch_shape,
    )
    outside, neighbour = _skin_beside(mesh, patch)
    clock.lap("ordering")
    return CondensedModel(
        surface=surface,
        patch=patch,
        receptor_row=mesh.receptor_row,
        nodes=len(mesh.nodes),
        receptors=receptors,
        receptor_e=young_ratios(config.tissue)[layers],
        strain_per_force=strain[:, xy],
        outside_mm=outside,
        outside_neighbour=neighbour,
        timing_s=clock.laps,
    )


def _skin_beside(mesh: FingerMesh, patch: Patch) -> tuple[Array, Ints]:
    """Skin nodes of the pulp's half outside the patch, and the nearest rim node of each."""
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[:, :, 0].ravel()
    position = mesh.nodes[np.setdiff1d(skin, mesh.patch_nodes)]
    position = position[position[:, 1] > 0]
    rim = np.flatnonzero(patch.rim)
    distance = ((position[:, None] - patch.position_mm[rim][None]) ** 2).sum(axis=-1)
    return position, rim[np.argmin(distance, axis=1)]


_PLAIN = ("receptor_e", "strain_per_force", "outside_mm", "outside_neighbour")


def to_arrays(model: CondensedModel) -> dict[str, NDArray[np.generic]]:
    """What is stored on disk: surface and receptors are made again in milliseconds."""
    patch = model.patch
    return {
        **{name: getattr(model, name) for name in _PLAIN},
        "position_mm": patch.position_mm,
        "area_mm2": patch.area_mm2,
        "compliance": patch.compliance,
        "shape": np.array(patch.shape),
        "counts": np.array([model.receptor_row, model.nodes]),
    }


def from_arrays(arrays: dict[str, Any], surface: FingertipSurface, receptors: ReceptorSet) -> CondensedModel:
    """The model that `to_arrays` stored."""
    shape = (int(arrays["shape"][0]), int(arrays["shape"][1]))
    patch = Patch(arrays["position_mm"], arrays["area_mm2"], arrays["compliance"], shape)
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
