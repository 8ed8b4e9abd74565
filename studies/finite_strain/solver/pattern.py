"""Where a body's stiffness is not zero, and the sum of element matrices there."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Pattern:
    """The upper triangle of a symmetric matrix in compressed rows, and where element matrices go in it."""

    size: int
    keys: Ints  # ascending, row · size + column
    taken: NDArray[np.bool_]  # of the element matrices' entries
    into: Ints

    @classmethod
    def of(cls, dof: Ints, size: int) -> "Pattern":
        """Of (n, k) unknowns of elements, −1 where held."""
        row, col = dof[:, :, None], dof[:, None, :]
        taken = (row >= 0) & (col >= row)
        keys, into = np.unique((row * size + col)[taken], return_inverse=True)
        return cls(size, keys, taken, into.astype(np.int32))

    def summed(self, matrices: Array) -> Array:
        """(n_keys,) values of (n, k, k) element matrices."""
        return np.asarray(np.bincount(self.into, matrices[self.taken], len(self.keys)), float)

    def matrix(self, values: Array) -> sp.csr_array:
        """The upper triangle."""
        rows = np.searchsorted(self.keys // self.size, np.arange(self.size + 1))
        return sp.csr_array((values, self.keys % self.size, rows), shape=(self.size, self.size))

    def at(self, row: Ints, col: Ints) -> Ints:
        """Where entries with row ≤ column are."""
        return np.searchsorted(self.keys, row * self.size + col)

    @cached_property
    def diagonal(self) -> Ints:
        """Where the diagonal is."""
        return self.at(np.arange(self.size), np.arange(self.size))
