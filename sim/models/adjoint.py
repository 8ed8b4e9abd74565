"""Strain columns by adjoint solves: six for each receptor location, whatever the number of forces on the skin."""

import logging
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.announce import note
from sim.fem.dissection import DissectionFactor
from sim.models.condensed import FiniteElements

Array = NDArray[np.float64]
Progress = Callable[[int, int], object]

_log = logging.getLogger(__name__)

_PLACES_AT_ONCE = 20  # 120 right-hand sides: their displacements take 0.1 GB on the default mesh


def adjoint_columns(
    problem: FiniteElements, factor: DissectionFactor, operator: sp.csr_array, progress: Progress | None = None
) -> Array:
    """Return (6 n, n_z, n_phi, 3) strains at n locations, in 1/N of a force on each skin node.

    K⁻¹ is applied to the rows of the strain operator, some locations at once; `progress(done, of)` counts locations.
    """
    n_z, n_phi, n_r = problem.mesh.grid
    rows_of_free = operator.tocsc()[:, problem.free].tocsr()
    node, component = np.divmod(problem.free, 3)
    on_skin = np.flatnonzero(node % n_r == 0)
    at = 3 * (node[on_skin] // n_r) + component[on_skin]
    columns = np.zeros((operator.shape[0], 3 * n_z * n_phi))
    for start in range(0, len(columns), 6 * _PLACES_AT_ONCE):
        some = slice(start, start + 6 * _PLACES_AT_ONCE)
        columns[some, at] = factor.solve(rows_of_free[some].toarray(), on_skin)
        done, of = min(some.stop, len(columns)) // 6, len(columns) // 6
        _log.debug("building a model: strain at %d of %d receptors …", done, of)
        note(f"building a model: strain at {done} of {of} receptors …")
        if progress:
            progress(done, of)
    return columns.reshape(-1, n_z, n_phi, 3)
