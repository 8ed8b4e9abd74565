"""Strain at any point inside a finger, from the factored stiffness of its whole mesh."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.fem.dissection import DissectionFactor
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet, strain_operator
from sim.models.adjoint import Progress, adjoint_columns
from sim.models.condensed import Columns, FiniteElements, discretise, factorise, meshed_for, young_ratios
from sim.models.result import IndentationResult

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_MOST_RECOVERED = 1000  # points whose map is cached
_POINTS_AT_ONCE = 200  # strain recovery takes a quarter of a megabyte per point


class Interior:
    """Mesh of a finger and the factor of its stiffness, 0.6 GB and some seconds on the default mesh.

    The factor is computed on first use, after the points were checked, and freed with the object.
    """

    def __init__(self, config: FingertipConfig, surface: FingertipSurface, slopes: tuple[int, ...]) -> None:
        self._config = config
        self.mesh = build_mesh(meshed_for(config, slopes), surface)
        self._recovered: tuple[bytes, Recovery] | None = None

    @cached_property
    def problem(self) -> FiniteElements:
        """Stiffness of the mesh, with a single kept unknown since nothing needs condensing."""
        problem = discretise(self._config, self.mesh)
        return replace(problem, kept=problem.kept[:1])

    @cached_property
    def factor(self) -> DissectionFactor:
        """Factor that solves under any loads."""
        return factorise(self.problem)

    def columns(self, receptors: ReceptorSet, progress: Progress | None = None) -> Columns:
        """Return columns of points by six adjoint solves each. Raises ReceptorError."""
        operator, layers = strain_operator(self.mesh, receptors.position_mm)
        strain = adjoint_columns(self.problem, self.factor, operator, progress)
        return Columns(receptors, young_ratios(self._config.tissue)[layers], strain)

    def recovery(self, points_mm: Array, progress: Progress | None = None) -> "Recovery":
        """Return the map from nodal displacements to strain at (n, 3) points. Raises ReceptorError."""
        operators, layers = [], np.zeros(len(points_mm), np.int64)
        for start in range(0, len(points_mm), _POINTS_AT_ONCE):
            some = slice(start, start + _POINTS_AT_ONCE)
            operator, layers[some] = strain_operator(self.mesh, points_mm[some])
            operators.append(operator)
            if progress:
                progress(min(some.stop, len(points_mm)), len(points_mm))
        return Recovery(tuple(operators), young_ratios(self._config.tissue)[layers])

    def moved(self, load: Array) -> Array:
        """Return (k, n_nodes, 3) displacements in mm under k loads on the nodes in N."""
        return moved_by(self.problem, self.factor, load)

    def strain(
        self, results: Sequence[IndentationResult], points_mm: Array, progress: Progress | None = None
    ) -> tuple[Array, Array]:
        """Return (n_results, n, 6) strains at (n, 3) points by one solve per press, and (n,) E / E(epidermis).

        The map of the last points is cached, unless they are very many. Raises ReceptorError.
        """
        points = points_mm.tobytes()
        if self._recovered is not None and self._recovered[0] == points:
            recovery = self._recovered[1]
        else:
            recovery = self.recovery(points_mm, progress)
            self._recovered = (points, recovery) if len(points_mm) <= _MOST_RECOVERED else None
        return recovery.strain(displaced(self.problem, self.factor, results)), recovery.young_ratio


class Recovery(NamedTuple):
    """Strain at n points of one mesh, linear in the displacements of its nodes."""

    operators: tuple[sp.csr_array, ...]  # each for some of the points
    young_ratio: Array  # (n,) E / E(epidermis) at the points

    def strain(self, moved: Array) -> Array:
        """Return (k, n, 6) engineering strains under (k, n_nodes, 3) displacements in mm."""
        flat = moved.reshape(len(moved), -1).T
        return np.concatenate([(operator @ flat).T for operator in self.operators], axis=1).reshape(len(moved), -1, 6)


def displaced(problem: FiniteElements, factor: DissectionFactor, results: Sequence[IndentationResult]) -> Array:
    """Return (n_results, n_nodes, 3) displacements in mm under the contact forces of indentations on this mesh."""
    mesh = problem.mesh
    loads = np.zeros((len(results), *mesh.nodes.shape))
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[:, :, 0].ravel()
    for load, result in zip(loads, results, strict=True):
        nodes = skin[result.model.patch_in_skin]
        load[nodes[:, None], result.model.patch.axes] = result.state.force.T
    return moved_by(problem, factor, loads)


def moved_by(problem: FiniteElements, factor: DissectionFactor, load: Array) -> Array:
    """Return (k, n_nodes, 3) displacements in mm under (k, n_nodes, 3) nodal forces in N."""
    moved = np.zeros((len(load), problem.mesh.nodes.size))
    moved[:, problem.free] = factor.solve(load.reshape(len(load), -1)[:, problem.free])
    return moved.reshape(load.shape)
