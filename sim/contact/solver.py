"""Unilateral frictionless contact of a rigid indentor with a condensed elastic patch.

Majorise–minimise with a modified-Newton predictor. Each pass freezes the indentor's tangent planes at the
displaced points and solves the resulting convex problem exactly; for a convex shape these planes lie inside
the feasible set, so an undamped pass never raises the energy. The predictor removes the slow modes, in which
nodes slide along a curved flank; it is taken back when the merit function rises.

Contact is enforced at the nodes and, where asked, at points between them: under a corner sharper than the mesh.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, lapack, solve_triangular

from sim.contact.indentor import Surface
from sim.contact.lcp import LcpSolution, solve_lcp
from sim.contact.patch import Patch
from sim.contact.points import ContactPoints, Pose, displaced_gap, near, norm, penetrated

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

TARGET_RESIDUAL = 1e-10
REQUIRED_RESIDUAL = 1e-8
MAX_PASSES = 120

_CANDIDATE_GAP_MM = 0.03
_LONGEST_MM = 0.1
_FULL_TURN = 1.0  # rad that a normal may turn in one step
_SHARE_SHRINK, _SHARE_GROWTH = 0.4, 2.0
_COARSE_FLOOR, _FINE_FLOOR = 0.05, 1e-5
_JITTER = 1e-10
_MERIT_ROUND_OFF = 1e-14


@dataclass(frozen=True)
class ContactState:
    """Forces and displacements of the patch in contact; `converged` means residual ≤ 1e-8."""

    points: ContactPoints
    multiplier: Array  # (k,) λ ≥ 0 at the points, force along (∇h, −1)
    displacement: Array  # (m, n) mm along the patch's axes, the last one vertical
    force: Array  # (m, n) per unit E(epidermis), on the skin
    gap: Array  # (n,) mm, vertical
    residual: float
    passes: int

    @property
    def converged(self) -> bool:
        """Whether the residual, over all places where contact is enforced, is at most 1e-8."""
        return bool(self.residual <= REQUIRED_RESIDUAL)

    @property
    def held(self) -> ContactPoints:
        """The points that carry force."""
        return self.points.chosen(self.multiplier > 0)

    @property
    def active(self) -> Bools:
        """(n,) nodes that carry force."""
        return self.force[-1] != 0

    @property
    def normal_force(self) -> float:
        """Downward force on the skin per unit E(epidermis)."""
        return float(np.abs(self.force[-1]).sum())


def solve_contact(
    patch: Patch, pose: Pose, start: ContactState | None = None, *, between_nodes: bool
) -> ContactState:
    """Equilibrium of the patch under a rigid indentor held in a pose, from rest or from a nearby state.

    Contact is enforced at the nodes, and with `between_nodes` also at points between them.
    """
    if start is None:
        nothing = np.zeros((len(patch.axes), len(patch)))
        start = ContactState(ContactPoints.none(), np.zeros(0), nothing, nothing, np.zeros(0), np.inf, 0)
    state, passes = start, 0
    candidates = near(pose, patch, start.displacement, _CANDIDATE_GAP_MM, between=between_nodes).joined(start.held)
    while True:
        iteration = _Iteration(pose, _Region(patch, candidates), state, MAX_PASSES - passes)
        iteration.run()
        passes += iteration.passes
        state, missed = _assessed(pose, patch, between_nodes, iteration, passes)
        if passes >= MAX_PASSES or missed.among(candidates).all():
            return state
        candidates = candidates.joined(missed)
        candidates = candidates.joined(
            near(pose, patch, state.displacement, _CANDIDATE_GAP_MM, between=between_nodes)
        )


class _Region:
    """The part of a patch that takes part: points that may be touched, and the nodes that carry them."""

    def __init__(self, patch: Patch, candidates: ContactPoints) -> None:
        self.segment_numbers = np.unique(candidates.segments)
        ends = patch.segments[self.segment_numbers]
        self.nodes = np.union1d(candidates.nodes, ends.ravel())
        self.segments = np.searchsorted(self.nodes, ends)
        self.points = self.from_patch(candidates)
        self.tangential_mm, self.y = patch.tangential_mm[:, self.nodes], patch.y[self.nodes]
        m, j, k = len(patch.axes), len(self.nodes), len(self.points)
        rows = (len(patch) * np.arange(m)[:, None] + self.nodes).ravel()
        self.compliance = patch.compliance[rows].take(rows, axis=1)
        among_nodes = self.compliance.reshape(m * j, m, j)
        # displacements per unit force at each point along each axis: of the nodes, and of the points themselves
        self.response = self.points.interpolate(self, among_nodes).reshape(m, j, m, k).transpose(2, 3, 0, 1).copy()
        self.own_response = self.points.interpolate(self, self.response).transpose(0, 2, 1, 3).copy()  # (m, m, k, k)

    def from_patch(self, points: ContactPoints) -> ContactPoints:
        """A patch's points by the numbers here."""
        nodes = np.zeros(int(max(self.nodes.max(initial=-1), points.nodes.max(initial=-1))) + 1, dtype=np.int64)
        nodes[self.nodes] = np.arange(len(self.nodes))
        last = int(max(self.segment_numbers.max(initial=-1), points.segments.max(initial=-1)))
        segments = np.zeros(last + 1, dtype=np.int64)
        segments[self.segment_numbers] = np.arange(len(self.segment_numbers))
        return points.renumbered(nodes, segments)


