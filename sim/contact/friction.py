"""Coulomb friction between a rigid indentor and a condensed elastic patch, one increment of its path at a time.

A skin point in contact sticks to the indentor while its tangential force is below the friction coefficient times its
normal force; on that cone it slips against the force. Slip counts from the displacement before the increment, so
that the answer depends on the path. A semismooth Newton method solves the equations of each increment, with
normals that turn as points slide (Alart & Curnier 1991).
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from sim.contact.compiled.friction_sweeps import swept
from sim.contact.compiled.skin_compliance import displaced
from sim.contact.patch import Patch
from sim.contact.planes import ContactRegion, Gathered
from sim.contact.points import ContactPoints, ContactPose, Survey, norm
from sim.contact.solver import REQUIRED_RESIDUAL, TARGET_RESIDUAL, ContactState

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MOST_FRICTION = 10.0
"""Largest friction coefficient; skin reaches about 3, and 10 sticks almost everywhere."""

_CANDIDATE_GAP_MM = 0.03
_MOST_REGIONS = 12
_PATIENCE, _SLOW = 6, 0.5
_ROUNDS, _SWEEPS, _TURNS = 6, 40, 4
_LONGEST_SLIDE_MM = 0.1
_LIFT = 1e-8  # of the compliance's diagonal: points on one segment may be dependent
_TINY = 1e-300


class FrictionResidual(NamedTuple):
    """Errors of an increment, relative to the largest normal force and the depth."""

    normal: float  # penetration, tension, and force across a gap
    cone: float  # tangential force beyond the friction cone
    slip: float  # slip without force on the cone, or not opposite to it

    @property
    def largest(self) -> float:
        """Largest of the three."""
        return max(self)


@dataclass(frozen=True)
class FrictionState(ContactState):
    """Forces and displacements of the patch in contact with friction, and where the indentor is."""

    pose: ContactPose = field(kw_only=True)
    friction: float = field(kw_only=True)
    pushing: Array = field(kw_only=True)  # (m, k) forces at the points per unit E(epidermis)
    slip_mm: Array = field(kw_only=True)  # (k,) tangential slip of the points within the last increment
    errors: FrictionResidual = field(kw_only=True)

    @property
    def normal_force(self) -> float:
        return float(-self.force[-1].sum())

    @property
    def slipping(self) -> Bools:
        """(k,) mask of points on the friction cone."""
        return (self.multiplier > 0) & (self._cone_share > 1 - 1e-6)

    @property
    def _cone_share(self) -> Array:
        p, tangential = self.split
        return np.linalg.norm(tangential, axis=0) / np.maximum(self.friction * p, _TINY)

    @property
    def split(self) -> tuple[Array, Array]:
        """(k,) normal and (m, k) tangential forces at the points."""
        p = self.multiplier * norm(self.slope)
        return p, self.pushing - _normals(self.slope) * p

    slope: Array = field(kw_only=True)  # (m − 1, k) of the indentor at the points


class _Frame(NamedTuple):
    """Geometry at points: gap along the normal, normal, tangents, turn of the normal by displacement."""

    gap_mm: Array  # (k,)
    normal: Array  # (k, m)
    tangent: Array  # (k, m − 1, m)
    turn: Array  # (k, m − 1, m) of the normal along the tangents, per mm


def at_rest(patch: Patch, pose: ContactPose, friction: float) -> FrictionState:
    """Return the state of the untouched patch under an indentor."""
    m, nothing = len(patch.axes), np.zeros((len(patch.axes), len(patch)))
    none = np.zeros(0)
    return FrictionState(
        ContactPoints.none(), none, nothing, nothing, none, np.inf, 0,
        pose=pose, friction=friction, pushing=np.zeros((m, 0)), slip_mm=none, slope=np.zeros((m - 1, 0)),
        errors=FrictionResidual(np.inf, np.inf, np.inf),
    )  # fmt: skip


def solve_increment(
    patch: Patch,
    pose: ContactPose,
    before: FrictionState,
    *,
    between_nodes: bool,
    gathered: Gathered,
    target: float = TARGET_RESIDUAL,
) -> FrictionState:
    """Solve for the equilibrium after the indentor moved from its pose before to another one.

    The state's residual, over all points where contact is enforced, says whether it converged.
    """
    survey = Survey.of(pose, patch, before.displacement, between=between_nodes)
    candidates, passes = survey.near(pose, _CANDIDATE_GAP_MM).joined(before.held), 0
    best: FrictionState | None = None
    start = before
    for _ in range(_MOST_REGIONS):
        increment = _Increment(pose, ContactRegion(gathered, candidates), before, start, target)
        increment.run()
        passes += increment.passes
        state, survey = _assessed(patch, between_nodes, increment, passes)
        if best is None or state.residual < best.residual:
            best = state
        missed, _ = survey.penetrated
        if missed.among(candidates).all() or not increment.solved:
            break
        candidates, start = candidates.joined(missed).joined(survey.near(pose, _CANDIDATE_GAP_MM)), state
    assert best is not None
    return replace(best, passes=passes)


class _Increment:
    """Newton passes over one region, from the forces of a start, with slip from the displacement before."""

    def __init__(
        self, pose: ContactPose, region: ContactRegion, before: FrictionState, start: FrictionState, target: float
    ) -> None:
        self.pose, self.region, self.target, self.friction = pose, region, target, before.friction
        moved = np.array([*np.subtract(pose.at_mm, before.pose.at_mm), pose.height_mm - before.pose.height_mm])
        self.reference = region.places.interpolate(before.displacement).T + moved  # (k, m) slip counts from it
        self.compliance = _between(region)  # (k, m, k, m)
        self.count, self.m = self.reference.shape
        stiffness = self.count and np.einsum("iaia->i", self.compliance) / self.m
        self.weight = 1.0 / np.maximum(stiffness, _TINY) if self.count else np.zeros(0)
        self.force = np.zeros((self.count, self.m))
        _copied(start, region.points, self.force)
        self.passes, self.solved, self.least = 0, False, np.inf

    def run(self) -> None:
        """Iterate until the errors reach the target, storing the best forces.

        Newton's passes come first. Where they do not converge, sweeps bring the forces closer and Newton's passes
        start again from there.
        """
        if not self.count:
            self.solved = True
            return
        swept, sweeps = self.force, _SWEEPS
        for _ in range(_ROUNDS):
            self._newton(swept)
            if self.solved:
                return
            swept, sweeps = self._swept(swept, sweeps), 2 * sweeps

    def _newton(self, force: Array) -> None:
        """Make Newton's passes while they help."""
        least, patience = np.inf, _PATIENCE
        while True:
            u = self._moved(force)
            frame = self.frame(u)
            error = self.errors(force, u, frame).largest
            if error < self.least and (force.any() or error < self.target):
                self.force, self.least = force, error
            self.solved = self.least <= self.target or (self.least <= REQUIRED_RESIDUAL and error > _SLOW * least)
            patience = _PATIENCE if error < _SLOW * least else patience - 1
            least = min(error, least)
            if self.solved or not patience:
                return
            onward = self._step(force, u, frame)
            if onward is None:
                return
            force, self.passes = onward, self.passes + 1

    def _swept(self, force: Array, sweeps: int) -> Array:
        """Return forces after sweeps, with normals that turn between them."""
        force = force.copy()
        for _ in range(_TURNS):
            u = self._moved(force)
            frame = self.frame(u)
            gap = frame.gap_mm - (frame.normal * u).sum(axis=1)
            swept(
                self.compliance, gap, -self.reference, frame.normal, frame.tangent, self.friction, force,
                sweeps // _TURNS,
            )  # fmt: skip
        return force

    def frame(self, u: Array) -> _Frame:
        """Return the geometry at the points, displaced by (k, m)."""
        surface = self.pose.gap(*self.region.moved_to(u.T))
        n, length = _normals(surface.slope).T, norm(surface.slope)
        tangent = _tangents(n)
        m = self.m
        bend = np.zeros((self.count, m, m))
        bend[:, :-1, :-1] = surface.curvature.transpose(2, 0, 1)
        turn = np.matmul(tangent, bend) / length[:, None, None]
        return _Frame(surface.height_mm / length, n, tangent, turn)

    def errors(self, force: Array, u: Array, frame: _Frame) -> FrictionResidual:
        """Return the errors of forces (k, m) and the displacements that they cause."""
        p = (frame.normal * force).sum(axis=1)
        tau = np.einsum("ktm,km->kt", frame.tangent, force)
        slip = np.einsum("ktm,km->kt", frame.tangent, u - self.reference)
        return residual_of(p, tau, frame.gap_mm, slip, self.friction, self.pose.scale_mm)

    def _step(self, force: Array, u: Array, frame: _Frame) -> Array | None:
        """Return forces after one Newton step."""
        mu, weight = self.friction, self.weight
        delta = u - self.reference
        p = (frame.normal * force).sum(axis=1)
        touching = p - weight * frame.gap_mm > 0
        change = np.where(touching[:, None], 0.0, -force)
        active = np.flatnonzero(touching)
        if len(active):
            n, t, turn = frame.normal[active], frame.tangent[active], frame.turn[active]
            f, d, w, load = force[active], delta[active], weight[active], np.maximum(p[active], 0.0)
            tau = np.einsum("ktm,km->kt", t, f)
            slip = np.einsum("ktm,km->kt", t, d)
            trial = tau - w[:, None] * slip
            size = np.linalg.norm(trial, axis=1)
            cone = mu * np.maximum(p[active] - w * frame.gap_mm[active], 0.0)
            slips = size > cone
            way = trial / np.maximum(size, _TINY)[:, None]
            # Rows: the gap closes; then no slip, or the tangential force on the cone, as motion.
            by_force = np.zeros((len(active), self.m, self.m))
            by_motion = np.zeros((len(active), self.m, self.m))
            right = np.zeros((len(active), self.m))
            by_motion[:, 0], right[:, 0] = n, -frame.gap_mm[active]
            along = (n * d).sum(axis=1)[:, None, None]
            sliding = t - along * turn  # of the slip by motion
            d_tau_u = -load[:, None, None] * turn
            d_p_u = np.einsum("kt,ktm->km", tau, turn)
            share = (mu * load / np.maximum(size, _TINY))[:, None, None]
            across = share * (np.eye(self.m - 1) - way[:, :, None] * way[:, None])
            keep = np.eye(self.m - 1) - across
            scale = (1.0 / w)[:, None, None]
            slip_f = scale * (np.matmul(keep, t) - mu * way[:, :, None] * n[:, None])
            slip_u = scale * (np.matmul(keep, d_tau_u) - mu * way[:, :, None] * d_p_u[:, None]) + np.matmul(
                across, sliding
            )
            on_cone = (tau - mu * p[active][:, None] * way) / w[:, None]
            s = slips[:, None, None]
            by_force[:, 1:] = np.where(s, slip_f, 0.0)
            by_motion[:, 1:] = np.where(s, slip_u, sliding)
            right[:, 1:] = np.where(slips[:, None], -on_cone, -slip)
            if change.any():
                right -= np.einsum("kab,kb->ka", by_motion, self._moved(change)[active])
            solved = self._solved(active, by_force, by_motion, right)
            if solved is None:
                return None
            change[active] = solved
        du = self._moved(change)
        bent = frame.turn.any(axis=(1, 2)) & touching
        longest = np.abs(du[bent]).max(initial=0.0)
        share_of = min(1.0, _LONGEST_SLIDE_MM / longest) if longest else 1.0
        return force + share_of * change

    def _solved(self, active: Ints, by_force: Array, by_motion: Array, right: Array) -> Array | None:
        k, m = len(active), self.m
        rows = self.compliance[active] if k < self.count else self.compliance
        rows = rows[:, :, active] if k < self.count else rows
        matrix = np.matmul(by_motion, rows.reshape(k, m, k * m)).reshape(k, m, k, m)
        lift = _LIFT / self.weight[active]
        i = np.arange(k)
        matrix[i, :, i] += by_force + lift[:, None, None] * by_motion
        _, _, found, failed = lapack.dgesv(matrix.reshape(k * m, k * m), right.ravel())
        if failed or not np.isfinite(found).all():
            return None
        return np.asarray(found).reshape(k, m)

    def _moved(self, force: Array) -> Array:
        """Return (k, m) displacements of all points under their forces."""
        size = force.size
        return np.asarray(self.compliance.reshape(size, size) @ force.ravel()).reshape(force.shape)


