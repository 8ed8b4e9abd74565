"""Linear complementarity with a symmetric positive definite matrix: block principal pivoting."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_PATIENCE = 8
_MAX_PIVOTS = 400


class LcpSolution(NamedTuple):
    """Multipliers (n,), their active set and its Cholesky factor (lower)."""

    multipliers: Array
    active: Ints
    factor: Array


def solve_lcp(
    q: Array, submatrix: Callable[[Ints], Array], apply: Callable[[Array], Array], start: NDArray[np.bool_]
) -> LcpSolution | None:
    """λ ≥ 0 with q + Wλ ≥ 0 and λ·(q + Wλ) = 0, or None when the pivoting does not end.

    `submatrix(A)` gives W[A, A], `apply(λ)` gives Wλ. All infeasible indices are exchanged at once; when their
    number has not fallen for 8 passes, only the last one is (Murty), which is finite. Source: Júdice & Pires (1994).
    """
    active = start.copy()
    best, patience = len(q) + 1, _PATIENCE
    scale = float(np.abs(q).max(initial=1e-300))
    for _ in range(_MAX_PIVOTS):
        index = np.flatnonzero(active)
        factor, info = lapack.dpotrf(submatrix(index), lower=1, clean=0, overwrite_a=1)
        if info:
            return None
        multipliers = np.zeros(len(q))
        if len(index):
            multipliers[index] = lapack.dpotrs(factor, -q[index], lower=1)[0]
        slack = q + apply(multipliers)
        slack[index] = 0.0
        wrong = np.where(active, multipliers < 0, slack < -1e-15 * scale)
        n_wrong = int(wrong.sum())
        if n_wrong == 0:
            return LcpSolution(multipliers, index, factor)
        if n_wrong < best:
            best, patience = n_wrong, _PATIENCE
        else:
            patience -= 1
        if patience >= 0:
            active ^= wrong
        else:
            last = int(np.flatnonzero(wrong)[-1])
            active[last] = not active[last]
    return None
