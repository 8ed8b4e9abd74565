"""An indentor at a place over a model's patch, and how it is pressed to a depth.

At once, or in steps from first touch where a corner may bear.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.force_control import ForceNotReachedError, TooDeepError, solve_for_force
from sim.contact.indentor import EDGE_RADIUS_MM, SHARP_RADIUS_MM, Indentor
from sim.contact.patch import X, Y, Z
from sim.contact.planes import Gathered
from sim.contact.points import ContactPose
from sim.contact.solver import ContactState, solve_contact
from sim.contact.touch import FirstTouch
from sim.errors import ForceOutOfReachError, ModelRangeError, z_outside
from sim.models.condensed import CondensedModel
from sim.models.relaxation import held_at
from sim.models.stiffening import LINEAR_TISSUE, Stiffened, Under
from sim.units import GWT_N

Array = NDArray[np.float64]

FARTHEST_X_MM = 20.0
"""Distance from x = 0 (mm) beyond which no part of a shape is over the pad."""

_PRESS_IN_MM, _PRESS_IN_CORNER_MM, _PRESS_IN_FINE_MM = 0.2, 0.05, 0.0125
OTHER_STEPS_MM = (0.0125, 0.00625)
"""Increments of the other loading paths (mm)."""

_ON_THE_WAY = 1e-4  # residual that is enough where the next step starts
_CORNER_REACH_MM, _EDGE_STEP_MM = 0.1, 0.005
_LEAST_SCALE_MM = 1e-3
_FORCE_GUESS_MM = 0.3
_AXIS_NAMES = {X: "x", Z: "z"}


class RimError(ModelRangeError, TooDeepError):
    """The indentor would touch skin that the patch does not hold, at (x, z), and perhaps at others; mm."""

    default_code = "at_rim"

    def __init__(
        self, message: str, at_mm: tuple[float, float], others_mm: Array, *, code: str | None = None, **fields: Any
    ) -> None:
        super().__init__(message, code=code, **fields)
        self.at_mm = at_mm
        self.others_mm = others_mm  # (n, 2) places beside the patch that the indentor, were it soft, would lie below


def refuse_beside_the_finger(config: FingertipConfig, x_mm: float, z_mm: float | None) -> None:
    """Refuse a place that is not over a finger."""
    length_mm = config.geometry.length_mm
    if not abs(x_mm) <= FARTHEST_X_MM:
        raise ModelRangeError(
            "x = {x_mm} mm: must be a number within ± {farthest_mm:g} mm",
            code="x_outside",
            x_mm=x_mm,
            farthest_mm=FARTHEST_X_MM,
        )
    if z_mm is not None and not 0 <= z_mm <= length_mm:
        raise z_outside(z_mm, length_mm)


def refuse_meaningless(indentor: Indentor, x_mm: float, z_mm: float | None) -> None:
    """Refuse a place that makes no difference to an indentor; x = 0 is what it has when none is given."""
    for axis, given in ((X, x_mm or None), (Z, z_mm)):
        if given is not None and axis not in indentor.placed_by:
            by = " and ".join(_AXIS_NAMES[axis] for axis in indentor.placed_by) or "its depth alone"
            raise ModelRangeError(
                "{indentor}: {axis}_mm = {place_mm:g} does not apply; the shape is positioned by {placed_by}",
                code="meaningless_place",
                indentor=indentor.name,
                axis=_AXIS_NAMES[axis],
                place_mm=given,
                placed_by=by,
            )


@dataclass(frozen=True)
class PlacedIndentor:
    """An indentor with its reference point at a place, along its axes; mm."""

    indentor: Indentor
    place: tuple[float, ...]
    zero_mm: float  # height of the indentor's lowest point where DOI is zero
    touch: FirstTouch
    model: CondensedModel

    def pose(self, doi_mm: float) -> ContactPose:
        """Where the indentor is at a depth."""
        return ContactPose(self.indentor, self.place, self.zero_mm - doi_mm, max(doi_mm, _LEAST_SCALE_MM))

    @property
    def first_mm(self) -> float:
        """DOI at first touch: 0, unless counted from the apex."""
        return self.zero_mm - self.touch.height_mm

    def bears_on_corner(self, state: ContactState) -> bool:
        """Whether a place that bears lies where the profile turns within less than a node's spacing."""
        return self._corner_near(self._bearing_mm(state))

    @cached_property
    def touches_corner(self) -> bool:
        """The same of the place that is touched first."""
        return self._corner_near((np.array(self.touch.at_mm) - np.array(self.place))[:, None])

    def bears_on_edge(self, state: ContactState) -> bool:
        """Whether a convex edge lies within 0.1 mm of a place that bears, along an axis."""
        bearing, steps = self._bearing_mm(state), np.arange(-_CORNER_REACH_MM, _CORNER_REACH_MM, _EDGE_STEP_MM)
        return any(
            self._edge_between(bearing[..., None] + np.multiply.outer(way, steps)[:, None], axis)
            for axis, way in enumerate(np.eye(len(bearing)))
        )

    def _edge_between(self, offset_mm: Array, axis: int) -> bool:
        """Whether the surface turns about an edge between (m, k, j) neighbours along an axis.

        What turns by an angle is an arc of a radius r, or sharper, if the tangents at its ends meet r tan(angle / 2)
        from the nearer end.
        """
        surface = self.indentor.evaluate(offset_mm.reshape(len(offset_mm), -1))
        height, slope = (values.reshape(offset_mm.shape[1:]) for values in (surface.height_mm, surface.slope[axis]))
        turn = np.diff(np.arctan(slope))
        bent = turn > _EDGE_STEP_MM / EDGE_RADIUS_MM
        before, after, up = slope[:, :-1][bent], slope[:, 1:][bent], np.diff(height)[bent]
        meet = (after * _EDGE_STEP_MM - up) / (after - before)
        nearer = np.minimum(meet * np.hypot(1, before), (_EDGE_STEP_MM - meet) * np.hypot(1, after))
        return bool((nearer < EDGE_RADIUS_MM * np.tan(0.5 * turn[bent])).any())

    def _corner_near(self, offset_mm: Array) -> bool:
        turning = self.indentor.turning(offset_mm, _CORNER_REACH_MM)
        return bool((turning > 2 * _CORNER_REACH_MM / SHARP_RADIUS_MM).any())

    def _bearing_mm(self, state: ContactState) -> Array:
        """(m, k) places that bear, from the indentor's reference point."""
        patch = self.model.patch
        at = state.held.on(patch).interpolate(patch.tangential_mm + state.displacement[:-1])
        return at - np.array(self.place)[:, None]

    def refuse_touch_outside(self) -> None:
        """Refuse a scene in which the indentor first touches skin beside the patch."""
        for axis, at, nodes in zip(self.indentor.axes, self.touch.at_mm, self.model.patch.tangential_mm, strict=True):
            if not nodes.min() < at < nodes.max():
                place = {X: 0.0, Z: self._plane_mm} | dict(zip(self.indentor.axes, self.touch.at_mm, strict=True))
                what = "touches the skin at {axis} = {touch_mm:.2f} mm, outside the patch"
                told = {"code": "touch_beside_patch", "axis": _AXIS_NAMES[axis], "touch_mm": float(at)}
                raise self._beyond(what, (place[X], place[Z]), np.zeros((0, 2)), **told)

    def refuse_rim(self, pose: ContactPose, state: ContactState) -> None:
        """Refuse an answer when the indentor touches skin that the patch does not hold."""
        patch, beside = self.model.patch, self.model.outside_mm
        at_rim = np.flatnonzero(state.active & patch.rim)
        y = beside[:, Y] + state.displacement[-1][self.model.outside_neighbour]
        gap = pose.gap(beside[:, list(self.indentor.axes)].T, y).height_mm
        if len(at_rim) or (gap < 0).any():
            below = pose.gap(beside[:, list(self.indentor.axes)].T, beside[:, Y]).height_mm < 0
            x, _, z = patch.position_mm[at_rim[0]] if len(at_rim) else beside[np.argmin(gap)]
            what = "contact reaches the edge of the patch at x = {x_mm:.2f}, z = {z_mm:.2f} mm"
            raise self._beyond(what, (x, z), beside[below][:, [X, Z]], x_mm=float(x), z_mm=float(z))

    @property
    def _plane_mm(self) -> float:
        """z of the receptor plane."""
        patch = self.model.patch
        return float(patch.position_mm[self.model.receptor_row * patch.shape[1], Z])

    def _beyond(self, what: str, at_mm: tuple[float, float], others_mm: Array, **told: Any) -> RimError:
        at = {axis: float(at) for axis, at in zip(self.indentor.axes, self.place, strict=True)}
        named = {_AXIS_NAMES[axis]: at[axis] for axis in self.indentor.placed_by}
        where = ", ".join(f"{name} = {{at_{name}_mm:g}}" for name in named)
        where = f" at {where} mm" if where else ""
        told |= {f"at_{name}_mm": place for name, place in named.items()}
        size = "mesh.round_patch_mm" if len(at) > 1 else "mesh.patch_x_mm / patch_z_mm"
        return RimError(
            f"{{indentor}}{where}: {what}; use a smaller depth, a position nearer to the pad center, or a "
            f"larger {{size}}",
            (float(at_mm[0]), float(at_mm[1])),
            others_mm,
            indentor=self.indentor.name,
            size=size,
            **told,
        )


