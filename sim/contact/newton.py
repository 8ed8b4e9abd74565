"""Newton's step from the planes of one pass to those of the next: forces turn as points slide along curved parts."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from sim.contact.lcp import LcpSolution
from sim.contact.planes import FrozenPlanes, among
from sim.contact.points import norm

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_LONGEST_MM = 0.1
_FULL_TURN = 1.0  # rad that a normal may turn in one step
_COARSE_FLOOR, _FINE_FLOOR = 0.05, 1e-5


class Onward(NamedTuple):
    """(m, k) displacements after a share of Newton's step, and whether what was stepped from is unstable."""

    u: Array
    unstable: bool


class _Slides(NamedTuple):
    """Slides of active points on curved parts along the principal directions of ∇²h, each scaled by √|λ κ|."""

    points: Ints  # (c,)
    weights: list[Array]  # m − 1 of (m − 1, c), the scaled directions
    concave: Bools  # ((m − 1) c,)

    def sideways(self, amplitude: Array) -> Array:
        """(m − 1, c) forces or displacements of (q,) amplitudes."""
        return summed(w * a for w, a in zip(self.weights, np.split(amplitude, len(self.weights)), strict=True))

    def amplitude(self, sideways: Array) -> Array:
        """(q,) the slides' shares in (m − 1, c) displacements."""
        return np.concatenate([(w * sideways).sum(axis=0) for w in self.weights])


def predicted(planes: FrozenPlanes, solution: LcpSolution, un: Array, residual: float, share: float) -> Onward | None:
    """Displacements after a share of Newton's step; None where no active point is on a curved part.

    A point that slides by δ has its force turned by λ ∇²h δ. With y the scaled slides, the step solves
    (1 − N S) y = r: N is their compliance while active points stay on their planes, S = 1 where the indentor is
    convex, −1 where concave, r the slides of the pass itself.
    """
    curved = np.flatnonzero(planes.curved & (solution.multipliers > 0))
    if not len(curved):
        return None
    slides = _slides(planes, solution.multipliers, curved)
    by_slide = planes.sideways.take(np.searchsorted(planes.turning, curved), axis=1)
    half = _held_back(planes, solution, by_slide, slides)
    moved = (un - planes.u)[:-1, curved]
    matrix = _one_less_compliance(by_slide, slides)
    matrix = blas.dsyrk(1.0, half, beta=1.0, c=matrix, trans=1, lower=1, overwrite_c=1)
    floor = _COARSE_FLOOR if residual > 1e-3 else _FINE_FLOOR
    turned, unstable = _turned(matrix, slides.amplitude(moved), slides.concave, floor)
    force = np.zeros_like(un)
    force[:-1, curved] = slides.sideways(turned)
    reaction = lapack.dtrtrs(solution.factor, half @ turned, lower=1, trans=1)[0]
    force[:, solution.active] -= planes.normal[:, solution.active] * reaction
    step = moved + np.einsum("bcmk,mk->bc", by_slide, force)
    after = un.copy()
    after[:-1, curved] = planes.u[:-1, curved] + share * step * _shortened(planes, step, curved)
    return Onward(after, unstable)


def summed(terms: Iterable[Array]) -> Array:
    """Their sum, made in the first one's place."""
    first, *others = terms
    for other in others:
        first += other
    return first


def _slides(planes: FrozenPlanes, multipliers: Array, curved: Ints) -> _Slides:
    bend = planes.curvature[:, :, curved]
    if len(bend) == 1:
        kappa, direction = bend[0].T, np.ones((len(curved), 1, 1))
    else:
        kappa, direction = np.linalg.eigh(np.moveaxis(bend, -1, 0))  # (c, i), (c, axis, i)
    scaled = direction * np.sqrt(multipliers[curved, None] * np.abs(kappa))[:, None]
    return _Slides(curved, list(scaled.transpose(2, 1, 0)), (kappa < 0).T.ravel())


def _one_less_compliance(moved: Array, slides: _Slides) -> Array:
    """(q, q) lower triangle of 1 − the compliance of the slides with nothing held, of (m − 1, c, m, k)."""
    lateral, c = range(len(moved)), len(slides.points)
    part = moved.take(slides.points, axis=3)
    matrix = np.empty((len(slides.concave),) * 2, order="F")
    for i, v in enumerate(slides.weights):
        along = [summed(v[a][:, None] * part[a, :, b] for a in lateral) for b in lateral]
        for j, w in enumerate(slides.weights[: i + 1]):
            compliance = summed(block * of_axis for block, of_axis in zip(along, w, strict=True))
            matrix[i * c : (i + 1) * c, j * c : (j + 1) * c] = -compliance
    np.einsum("ii->i", matrix)[:] += 1.0
    return matrix


