"""Finger under an indentor: the force at the carriage's successive poses."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

from scipy.optimize import brentq

from sim.carriage import AS_MODELLED, STRAIGHT, Carriage, Pose, TruePose, Truth
from sim.carriage import Placement as Placement  # as in 0.2
from sim.carriage import Screws as Screws
from sim.carriage import StepsAt as StepsAt
from sim.carriage import Turn as Turn
from sim.contact.indentor import Indentor, Revolved
from sim.contact.patch import Z
from sim.contact.profiles import Cylinder
from sim.contact.shapes import parse_shape
from sim.contact.solver import REQUIRED_RESIDUAL, ContactState
from sim.devices.clock import Scheduler, sample_at
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.pressing import FARTHEST_X_MM
from sim.models.relaxation import Memory, Prony, PronyTerm, RelaxationStep

_WARM_MOVE_MM = 0.1
_FARTHEST_ONWARD = 2.0  # largest extrapolation / distance between the last two states
_DEPTH_TOLERANCE_MM = 1e-6
_POSITIONS_CACHED = 64


@dataclass(frozen=True)
class _Pressed:
    """Contact at a pose: depth past first contact (mm), force (N), and the solver's state.

    `stiffer` is the force of the tissue over that of linear tissue, whose contact it is.
    """

    pose: Pose
    doi_mm: float
    force_n: float
    state: ContactState
    stiffer: float


class PressedFinger:
    """Finger under an indentor, with the force at successive poses."""

    def __init__(self, finger: Fingertip, indentor: str, truth: Truth = AS_MODELLED) -> None:
        """Place the indentor. Raises ShapeError, and ModelRangeError unless it is a sphere on a turned finger."""
        self._finger, self._truth = finger, truth
        self._indentor: Indentor = parse_shape(indentor)
        self._radius_mm = 0.0  # a straight finger needs no rotation
        if isinstance(self._indentor, Revolved) and isinstance(self._indentor.profile, Cylinder):
            self._radius_mm = self._indentor.profile.sharpest_radius_mm
        elif truth.turn != STRAIGHT:
            raise ModelRangeError(
                f"{indentor} on a finger that is rolled or tilted: must be a sphere", "turned_finger"
            )
        self._stiffness = truth.stiffness
        # There are thousands of heights over few positions, and the finger would hash the shape each time.
        self._touch_mm = lru_cache(_POSITIONS_CACHED)(partial(finger.touch_height_mm, self._indentor))
        self._known: _Pressed | None = None  # with the current skin
        self._last: _Pressed | None = None
        self._before: _Pressed | None = None  # the state before the last
        self.contact_solves = 0

    def doi_mm(self, pose: Pose) -> float:
        """Return the depth past first contact, negative above the skin, −∞ beside it. Raises ModelRangeError."""
        pose = self._truth.turn.seen_from_finger(pose, self._radius_mm)
        way_mm = self._travel_mm(pose)
        return self._pressed(pose, way_mm).doi_mm if way_mm > 0 and self._truth.compliance_mm_per_n else way_mm

    def force_n(self, pose: Pose) -> float:
        """Return the downward force on the finger in N. Raises ModelRangeError."""
        pose = self._truth.turn.seen_from_finger(pose, self._radius_mm)
        if pose.above_apex_mm > 0:
            return 0.0
        way_mm = self._travel_mm(pose)
        return self._pressed(pose, way_mm).force_n if way_mm > 0 else 0.0

    @property
    def _current_finger(self) -> Fingertip:
        """Finger with its current skin."""
        return self._finger

    def _travel_mm(self, pose: Pose) -> float:
        """Return the stage's travel past first contact: the depth, for a rigid rig."""
        z_mm = self._z_mm(pose)
        if abs(pose.x_mm) > FARTHEST_X_MM or not 0 <= (z_mm or 0.0) <= self._finger.config.geometry.length_mm:
            return -math.inf
        touch_mm = self._touch_mm(self._indentor.lateral_mm(pose.x_mm), z_mm=z_mm)
        return touch_mm - (pose.above_apex_mm + self._finger.apex_height_mm)

    def _z_mm(self, pose: Pose) -> float | None:
        """Return the position along the finger, where it makes a difference to the shape."""
        return None if Z not in self._indentor.placed_by else self._finger.config.receptor_plane_mm + pose.along_mm

    def _pressed(self, pose: Pose, way_mm: float) -> _Pressed:
        if self._known is None or self._known.pose != pose:
            rigid = self._at_depth(pose, way_mm, self._last)
            self._known = self._with_compliance(rigid) if self._truth.compliance_mm_per_n else rigid
            self._before, self._last = self._last, self._known
        return self._known

    def _with_compliance(self, rigid: _Pressed) -> _Pressed:
        """Return the depth at which finger and rig, in series, share the travel; laterally the rig is rigid."""
        nearest = rigid

        def left_over_mm(doi_mm: float) -> float:
            nonlocal nearest
            if doi_mm <= 0:
                return -rigid.doi_mm
            nearest = self._at_depth(rigid.pose, doi_mm, nearest)
            return doi_mm + self._truth.compliance_mm_per_n * nearest.force_n - rigid.doi_mm

        doi_mm = brentq(left_over_mm, 0.0, rigid.doi_mm, xtol=_DEPTH_TOLERANCE_MM)
        return self._at_depth(rigid.pose, doi_mm, nearest)

    def _at_depth(self, pose: Pose, doi_mm: float, last: _Pressed | None) -> _Pressed:
        """Solve at a depth, from the last state if it is near: the branch reached by pressing in."""
        self.contact_solves += 1
        near = last is not None and last.pose.over(pose) and abs(last.doi_mm - doi_mm) <= _WARM_MOVE_MM
        start = self._onward(last, doi_mm) if last is not None and near else None
        result = self._current_finger.indent(
            self._indentor,
            self._indentor.lateral_mm(pose.x_mm),
            z_mm=self._z_mm(pose),
            doi_mm=doi_mm,
            start=start,
            target=REQUIRED_RESIDUAL,
        )
        if not result.state.converged:
            raise ModelRangeError(
                f"the virtual finger has no converged force for {self._indentor.name} at x = {pose.x_mm:g} mm, "
                f"DOI {doi_mm:g} mm: residual {float(result.state.residual):.0e}",
                "no_answer",
            )
        return _Pressed(pose, doi_mm, self._stiffness * result.force_n, result.state, result.strained.force)

    def _onward(self, last: _Pressed, doi_mm: float) -> ContactState:
        """Return a start: the last state, extrapolated under smooth shapes.

        Sharp shapes have several equilibria, and a start beyond the last state may lead to another one.
        """
        before = self._before
        if self._indentor.sharp or before is None or last is not self._last or not before.pose.over(last.pose):
            return last.state
        if before.state.displacement.shape != last.state.displacement.shape:  # solved on a narrower patch
            return last.state
        gone_mm, going_mm = last.doi_mm - before.doi_mm, doi_mm - last.doi_mm
        if gone_mm == 0 or abs(going_mm) > _FARTHEST_ONWARD * abs(gone_mm):
            return last.state
        change = (last.state.displacement - before.state.displacement) * (going_mm / gone_mm)
        return replace(last.state, displacement=last.state.displacement + change)


