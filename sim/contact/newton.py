"""Newton's step from the planes of one pass to the next: forces turn as points slide along curved parts."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled
from sim.contact.compiled.factors import (
    add_products,
    back_in_place,
    eigen_in_place,
    factor_in_place,
    forth_in_place,
    one_over_inverse,
    solve_in_place,
)
from sim.contact.compiled.skin_compliance import SkinCompliance, moved, worked
from sim.contact.lcp import LcpSolution
from sim.contact.planes import FrozenPlanes

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_LONGEST_MM = 0.1
_FULL_TURN = 1.0  # largest turn of a normal in one step (rad)
_COARSE_FLOOR, _FINE_FLOOR = 0.05, 1e-5


class Onward(NamedTuple):
    """Displacements (m, k) after a fraction of Newton's step, and whether the state before it is unstable."""

    u: Array
    unstable: bool


def predicted(planes: FrozenPlanes, solution: LcpSolution, un: Array, residual: float, share: float) -> Onward | None:
    """Return displacements after a fraction of Newton's step; None where no active point is on a curved part.

    A point that slides by δ has its force turned by λ ∇²h δ. With y the scaled slides, the step solves
    (1 − N S) y = r: N is their compliance while active points stay on their planes, S = 1 where the indentor is
    convex, −1 where concave, r the slides of the pass itself.
    """
    curved = np.flatnonzero(planes.curved & (solution.multipliers > 0))
    if not len(curved):
        return None
    slides = _slides(planes.curvature, solution.multipliers, curved)
    moved_mm = (un - planes.u)[:-1].take(curved, axis=1)
    floor = _COARSE_FLOOR if residual > 1e-3 else _FINE_FLOOR
    step, unstable = _step(planes.region.skin, planes.normal, solution, slides, moved_mm, floor)
    step *= share * _shortened(planes.curvature, planes.slope, step, curved)
    after = un.copy()
    after[:-1, curved] = planes.u[:-1, curved] + step
    return Onward(after, unstable)


class _Slides(NamedTuple):
    """Slides of active points on curved parts along the principal directions of ∇²h, each scaled by √|λ κ|."""

    points: Ints  # (q,) along the first direction, then along the second
    force: Array  # (m, q) of unit amplitude
    concave: Bools  # (q,)


@compiled
def _slides(curvature: Array, multipliers: Array, curved: Ints) -> _Slides:
    m, c = len(curvature), len(curved)
    points, force, concave = np.empty(m * c, np.int64), np.zeros((m + 1, m * c)), np.zeros(m * c, np.bool_)
    for p in range(c):
        bend = curvature[:, :, curved[p]]
        angle = 0.5 * math.atan2(2.0 * bend[0, m - 1], bend[0, 0] - bend[m - 1, m - 1]) if m > 1 else 0.0
        for i in range(m):
            way = (math.cos(angle + 0.5 * math.pi * i), math.sin(angle + 0.5 * math.pi * i))
            kappa = 0.0
            for a in range(m):
                for b in range(m):
                    kappa += way[a] * bend[a, b] * way[b]
            points[i * c + p], concave[i * c + p] = curved[p], kappa < 0.0
            for a in range(m):
                force[a, i * c + p] = way[a] * math.sqrt(multipliers[curved[p]] * abs(kappa))
    return _Slides(points, force, concave)


@compiled
def _step(
    skin: SkinCompliance, normal: Array, solution: LcpSolution, slides: _Slides, moved_mm: Array, floor: float
) -> tuple[Array, bool]:
    """Return (m − 1, c) slides by the full Newton step, and whether the state before it is unstable."""
    active, m, q = solution.active, len(normal) - 1, len(slides.points)
    c = moved_mm.shape[1]
    pressing = np.empty((m + 1, len(active)))
    for i in range(len(active)):
        for a in range(m + 1):
            pressing[a, i] = normal[a, active[i]]
    # (q, active): approach of active points to the indentor by unit slides, then L⁻¹ of it, W = L Lᵀ
    held_back = worked(skin, slides.points, slides.force, active, pressing, len(active))
    forth_in_place(solution.factor, held_back)
    matrix, right = -worked(skin, slides.points, slides.force, slides.points, slides.force, 1), np.zeros(q)
    for s in range(q):
        matrix[s, s] += 1.0
        for a in range(m):
            right[s] += slides.force[a, s] * moved_mm[a, s % c]
    add_products(matrix, held_back)
    turned, unstable = _turned(matrix, right, slides.concave, floor)
    reaction, place = np.zeros(len(active)), np.empty(normal.shape[1], np.int64)
    for s in range(q):
        for i in range(len(active)):
            reaction[i] += turned[s] * held_back[s, i]
    back_in_place(solution.factor, reaction)
    for i in range(len(active)):
        place[active[i]] = i
        for a in range(m + 1):
            pressing[a, i] *= -reaction[i]
    for s in range(q):
        for a in range(m):
            pressing[a, place[slides.points[s]]] += slides.force[a, s] * turned[s]
    u, step = moved(skin, active, pressing), moved_mm.copy()
    for p in range(c):
        for a in range(m):
            step[a, p] += u[a, slides.points[p]]
    return step, unstable


