"""Dense symmetric algebra by LAPACK."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from sim.errors import SimError

Array = NDArray[np.float64]

_TILE = 512


class IndefiniteError(SimError, ValueError):
    """A matrix is not positive definite: its leading minor of this order is not positive."""

    default_code = "not_positive_definite"

    def __init__(self, minor: int) -> None:
        super().__init__("matrix is not positive definite (leading minor {minor})", minor=minor)


def inverse_spd(matrix: Array) -> Array:
    """(n, n) inverse of a symmetric positive definite matrix; raises ValueError when it is not definite."""
    factor, info = lapack.dpotrf(matrix.T, lower=1, clean=0)
    if info:
        raise IndefiniteError(info)
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
