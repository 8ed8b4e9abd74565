"""Indentor placed over a model's patch, and its loading path to a depth.

Smooth shapes go to the depth at once, others in steps from first touch where a corner may bear.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.first_contact import FirstTouch
from sim.contact.force_control import ForceNotReachedError, TooDeepError, solve_for_force
from sim.contact.indentor import EDGE_RADIUS_MM, SHARP_RADIUS_MM, Indentor
from sim.contact.patch import X, Y, Z
from sim.contact.planes import Gathered
from sim.contact.points import ContactPose
from sim.contact.solver import ContactState, solve_contact
from sim.errors import ForceOutOfReachError, ModelRangeError, refuse_unless_numbers, z_outside
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

_LOOSE_RESIDUAL = 1e-4  # sufficient residual at the start of the next step
_CORNER_REACH_MM, _EDGE_STEP_MM = 0.1, 0.005
_LEAST_SCALE_MM = 1e-3
_FORCE_GUESS_MM = 0.3
_AXIS_NAMES = {X: "x", Z: "z"}

NARROWEST, NARROW, _SECTION = 0.7, 1.5, 0.4
"""Least radius of an indentor, radius below which contact is enforced within faces, and the height above its first
touch at which it is measured, in elements."""
_FARTHEST, _ANGLES, _RADII = 3.0, 12, 30  # of the search for the radius: distance in elements, rays, steps on each


class RimError(ModelRangeError, TooDeepError):
    """Error of an indentor that would touch skin outside the patch, at (x, z) and perhaps elsewhere (mm)."""

    default_code = "at_rim"

    def __init__(self, sentence: str, at_mm: tuple[float, float], others_mm: Array, code: str | None = None) -> None:
        super().__init__(sentence, code)
        self.at_mm = at_mm
        self.others_mm = others_mm  # (n, 2) undeformed skin beside the patch that the indentor would penetrate


def refuse_beside_the_finger(config: FingertipConfig, x_mm: float, z_mm: float | None) -> None:
    """Raise ModelRangeError for a position that is not over the finger."""
    refuse_unless_numbers(x_mm=x_mm, **({} if z_mm is None else {"z_mm": z_mm}))
    length_mm = config.geometry.length_mm
    if not abs(x_mm) <= FARTHEST_X_MM:
        raise ModelRangeError(f"x = {x_mm} mm: must be a number within ± {FARTHEST_X_MM:g} mm", "x_outside")
    if z_mm is not None and not 0 <= z_mm <= length_mm:
        raise z_outside(z_mm, length_mm)


def refuse_meaningless(indentor: Indentor, x_mm: float, along_mm: float | None, along: str = "z_mm") -> None:
    """Raise ModelRangeError for a position that makes no difference to an indentor; x = 0 is the default.

    along: name of the caller's argument for the position along the finger.
    """
    for axis, name, position_mm in ((X, "x_mm", x_mm or None), (Z, along, along_mm)):
        if position_mm is not None and axis not in indentor.placed_by:
            by = " and ".join(_AXIS_NAMES[axis] for axis in indentor.placed_by) or "its depth alone"
            raise ModelRangeError(
                f"{indentor.name}: {name} = {position_mm:g} does not apply; the shape is positioned by {by}",
                "meaningless_place",
            )


@dataclass(frozen=True)
class PlacedIndentor:
    """Indentor with its reference point at a position along its axes (mm)."""

    indentor: Indentor
    place: tuple[float, ...]
    zero_mm: float  # height of the indentor's lowest point where DOI is zero
    touch: FirstTouch
    model: CondensedModel

    def pose(self, doi_mm: float) -> ContactPose:
        """Return the pose at a depth."""
        scale_mm, narrow = max(doi_mm, _LEAST_SCALE_MM), self._radius < NARROW
        return ContactPose(self.indentor, self.place, self.zero_mm - doi_mm, scale_mm, narrow)

    @property
    def first_mm(self) -> float:
        """DOI at first touch (mm): 0, unless counted from the apex."""
        return self.zero_mm - self.touch.height_mm

    def bears_on_corner(self, state: ContactState) -> bool:
        """Return whether contact lies where the profile turns within less than a node's spacing."""
        return self._corner_near(self._bearing_mm(state))

    @cached_property
    def touches_corner(self) -> bool:
        """Whether the first touch lies at such a corner."""
        return self._corner_near((np.array(self.touch.at_mm) - np.array(self.place))[:, None])

    def bears_on_edge(self, state: ContactState) -> bool:
        """Return whether a convex edge lies within 0.1 mm of the contact, along an axis."""
        bearing, steps = self._bearing_mm(state), np.arange(-_CORNER_REACH_MM, _CORNER_REACH_MM, _EDGE_STEP_MM)
        return any(
            self._edge_between(bearing[..., None] + np.multiply.outer(direction, steps)[:, None], axis)
            for axis, direction in enumerate(np.eye(len(bearing)))
        )

    def _edge_between(self, offset_mm: Array, axis: int) -> bool:
        """Return whether the surface turns about an edge between (m, k, j) neighbors along an axis.

        A surface that turns by an angle is an arc of radius r, or sharper, if the tangents at its ends intersect
        r tan(angle / 2) from the nearer end.
        """
        surface = self.indentor.evaluate(offset_mm.reshape(len(offset_mm), -1))
        height, slope = (values.reshape(offset_mm.shape[1:]) for values in (surface.height_mm, surface.slope[axis]))
        turn = np.diff(np.arctan(slope))
        bent = turn > _EDGE_STEP_MM / EDGE_RADIUS_MM
        before, after, up = slope[:, :-1][bent], slope[:, 1:][bent], np.diff(height)[bent]
        crossing = (after * _EDGE_STEP_MM - up) / (after - before)
        nearer = np.minimum(crossing * np.hypot(1, before), (_EDGE_STEP_MM - crossing) * np.hypot(1, after))
        return bool((nearer < EDGE_RADIUS_MM * np.tan(0.5 * turn[bent])).any())

    def _corner_near(self, offset_mm: Array) -> bool:
        turning = self.indentor.turning(offset_mm, _CORNER_REACH_MM)
        return bool((turning > 2 * _CORNER_REACH_MM / SHARP_RADIUS_MM).any())

    def _bearing_mm(self, state: ContactState) -> Array:
        """Return (m, k) contact points, relative to the indentor's reference point."""
        patch = self.model.patch
        at = state.held.on(patch).interpolate(patch.tangential_mm + state.displacement[:-1])
        return at - np.array(self.place)[:, None]

    def refuse_narrow(self) -> None:
        """Raise ModelRangeError if the indentor is narrower, where it first touches, than the mesh carries.

        A tip between nodes moves the skin as an element does: the force would depend on the place within the element,
        and fall where points slide off the tip.
        """
        if self._radius < NARROWEST:
            size = self._element_mm
            at = ", ".join(
                f"{_AXIS_NAMES[axis]} = {mm:.2f}" for axis, mm in zip(self.indentor.axes, self.place, strict=True)
            )
            raise ModelRangeError(
                f"{self.indentor.name} at {at} mm: its tip has a radius of {self._radius * size:.3f} mm, "
                f"{_SECTION * size:.3f} mm above the first touch; elements of {size:.3f} mm carry at least "
                f"{NARROWEST * size:.3f} mm; use a wider indentor, mesh.level = 'fine' or a smaller mesh.spacing_mm",
                "narrower_than_mesh",
            )

    @cached_property
    def _element_mm(self) -> float:
        """Longer side of the elements where the indentor first touches (mm)."""
        return self.model.patch.spacing_mm(self.touch.at_mm)

    @cached_property
    def _radius(self) -> float:
        """Radius of a circle as large as the indentor's section above its first touch, in elements.

        The section is what is seen from the first touch within three elements; infinite for a prismatic shape.
        """
        if not self.indentor.corners_only:
            return np.inf
        radii = _FARTHEST * self._element_mm * np.arange(1, _RADII + 1) / _RADII
        angle = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
        touch = (np.array(self.touch.at_mm) - np.array(self.place))[:, None]
        rays = np.stack([np.cos(angle), np.sin(angle)])[:, :, None] * radii
        level_mm = self.indentor.evaluate(touch).height_mm[0] + _SECTION * self._element_mm
        height_mm = self.indentor.evaluate(touch + rays.reshape(2, -1)).height_mm.reshape(_ANGLES, _RADII)
        within = np.logical_and.accumulate(height_mm <= level_mm, axis=1).mean(axis=1)
        return float(_FARTHEST * np.sqrt(((within + 0.5 / _RADII) ** 2).mean()))

    def refuse_touch_outside(self) -> None:
        """Raise RimError if the indentor first touches skin beside the patch."""
        for axis, at, nodes in zip(self.indentor.axes, self.touch.at_mm, self.model.patch.tangential_mm, strict=True):
            if not nodes.min() < at < nodes.max():
                place = {X: 0.0, Z: self._plane_mm} | dict(zip(self.indentor.axes, self.touch.at_mm, strict=True))
                what = f"touches the skin at {_AXIS_NAMES[axis]} = {at:.2f} mm, outside the patch"
                raise self._beyond(what, (place[X], place[Z]), np.zeros((0, 2)), "touch_beside_patch")

    def refuse_rim(self, pose: ContactPose, state: ContactState) -> None:
        """Raise RimError if the indentor touches skin outside the patch."""
        patch, beside = self.model.patch, self.model.outside_mm
        at_rim = np.flatnonzero(state.active & patch.rim)
        y = beside[:, Y] + state.displacement[-1][self.model.outside_neighbour]
        gap = pose.gap(beside[:, list(self.indentor.axes)].T, y).height_mm
        if len(at_rim) or (gap < 0).any():
            below = pose.gap(beside[:, list(self.indentor.axes)].T, beside[:, Y]).height_mm < 0
            x, _, z = patch.position_mm[at_rim[0]] if len(at_rim) else beside[np.argmin(gap)]
            what = f"contact reaches the edge of the patch at x = {x:.2f}, z = {z:.2f} mm"
            raise self._beyond(what, (x, z), beside[below][:, [X, Z]])

    @property
    def _plane_mm(self) -> float:
        """z of the receptor plane (mm)."""
        patch = self.model.patch
        return float(patch.position_mm[self.model.receptor_row * patch.shape[1], Z])

    def _beyond(self, what: str, at_mm: tuple[float, float], others_mm: Array, code: str | None = None) -> RimError:
        at = dict(zip(self.indentor.axes, self.place, strict=True))
        where = ", ".join(f"{_AXIS_NAMES[axis]} = {at[axis]:g}" for axis in self.indentor.placed_by)
        where = f" at {where} mm" if where else ""
        size = "mesh.round_patch_mm" if len(at) > 1 else "mesh.patch_x_mm / patch_z_mm"
        return RimError(
            f"{self.indentor.name}{where}: {what}; use a smaller depth, a position nearer to the pad center, or a "
            f"larger {size}",
            (float(at_mm[0]), float(at_mm[1])),
            others_mm,
            code,
        )


