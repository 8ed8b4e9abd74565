"""One sparsity pattern, many matrices: MKL PARDISO analyses it once and tells which of them are positive definite."""

import weakref

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from pypardiso import PyPardisoSolver
from pypardiso.pardiso_wrapper import PyPardisoError

from studies.finite_strain.solver.pattern import Pattern

Array = NDArray[np.float64]

_SYMMETRIC_POSITIVE_DEFINITE = 2
_ANALYSE, _FACTORISE_SOLVE, _RELEASE = 11, 23, -1


class NotPositiveDefiniteError(ValueError):
    """A matrix is not positive definite."""


class Factor:
    """Solves with upper triangles of one pattern."""

    def __init__(self, pattern: Pattern) -> None:
        self._pattern = pattern
        self._solver = PyPardisoSolver(mtype=_SYMMETRIC_POSITIVE_DEFINITE)
        self._analysed = False
        weakref.finalize(self, _release, self._solver, pattern.size).atexit = False

    def solve(self, values: Array, load: Array) -> Array:
        """(n,) from the upper triangle's values and (n,) loads. Raises NotPositiveDefiniteError."""
        matrix = self._pattern.matrix(values)
        if not self._analysed:
            self._solver.set_phase(_ANALYSE)
            self._solver._call_pardiso(matrix, load)
            self._analysed = True
        self._solver.set_phase(_FACTORISE_SOLVE)
        try:
            return np.asarray(self._solver._call_pardiso(matrix, load))
        except PyPardisoError as error:
            raise NotPositiveDefiniteError(str(error)) from None


def _release(solver: PyPardisoSolver, size: int) -> None:
    solver.set_phase(_RELEASE)
    solver._call_pardiso(sp.eye_array(size, format="csr"), np.zeros(size))