class Plant:
    """Fingertip under a stage; forces are computed on request only."""

    def __init__(self, finger: Fingertip, carriage: Carriage, truth: Truth = AS_MODELLED) -> None:
        self._finger, self._carriage, self._truth = finger, carriage, truth
        self._press: PressedFinger | None = None

    @property
    def contact_solves(self) -> int:
        """Number of contact solves for the mounted indentor."""
        return 0 if self._press is None else self._press.contact_solves

    def mount(self, indentor: str) -> None:
        """Mount an indentor on the carriage. Raises ShapeError."""
        self._press = PressedFinger(self._finger, indentor, self._truth)

    def pose_at(self, t_s: float) -> TruePose:
        """Return the indentor's true pose at a time. Raises ModelRangeError."""
        pose = self._carriage.pose_at(t_s)
        doi = float("-inf") if self._press is None else self._press.doi_mm(pose)
        return TruePose(pose.x_mm, pose.above_apex_mm + self._finger.apex_height_mm, doi)

    def force_n(self, t_s: float) -> float:
        """Return the downward force on the finger at a time in N. Raises ModelRangeError."""
        return 0.0 if self._press is None else self._press.force_n(self._carriage.pose_at(t_s))


# --- sampled ---
#
# A force that depends on history is sampled on a fixed time grid, with or without requests.

