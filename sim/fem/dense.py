"""Dense symmetric algebra by LAPACK."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]

_TILE = 512


def inverse_spd(matrix: Array) -> Array:
    """(n, n) inverse of a symmetric positive definite matrix; raises ValueError when it is not definite."""
    factor, info = lapack.dpotrf(matrix.T, lower=1, clean=0)
    if info:
        raise ValueError(f"matrix is not positive definite (leading minor {info})")
    inverse, info = lapack.dpotri(factor, lower=1, overwrite_c=1)
    return mirror_lower(inverse).T


def mirror_lower(matrix: Array) -> Array:
    """Copy the lower triangle over the upper one, in place, tile by tile."""
    n = len(matrix)
    for i in range(0, n, _TILE):
        rows = slice(i, min(i + _TILE, n))
        matrix[rows, rows] = np.tril(matrix[rows, rows]) + np.tril(matrix[rows, rows], -1).T
        matrix[rows, rows.stop :] = matrix[rows.stop :, rows].T
    return matrix
