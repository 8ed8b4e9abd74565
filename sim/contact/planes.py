"""The convex problem of one pass: contact planes frozen at one displacement, and Newton's step to the next."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, lapack, solve_triangular

from sim.contact.lcp import LcpSolution, solve_lcp
from sim.contact.patch import Patch
from sim.contact.points import ContactPoints, Pose, norm

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_LONGEST_MM = 0.1
_FULL_TURN = 1.0  # rad that a normal may turn in one step
_COARSE_FLOOR, _FINE_FLOOR = 0.05, 1e-5
_JITTER = 1e-10


class Region:
    """The part of a patch that takes part: points that may be touched, and the nodes that carry them."""

    def __init__(self, patch: Patch, candidates: ContactPoints) -> None:
        self.segment_numbers = np.unique(candidates.segments)
        ends = patch.segments[self.segment_numbers]
        self.nodes = np.union1d(candidates.nodes, ends.ravel())
        self.segments = np.searchsorted(self.nodes, ends)
        self.points = self.from_patch(candidates)
        self.tangential_mm, self.y = patch.tangential_mm[:, self.nodes], patch.y[self.nodes]
        self.places = self.points.on(self)
        m, j, k = len(patch.axes), len(self.nodes), len(self.points)
        self.compliance = patch.response(self.nodes).take(patch.unknowns(self.nodes), axis=1)
        among_nodes = self.compliance.reshape(m * j, m, j)
        # displacements per unit force at each point along each axis: of the nodes, and of the points themselves
        self.response = self.places.interpolate(among_nodes).reshape(m, j, m, k).transpose(2, 3, 0, 1).copy()
        self.own_response = self.places.interpolate(self.response).transpose(0, 2, 1, 3).copy()  # (m, m, k, k)

    def from_patch(self, points: ContactPoints) -> ContactPoints:
        """Some of the candidates, by the numbers here."""
        segments = np.searchsorted(self.segment_numbers, points.segments)
        return points.renumbered_as(np.searchsorted(self.nodes, points.nodes), segments)

    def to_patch(self, points: ContactPoints) -> ContactPoints:
        """Points here by the patch's numbers."""
        return points.renumbered_as(self.nodes[points.nodes], self.segment_numbers[points.segments])


class FrozenPlanes:
    """The convex problem whose contact planes are tangent to the indentor at one displacement."""

    def __init__(self, pose: Pose, region: Region, u: Array, pressed: bool) -> None:
        self.region, self.u = region, u
        at = u if pressed else np.concatenate([u[:-1], np.zeros_like(u[-1:])])
        moved = region.places.interpolate(at)
        tangential, y = region.places.tangential_mm + moved[:-1], region.places.y + moved[-1]
        planes = pose.plane(tangential, y) if pressed else pose.gap(tangential, y)
        self.slope, self.curvature = planes.slope, planes.curvature
        self.normal = forces_along(self.slope, np.ones(len(region.points)))
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
        return moved_by(self.region.response, self.normal * solution.multipliers)

    def energy(self, solution: LcpSolution, u: Array) -> float:
        """Elastic energy of the displacements u that the multipliers cause."""
        return 0.5 * float((self.normal * solution.multipliers * self.region.places.interpolate(u)).sum())

    def predictor(self, solution: LcpSolution, un: Array, residual: float, share: float) -> Array | None:
        """Displacements after a share of the Newton step (eigenvalues positive) of active points on curved parts."""
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
        carriers, share = self.region.places.carriers
        nodes, place = np.unique(carriers[:, curved], return_inverse=True)
        weights = np.zeros((len(curved), len(nodes)))
        np.add.at(weights, (np.arange(len(curved)), place.reshape(2, -1)), share[:, curved])
        turn = -multipliers[curved] * self.curvature[:, :, curved]
        blocks = (turn[..., None] * weights).swapaxes(-1, -2) @ weights  # (m, m, nodes, nodes)
        slots = (self.u.shape[1] * np.arange(m)[:, None] + nodes).ravel()
        return slots, blocks.swapaxes(1, 2).reshape(m * len(nodes), m * len(nodes))

    def _shortened(self, step: Array, slots: Ints) -> Array:
        """Factors ≤ 1 that keep each step within 0.1 mm and within what turns a node's own normal by a radian."""
        bend = np.sqrt((self.curvature**2).sum(axis=(0, 1))) / norm(self.slope) ** 2  # of the normal, rad/mm
        carriers, share = self.region.places.carriers
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


def forces_along(slope: Array, multipliers: Array) -> Array:
    """(m, k) forces on the skin along (∇h, −1), the vertical last."""
    return np.concatenate([slope * multipliers, -multipliers[None]])


def moved_by(response: Array, force: Array) -> Array:
    """(m, n) displacements in mm from (m, k, m, n) responses and (m, k) forces."""
    m, k = force.shape
    return np.asarray(force.ravel() @ response.reshape(m * k, -1)).reshape(m, -1)
