"""Unilateral frictionless contact of a rigid indentor with a condensed elastic patch.

Majorize–minimize with a modified-Newton predictor. Each pass freezes the indentor's tangent planes at the
displaced points and solves the resulting convex problem exactly; for a convex shape these planes lie inside
the feasible set, so an undamped pass never raises the energy. The predictor removes the slow modes, in which
nodes slide along a curved flank; when the merit function rises, the solver reverts it and tries a smaller fraction.
Contact is enforced at the nodes and, on request, at points between them: under a corner sharper than the mesh.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim.contact.compiled.planes_and_residual import missed
from sim.contact.compiled.skin_compliance import displaced, moved_by_turns
from sim.contact.newton import predicted
from sim.contact.patch import Patch
from sim.contact.planes import ContactRegion, FrozenPlanes, Gathered, forces_along
from sim.contact.points import ContactPoints, ContactPose, Survey, displaced_gap

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
    """Forces and displacements of the patch in contact."""

    points: ContactPoints
    multiplier: Array  # (k,) λ ≥ 0 at the points, force along (∇h, −1)
    displacement: Array  # (m, n) mm along the patch's axes, the last one vertical
    force: Array  # (m, n) per unit E(epidermis), on the skin
    gap: Array  # (n,) mm, vertical
    residual: float
    passes: int
    snapped: bool = (
        False  # whether an intermediate equilibrium was unstable, so that the result may depend on the steps
    )

    @property
    def converged(self) -> bool:
        """Whether the residual, over all points where contact is enforced, is at most 1e-8."""
        return bool(self.residual <= REQUIRED_RESIDUAL)

    @property
    def held(self) -> ContactPoints:
        """Points that carry force."""
        return self.points.chosen(self.multiplier > 0)

    @property
    def active(self) -> Bools:
        """(n,) mask of nodes that carry force."""
        return self.force[-1] != 0

    @property
    def normal_force(self) -> float:
        """Downward force on the skin per unit E(epidermis)."""
        return float(np.abs(self.force[-1]).sum())


@dataclass(frozen=True)
class PassedState(ContactState):
    """Intermediate state towards a deeper one; its residual covers only the points of the region, and penetration."""

    survey: Survey = field(kw_only=True)


def solve_contact(
    patch: Patch,
    pose: ContactPose,
    start: ContactState | None = None,
    *,
    between_nodes: bool,
    target: float = TARGET_RESIDUAL,
    gathered: Gathered | None = None,
    on_the_way: bool = False,
) -> ContactState:
    """Solve for equilibrium of the patch under a rigid indentor in a pose, from rest or from a nearby state.

    Contact is enforced at the nodes, and with `between_nodes` also at points between them. Passes end at the target
    residual. `gathered` can be reused for other poses. With `on_the_way` the residual of the whole patch is not
    computed.
    """
    gathered = Gathered(patch) if gathered is None else gathered
    state = _at_rest(patch) if start is None else start
    if isinstance(state, PassedState):
        survey = state.survey
    else:
        survey = Survey.of(pose, patch, state.displacement, between=between_nodes)
    candidates, passes = survey.near(pose, _CANDIDATE_GAP_MM).joined(state.held), 0
    snapped = False
    while True:
        iteration = _Iteration(pose, ContactRegion(gathered, candidates), state, MAX_PASSES - passes, target)
        iteration.run()
        passes, snapped = passes + iteration.passes, snapped or iteration.snapped
        state, survey = (_passed if on_the_way else _assessed)(patch, between_nodes, iteration, passes)
        missed, _ = survey.penetrated
        if passes >= MAX_PASSES or missed.among(candidates).all():
            return replace(state, snapped=snapped)
        candidates = candidates.joined(missed).joined(survey.near(pose, _CANDIDATE_GAP_MM))


def _at_rest(patch: Patch) -> ContactState:
    nothing = np.zeros((len(patch.axes), len(patch)))
    return ContactState(ContactPoints.none(), np.zeros(0), nothing, nothing, np.zeros(0), np.inf, 0)


class _Iteration:
    """Passes over one region."""

    def __init__(
        self, pose: ContactPose, region: ContactRegion, start: ContactState, most_passes: int, target: float
    ) -> None:
        self.pose, self.region, self.most_passes, self.target = pose, region, most_passes, target
        self.u = region.places.interpolate(start.displacement)  # of the points
        self.held = region.points.among(start.held)
        # From rest, press down before choosing closest planes: a side wall could claim a point from below.
        self.pressed = bool(self.held.any())
        self.multiplier = np.zeros(len(region.points))
        self.slope = np.zeros((len(self.u) - 1, len(region.points)))
        self.passes, self.residual = 0, np.inf
        self.snapped = False

    def run(self) -> None:
        """Iterate until the residual reaches the target, storing the best state."""
        share, penalty, merit = 1.0, 0.0, np.inf
        fallback = None
        while self.passes < self.most_passes and len(self.held):
            self.passes += 1
            planes = FrozenPlanes(self.pose, self.region, self.u, self.pressed)
            solution = planes.solve(self.held)
            if solution is None:
                if fallback is None:
                    return
                self.u, fallback = fallback, None
                continue
            un = solution.u
            residual, depth = self._residual(un, solution.multipliers, planes.slope)
            if residual < self.residual:
                self.residual, self.multiplier, self.slope = residual, solution.multipliers, planes.slope
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
                self.u, fallback = onward.u, un
                self.snapped |= onward.unstable

    def _residual(self, u: Array, multipliers: Array, slope: Array) -> tuple[float, float]:
        """Return the residual over the region's points and the sum of their depths (mm)."""
        here = self.pose.gap(*self.region.moved_to(u))
        mismatch = moved_by_turns(self.region.skin, here.slope - slope, multipliers)
        return missed(mismatch, here.height_mm, here.slope, multipliers, self.pose.scale_mm)


def _passed(patch: Patch, between_nodes: bool, iteration: "_Iteration", passes: int) -> tuple[ContactState, Survey]:
    """Return the whole patch under the forces found in a region, without its residual outside the region."""
    region, pose = iteration.region, iteration.pose
    force = region.places.to_nodes(forces_along(iteration.slope, iteration.multiplier))
    u = displaced(patch.compliance, force)
    survey = Survey.of(pose, patch, u, between=between_nodes)
    residual = max(iteration.residual, float(survey.penetrated[1].max(initial=0.0)) / pose.scale_mm)
    gap = survey.surface.height_mm
    return PassedState(region.points, iteration.multiplier, u, force, gap, residual, passes, survey=survey), survey


def _assessed(patch: Patch, between_nodes: bool, iteration: "_Iteration", passes: int) -> tuple[ContactState, Survey]:
    """Return the whole patch under the forces found in a region, and its residual."""
    region, pose, multiplier = iteration.region, iteration.pose, iteration.multiplier
    places = region.places
    pushing = forces_along(iteration.slope, multiplier)
    force = places.to_nodes(pushing)
    here = pose.gap(*region.moved_to(region.moved_by(pushing, np.arange(len(region.points)))))
    turned = places.to_nodes(forces_along(here.slope, multiplier))
    u, again = displaced(patch.compliance, force), displaced(patch.compliance, turned)
    survey = Survey.of(pose, patch, u, between=between_nodes)
    there = displaced_gap(pose, places, u)
    residual, _ = missed(again - u, there.height_mm, there.slope, multiplier, pose.scale_mm)
    residual = max(residual, float(survey.penetrated[1].max(initial=0.0)) / pose.scale_mm)
    return ContactState(region.points, multiplier, u, force, survey.surface.height_mm, residual, passes), survey