def _held_back(planes: FrozenPlanes, solution: LcpSolution, moved: Array, slides: _Slides) -> Array:
    """(active, q) L⁻¹ A: A the approach of active points to the indentor by unit slides, W = L Lᵀ."""
    active = solution.active
    approach = np.einsum("bcma,ma->bca", moved.take(active, axis=3), planes.normal[:, active])
    by_slide = [summed(block * w[:, None] for block, w in zip(approach, ws, strict=True)) for ws in slides.weights]
    return np.asarray(blas.dtrsm(1.0, solution.factor, np.concatenate(by_slide).T, lower=1))


def _shortened(planes: FrozenPlanes, step: Array, curved: Ints) -> Array:
    """Factors ≤ 1 that keep each step within 0.1 mm and within what turns the point's normal by a radian."""
    curvature, slope = planes.curvature[:, :, curved], planes.slope[:, curved]
    bend = np.sqrt((curvature**2).sum(axis=(0, 1))) / norm(slope) ** 2  # of the normal, rad/mm
    return np.minimum(1.0, np.minimum(_LONGEST_MM, _FULL_TURN / bend) / np.maximum(np.abs(step), 1e-300))


def _turned(matrix: Array, right: Array, concave: Bools, floor: float) -> tuple[Array, bool]:
    """(q,) turning forces S y of (1 − N S) y = r, given the lower triangle of 1 − N; whether that is indefinite.

    The concave ones are eliminated first: they stiffen, and leave (1 − N') y = r' with N' ≥ 0 over the convex ones.
    """
    if not concave.any():
        return _solve_positive(matrix, right, floor)
    matrix = np.tril(matrix) + np.tril(matrix, -1).T
    stiff, soft = np.flatnonzero(concave), np.flatnonzero(~concave)
    lower = lapack.dpotrf(2 * np.eye(len(stiff)) - among(matrix, stiff, stiff), lower=1, clean=0)[0]
    cross = np.asarray(blas.dtrsm(1.0, lower, among(matrix, stiff, soft), lower=1))
    known = lapack.dtrtrs(lower, right[stiff], lower=1)[0]
    force = np.empty(len(right))
    left = among(matrix, soft, soft) + cross.T @ cross
    force[soft], unstable = _solve_positive(left, right[soft] + cross.T @ known, floor)
    force[stiff] = lapack.dtrtrs(lower, cross @ force[soft] - known, lower=1, trans=1)[0]
    return force, unstable


def _solve_positive(matrix: Array, right: Array, floor: float) -> tuple[Array, bool]:
    """z = M⁻¹ r of the step y + (1 − M) z, given M's lower triangle; r is y, scaled: along an eigenvector z is y / e.

    Eigenvalues e count as max(|e|, floor), by the coarse floor if one is negative: then the second answer is yes.
    """
    if not len(right):
        return right, False
    factor, info = lapack.dpotrf(matrix, lower=1, clean=0)
    if info == 0 and _smallest_exceeds(floor, matrix, factor):
        return np.asarray(lapack.dpotrs(factor, right, lower=1)[0]), False
    values, vectors, _ = lapack.dsyevd(matrix, lower=1)
    unstable = bool(values[0] < 0)
    if unstable:
        floor = _COARSE_FLOOR
    raised = np.maximum(np.abs(values), floor)
    share = np.where(values >= floor, 1 / raised, (1 - 1 / raised) / np.minimum(values - 1, -1e-3))
    return np.asarray(vectors @ ((vectors.T @ right) * share)), unstable


def _smallest_exceeds(floor: float, matrix: Array, factor: Array) -> bool:
    """Whether every eigenvalue does: by an estimate of the inverse's norm, else by a factorisation."""
    if lapack.dpocon(factor, 1.0, uplo="L")[0] > floor:  # 1 / the inverse's 1-norm, no more than the smallest
        return True
    return bool(lapack.dpotrf(matrix - floor * np.eye(len(matrix)), lower=1, clean=0)[1] == 0)
