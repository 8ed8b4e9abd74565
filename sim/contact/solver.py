"""Unilateral frictionless contact of a rigid profile with a condensed elastic patch.

Majorise–minimise with a modified-Newton predictor. Each pass freezes the profile's tangent planes at the
displaced nodes and solves the resulting convex problem exactly; for a convex profile these planes lie inside
the feasible set, so an undamped pass never raises the energy. The predictor removes the slow modes, in which
the nodes slide along a curved flank; it is taken back when the merit function rises.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, lapack, solve_triangular

from sim.contact.indentors import Profile
from sim.contact.lcp import LcpSolution, solve_lcp
from sim.contact.patch import Patch

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TARGET_RESIDUAL = 1e-10
REQUIRED_RESIDUAL = 1e-8
MAX_PASSES = 120

_CANDIDATE_GAP_MM = 0.15
_FIRST_TRUST_MM = 0.1
_FULL_TURN = 1.0  # rad that a normal may turn in one step at full trust
_TRUST_SHRINK, _TRUST_GROWTH = 0.4, 2.0
_COARSE_FLOOR, _FINE_FLOOR = 0.05, 1e-5


@dataclass(frozen=True)
class ContactState:
    """Forces and displacements of the patch in contact; `converged` means residual ≤ 1e-8."""

    multiplier: Array  # (n,) λ ≥ 0, force along (h', −1)
    displacement: Array  # (2, n) mm, x then y
    force: Array  # (2, n) per unit E(epidermis), on the skin, x then y
    gap: Array  # (n,) mm, vertical
    residual: float
    passes: int

    @property
    def converged(self) -> bool:
        """Whether the residual, over all patch nodes, is at most 1e-8."""
        return bool(self.residual <= REQUIRED_RESIDUAL)

    @property
    def active(self) -> NDArray[np.bool_]:
        """(n,) nodes that carry force."""
        return self.multiplier > 0

    @property
    def normal_force(self) -> float:
        """Downward force on the skin per unit E(epidermis)."""
        return float(np.abs(self.force[1]).sum())


@dataclass(frozen=True)
class Pose:
    """Where the profile is: its reference x, the height of its lowest point and the length that scales errors."""

    profile: Profile
    x_mm: float
    height_mm: float
    scale_mm: float  # D = max(DOI, 1 µm)

    def gap(self, patch: Patch, ux: Array, uy: Array, nodes: Ints | slice) -> tuple[Array, Array, Array]:
        """Vertical gap (mm), slope and curvature of the profile at displaced nodes."""
        h, slope, curvature = self.profile.evaluate(patch.x[nodes] + ux - self.x_mm)
        return self.height_mm + h - patch.y[nodes] - uy, slope, curvature

    def tangent(self, patch: Patch, ux: Array, uy: Array, nodes: Ints) -> tuple[Array, Array, Array]:
        """Gap (mm) a node at (x + ux, y) would have to the profile's tangent nearest to (x + ux, y + uy)."""
        s = patch.x[nodes] + ux - self.x_mm
        h, slope, curvature = self.profile.tangent(s, patch.y[nodes] + uy - self.height_mm)
        return self.height_mm + h - patch.y[nodes], slope, curvature


def solve_contact(patch: Patch, pose: Pose, start: ContactState | None = None) -> ContactState:
    """Equilibrium of the patch under a rigid profile held in a pose, from rest or from a nearby state."""
    n = len(patch)
    ux, uy = (np.zeros(n), None) if start is None else start.displacement
    held = np.zeros(n, dtype=bool) if start is None else start.active
    near = pose.gap(patch, ux, np.zeros(n) if uy is None else uy, slice(None))[0] < _CANDIDATE_GAP_MM
    near |= held
    passes = 0
    while True:
        nodes = np.flatnonzero(near)
        if not len(nodes):
            return _state(patch, pose, nodes, np.zeros(0), np.zeros(0), passes)
        iteration = _Iteration(patch, pose, nodes, ux[nodes], None if uy is None else uy[nodes], held[nodes])
        iteration.run()
        passes += iteration.passes
        state = _state(patch, pose, nodes, iteration.multiplier, iteration.slope, passes)
        missed = ~near & (state.gap < 0)
        if not missed.any() or passes >= MAX_PASSES:
            return state
        (ux, uy), held = state.displacement, state.active
        near |= state.gap < _CANDIDATE_GAP_MM


