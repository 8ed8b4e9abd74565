"""Linear complementarity problem with a symmetric positive definite matrix: which points bear load, and how much."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled
from sim.contact.compiled.factors import factor_in_place, solve_in_place
from sim.contact.compiled.skin_compliance import SkinCompliance, moved, worked

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_PATIENCE = 3
_MOST_ENTRIES = 4000
_LIFT = 1e-11
_TOLERANCE = 1e-15


class LcpSolution(NamedTuple):
    """Multipliers (n,), the displacements (m, n) they cause, the active set and its Cholesky factor (lower)."""

    multipliers: Array
    u: Array
    active: Ints
    factor: Array


class _Problem(NamedTuple):
    """q, the points with their normals, and the part of W computed so far."""

    q: Array
    skin: SkinCompliance
    normal: Array  # (m, n)
    w: Array  # (n, n), filled as far as needed
    place: Ints  # (n,) row of a point in W, or −1


def solve_lcp(q: Array, skin: SkinCompliance, normal: Array, start: Bools) -> LcpSolution | None:
    """Solve λ ≥ 0, q + Wλ ≥ 0, λ·(q + Wλ) = 0; return None when W is not positive definite.

    W (n, n) holds the motion of points along their normals (m, n) by unit forces along them. Block principal pivoting
    exchanges all infeasible indices at once (Júdice & Pires 1994). Where their number has not fallen for 3 exchanges,
    one index at a time enters the best set so far, and λ stays feasible (Lawson & Hanson 1974), which is finite. W's
    diagonal counts as raised by 1e-11, so that coincident points share a load.
    """
    found, solution = _solved(q, skin, np.ascontiguousarray(normal), start)
    return solution if found else None


@compiled
def _solved(q: Array, skin: SkinCompliance, normal: Array, start: Bools) -> tuple[bool, LcpSolution]:
    problem = _Problem(q, skin, normal, np.empty((len(q), len(q))), np.full(len(q), -1))
    tiny = _TOLERANCE * max(1e-300, np.abs(q).max()) if len(q) else 0.0
    ended, found, solution = _by_blocks(problem, start, tiny)
    return (found, solution) if ended else _one_by_one(problem, solution.active, tiny)


@compiled
def _by_blocks(problem: _Problem, start: Bools, tiny: float) -> tuple[bool, bool, LcpSolution]:
    """Return whether block pivoting ended, whether W was definite so far, and the solution, or the nearest to one."""
    held = start.copy()
    best, patience = len(held) + 1, _PATIENCE
    while True:
        active = np.flatnonzero(held)
        definite, multipliers, factor = _held(problem, active)
        slack, u = _slack(problem, multipliers, active)
        solution = LcpSolution(multipliers, u, active, factor)
        if not definite:
            return True, False, solution
        wrong = np.flatnonzero((multipliers < 0.0) | (slack < -tiny))
        if len(wrong) == 0:
            return True, True, solution
        if len(wrong) < best:
            best, patience, nearest = len(wrong), _PATIENCE, solution
        else:
            patience -= 1
        if patience < 0:
            return False, True, nearest
        for point in wrong:
            held[point] = not held[point]


@compiled
def _one_by_one(problem: _Problem, start: Ints, tiny: float) -> tuple[bool, LcpSolution]:
    entries, entered = 0, start
    multipliers = np.zeros(len(problem.q))
    while True:
        definite, multipliers, active, factor = _feasible(problem, entered, multipliers)
        slack, u = _slack(problem, multipliers, active)
        entering = np.argmin(slack)
        done = slack[entering] >= -tiny
        if done or not definite or entries == _MOST_ENTRIES:
            return done and definite, LcpSolution(multipliers, u, active, factor)
        entries, entered = entries + 1, np.append(active, entering)


@compiled
def _feasible(problem: _Problem, active: Ints, before: Array) -> tuple[bool, Array, Ints, Array]:
    """Solve as `_held` does, dropping indices whose force would turn negative on the path from `before`.

    Returns whether W is definite, the multipliers, the remaining indices and their factor.
    """
    while True:
        definite, multipliers, factor = _held(problem, active)
        new, old = multipliers[active], before[active]
        if not definite or not (new < 0.0).any():
            return definite, multipliers, active, factor
        share = np.full(len(active), np.inf)
        for i in range(len(active)):
            if new[i] < 0.0:
                share[i] = old[i] / (old[i] - new[i])
        before = before + share.min() * (multipliers - before)
        active = active[share > share.min()]


@compiled
def _held(problem: _Problem, active: Ints) -> tuple[bool, Array, Array]:
    """Return whether W is definite on the active set, the multipliers, and the Cholesky factor."""
    _know(problem, active)
    n, w, place = len(active), problem.w, problem.place
    held, multipliers = np.empty((n, n)), np.zeros(len(place))
    for i in range(n):
        one = place[active[i]]
        for j in range(i + 1):
            other = place[active[j]]
            held[i, j] = w[one, other] if one > other else w[other, one]
        held[i, i] *= 1.0 + _LIFT
    definite = factor_in_place(held)
    if definite:
        right = np.empty(n)
        for i in range(n):
            right[i] = -problem.q[active[i]]
        solve_in_place(held, right)
        for i in range(n):
            multipliers[active[i]] = right[i]
    return definite, multipliers, held


@compiled
def _know(problem: _Problem, active: Ints) -> None:
    """Fill W's lower triangle for points that are active for the first time."""
    place, normal = problem.place, problem.normal
    before = 0
    for point in range(len(place)):
        before = max(before, place[point] + 1)
    after = before
    for point in active:
        if place[point] < 0:
            place[point] = after
            after += 1
    if after == before:
        return
    every, along = np.empty(after, np.int64), np.empty((len(normal), after))
    for point in range(len(place)):
        if place[point] >= 0:
            every[place[point]] = point
            for a in range(len(normal)):
                along[a, place[point]] = normal[a, point]
    rows = worked(problem.skin, every[before:], along[:, before:].copy(), every, along, before + 1)
    for r in range(after - before):
        for c in range(before + r + 1):
            problem.w[before + r, c] = rows[r, c]


@compiled
def _slack(problem: _Problem, multipliers: Array, active: Ints) -> tuple[Array, Array]:
    """Return q + Wλ, zero on the active set, and the displacements (m, n)."""
    normal, slack = problem.normal, problem.q.copy()
    force = np.empty((len(normal), len(active)))
    for i in range(len(active)):
        for a in range(len(normal)):
            force[a, i] = normal[a, active[i]] * multipliers[active[i]]
    u = moved(problem.skin, active, force)
    for a in range(len(normal)):
        for point in range(len(slack)):
            slack[point] += normal[a, point] * u[a, point]
    for point in active:
        slack[point] = 0.0
    return slack, u