class _Iteration:
    """The passes over one region."""

    def __init__(self, pose: Pose, region: _Region, start: ContactState, most_passes: int) -> None:
        self.pose, self.region, self.most_passes = pose, region, most_passes
        self.u = start.displacement[:, region.nodes].copy()
        self.held = region.points.among(region.from_patch(start.held))
        # From rest no plane closest to a point is taken: first press down, lest a side wall claims it from below.
        self.pressed = bool(self.held.any())
        self.multiplier = np.zeros(len(region.points))
        self.slope = np.zeros((len(self.u) - 1, len(region.points)))
        self.passes = 0

    def run(self) -> None:
        """Passes until the residual meets the target, keeping the best state seen."""
        share, penalty, best = 1.0, 0.0, np.inf
        merit, fallback = np.inf, None
        while self.passes < self.most_passes and len(self.held):
            self.passes += 1
            planes = _FrozenPlanes(self.pose, self.region, self.u, self.pressed)
            solution = planes.solve(self.held)
            if solution is None:
                if fallback is None:
                    return
                self.u, fallback = fallback, None
                continue
            un = planes.displacement(solution)
            residual, depth = self._residual(un, solution.multipliers)
            if residual < best:
                best, self.multiplier, self.slope = residual, solution.multipliers, planes.slope
            if residual < TARGET_RESIDUAL:
                return
            penalty = max(penalty, 2 * float(solution.multipliers.max(initial=0.0)))
            new_merit = planes.energy(solution, un) + penalty * depth
            if fallback is not None and new_merit > (1 + _MERIT_ROUND_OFF) * merit:
                share *= _SHARE_SHRINK
                self.u, fallback = fallback, None
                continue
            if fallback is not None:
                share = min(_SHARE_GROWTH * share, 1.0)
            merit = new_merit
            self.held = solution.multipliers > 0
            predicted = planes.predictor(solution, un, residual, share)
            self.u, self.pressed, fallback = un, True, None
            if predicted is not None:
                self.u, fallback = predicted, un

    def _residual(self, u: Array, multipliers: Array) -> tuple[float, float]:
        """The residual over the region's points, and the sum of their depths (mm) within the indentor."""
        here = displaced_gap(self.pose, self.region, u, self.region.points)
        mismatch = _moved(self.region.response, _forces(here.slope, multipliers)) - u
        depth = np.maximum(0.0, -here.height_mm) / norm(here.slope)
        return _residual(mismatch, here, multipliers, self.pose.scale_mm), float(depth.sum())