class _Iteration:
    """The passes over one fixed set of candidate nodes."""

    def __init__(
        self,
        patch: Patch,
        pose: Pose,
        nodes: Ints,
        ux: Array,
        uy: Array | None,  # None at rest: first press down, lest a side wall claims a node from below
        held: NDArray[np.bool_],
    ) -> None:
        self.patch, self.pose, self.nodes = patch, pose, nodes
        k = self.k = len(nodes)
        both = np.concatenate([nodes, nodes + len(patch)])
        self.c = patch.compliance[both].take(both, axis=1)
        self.xx, self.xy, self.yy = self.c[:k, :k], self.c[:k, k:], self.c[k:, k:]
        self.ux = ux.copy()
        self.uy = uy
        self.held = held
        self.multiplier = np.zeros(k)
        self.slope = np.zeros(k)
        self.passes = 0

    def run(self) -> None:
        """Passes until the residual meets the target, keeping the best state seen."""
        trust, penalty, best = _FIRST_TRUST_MM, 0.0, np.inf
        merit, fallback = np.inf, None
        while self.passes < MAX_PASSES:
            self.passes += 1
            gap, slope, curvature = self._planes()
            solution = self._frozen_normals(gap, slope)
            if solution is None:
                if fallback is None:
                    return
                self.ux, fallback = fallback, None
                continue
            un = self.c @ _forces(slope, solution.multipliers)
            residual = self._residual(un, solution.multipliers)
            if residual < best:
                best, self.multiplier, self.slope = residual, solution.multipliers, slope
            if residual < TARGET_RESIDUAL:
                return
            penalty = max(penalty, 2 * float(solution.multipliers.max(initial=0.0)))
            new_merit = self._merit(un, solution.multipliers, slope, penalty)
            if fallback is not None and new_merit > merit:
                trust *= _TRUST_SHRINK
                self.ux, fallback = fallback, None
                continue
            if fallback is not None:
                trust = min(_TRUST_GROWTH * trust, _FIRST_TRUST_MM)
            merit = new_merit
            self.held = solution.multipliers > 0
            step = self._predictor(solution, slope, curvature, un, residual)
            plain, before = un[: self.k], self.ux
            self.uy = un[self.k :]
            self.ux, fallback = plain.copy(), None
            if step is not None:
                sliding, ds = step
                turn = np.abs(curvature[sliding]) / (1 + slope[sliding] ** 2)  # of the normal, rad/mm
                longest = trust * np.minimum(1.0, _FULL_TURN / (_FIRST_TRUST_MM * turn))
                self.ux[sliding] = before[sliding] + np.clip(ds, -longest, longest)
                fallback = plain

    def _planes(self) -> tuple[Array, Array, Array]:
        """Height of the tangent plane over each undisplaced node, its slope and the profile's curvature."""
        if self.uy is None:
            return self.pose.gap(self.patch, self.ux, np.zeros(self.k), self.nodes)
        return self.pose.tangent(self.patch, self.ux, self.uy, self.nodes)

    def _frozen_normals(self, gap: Array, slope: Array) -> LcpSolution | None:
        """Exact solution of the convex problem whose contact planes are tangent at the present ux."""
        q = gap - slope * self.ux

        def submatrix(index: Ints) -> Array:
            n = slope[index]
            block = np.ix_(index, index)
            coupling = n[:, None] * self.xy[block]
            return np.asfortranarray((n[:, None] * n) * self.xx[block] - coupling - coupling.T + self.yy[block])

        def apply(multipliers: Array) -> Array:
            u = self.c @ _forces(slope, multipliers)
            return slope * u[: self.k] - u[self.k :]

        start = self.held if self.held.any() else q < 0
        return solve_lcp(q, submatrix, apply, start)

    def _residual(self, u: Array, multipliers: Array) -> float:
        k = self.k
        gap, slope, _ = self.pose.gap(self.patch, u[:k], u[k:], self.nodes)
        mismatch = self.c @ _forces(slope, multipliers) - u
        return _residual(mismatch, gap, slope, multipliers, self.pose.scale_mm)

    def _merit(self, u: Array, multipliers: Array, slope: Array, penalty: float) -> float:
        gap, at_u, _ = self.pose.gap(self.patch, u[: self.k], u[self.k :], self.nodes)
        depth = np.maximum(0.0, -gap) / np.sqrt(1 + at_u**2)
        energy = 0.5 * float(_forces(slope, multipliers) @ u)
        return energy + penalty * float(depth.sum())

    def _predictor(
        self, solution: LcpSolution, slope: Array, curvature: Array, un: Array, residual: float
    ) -> tuple[Ints, Array] | None:
        """Extra lateral slip (mm) of the active nodes on curved parts, by Newton with positive eigenvalues."""
        active = solution.active
        sliding = active[(curvature[active] != 0) & (solution.multipliers[active] > 0)]
        if not len(sliding):
            return None
        r = slope[active, None] * self.xx[np.ix_(active, sliding)] - self.xy[np.ix_(sliding, active)].T
        half = solve_triangular(solution.factor, r, lower=True, check_finite=False)
        lower, info = lapack.dpotrf(self.xx[np.ix_(sliding, sliding)] - half.T @ half, lower=1, clean=1)
        if info:
            return None
        weight = solution.multipliers[sliding] * curvature[sliding]
        stiffness = np.eye(len(sliding)) - lower.T @ (weight[:, None] * lower)
        target = solve_triangular(lower, (un[: self.k] - self.ux)[sliding], lower=True, check_finite=False)
        floor = _COARSE_FLOOR if residual > 1e-3 else _FINE_FLOOR
        return sliding, lower @ _solve_positive(stiffness, target, floor)