_KEPT = 256


class SampledForce:
    """Force signal force_n(t) of a system that advances from sample to sample."""

    def __init__(self, scheduler: Scheduler, moved: Callable[[float, float], float], period_s: float) -> None:
        """Take moved(t_s, step_s), called once per sample in order, which returns the force in N."""
        self._scheduler, self._moved, self._period_s = scheduler, moved, period_s
        self._index = self._index_at(scheduler.monotonic_s())
        self._forces = {self._index: 0.0}
        self._tick()

    def force_n(self, t_s: float) -> float:
        """Return the force at the last sample by t_s in N; 0 before the first."""
        index = self._index_at(t_s)
        while self._index < index:
            self._index += 1
            self._forces[self._index] = self._moved(self._index * self._period_s, self._period_s)
            self._forces.pop(self._index - _KEPT, None)
        return self._forces.get(index, 0.0)

    def _tick(self) -> None:
        self.force_n(self._scheduler.monotonic_s())
        self._scheduler.call_at((self._index + 1) * self._period_s, self._tick)

    def _index_at(self, t_s: float) -> int:
        return sample_at(t_s, self._period_s)


# --- relaxing plant ---
#
# The load history of relaxing tissue determines where the indentor next touches the skin.


class RelaxingPress(PressedFinger):
    """Finger with relaxing tissue under an indentor, from one time to the next."""

    def __init__(
        self, finger: Fingertip, indentor: str, terms: Sequence[PronyTerm], truth: Truth = AS_MODELLED
    ) -> None:
        """Start with tissue that was never loaded. Raises ArgumentError for an invalid Prony series."""
        super().__init__(finger, indentor, truth)
        self._patch = finger.model_for(self._indentor.axes).patch
        self._memory = Memory.none(Prony(terms), (len(self._patch.axes), len(self._patch)))
        self._held: Fingertip | None = finger

    def moved_to(self, pose: Pose, step_s: float) -> float:
        """Advance by a time step to a pose; return the force in N. Raises ModelRangeError."""
        ahead = self._memory.ahead(step_s)
        self._lie(ahead)
        force_n = self.force_n(pose)
        if self._known is None or force_n == 0:
            self._memory = self._memory.released(step_s)
        else:
            borne = ahead.carried + self._known.stiffer * self._known.state.force
            self._memory = self._memory.after(ahead, borne)
        return force_n

    def _lie(self, ahead: RelaxationStep) -> None:
        """Displace the skin by the load history; a continuing contact starts where the skin was."""
        self._carried, self._held = ahead.carried, None
        self._stiffness = self._truth.stiffness * ahead.stiffness
        if self._known is not None:
            stayed = self._patch.displaced((self._memory.borne - ahead.carried) / self._known.stiffer)
            self._last = replace(self._known, state=replace(self._known.state, displacement=stayed))
        self._known = self._before = None

    @property
    def _current_finger(self) -> Fingertip:
        """Finger with skin displaced by the load history, made on first touch."""
        if self._held is None:
            self._held = self._finger.held_by(self._indentor.axes, self._carried)
        return self._held


class RelaxingPlant(Plant):
    """Fingertip with relaxing tissue under a stage; mounting an indentor starts with recovered tissue."""

    def __init__(
        self,
        finger: Fingertip,
        carriage: Carriage,
        terms: Sequence[PronyTerm],
        truth: Truth,
        scheduler: Scheduler,
        period_s: float,
    ) -> None:
        """Sample the force at the load cell's sample times."""
        super().__init__(finger, carriage, truth)
        self._terms = terms
        self._relaxing: RelaxingPress | None = None
        self._sampled = SampledForce(scheduler, self._moved, period_s)

    def mount(self, indentor: str) -> None:
        self._press = self._relaxing = RelaxingPress(self._finger, indentor, self._terms, self._truth)

    def force_n(self, t_s: float) -> float:
        return self._sampled.force_n(t_s)

    def _moved(self, t_s: float, step_s: float) -> float:
        return 0.0 if self._relaxing is None else self._relaxing.moved_to(self._carriage.pose_at(t_s), step_s)