class _FrozenPlanes:
    """The convex problem whose contact planes are tangent to the indentor at one displacement."""

    def __init__(self, pose: Pose, region: _Region, u: Array, pressed: bool) -> None:
        self.region, self.u = region, u
        at = u if pressed else np.concatenate([u[:-1], np.zeros_like(u[-1:])])
        moved = region.points.interpolate(region, at)
        tangential = region.points.interpolate(region, region.tangential_mm) + moved[:-1]
        y = region.points.interpolate(region, region.y) + moved[-1]
        planes = pose.plane(tangential, y) if pressed else pose.gap(tangential, y)
        self.slope, self.curvature = planes.slope, planes.curvature
        self.normal = _forces(self.slope, np.ones(len(region.points)))
        self.gap_mm = planes.height_mm - (self.normal * moved).sum(axis=0)

    def solve(self, held: Bools) -> LcpSolution | None:
        """Multipliers λ ≥ 0 with gap + Wλ ≥ 0 complementary to them."""
        entered = (self.gap_mm < 0) & (np.arange(len(held)) < len(self.region.points.nodes))
        return solve_lcp(self.gap_mm, self._compliance(), held if held.any() else entered)

    def _compliance(self) -> Array:
        """(k, k) motion of the points along their normals per unit multiplier."""
        c, vertical = self.region.own_response, len(self.slope)
        w = c[vertical, vertical].copy()
        for a, slope in enumerate(self.slope):
            mixed = slope[:, None] * c[a, vertical]
            w -= mixed
            w -= mixed.T
            for b, other in enumerate(self.slope):
                w += slope[:, None] * c[a, b] * other
        return w

    def displacement(self, solution: LcpSolution) -> Array:
        """(m, n) displacements in mm."""
        return _moved(self.region.response, self.normal * solution.multipliers)

    def energy(self, solution: LcpSolution, u: Array) -> float:
        """Elastic energy of the displacements u that the multipliers cause."""
        return 0.5 * float(
            (self.normal * solution.multipliers * self.region.points.interpolate(self.region, u)).sum()
        )

    def predictor(self, solution: LcpSolution, un: Array, residual: float, share: float) -> Array | None:
        """Displacements after a share of the Newton step (positive eigenvalues) of the active points on curved parts."""
        curved = (self.curvature != 0).any(axis=(0, 1)) & (solution.multipliers > 0)
        if not curved.any():
            return None
        slots, bending = self._bending(solution.multipliers, np.flatnonzero(curved))
        active = solution.active
        per_axis = self.region.response[:, active].reshape(len(un), len(active), -1)[:, :, slots]
        along = np.einsum("ak,aks->ks", self.normal[:, active], per_axis)
        half = solve_triangular(solution.factor, along, lower=True, check_finite=False)
        free = self.region.compliance[np.ix_(slots, slots)] - half.T @ half
        free[np.diag_indices_from(free)] *= 1 + _JITTER
        lower, info = lapack.dpotrf(free, lower=1, clean=1)
        if info:
            return None
        move = (un - self.u).ravel()[slots]
        floor = _COARSE_FLOOR if residual > 1e-3 else _FINE_FLOOR
        turned = lower.T @ bending
        step = move - lower @ _solve_positive(np.eye(len(slots)) + turned @ lower, turned @ move, floor)
        predicted = un.copy()
        predicted.ravel()[slots] = self.u.ravel()[slots] + share * step * self._shortened(step, slots)
        return predicted

    def _bending(self, multipliers: Array, curved: Ints) -> tuple[Ints, Array]:
        """Lateral displacements in which planes turn, and the stiffness that gives: −λ ∇²h, (slots, slots)."""
        m = len(self.slope)
        carriers, share = self.region.points.carriers(self.region)
        nodes, place = np.unique(carriers[:, curved], return_inverse=True)
        weights = np.zeros((len(curved), len(nodes)))
        np.add.at(weights, (np.arange(len(curved)), place.reshape(2, -1)), share[:, curved])
        turn = -multipliers[curved] * self.curvature[:, :, curved]
        blocks = np.einsum("stk,ki,kj->sitj", turn, weights, weights, optimize=True)
        slots = (self.u.shape[1] * np.arange(m)[:, None] + nodes).ravel()
        return slots, blocks.reshape(m * len(nodes), m * len(nodes))

    def _shortened(self, step: Array, slots: Ints) -> Array:
        """Factors ≤ 1 that keep each step within 0.1 mm and within what turns a node's own normal by a radian."""
        bend = np.sqrt((self.curvature**2).sum(axis=(0, 1))) / norm(self.slope) ** 2  # of the normal, rad/mm
        carriers, share = self.region.points.carriers(self.region)
        turn = np.zeros(self.u.shape[1])
        np.maximum.at(turn, carriers, share * bend)
        turn = np.tile(turn, len(self.slope))[slots]
        longest = np.minimum(_LONGEST_MM, _FULL_TURN / np.maximum(turn, 1e-300))
        return np.minimum(1.0, longest / np.maximum(np.abs(step), 1e-300))


