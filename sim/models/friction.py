"""Presses with Coulomb friction: a model condensed along all axes, pressed in small increments.

Skin under friction is held along the finger too, so that the model keeps the displacement along every axis. It is
condensed for the same mesh as without friction, when friction first asks for it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.first_contact import FirstTouch
from sim.contact.friction import MOST_FRICTION, FrictionState, at_rest, solve_increment
from sim.contact.indentor import BOTH, Indentor, Prismatic
from sim.contact.patch import Patch, X, Y, Z
from sim.contact.planes import Gathered, forces_along
from sim.contact.points import ContactPose
from sim.contact.solver import TARGET_RESIDUAL, ContactState
from sim.errors import ArgumentError, ForceOutOfReachError, refuse_unless_numbers
from sim.models.condensed import CondensedModel, meshed_for
from sim.models.pressing import PlacedIndentor
from sim.models.result import IndentationResult, PressJson
from sim.models.sources import Recipe, on_large_enough
from sim.units import GWT_N, PSEUDO_E_EPIDERMIS

if TYPE_CHECKING:
    from sim.models.fingertip import Fingertip

Array = NDArray[np.float64]

INCREMENT_MM = 0.05
"""Longest increment of a path with friction (mm)."""

_HALVINGS = 6
_FORCE_TOLERANCE = 1e-10
_MOST_SECANTS = 40


def checked_friction(friction: float) -> float:
    """Return a friction coefficient; raise ArgumentError unless it is 0 to 10."""
    refuse_unless_numbers(friction=friction)
    if not 0 <= friction <= MOST_FRICTION:
        raise ArgumentError(f"friction {friction:g}: must be a number from 0 to {MOST_FRICTION:g}", "bad_friction")
    return float(friction)


def frictional(config: FingertipConfig, slopes: tuple[int, ...]) -> FingertipConfig:
    """Return the configuration whose model for all slopes has the mesh of that for some slopes."""
    if slopes == BOTH:
        return config
    mesh = meshed_for(config, slopes).mesh
    same = {"axial_spacing_mm": mesh.axial_mm, "round_patch_mm": 0.0}
    return config.model_copy(update={"mesh": mesh.model_copy(update=same)})


@dataclass(frozen=True, repr=False)
class _Extruded(Prismatic):
    """Prismatic shape as a surface over x and z, and the axes along which it slopes."""

    slopes: tuple[int, ...] = BOTH
    placed: tuple[int, ...] = BOTH

    @cached_property
    def placed_by(self) -> tuple[int, ...]:
        """Axes along which the position makes a difference."""
        return self.placed


def _over_both(indentor: Indentor) -> Indentor:
    """Return the same surface over x and z."""
    if indentor.axes == BOTH:
        return indentor
    assert isinstance(indentor, Prismatic)
    direction = tuple(indentor.direction[0] if axis == indentor.axes[0] else 0.0 for axis in BOTH)
    return _Extruded(indentor.name, indentor.profile, BOTH, direction, indentor.axes, indentor.placed_by)


@dataclass(frozen=True, eq=False, repr=False)
class FrictionResult(IndentationResult):
    """One simulated indentation with friction; forces on the skin are normal and tangential."""

    increments: int = 0

    def meshed_by(self, config: FingertipConfig) -> FingertipConfig:
        """Return the configuration of the mesh, from that of the finger."""
        return config if self.model.kind == "section" else frictional(config, self.indentor.axes)

    @property
    def friction(self) -> float:
        """Friction coefficient."""
        return self._friction_state.friction

    @property
    def _friction_state(self) -> FrictionState:
        assert isinstance(self.state, FrictionState)
        return self.state

    @property
    def _pose(self) -> ContactPose:
        """Pose of the indentor, to which gaps are measured."""
        return self._friction_state.pose

    @cached_property
    def nodal_pressure_pseudo(self) -> Array:
        """Normal nodal force over tributary undeformed area, shape (n_patch,), in pseudo-units."""
        state, patch = self._friction_state, self.model.patch
        normal = state.points.on(patch).to_nodes(forces_along(state.slope, state.multiplier))
        return PSEUDO_E_EPIDERMIS * np.asarray(np.linalg.norm(normal, axis=0)) / patch.area_mm2

    @property
    def shear_force_n(self) -> tuple[float, ...]:
        """Force on the skin along x, and along z unless the model is a section (N, or N/mm of a section)."""
        return tuple(float(f) * self.e_epidermis_mpa for f in self.state.force[:-1].sum(axis=1))

    @property
    def sticking_share(self) -> float:
        """Share of the normal force that sticking points carry."""
        state = self._friction_state
        p, _ = state.split
        return float(p[~state.slipping].sum() / p.sum()) if p.sum() > 0 else 1.0

    def as_json(self) -> PressJson:
        """Return the JSON object of `rig indent --json`, without the build time of the model."""
        errors, shear, found = self._friction_state.errors, self.shear_force_n, super().as_json()
        found["friction"] = {
            "coefficient": self.friction,
            "increments": self.increments,
            "sticking_share": self.sticking_share,
            "shear_x_n": shear[0],
            "shear_z_n": shear[1] if len(shear) > 1 else 0.0,
            "normal_residual": errors.normal,
            "cone_residual": errors.cone,
            "slip_residual": errors.slip,
        }
        return found


class PathOptions(NamedTuple):
    """Friction, and how finely a path is followed."""

    friction: float
    between_nodes: bool = True
    target: float = TARGET_RESIDUAL
    increment_mm: float = INCREMENT_MM


class _Path:
    """Indentor over one model, moved increment by increment."""

    def __init__(self, model: CondensedModel, slopes: tuple[int, ...], how: PathOptions) -> None:
        self.model, self.how = model, how
        self._patch = _joined_along(model.patch, slopes)
        self._gathered = Gathered(self._patch)
        self.increments = 0

    def begin(self, placed: PlacedIndentor) -> FrictionState:
        """Return the state at first touch."""
        return at_rest(self.model.patch, placed.pose(placed.first_mm), self.how.friction)

    def onward(self, placed: PlacedIndentor, pose: ContactPose, before: FrictionState) -> FrictionState:
        """Move straight to another pose, in increments of at most `increment_mm`."""
        start = before.pose
        far = float(np.abs(np.subtract([*pose.at_mm, pose.height_mm], [*start.at_mm, start.height_mm])).max())
        steps = max(1, math.ceil(far / self.how.increment_mm - 1e-9))
        state = before
        for k in range(1, steps + 1):
            state = self._to(placed, pose if k == steps else _part(start, pose, k / steps), state, _HALVINGS)
        return state

    def _to(self, placed: PlacedIndentor, pose: ContactPose, before: FrictionState, halvings: int) -> FrictionState:
        between = self.how.between_nodes and placed.indentor.between_nodes
        state = solve_increment(
            self._patch, pose, before, between_nodes=between, gathered=self._gathered, target=self.how.target
        )
        if state.converged or not halvings:
            self.increments += 1
            placed.refuse_rim(pose, state)
            return replace(state, passes=state.passes + before.passes)
        half = self._to(placed, _part(before.pose, pose, 0.5), before, halvings - 1)
        if not half.converged:
            return half
        return self._to(placed, pose, half, halvings - 1)


def _joined_along(patch: Patch, slopes: tuple[int, ...]) -> Patch:
    """Return the patch with contact between nodes along some axes only, as without friction.

    Segments along another axis join each node to itself, so that results number the points alike.
    """
    across = len(replace(patch, axes=(X, Y)).across) if len(patch.axes) > 2 else len(patch.across)
    strips = patch.strips.copy()
    for axis, some in ((X, slice(0, across)), (Z, slice(across, None))):
        if axis not in slopes:
            strips[:, some] = strips[:1, some]
    joined = replace(patch)
    vars(joined)["strips"] = strips  # as cached_property stores them
    return joined


def _part(start: ContactPose, end: ContactPose, share: float) -> ContactPose:
    """Return the pose at a share of the straight way from one pose to another."""
    at = tuple((1 - share) * a + share * b for a, b in zip(start.at_mm, end.at_mm, strict=True))
    height = (1 - share) * start.height_mm + share * end.height_mm
    return replace(end, at_mm=at, height_mm=height, scale_mm=(1 - share) * start.scale_mm + share * end.scale_mm)


@dataclass(frozen=True)
class Rubbed:
    """A shape over a finger with friction, at any position; models grow as contact leaves their patch.

    The finger's model has all axes; in `plane_strain` nothing moves along the finger.
    """

    finger: "Fingertip"
    e_epidermis_mpa: float
    indentor: Indentor
    how: PathOptions
    plane_strain: bool

    def press(
        self,
        place: tuple[float, float],
        touch: FirstTouch,
        zero_mm: float,
        doi_mm: float | None,
        force_gwt: float | None,
        start: ContactState | None,
    ) -> FrictionResult:
        """Press at a position (x, z) to a depth, or to a force."""
        if start is not None and not (isinstance(start, FrictionState) and start.friction == self.how.friction):
            raise ArgumentError(f"start: must be a state with friction {self.how.friction:g}", "other_start")

        def pressed(path: _Path) -> list[tuple[float, FrictionState]]:
            return [self._pressed(path, self._placed(place, touch, zero_mm, path.model), doi_mm, force_gwt, start)]

        return self._results(pressed, [(place, zero_mm)])[0]

    def drag(
        self, stops: Sequence[tuple[tuple[float, float], FirstTouch, float]], doi_mm: float
    ) -> list[FrictionResult]:
        """Press at the first stop, then slide from stop to stop at the same depth below the zero of each."""

        def along(path: _Path) -> list[tuple[float, FrictionState]]:
            placed = [self._placed(place, touch, zero_mm, path.model) for place, touch, zero_mm in stops]
            state = path.onward(placed[0], placed[0].pose(doi_mm), path.begin(placed[0]))
            found = [(doi_mm, state)]
            for one in placed[1:]:
                state = path.onward(one, one.pose(doi_mm), replace(state, passes=0))
                found.append((doi_mm, state))
            return found

        return self._results(along, [(place, zero_mm) for place, _, zero_mm in stops])

    def _results(
        self,
        solve: Callable[["_Path"], list[tuple[float, FrictionState]]],
        places: Sequence[tuple[tuple[float, float], float]],
    ) -> list[FrictionResult]:
        """Return the results of a solution at places with their zeros, on a patch that contact does not leave."""
        axes = self._surface.axes

        def solved(model: CondensedModel) -> tuple[_Path, list[tuple[float, FrictionState]]]:
            path = _Path(model, self.indentor.axes, self.how)
            return path, solve(path)

        (path, found), patch = on_large_enough(self.finger, axes, solved)
        return [
            FrictionResult(
                indentor=self.indentor,
                x_mm=x_mm,
                z_mm=z_mm,
                doi_mm=doi_mm,
                touch_height_mm=zero_mm,
                force_n=state.normal_force * self.e_epidermis_mpa,
                state=state,
                model=self.finger._outlines[axes, patch],
                e_epidermis_mpa=self.e_epidermis_mpa,
                contact_s=0.0,
                _strain=partial(path.model.strain, state.force),
                increments=path.increments,
            )
            for ((x_mm, z_mm), zero_mm), (doi_mm, state) in zip(places, found, strict=True)
        ]

    @cached_property
    def _surface(self) -> Indentor:
        return self.indentor if self.plane_strain else _over_both(self.indentor)

    def _placed(
        self, place: tuple[float, float], touch: FirstTouch, zero_mm: float, model: CondensedModel
    ) -> PlacedIndentor:
        at = dict(zip(BOTH, place, strict=True))
        touched = at | dict(zip(self.indentor.axes, touch.at_mm, strict=True))
        axes = self._surface.axes
        placed = PlacedIndentor(
            self._surface,
            tuple(at[axis] for axis in axes),
            zero_mm,
            touch._replace(at_mm=tuple(touched[axis] for axis in axes)),
            model,
        )
        placed.refuse_touch_outside()
        placed.refuse_narrow()
        return placed

    def _pressed(
        self,
        path: _Path,
        placed: PlacedIndentor,
        doi_mm: float | None,
        force_gwt: float | None,
        start: FrictionState | None,
    ) -> tuple[float, FrictionState]:
        state = path.begin(placed) if start is None else start
        if state.displacement.shape != (len(placed.indentor.axes) + 1, len(placed.model.patch)):
            raise ArgumentError("start: must be a state of the same finger, with friction", "other_start")
        if doi_mm is not None:
            return doi_mm, path.onward(placed, placed.pose(doi_mm), state)
        assert force_gwt is not None
        return self._to_force(path, placed, force_gwt * GWT_N / self.e_epidermis_mpa, state)

    def _to_force(
        self, path: _Path, placed: PlacedIndentor, force: float, state: FrictionState
    ) -> tuple[float, FrictionState]:
        """Follow the path until it reaches a force, and shorten its last increment to end there."""
        deepest_mm = self.finger.deepest_doi_mm
        before, low = state, placed.zero_mm - state.pose.height_mm
        while True:
            high = min(low + path.how.increment_mm, deepest_mm)
            if high <= low:
                raise ForceOutOfReachError(
                    f"force {force * self.e_epidermis_mpa:g} N: not reached at the largest DOI allowed, "
                    f"{deepest_mm:g} mm",
                )
            state = path.onward(placed, placed.pose(high), before)
            if state.normal_force >= force:
                break
            before, low = state, high
        f_low, f_high, doi, side = before.normal_force - force, state.normal_force - force, high, 0
        for _ in range(_MOST_SECANTS):
            reached = state.normal_force - force
            if abs(reached) <= _FORCE_TOLERANCE * force:
                return doi, state
            if reached > 0:
                high, f_high = doi, reached
                f_low *= 0.5 if side > 0 else 1.0  # Illinois
                side = 1
            else:
                low, f_low = doi, reached
                f_high *= 0.5 if side < 0 else 1.0
                side = -1
            doi = low - f_low * (high - low) / (f_high - f_low)
            state = path.onward(placed, placed.pose(doi), before)
        missed = abs(state.normal_force - force) / force
        return doi, replace(state, residual=max(state.residual, missed))


def rubbing_finger(recipe: Recipe, friction: float) -> "Fingertip":
    """Return the finger of a recipe, pressed with friction."""
    finger: Fingertip = recipe.make(*recipe.arguments, **dict(recipe.options))
    return finger.with_friction(friction)


def with_all_axes(recipe: Recipe, slopes: tuple[int, ...]) -> "Fingertip":
    """Load a recipe's finger with the displacement along every axis, on the mesh of shapes that slope along some."""
    if recipe.make is rubbing_finger:
        recipe = recipe.arguments[0]  # type: ignore[assignment]
    arguments = [frictional(one, slopes) if isinstance(one, FingertipConfig) else one for one in recipe.arguments]
    options = dict(recipe.options) | {"slopes": BOTH}
    if "exact" in options:
        options["exact"] = True
    finger: Fingertip = recipe.make(*arguments, **options)
    return finger
