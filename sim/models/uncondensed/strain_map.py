"""Strain everywhere in the receptor plane, not at receptors only: one direct solve under given contact forces."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import griddata

from sim.config.fingertip_config import FingertipConfig
from sim.fem.strain import strain_matrix
from sim.finger.mesh import FingerMesh, build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.measures import measures_in_layers
from sim.measures.receptors import sampled
from sim.models.discretised import discretise, factorise, meshed_for, young_ratios
from sim.models.inside.interior import displaced
from sim.models.patches import widened
from sim.models.results.indentation import IndentationResult

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class StrainMap:
    """The elements' section with the receptor plane, from the skin inwards and once around.

    `corner_mm` and `moved_mm` (n_phi + 1, n_r, 2) x and y of the corners, undeformed and deformed; `measures` the 18,
    each (n_phi, n_r − 1), tension positive, stresses in pseudo-units.
    """

    corner_mm: Array
    moved_mm: Array
    measures: dict[str, Array]

    def carried(self, points_mm: Array) -> Array:
        """(n, 2) where points of the undeformed section go."""
        corner, by = self.corner_mm[:-1].reshape(-1, 2), (self.moved_mm - self.corner_mm)[:-1].reshape(-1, 2)
        return np.asarray(points_mm + griddata(corner, by, points_mm))


def strain_maps(config: FingertipConfig, results: Sequence[IndentationResult]) -> list[StrainMap]:
    """One map for each indentation of this finger, by one factorisation (seconds) a mesh and one solve each.

    The strain is that within each cell where it is most accurate, averaged over the cells on both sides of the plane,
    and not smoothed.
    """
    found: dict[int, StrainMap] = {}
    kinds = [(result.model.patch.axes, result.model.widened_mm) for result in results]
    for kind in set(kinds):
        mine = [k for k, other in enumerate(kinds) if other == kind]
        mesh = mesh_of(config, results[mine[0]])
        moved = displacements(config, mesh, [results[k] for k in mine])
        found |= zip(mine, _in_plane(config, mesh, moved), strict=True)
    return [found[k] for k in range(len(results))]


def mesh_of(config: FingertipConfig, result: IndentationResult) -> FingerMesh:
    """The mesh that an indentation was solved on: by the axes along which the indentor slopes, and its patch."""
    meshed = meshed_for(widened(config, result.model.widened_mm), result.model.patch.axes[:-1])
    return build_mesh(meshed, FingertipSurface.fit(config.geometry))


def _in_plane(config: FingertipConfig, mesh: FingerMesh, displacement: Array) -> Iterator[StrainMap]:
    plane = int(np.argmin(np.abs(mesh.z_mm - config.receptor_plane_mm)))
    cells = np.stack(np.meshgrid([plane - 1, plane], *(np.arange(n) for n in (mesh.grid[1], mesh.grid[2] - 1)),
                                 indexing="ij"), -1)  # fmt: skip
    elements, local = sampled(mesh, cells.reshape(-1, 3))
    nodes = mesh.hexes[elements]
    strains = strain_matrix(mesh.nodes[nodes], local)
    ratio = young_ratios(config.tissue)[mesh.layer[elements]].reshape(cells.shape[:3])[1]
    section = np.arange(len(mesh.nodes)).reshape(mesh.grid)[plane]
    corner = mesh.nodes[section, :2]
    for u in displacement:
        strain = np.einsum("mij,mj->mi", strains, u[nodes].reshape(len(nodes), -1)).reshape(2, -1, 6).mean(axis=0)
        measures = measures_in_layers(strain, ratio.ravel(), config.tissue.poisson)
        by_cell = {name: values.reshape(ratio.shape) for name, values in measures.items()}
        yield StrainMap(_closed(corner), _closed(corner + u[section, :2]), by_cell)


def _closed(corner: Array) -> Array:
    return np.concatenate([corner, corner[:1]])


def displacements(config: FingertipConfig, mesh: FingerMesh, results: Sequence[IndentationResult]) -> Array:
    """(n_results, n_nodes, 3) mm of every node of their mesh under the contact forces of indentations."""
    problem = discretise(config, mesh)
    with factorise(replace(problem, kept=problem.kept[:1])) as factor:  # nothing is to be condensed
        return displaced(problem, factor, results)