def residual_of(
    p: Array, tau: Array, gap_mm: Array, slip_mm: Array, friction: float, scale_mm: float
) -> FrictionResidual:
    """Return the errors of (k,) normal forces and gaps, and of (k, m − 1) tangential forces and slips.

    Coulomb's law holds where the tangential force is its own projection onto the cone after a step against the slip.
    """
    if not len(p):
        return FrictionResidual(0.0, 0.0, 0.0)
    largest = max(float(p.max()), _TINY)
    load, gap = p / largest, gap_mm / scale_mm
    size = np.linalg.norm(tau, axis=1) / largest
    normal = float(np.abs(np.minimum(load, gap)).max())
    cone = float((size - friction * np.maximum(load, 0.0)).max(initial=0.0))
    trial = tau / largest - slip_mm / scale_mm
    radius = friction * np.maximum(load, 0.0)
    shrunk = np.minimum(1.0, radius / np.maximum(np.linalg.norm(trial, axis=1), _TINY))
    slip = float(np.linalg.norm(tau / largest - shrunk[:, None] * trial, axis=1).max())
    return FrictionResidual(normal, cone, slip)


def _assessed(patch: Patch, between_nodes: bool, increment: _Increment, passes: int) -> tuple[FrictionState, Survey]:
    """Return the whole patch under the forces found in a region, and its residual."""
    pose, region, force = increment.pose, increment.region, increment.force
    nodal = region.places.to_nodes(np.ascontiguousarray(force.T))
    u = displaced(patch.compliance, nodal)
    survey = Survey.of(pose, patch, u, between=between_nodes)
    there = region.places.interpolate(u).T
    frame = increment.frame(there)
    errors = increment.errors(force, there, frame)
    deep = float(survey.penetrated[1].max(initial=0.0)) / pose.scale_mm
    errors = errors._replace(normal=max(errors.normal, deep))
    slope = -frame.normal[:, :-1].T / frame.normal[:, -1]
    p = np.where(force.any(axis=1), (frame.normal * force).sum(axis=1), 0.0)
    slip = np.einsum("ktm,km->kt", frame.tangent, there - increment.reference)
    return FrictionState(
        region.points, p / norm(slope), u, nodal, survey.surface.height_mm, errors.largest, passes,
        pose=pose, friction=increment.friction, pushing=np.ascontiguousarray(force.T),
        slip_mm=np.linalg.norm(slip, axis=1), slope=slope, errors=errors,
    ), survey  # fmt: skip


