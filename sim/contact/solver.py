"""Unilateral frictionless contact of a rigid indentor with a condensed elastic patch.

Majorise–minimise with a modified-Newton predictor. Each pass freezes the indentor's tangent planes at the
displaced points and solves the resulting convex problem exactly; for a convex shape these planes lie inside
the feasible set, so an undamped pass never raises the energy. The predictor removes the slow modes, in which
nodes slide along a curved flank; when the merit function rises it is taken back, and a smaller share of it is tried.

Contact is enforced at the nodes and, where asked, at points between them: under a corner sharper than the mesh.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Surface
from sim.contact.newton import predicted
from sim.contact.patch import Patch
from sim.contact.planes import FrozenPlanes, Region, forces_along
from sim.contact.points import ContactPoints, Pose, displaced_gap, near, norm, penetrated

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

TARGET_RESIDUAL = 1e-10
REQUIRED_RESIDUAL = 1e-8
MAX_PASSES = 120

_CANDIDATE_GAP_MM = 0.03
_SHARE_SHRINK, _SHARE_GROWTH = 0.4, 2.0
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
    patch: Patch,
    pose: Pose,
    start: ContactState | None = None,
    *,
    between_nodes: bool,
    target: float = TARGET_RESIDUAL,
) -> ContactState:
    """Equilibrium of the patch under a rigid indentor held in a pose, from rest or from a nearby state.

    Contact is enforced at the nodes, and with `between_nodes` also at points between them. Passes end at the target.
    """
    if start is None:
        nothing = np.zeros((len(patch.axes), len(patch)))
        start = ContactState(ContactPoints.none(), np.zeros(0), nothing, nothing, np.zeros(0), np.inf, 0)
    state, passes = start, 0
    candidates = near(pose, patch, start.displacement, _CANDIDATE_GAP_MM, between=between_nodes).joined(start.held)
    while True:
        iteration = _Iteration(pose, Region(patch, candidates), state, MAX_PASSES - passes, target)
        iteration.run()
        passes += iteration.passes
        state, missed = _assessed(pose, patch, between_nodes, iteration, passes)
        if passes >= MAX_PASSES or missed.among(candidates).all():
            return state
        candidates = candidates.joined(missed)
        candidates = candidates.joined(
            near(pose, patch, state.displacement, _CANDIDATE_GAP_MM, between=between_nodes)
        )


class _Iteration:
    """The passes over one region."""

    def __init__(self, pose: Pose, region: Region, start: ContactState, most_passes: int, target: float) -> None:
        self.pose, self.region, self.most_passes, self.target = pose, region, most_passes, target
        self.u = region.places.interpolate(start.displacement)  # of the points
        self.held = region.points.among(start.held)
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
            planes = FrozenPlanes(self.pose, self.region, self.u, self.pressed)
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
            if residual < self.target:
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
            onward = predicted(planes, solution, un, residual, share)
            self.u, self.pressed, fallback = un, True, None
            if onward is not None:
                self.u, fallback = onward, un

    def _residual(self, u: Array, multipliers: Array) -> tuple[float, float]:
        """The residual over the region's points, and the sum of their depths (mm) within the indentor."""
        here = self.pose.gap(*self.region.moved_to(u))
        mismatch = self.region.moved_by(forces_along(here.slope, multipliers)) - u
        depth = np.maximum(0.0, -here.height_mm) / norm(here.slope)
        return _residual(mismatch, here, multipliers, self.pose.scale_mm), float(depth.sum())


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
    places = region.places
    pushing = forces_along(iteration.slope, multiplier)
    force = places.to_nodes(pushing)
    here = pose.gap(*region.moved_to(region.moved_by(pushing)))
    turned = places.to_nodes(forces_along(here.slope, multiplier))
    u, again = patch.displaced(np.stack([force, turned]))
    here = displaced_gap(pose, places, u)
    missed, depth = penetrated(pose, patch, u, between=between_nodes)
    residual = _residual(again - u, here, multiplier, pose.scale_mm)
    residual = max(residual, float(depth.max(initial=0.0)) / pose.scale_mm)
    gap = pose.gap(patch.tangential_mm + u[:-1], patch.y + u[-1]).height_mm
    return ContactState(region.points, multiplier, u, force, gap, residual, passes), missed
