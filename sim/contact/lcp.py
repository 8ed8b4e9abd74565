"""Linear complementarity with a symmetric positive definite matrix."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_PATIENCE = 8
_MOST_ENTRIES = 4000
_LIFT = 1e-11
_TOLERANCE = 1e-15


class LcpSolution(NamedTuple):
    """Multipliers (n,), their active set and its Cholesky factor (lower)."""

    multipliers: Array
    active: Ints
    factor: Array


def solve_lcp(q: Array, w: Array, start: Bools) -> LcpSolution | None:
    """λ ≥ 0 with q + Wλ ≥ 0 and λ·(q + Wλ) = 0, or None when W is not positive definite.

    Block principal pivoting: all infeasible indices are exchanged at once (Júdice & Pires 1994). Where their number
    has not fallen for 8 exchanges, one index enters at a time and λ stays feasible (Lawson & Hanson 1974), which is
    finite. W's diagonal counts as raised by 1e-11, so that points that cannot be told apart share a load.
    """
    return _by_blocks(q, w, start) or _one_by_one(q, w, start)


def _by_blocks(q: Array, w: Array, start: Bools) -> LcpSolution | None:
    active = start.copy()
    best, patience = len(q) + 1, _PATIENCE
    tiny = _TOLERANCE * np.abs(q).max(initial=1e-300)
    while patience >= 0:
        solution = _held(q, w, active.nonzero()[0])
        if solution is None:
            return None
        wrong = solution.multipliers < 0
        wrong |= _slack(q, w, solution) < -tiny
        n_wrong = int(wrong.sum())
        if n_wrong == 0:
            return solution
        best, patience = (n_wrong, _PATIENCE) if n_wrong < best else (best, patience - 1)
        active ^= wrong
    return None


def _one_by_one(q: Array, w: Array, start: Bools) -> LcpSolution | None:
    solution = _feasible(q, w, np.flatnonzero(start), np.zeros(len(q)))
    tiny = _TOLERANCE * np.abs(q).max(initial=1e-300)
    for _ in range(_MOST_ENTRIES):
        if solution is None:
            return None
        slack = _slack(q, w, solution)
        entering = int(np.argmin(slack))
        if slack[entering] >= -tiny:
            return solution
        solution = _feasible(q, w, np.append(solution.active, entering), solution.multipliers)
    return None


def _feasible(q: Array, w: Array, active: Ints, before: Array) -> LcpSolution | None:
    """The solution with some indices held, or fewer: those that would pull are let go on the way from `before`."""
    while True:
        solution = _held(q, w, active)
        if solution is None:
            return None
        new, old = solution.multipliers[active], before[active]
        pulling = new < 0
        if not pulling.any():
            return solution
        share = np.where(pulling, old / np.where(pulling, old - new, 1.0), np.inf)
        before = before + share.min() * (solution.multipliers - before)
        active = active[share > share.min()]


def _held(q: Array, w: Array, active: Ints) -> LcpSolution | None:
    held = w.take(active, axis=0).take(active, axis=1)
    held.ravel()[:: len(active) + 1] *= 1 + _LIFT
    factor, info = lapack.dpotrf(held.T, lower=1, clean=0, overwrite_a=1)
    if info:
        return None
    multipliers = np.zeros(len(q))
    if len(active):
        multipliers[active] = lapack.dpotrs(factor, -q.take(active), lower=1)[0]
    return LcpSolution(multipliers, active, factor)


def _slack(q: Array, w: Array, solution: LcpSolution) -> Array:
    """q + Wλ, zero where held."""
    slack = w @ solution.multipliers
    slack += q
    slack[solution.active] = 0.0
    return slack
