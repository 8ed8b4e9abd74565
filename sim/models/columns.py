"""Columns: strain at places inside a model under unit forces on its skin, apart from the skin's own compliance."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.measures.receptors import ReceptorSet
from sim.models.discretised import Factor, FiniteElements

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Progress = Callable[[int, int], object]

STORED = ("young_ratio", "per_skin_force")
"""Fields of columns that go to disk."""

_PLACES_AT_ONCE = 20  # 120 right-hand sides: their displacements take 0.1 GB on the default mesh


@dataclass(frozen=True)
class Columns:
    """Strain at receptors, linear in the forces on the skin. E(epidermis) = 1 MPa."""

    receptors: ReceptorSet
    young_ratio: Array  # (n,) E / E(epidermis) there
    per_skin_force: Array  # (6 n, n_z, n_phi, 3) 1/N, forces on all skin nodes

    def per_force(self, nodes: Ints, axes: tuple[int, ...]) -> Array:
        """(6 n, m k) 1/N, forces on k of the skin's nodes along m axes, all along the first, then the next."""
        by_node = self.per_skin_force.reshape(len(self.per_skin_force), -1, 3)
        on_nodes = by_node[:, nodes][:, :, list(axes)]
        return np.ascontiguousarray(on_nodes.swapaxes(1, 2)).reshape(len(by_node), -1)

    def as_arrays(self) -> dict[str, NDArray[np.generic]]:
        """What is stored on disk: the receptors are known to whoever asks."""
        return {name: np.ascontiguousarray(getattr(self, name)) for name in STORED}


def adjoint_columns(
    problem: FiniteElements, factor: Factor, operator: sp.csr_array, progress: Progress | None = None
) -> Array:
    """(6 n, n_z, n_phi, 3) strains that an operator recovers at n places, 1/N of a force on each skin node.

    K⁻¹ is applied to its rows, those of some places at once; `progress(done, of)` is called as places are done.
    """
    n_z, n_phi, n_r = problem.mesh.grid
    rows_of_free = operator.tocsc()[:, problem.free].tocsr()
    node, component = np.divmod(problem.free, 3)
    on_skin = np.flatnonzero(node % n_r == 0)
    at = 3 * (node[on_skin] // n_r) + component[on_skin]
    columns = np.zeros((operator.shape[0], 3 * n_z * n_phi))
    for start in range(0, len(columns), 6 * _PLACES_AT_ONCE):
        some = slice(start, start + 6 * _PLACES_AT_ONCE)
        columns[some, at] = factor.solve(rows_of_free[some].toarray())[:, on_skin]
        if progress:
            progress(min(some.stop, len(columns)) // 6, len(columns) // 6)
    return columns.reshape(-1, n_z, n_phi, 3)
