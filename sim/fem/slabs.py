"""Portable static condensation: block Cholesky over slabs of nodes, LAPACK only.

The matrix couples a slab only with its neighbours, so it is block tridiagonal. Slower than PARDISO and the
same to round-off; used where MKL does not exist.
"""

from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_COLUMNS = 512  # unit loads at once


class SlabFactor:
    """Factor of a symmetric positive definite block-tridiagonal matrix, condensed onto some of its unknowns."""

    def __init__(self, upper: sp.csr_array, kept: Ints, slabs: Ints) -> None:
        """Upper triangle (n, n), ascending numbers of the kept unknowns, and the first unknown of each slab."""
        self.kept = kept
        bounds = np.append(slabs, upper.shape[0])
        self._slabs = [slice(int(a), int(b)) for a, b in pairwise(bounds) if b > a]
        self._pivots: list[tuple[Array, bool]] = []
        self._couplings: list[sp.csr_array] = []
        for here, after in zip(self._slabs, [*self._slabs[1:], None], strict=True):
            block = upper[here, here].toarray()
            block += np.triu(block, 1).T
            if self._couplings:
                coupling = self._couplings[-1]
                block -= coupling.T @ cho_solve(self._pivots[-1], coupling.toarray(), check_finite=False)
            self._pivots.append(cho_factor(block, lower=True, overwrite_a=True, check_finite=False))
            if after is not None:
                self._couplings.append(sp.csr_array(upper[here, after]))

    def solve(self, loads: Array) -> Array:
        """(k, n) displacements under (k, n) loads."""
        x = np.array(loads, dtype=float).T
        for k, coupling in enumerate(self._couplings):
            x[self._slabs[k + 1]] -= coupling.T @ cho_solve(self._pivots[k], x[self._slabs[k]], check_finite=False)
        for k in reversed(range(len(self._slabs))):
            right = x[self._slabs[k]]
            if k < len(self._couplings):
                right = right - self._couplings[k] @ x[self._slabs[k + 1]]
            x[self._slabs[k]] = cho_solve(self._pivots[k], right, check_finite=False)
        return x.T

    @cached_property
    def compliance(self) -> Array:
        """(n_kept, n_kept) displacements of the kept unknowns under unit loads on them."""
        out = np.empty((len(self.kept), len(self.kept)))
        for start in range(0, len(self.kept), _COLUMNS):
            part = self.kept[start : start + _COLUMNS]
            loads = np.zeros((len(part), self._slabs[-1].stop))
            loads[np.arange(len(part)), part] = 1.0
            out[start : start + _COLUMNS] = self.solve(loads)[:, self.kept]
        return 0.5 * (out + out.T)

    def close(self) -> None:
        """Nothing to free."""

    def __enter__(self) -> "SlabFactor":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