def _solve_positive(matrix: Array, right: Array, floor: float) -> Array:
    """matrix⁻¹ right with each eigenvalue e replaced by max(|e|, floor), floor coarse if one is negative."""
    shifted = matrix - floor * np.eye(len(matrix))
    if lapack.dpotrf(shifted, lower=1, clean=0)[1] == 0:
        return np.asarray(lapack.dposv(matrix, right, lower=1)[1])
    values, vectors = eigh(matrix, check_finite=False, driver="evd")
    if values[0] < 0:
        floor = _COARSE_FLOOR
    return np.asarray(vectors @ ((vectors.T @ right) / np.maximum(np.abs(values), floor)))


def _forces(slope: Array, multipliers: Array) -> Array:
    """(2k,) nodal forces on the skin, x then y, along (h', −1)."""
    return np.concatenate([slope * multipliers, -multipliers])


def _residual(mismatch: Array, gap: Array, slope: Array, multipliers: Array, scale_mm: float) -> float:
    """Largest of mismatch of u, penetration, complementarity and tension, as ratios."""
    norm = np.sqrt(1 + slope**2)
    push = multipliers * norm
    peak = float(push.max(initial=0.0))
    push = push / peak if peak > 0 else push
    opening = gap / (norm * scale_mm)
    complementarity = np.abs(np.minimum(push, opening))
    return float(
        max(
            np.abs(mismatch).max(initial=0.0) / scale_mm,
            complementarity.max(initial=0.0),
            -push.min(initial=0.0),
        )
    )


def _state(patch: Patch, pose: Pose, nodes: Ints, multiplier: Array, slope: Array, passes: int) -> ContactState:
    """The whole patch's state and its residual, from the forces on the candidate nodes."""
    n = len(patch)
    active = multiplier > 0
    at = nodes[active]
    push = _forces(slope[active], multiplier[active]).reshape(2, -1)
    u = patch.displacement(push, at).reshape(2, n)
    full = np.zeros(n)
    full[at] = multiplier[active]
    gap, final_slope, _ = pose.gap(patch, u[0], u[1], slice(None))
    again = patch.displacement(_forces(final_slope[at], full[at]).reshape(2, -1), at)
    residual = _residual(again - u.ravel(), gap, final_slope, full, pose.scale_mm)
    force = np.zeros((2, n))
    force[:, at] = push
    return ContactState(full, u, force, gap, residual, passes)