@dataclass(frozen=True)
class Pressing:
    """Answers at one depth after another, each solved to a target residual."""

    placed: PlacedIndentor
    between_nodes: bool  # contact is enforced between nodes, too
    target: float
    _pressed: dict[float, ContactState] = field(default_factory=dict)  # by depth past first touch, loosely solved
    under: Under | None = None
    held_mm: Array | None = None  # (m, n) how far the tissue's past displaces the skin where it is linear
    _lying: dict[float, "Pressing"] = field(default_factory=dict)  # by what linear tissue is held more

    @cached_property
    def _gathered(self) -> Gathered:
        return Gathered(self.placed.model.patch)

    def solve_from_rest(self, doi_mm: float, _: ContactState | None) -> ContactState:
        """The answer at a depth, whatever was solved before."""
        return self.solve(doi_mm, None)

    def solve(self, doi_mm: float, start: ContactState | None) -> ContactState:
        """At once from a start or for a smooth shape, else pressed in from first touch, finely if that misses.

        What bears at an edge finer than the points are apart counts as snapped: it may lie on either side.
        """
        lying = self.lying(doi_mm)
        state = lying._solved(doi_mm, start)
        if state.snapped or not self.placed.indentor.sharp:
            return state
        return replace(state, snapped=lying.placed.bears_on_edge(state))

    def lying(self, doi_mm: float) -> "Pressing":
        """With the skin where it is held under a depth: forces displace tissue less that has stiffened."""
        if self.held_mm is None:
            return self
        stiffer, model = self.strained(doi_mm).force, self.placed.model
        if stiffer not in self._lying:
            placed = replace(self.placed, model=replace(model, patch=held_at(model.patch, self.held_mm / stiffer)))
            self._lying[stiffer] = replace(self, placed=placed, held_mm=None, _pressed={}, _lying={})
        return self._lying[stiffer]

    def _solved(self, doi_mm: float, start: ContactState | None) -> ContactState:
        in_steps = start is None and self.placed.indentor.sharp
        state = self._pressed_in(doi_mm) if in_steps else self._at(doi_mm, start, self.target)
        if state.residual <= self.target:
            return state
        finer = self._pressed_in_finely(doi_mm)
        better = min((state, finer), key=lambda s: s.residual)
        if not better.converged:
            self.placed.refuse_rim(self.placed.pose(doi_mm), better)
        return replace(better, passes=state.passes + finer.passes)

    def strained(self, doi_mm: float) -> Stiffened:
        """How the tissue answers at a depth beside its linear twin."""
        if self.under is None:
            return LINEAR_TISSUE
        return self.under.at(doi_mm - self.placed.first_mm, self.placed.model.receptors.position_mm)

    def solve_force(self, force_gwt: float, unit_n: float, deepest_mm: float) -> tuple[float, ContactState]:
        """DOI and state at a force, a state's forces being in units. Raises ForceOutOfReachError."""
        solve = self.solve_from_rest if self.placed.indentor.sharp else self.solve
        force, factor = force_gwt * GWT_N / unit_n, lambda doi_mm: self.strained(doi_mm).force
        try:
            return solve_for_force(force, _FORCE_GUESS_MM, deepest_mm, solve, factor)
        except ForceNotReachedError as error:
            raise ForceOutOfReachError(
                "force {force_gwt:g} gwt: {problem}", force_gwt=force_gwt, problem=str(error), **error.fields
            ) from None

    def by_other_paths(self, doi_mm: float) -> list[ContactState]:
        """The answers at a depth at the end of paths in finer steps from first touch."""
        lying = self.lying(doi_mm)
        return [lying._in_equal_steps(doi_mm, step_mm, None) for step_mm in OTHER_STEPS_MM]

    def _pressed_in(self, doi_mm: float) -> ContactState:
        """From first touch in long steps, and from where a corner bears in short ones: its side is chosen there."""
        before_mm, state = self.placed.first_mm, None
        for depth in self._depths(_PRESS_IN_MM, before_mm, doi_mm):
            if depth not in self._pressed:
                self._pressed[depth] = self._onward(before_mm, depth, state, None)
            before_mm, state = depth, self._pressed[depth]
        return self._onward(before_mm, doi_mm, state, self.target)

    def _onward(
        self, before_mm: float, doi_mm: float, start: ContactState | None, target: float | None
    ) -> ContactState:
        corner = self.placed.touches_corner if start is None else self.placed.bears_on_corner(start)
        if not corner:
            state = self._step(doi_mm, start, target)
            if not self.placed.bears_on_corner(state):
                return state
        for depth in self._depths(_PRESS_IN_CORNER_MM, before_mm, doi_mm):
            if depth not in self._pressed:
                self._pressed[depth] = self._step(depth, start, None)
            start = self._pressed[depth]
        return self._step(doi_mm, start, target)

    def _pressed_in_finely(self, doi_mm: float) -> ContactState:
        return self._in_equal_steps(doi_mm, _PRESS_IN_FINE_MM, self.target)

    def _in_equal_steps(self, doi_mm: float, step_mm: float, on_the_way: float | None) -> ContactState:
        """From first touch, each depth on the way solved to a target, or loosely."""
        state = None
        for depth in self._depths(step_mm, self.placed.first_mm, doi_mm):
            state = self._step(depth, state, on_the_way)
        return self._step(doi_mm, state, self.target)

    def _step(self, doi_mm: float, start: ContactState | None, target: float | None) -> ContactState:
        """Solved at a depth, the passes counted from rest; without a target it is only on the way."""
        state = self._at(doi_mm, start, target)
        if start is None:
            return state
        return replace(state, passes=start.passes + state.passes, snapped=start.snapped or state.snapped)

    @staticmethod
    def _depths(step_mm: float, after_mm: float, before_mm: float) -> list[float]:
        """Depths in equal steps between two others, both left out."""
        return np.arange(after_mm + step_mm, before_mm - 1e-9, step_mm).tolist()

    def _at(self, doi_mm: float, start: ContactState | None, target: float | None) -> ContactState:
        pose = self.placed.pose(doi_mm)
        state = solve_contact(
            self.placed.model.patch,
            pose,
            start,
            between_nodes=self.between_nodes,
            target=_ON_THE_WAY if target is None else target,
            gathered=self._gathered,
            on_the_way=target is None,
        )
        if state.converged:  # an unfinished state may touch anything on its way
            self.placed.refuse_rim(pose, state)
        return state