def _solve_positive(matrix: Array, right: Array, floor: float) -> Array:
    """z = M⁻¹ r of the Newton step y − Lz; eigenvalues e of M count as max(|e|, floor), coarse if one is negative.

    r = (M − 1) L⁻¹ y, so that along an eigenvector the step is y / e.
    """
    shifted = matrix - floor * np.eye(len(matrix))
    if lapack.dpotrf(shifted, lower=1, clean=0)[1] == 0:
        return np.asarray(lapack.dposv(matrix, right, lower=1)[1])
    values, vectors = eigh(matrix, check_finite=False, driver="evd")
    if values[0] < 0:
        floor = _COARSE_FLOOR
    raised = np.maximum(np.abs(values), floor)
    share = np.where(values >= floor, 1 / raised, (1 - 1 / raised) / np.minimum(values - 1, -1e-3))
    return np.asarray(vectors @ ((vectors.T @ right) * share))


def _forces(slope: Array, multipliers: Array) -> Array:
    """(m, k) forces on the skin along (∇h, −1), the vertical last."""
    return np.concatenate([slope * multipliers, -multipliers[None]])


def _moved(response: Array, force: Array) -> Array:
    """(m, n) displacements in mm from (m, k, m, n) responses and (m, k) forces."""
    loaded = np.flatnonzero(force[-1])
    return np.tensordot(force[:, loaded], response[:, loaded], 2)


def _residual(mismatch: Array, here: Surface, multipliers: Array, scale_mm: float) -> float:
    """Largest of mismatch of u, penetration, complementarity and tension, as ratios."""
    along = norm(here.slope)
    push = multipliers * along
    peak = float(push.max(initial=0.0))
    push = push / peak if peak > 0 else push
    complementarity = np.abs(np.minimum(push, here.height_mm / (along * scale_mm)))
    mismatch_ratio = float(np.abs(mismatch).max(initial=0.0)) / scale_mm
    return float(max(mismatch_ratio, complementarity.max(initial=0.0), -push.min(initial=0.0)))


def _assessed(
    pose: Pose, patch: Patch, between_nodes: bool, iteration: _Iteration, passes: int
) -> tuple[ContactState, ContactPoints]:
    """The whole patch under the forces found in a region, its residual, and the points that it penetrates."""
    region, multiplier = iteration.region, iteration.multiplier
    points = region.points.renumbered(region.nodes, region.segment_numbers)
    force = points.to_nodes(patch, _forces(iteration.slope, multiplier))
    u = _displacement(patch, force)
    here = displaced_gap(pose, patch, u, points)
    again = _displacement(patch, points.to_nodes(patch, _forces(here.slope, multiplier)))
    missed, depth = penetrated(pose, patch, u, between=between_nodes)
    residual = _residual(again - u, here, multiplier, pose.scale_mm)
    residual = max(residual, float(depth.max(initial=0.0)) / pose.scale_mm)
    gap = pose.gap(patch.tangential_mm + u[:-1], patch.y + u[-1]).height_mm
    return ContactState(points, multiplier, u, force, gap, residual, passes), missed


def _displacement(patch: Patch, force: Array) -> Array:
    loaded = np.flatnonzero((force != 0).any(axis=0))
    return patch.displacement(force[:, loaded], loaded)