@compiled
def _shortened(curvature: Array, slope: Array, step: Array, curved: Ints) -> Array:
    """Return factors ≤ 1 that keep each step within 0.1 mm and each normal's turn within one radian."""
    factor = np.ones(step.shape)
    m = len(slope)
    for p in range(len(curved)):
        bend, along = 0.0, 1.0
        for a in range(m):
            along += slope[a, curved[p]] ** 2
            for b in range(m):
                bend += curvature[a, b, curved[p]] ** 2
        longest = min(_LONGEST_MM, _FULL_TURN * along / math.sqrt(bend))
        for a in range(m):
            factor[a, p] = min(1.0, longest / max(abs(step[a, p]), 1e-300))
    return factor


@compiled
def _turned(matrix: Array, right: Array, concave: Bools, floor: float) -> tuple[Array, bool]:
    """Return (q,) turning forces S y of (1 − N S) y = r, and whether 1 − N (lower triangle) is indefinite.

    The concave ones are eliminated first: they stiffen, and leave (1 − N') y = r' with N' ≥ 0 over the convex ones.
    """
    stiff, soft = np.flatnonzero(concave), np.flatnonzero(~concave)
    if not len(stiff):
        return _solve_positive(matrix, right, floor)
    lower, known = -_part(matrix, stiff, stiff), right[stiff]
    for i in range(len(stiff)):
        lower[i, i] += 2.0
    factor_in_place(lower)
    cross, left, rest = _part(matrix, soft, stiff), _part(matrix, soft, soft), right[soft]
    forth_in_place(lower, cross)
    forth_in_place(lower, known.reshape(1, -1))
    add_products(left, cross)
    for s in range(len(soft)):
        for i in range(len(stiff)):
            rest[s] += cross[s, i] * known[i]
    convex, unstable = _solve_positive(left, rest, floor)
    force, stiffened = np.empty(len(right)), -known
    for s in range(len(soft)):
        force[soft[s]] = convex[s]
        for i in range(len(stiff)):
            stiffened[i] += cross[s, i] * convex[s]
    back_in_place(lower, stiffened)
    force[stiff] = stiffened
    return force, unstable


@compiled
def _part(matrix: Array, rows: Ints, columns: Ints) -> Array:
    """Return (r, c) entries of a symmetric matrix stored as its lower triangle."""
    found = np.empty((len(rows), len(columns)))
    for r in range(len(rows)):
        for c in range(len(columns)):
            found[r, c] = matrix[max(rows[r], columns[c]), min(rows[r], columns[c])]
    return found


@compiled
def _solve_positive(matrix: Array, right: Array, floor: float) -> tuple[Array, bool]:
    """Return z = M⁻¹ r of the step y + (1 − M) z, and whether M (lower triangle) has a negative eigenvalue.

    r is y, scaled: along an eigenvector z is y / e. Eigenvalues e count as max(|e|, floor), by the coarse floor if
    one
    is negative.
    """
    factor, found = matrix.copy(), right.copy()
    if factor_in_place(factor) and _smallest_exceeds(floor, matrix, factor):
        solve_in_place(factor, found)
        return found, False
    vectors = matrix.copy()
    values = eigen_in_place(vectors)
    unstable = values[0] < 0.0
    least = _COARSE_FLOOR if unstable else floor
    found[:] = 0.0
    for i in range(len(values)):
        along, raised = 0.0, max(abs(values[i]), least)
        for j in range(len(values)):
            along += vectors[i, j] * right[j]
        along *= 1.0 / raised if values[i] >= least else (1.0 - 1.0 / raised) / min(values[i] - 1.0, -1e-3)
        for j in range(len(values)):
            found[j] += vectors[i, j] * along
    return found, unstable


@compiled
def _smallest_exceeds(floor: float, matrix: Array, factor: Array) -> bool:
    """Return whether every eigenvalue exceeds the floor, by a norm estimate or else a factorization."""
    if not len(matrix) or one_over_inverse(factor) > floor:
        return True
    lowered = matrix.copy()
    for i in range(len(matrix)):
        lowered[i, i] -= floor
    return factor_in_place(lowered)
