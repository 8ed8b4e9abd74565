"""Arrays of several builds in single precision, and their weighted sums: one pass through the memory.

Rounding takes 6e-8 of an entry, far below what interpolation leaves. Of a symmetric matrix the lower triangle is
kept, in blocks of rows; the mirrored sum is symmetric to the last bit.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sim.fem.dense import mirror_lower

Array = NDArray[np.float64]
Singles = NDArray[np.float32]

_ROWS = 256


def packed(symmetric: Array) -> Singles:
    """(k,) the lower triangle of an (n, n) matrix, each block of rows as far as its last diagonal entry."""
    return np.concatenate(
        [symmetric[rows, : rows.stop].ravel() for rows in _blocks(len(symmetric))], dtype=np.float32
    )


def unpacked(entries: Singles, n: int) -> Array:
    """(n, n) the matrix of which the entries were packed."""
    matrix = np.empty((n, n))
    start = 0
    for rows in _blocks(n):
        block = matrix[rows, : rows.stop]
        block[:] = entries[start : start + block.size].reshape(block.shape)
        start += block.size
    return mirror_lower(matrix)


def summed(weights: Array, stacked: Singles) -> Singles:
    """(…) the sum of (m, …) arrays with (m,) weights."""
    flat = weights.astype(np.float32) @ stacked.reshape(len(weights), -1)
    return np.asarray(flat, dtype=np.float32).reshape(stacked.shape[1:])


def _blocks(n: int) -> Iterator[slice]:
    return (slice(start, min(start + _ROWS, n)) for start in range(0, n, _ROWS))
