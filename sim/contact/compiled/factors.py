"""Cholesky factors and triangular solves by scipy's LAPACK and BLAS, called from compiled loops.

Matrices are symmetric and stored by rows; only their lower triangles are read. LAPACK reads the same memory by
columns, where these are upper triangles: hence "U" throughout.
"""

from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba import types
from numba.extending import get_cython_function_address
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]

_U, _T, _N, _L, _V = (np.array([ord(letter)], np.uint8) for letter in "UTNLV")
_ONE = np.ones(1)
_pointer: Any = types.CPointer
_TEXT, _INT, _REAL = (_pointer(kind) for kind in (types.uint8, types.int32, types.float64))


def _routine(library: str, name: str, *arguments: Any) -> Any:
    """Declare a routine under a name that compiled code finds again when it is read from disk."""
    symbol = f"indentation_rig_{name}"
    llvm.add_symbol(symbol, get_cython_function_address(f"scipy.linalg.cython_{library}", name))
    return types.ExternalFunction(symbol, types.void(*arguments))


_dpotrf = _routine("lapack", "dpotrf", _TEXT, _INT, _REAL, _INT, _INT)
_dpotrs = _routine("lapack", "dpotrs", _TEXT, _INT, _INT, _REAL, _INT, _REAL, _INT, _INT)
_dpocon = _routine("lapack", "dpocon", _TEXT, _INT, _REAL, _INT, _REAL, _REAL, _REAL, _INT, _INT)
_dsyevd = _routine("lapack", "dsyevd", _TEXT, _TEXT, _INT, _REAL, _INT, _REAL, _REAL, _INT, _INT, _INT, _INT)
_dtrsm = _routine("blas", "dtrsm", *[_TEXT] * 4, _INT, _INT, _REAL, _REAL, _INT, _REAL, _INT)
_dsyrk = _routine("blas", "dsyrk", _TEXT, _TEXT, _INT, _INT, _REAL, _REAL, _INT, _REAL, _REAL, _INT)


@compiled
def factor_in_place(matrix: Array) -> bool:
    """Overwrite the lower triangle with L of L Lᵀ; return whether the matrix is positive definite."""
    n, info = np.array([len(matrix)], np.int32), np.zeros(1, np.int32)
    if n[0]:
        _dpotrf(_U.ctypes, n.ctypes, matrix.ctypes, n.ctypes, info.ctypes)
    return info[0] == 0


@compiled
def solve_in_place(factor: Array, right: Array) -> None:
    """Overwrite b (n,) with x of L Lᵀ x = b."""
    n, one, info = np.array([len(factor)], np.int32), np.ones(1, np.int32), np.zeros(1, np.int32)
    if n[0]:
        _dpotrs(_U.ctypes, n.ctypes, one.ctypes, factor.ctypes, n.ctypes, right.ctypes, n.ctypes, info.ctypes)


@compiled
def forth_in_place(factor: Array, rows: Array) -> None:
    """Overwrite each row b of (q, n) with L⁻¹ b."""
    n, q = np.array([len(factor)], np.int32), np.array([len(rows)], np.int32)
    if n[0] and q[0]:
        _dtrsm(_L.ctypes, _U.ctypes, _T.ctypes, _N.ctypes, n.ctypes, q.ctypes, _ONE.ctypes, factor.ctypes, n.ctypes,
               rows.ctypes, n.ctypes)  # fmt: skip


@compiled
def back_in_place(factor: Array, right: Array) -> None:
    """Overwrite b (n,) with L⁻ᵀ b."""
    n, one = np.array([len(factor)], np.int32), np.ones(1, np.int32)
    if n[0]:
        _dtrsm(_L.ctypes, _U.ctypes, _N.ctypes, _N.ctypes, n.ctypes, one.ctypes, _ONE.ctypes, factor.ctypes, n.ctypes,
               right.ctypes, n.ctypes)  # fmt: skip


@compiled
def add_products(matrix: Array, rows: Array) -> None:
    """Add the products of rows (q, n) with one another to the lower triangle of (q, q)."""
    q, n = np.array([len(rows)], np.int32), np.array([rows.shape[1]], np.int32)
    if n[0] and q[0]:
        _dsyrk(_U.ctypes, _T.ctypes, q.ctypes, n.ctypes, _ONE.ctypes, rows.ctypes, n.ctypes, _ONE.ctypes,
               matrix.ctypes, q.ctypes)  # fmt: skip


@compiled
def one_over_inverse(factor: Array) -> float:
    """Return LAPACK's estimate of 1 / ‖(L Lᵀ)⁻¹‖₁; with the exact norm, at most the smallest eigenvalue."""
    n, info, found = np.array([len(factor)], np.int32), np.zeros(1, np.int32), np.zeros(1)
    work, counts = np.empty(3 * len(factor)), np.empty(len(factor), np.int32)
    _dpocon(_U.ctypes, n.ctypes, factor.ctypes, n.ctypes, _ONE.ctypes, found.ctypes, work.ctypes, counts.ctypes,
            info.ctypes)  # fmt: skip
    return found[0]


@compiled
def eigen_in_place(matrix: Array) -> Array:
    """Return (n,) ascending eigenvalues; overwrite the matrix's rows with the eigenvectors."""
    n, info, values = np.array([len(matrix)], np.int32), np.zeros(1, np.int32), np.empty(len(matrix))
    room = np.array([1 + 6 * n[0] + 2 * n[0] * n[0]], np.int32)
    counts = np.array([3 + 5 * n[0]], np.int32)
    work, whole = np.empty(room[0]), np.empty(counts[0], np.int32)
    _dsyevd(_V.ctypes, _U.ctypes, n.ctypes, matrix.ctypes, n.ctypes, values.ctypes, work.ctypes, room.ctypes,
            whole.ctypes, counts.ctypes, info.ctypes)  # fmt: skip
    return values