def _copied(start: FrictionState, points: ContactPoints, force: Array) -> None:
    """Copy the forces of a start to the points that carried them."""
    held = start.multiplier > 0
    chosen = start.points.chosen(held)
    force[points.among(chosen)] = start.pushing[:, held].T


def _between(region: ContactRegion) -> Array:
    """Return the (k, m, k, m) compliance between a region's points (mm/N)."""
    skin = region.skin
    (first, second, third, fourth), (along, across) = skin.carriers, skin.share

    def between(nodal: Array) -> Array:
        """Interpolate values at nodes (n, …) to the points."""
        shape = (-1,) + (1,) * (nodal.ndim - 1)
        s, t, found = along.reshape(shape), across.reshape(shape), nodal[first]
        if s.any():
            found = found + s * (nodal[second] - found)
        if t.any():
            found = found + t * (nodal[third] + s * (nodal[fourth] - nodal[third]) - found)
        return found

    rows = between(skin.store.transpose(1, 0, 2, 3))  # (k, m, m, N)
    return np.ascontiguousarray(between(rows.transpose(3, 0, 1, 2)).transpose(1, 2, 0, 3))


def _normals(slope: Array) -> Array:
    """Return (m, k) unit vectors along (∇h, −1)."""
    return np.asarray(np.concatenate([slope, -np.ones_like(slope[:1])]) / norm(slope))


def _tangents(normal: Array) -> Array:
    """Return (k, m − 1, m) orthonormal vectors perpendicular to (k, m) normals; any such frame will do."""
    k, m = normal.shape
    if m == 2:
        return np.stack([normal[:, 1], -normal[:, 0]], axis=1)[:, None]
    helper = np.zeros_like(normal)
    helper[np.arange(k), np.argmin(np.abs(normal), axis=1)] = 1.0
    one = np.cross(normal, helper)
    one /= np.linalg.norm(one, axis=1)[:, None]
    return np.stack([one, np.cross(normal, one)], axis=1)