@dataclass(frozen=True)
class Pressing:
    """Presses at one position to several depths, each solved to a target residual."""

    placed: PlacedIndentor
    between_nodes: bool  # whether contact is enforced between nodes, too
    target: float
    _pressed: dict[float, ContactState] = field(default_factory=dict)  # intermediate states by depth past first touch
    under: Under | None = None
    held_mm: Array | None = None  # (m, n) displacement by the load history, in linear tissue
    _lying: dict[float, "Pressing"] = field(default_factory=dict)  # by stiffening factor

    @cached_property
    def _gathered(self) -> Gathered:
        return Gathered(self.placed.model.patch)

    def solve_from_rest(self, doi_mm: float, _: ContactState | None) -> ContactState:
        """Solve at a depth from rest."""
        return self.solve(doi_mm, None)

    def solve(self, doi_mm: float, start: ContactState | None) -> ContactState:
        """Solve at a depth: at once from a start or for a smooth shape, else in steps from first touch.

        Finer steps follow if the target is missed. Contact at an edge finer than the points' spacing counts as
        snapped: it may lie on either side.
        """
        lying = self.lying(doi_mm)
        state = lying._solved(doi_mm, start)
        if state.snapped or not self.placed.indentor.sharp:
            return state
        return replace(state, snapped=lying.placed.bears_on_edge(state))

    def lying(self, doi_mm: float) -> "Pressing":
        """Return the press on skin displaced by the load history; stiffened tissue moves less under it."""
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
        finer = self._in_equal_steps(doi_mm, _PRESS_IN_FINE_MM, self.target)
        better = min((state, finer), key=lambda s: s.residual)
        if not better.converged:
            self.placed.refuse_rim(self.placed.pose(doi_mm), better)
        return replace(better, passes=state.passes + finer.passes)

    def strained(self, doi_mm: float) -> Stiffened:
        """Return the correction for tissue that stiffens, at a depth."""
        if self.under is None:
            return LINEAR_TISSUE
        return self.under.at(doi_mm - self.placed.first_mm, self.placed.model.receptors.position_mm)

    def solve_force(self, force_gwt: float, unit_n: float, deepest_mm: float) -> tuple[float, ContactState]:
        """Return DOI and state at a force, where states are in units of `unit_n` (N). Raises ForceOutOfReachError."""
        solve = self.solve_from_rest if self.placed.indentor.sharp else self.solve
        force, factor = force_gwt * GWT_N / unit_n, lambda doi_mm: self.strained(doi_mm).force
        try:
            return solve_for_force(force, _FORCE_GUESS_MM, deepest_mm, solve, factor)
        except ForceNotReachedError as error:
            raise ForceOutOfReachError(f"force {force_gwt:g} gwt: {error}") from None

    def by_other_paths(self, doi_mm: float) -> list[ContactState]:
        """Return the states at a depth after paths in finer steps from first touch."""
        lying = self.lying(doi_mm)
        return [lying._in_equal_steps(doi_mm, step_mm, None) for step_mm in OTHER_STEPS_MM]

    def _pressed_in(self, doi_mm: float) -> ContactState:
        """Press from first touch in long steps, and in short ones where a corner bears, which choose its side."""
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

    def _in_equal_steps(self, doi_mm: float, step_mm: float, on_the_way: float | None) -> ContactState:
        """Press from first touch, each intermediate depth solved to a target, or loosely."""
        state = None
        for depth in self._depths(step_mm, self.placed.first_mm, doi_mm):
            state = self._step(depth, state, on_the_way)
        return self._step(doi_mm, state, self.target)

    def _step(self, doi_mm: float, start: ContactState | None, target: float | None) -> ContactState:
        """Solve at a depth, counting passes from rest; without a target the state is intermediate."""
        state = self._at(doi_mm, start, target)
        if start is None:
            return state
        return replace(state, passes=start.passes + state.passes, snapped=start.snapped or state.snapped)

    @staticmethod
    def _depths(step_mm: float, after_mm: float, before_mm: float) -> list[float]:
        """Return depths in equal steps strictly between two others."""
        return np.arange(after_mm + step_mm, before_mm - 1e-9, step_mm).tolist()

    def _at(self, doi_mm: float, start: ContactState | None, target: float | None) -> ContactState:
        pose = self.placed.pose(doi_mm)
        state = solve_contact(
            self.placed.model.patch,
            pose,
            start,
            between_nodes=self.between_nodes,
            target=_LOOSE_RESIDUAL if target is None else target,
            gathered=self._gathered,
            on_the_way=target is None,
        )
        if state.converged:  # a state that has not converged may touch anything
            self.placed.refuse_rim(pose, state)
        return state
