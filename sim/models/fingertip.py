"""The door to the simulator: a fingertip that can be indented."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from sim.config.fingertip_config import FingertipConfig
from sim.config.stiffness import E_EPIDERMIS_MPA
from sim.config.units import GWT_N
from sim.contact.control import ForceNotReachedError, TooDeepError, solve_for_force
from sim.contact.indentor import ALONG, SHARP_RADIUS_MM, Indentor
from sim.contact.patch import X, Y, Z
from sim.contact.points import Pose
from sim.contact.profiles import Profile
from sim.contact.shapes import parse_shape
from sim.contact.solver import TARGET_RESIDUAL, ContactState, solve_contact
from sim.contact.touch import Touch, first_touch
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, place_receptors
from sim.models.cache import cached_arrays, content_key
from sim.models.condensed import CondensedModel, build_model, from_arrays, to_arrays
from sim.models.result import IndentationResult, PointLoadResult

Array = NDArray[np.float64]
Reference = Literal["contact", "apex"]
ModelLoader = Callable[[tuple[int, ...]], tuple[CondensedModel, bool]]

DEEPEST_DOI_MM = 2.0
"""The small-displacement model is not asked beyond this depth; the source's deepest is 1.33 mm."""

FARTHEST_X_MM = 20.0
"""Beyond this no part of a shape is over the pad."""

_FORCE_GUESS_MM = 0.3
_TOUCHES_KEPT = 64
_PRESS_IN_MM, _PRESS_IN_CORNER_MM, _PRESS_IN_FINE_MM = 0.2, 0.05, 0.0125
_ON_THE_WAY = 1e-4  # residual that is enough where the next step starts
_CORNER_REACH_MM = 0.1
_SIDE_RAD = 0.05  # of the section's widest places; below them the skin is no function of x
_AXIS_NAMES = {X: "x", Z: "z"}


class ModelRangeError(ValueError):
    """The scene asks for something outside what the model can answer."""


class _RimError(ModelRangeError, TooDeepError):
    """The indentor would touch skin that the patch does not hold."""


class Fingertip:
    """A condensed 3-D fingertip. It keeps no state: an indentation starts from rest unless told where from.

    A model is condensed for indentors that slope along some axes, when one is first needed.
    """

    def __init__(self, config: FingertipConfig, surface: FingertipSurface, load_model: ModelLoader) -> None:
        self.config = config
        self.surface = surface
        self.e_epidermis_mpa = E_EPIDERMIS_MPA
        self.from_cache = True
        self.build_s = 0.0
        self._load_model = load_model
        self._models: dict[tuple[int, ...], CondensedModel] = {}
        self._threads = ThreadpoolController()
        self._first_touch = lru_cache(maxsize=_TOUCHES_KEPT)(partial(first_touch, skin=surface))

    @classmethod
    def load(
        cls,
        config: FingertipConfig | None = None,
        *,
        slopes: tuple[int, ...] = ALONG,
        receptor_x_mm: Sequence[float] = DEFAULT_X_MM,
        receptor_depth_mm: float = DEFAULT_DEPTH_MM,
        solver: Literal["auto", "pardiso", "slabs"] = "auto",
    ) -> "Fingertip":
        """The fingertip of a configuration, its model for shapes that slope so read or built (seconds).

        Raises SurfaceError, MeshError or ReceptorError when geometry, mesh or receptors do not go together.
        """
        config = FingertipConfig() if config is None else config
        surface = FingertipSurface.fit(config.geometry)
        receptors = place_receptors(surface, np.array(receptor_x_mm), receptor_depth_mm, config.receptor_plane_mm)
        described = config.model_dump(mode="json", exclude={"contact"})

        def load_model(slopes: tuple[int, ...]) -> tuple[CondensedModel, bool]:
            key = content_key([described, list(receptor_x_mm), receptor_depth_mm, solver, list(slopes)])
            built: list[CondensedModel] = []

            def make() -> dict[str, NDArray[np.generic]]:
                built.append(build_model(config, surface, receptors, slopes, solver))
                return to_arrays(built[0])

            arrays, from_cache = cached_arrays(key, make)
            return (from_arrays(arrays, surface, receptors) if from_cache else built[0]), from_cache

        finger = cls(config, surface, load_model)
        finger.model_for(slopes)
        return finger

    def model_for(self, slopes: tuple[int, ...]) -> CondensedModel:
        """The model condensed for indentors that slope along some axes, from the cache or built (seconds)."""
        if slopes not in self._models:
            start = time.perf_counter()
            self._models[slopes], from_cache = self._load_model(slopes)
            self.from_cache = self.from_cache and from_cache
            self.build_s += time.perf_counter() - start
        return self._models[slopes]

    @property
    def model(self) -> CondensedModel:
        """The model for shapes prismatic along the finger."""
        return self.model_for(ALONG)

    @cached_property
    def apex_height_mm(self) -> float:
        """Height of the skin's topmost point."""
        ridge = self.surface.ridge
        return float(ridge(ridge.derivative().roots(extrapolate=False)).max())

    def touch_height_mm(
        self,
        indentor: Indentor | Profile | str,
        x_mm: float,
        reference: Reference = "contact",
        z_mm: float | None = None,
    ) -> float:
        """Height of the indentor's lowest point where DOI is zero.

        "contact" is first touch of the continuous skin at this place; "apex" the finger's topmost point.
        """
        shape = _indentor(indentor)
        place = self._place(shape, x_mm, z_mm)
        return self.apex_height_mm if reference == "apex" else self._first_touch(shape, place).height_mm

    def indent(
        self,
        indentor: Indentor | Profile | str,
        x_mm: float = 0.0,
        *,
        z_mm: float | None = None,
        doi_mm: float | None = None,
        force_gwt: float | None = None,
        reference: Reference = "contact",
        start: ContactState | None = None,
        target: float = TARGET_RESIDUAL,
    ) -> IndentationResult:
        """Press an indentor to a depth or to a force, from rest or on from a nearby state, to a target residual.

        Shapes prismatic along the finger are placed by x, the line by z (default: the receptor plane), round shapes
        by both. Raises ModelRangeError when the scene leaves the model: contact at the patch's rim, a place, depth
        or force out of range.
        """
        shape = _indentor(indentor)
        if (doi_mm is None) == (force_gwt is None):
            raise ModelRangeError("expected exactly one of a depth (doi_mm) and a force (force_gwt)")
        self._refuse_beside_the_finger(x_mm, z_mm)
        place = self._place(shape, x_mm, z_mm)
        touch = self._first_touch(shape, place)
        height = self.apex_height_mm if reference == "apex" else touch.height_mm
        between_nodes = self.config.contact.between_nodes and shape.sharp
        scene = _Scene(shape, place, height, touch, self.model_for(shape.axes), between_nodes, target)
        scene.refuse_touch_outside()
        began = time.thread_time()
        with self._threads.limit(limits=1, user_api="blas"):
            if doi_mm is not None:
                if not 0 < doi_mm <= DEEPEST_DOI_MM:
                    raise ModelRangeError(f"DOI {doi_mm:g} mm: expected 0 < DOI ≤ {DEEPEST_DOI_MM:g} mm")
                doi, state = doi_mm, scene.solve(doi_mm, start)
            else:
                assert force_gwt is not None
                doi, state = self._solve_force(scene, force_gwt)
        return IndentationResult(
            indentor=shape,
            x_mm=x_mm,
            z_mm=self.config.receptor_plane_mm if z_mm is None else z_mm,
            doi_mm=doi,
            touch_height_mm=height,
            force_n=state.normal_force * self.e_epidermis_mpa,
            state=state,
            model=self.model_for(shape.axes),
            e_epidermis_mpa=self.e_epidermis_mpa,
            contact_s=time.thread_time() - began,
            poisson=self.config.tissue.poisson,
        )

    def point_load(self, x_mm: float, force_gwt: float, *, z_mm: float | None = None) -> PointLoadResult:
        """Press on one point of the pulp's skin, along its inward normal. Raises ModelRangeError beside the pulp."""
        z = self.config.receptor_plane_mm if z_mm is None else z_mm
        if not 0 < z < self.config.geometry.length_mm:
            raise ModelRangeError(f"z = {z} mm: expected 0 … {self.config.geometry.length_mm:g} mm along the finger")
        left, right = (float(self.surface.section(phi, z)[0]) for phi in (math.pi - _SIDE_RAD, _SIDE_RAD))
        if not left < x_mm < right:
            raise ModelRangeError(f"x = {x_mm} mm: expected {left:.2f} … {right:.2f} mm, the pulp at z = {z:g} mm")
        force_n = _positive(force_gwt) * GWT_N
        model = next(iter(self._models.values()))
        strain = model.point_load(x_mm, z) * (force_n / self.e_epidermis_mpa)
        return PointLoadResult(x_mm, z, force_n, strain.reshape(-1, 6), model, self.config.tissue.poisson)

    def _place(self, shape: Indentor, x_mm: float, z_mm: float | None) -> tuple[float, ...]:
        """Where the reference point is, along the indentor's axes."""
        z = self.config.receptor_plane_mm if z_mm is None else z_mm
        return tuple({X: x_mm, Z: z}[axis] for axis in shape.axes)

    def _refuse_beside_the_finger(self, x_mm: float, z_mm: float | None) -> None:
        if not abs(x_mm) <= FARTHEST_X_MM:
            raise ModelRangeError(f"x = {x_mm} mm: expected a finite number within ± {FARTHEST_X_MM:g} mm")
        if z_mm is not None and not 0 <= z_mm <= self.config.geometry.length_mm:
            raise ModelRangeError(
                f"z = {z_mm} mm: expected 0 … {self.config.geometry.length_mm:g} mm along the finger"
            )

    def _solve_force(self, scene: "_Scene", force_gwt: float) -> tuple[float, ContactState]:
        force = _positive(force_gwt) * GWT_N / self.e_epidermis_mpa
        try:
            solve = scene.solve_from_rest if scene.indentor.sharp else scene.solve
            return solve_for_force(force, _FORCE_GUESS_MM, DEEPEST_DOI_MM, solve)
        except ForceNotReachedError as error:
            raise ModelRangeError(f"force {force_gwt:g} gwt: {error}") from None


@dataclass(frozen=True)
class _Scene:
    """An indentor over a model's patch, ready to be pressed."""

    indentor: Indentor
    place: tuple[float, ...]
    zero_mm: float  # height of the indentor's lowest point where DOI is zero
    touch: Touch
    model: CondensedModel
    between_nodes: bool
    target: float
    _pressed: dict[float, ContactState] = field(default_factory=dict)  # by depth past first touch, loosely solved

    def solve_from_rest(self, doi_mm: float, _: ContactState | None) -> ContactState:
        """The answer at a depth, whatever was solved before."""
        return self.solve(doi_mm, None)

    def solve(self, doi_mm: float, start: ContactState | None) -> ContactState:
        """At once from a start or for a smooth shape, else pressed in from first touch, finely if that misses."""
        in_steps = start is None and self.indentor.sharp
        state = self._pressed_in(doi_mm) if in_steps else self._at(doi_mm, start, self.target)
        if state.residual <= self.target:
            return state
        finer = self._pressed_in_finely(doi_mm)
        better = min((state, finer), key=lambda s: s.residual)
        if not better.converged:
            self._refuse_rim(self._pose(doi_mm), better)
        return replace(better, passes=state.passes + finer.passes)

    def _pressed_in(self, doi_mm: float) -> ContactState:
        """From first touch in long steps, and from where a corner bears in short ones: its side is chosen there."""
        before_mm, state = self._first_mm, None
        for depth in self._depths(_PRESS_IN_MM, before_mm, doi_mm):
            if depth not in self._pressed:
                self._pressed[depth] = self._onward(before_mm, depth, state, _ON_THE_WAY)
            before_mm, state = depth, self._pressed[depth]
        return self._onward(before_mm, doi_mm, state, self.target)

    def _onward(self, before_mm: float, doi_mm: float, start: ContactState | None, target: float) -> ContactState:
        if start is None or not self._at_corner(start):
            state = self._step(doi_mm, start, target)
            if not self._at_corner(state):
                return state
        for depth in self._depths(_PRESS_IN_CORNER_MM, before_mm, doi_mm):
            if depth not in self._pressed:
                self._pressed[depth] = self._step(depth, start, _ON_THE_WAY)
            start = self._pressed[depth]
        return self._step(doi_mm, start, target)

    def _pressed_in_finely(self, doi_mm: float) -> ContactState:
        state = None
        for depth in self._depths(_PRESS_IN_FINE_MM, self._first_mm, doi_mm):
            state = self._step(depth, state, self.target)
        return self._step(doi_mm, state, self.target)

    def _step(self, doi_mm: float, start: ContactState | None, target: float) -> ContactState:
        """Solved at a depth, the passes counted from rest."""
        state = self._at(doi_mm, start, target)
        return state if start is None else replace(state, passes=start.passes + state.passes)

    @property
    def _first_mm(self) -> float:
        """DOI at first touch: 0, unless counted from the apex."""
        return self.zero_mm - self.touch.height_mm

    @staticmethod
    def _depths(step_mm: float, after_mm: float, before_mm: float) -> list[float]:
        """Depths in equal steps between two others, both left out."""
        return np.arange(after_mm + step_mm, before_mm - 1e-9, step_mm).tolist()

    def _at_corner(self, state: ContactState) -> bool:
        """Whether a place that bears lies where the profile turns within less than a node's spacing."""
        patch = self.model.patch
        at = state.held.on(patch).interpolate(patch.tangential_mm + state.displacement[:-1])
        turning = self.indentor.turning(at - np.array(self.place)[:, None], _CORNER_REACH_MM)
        return bool((turning > 2 * _CORNER_REACH_MM / SHARP_RADIUS_MM).any())

    def _at(self, doi_mm: float, start: ContactState | None, target: float) -> ContactState:
        pose = self._pose(doi_mm)
        state = solve_contact(self.model.patch, pose, start, between_nodes=self.between_nodes, target=target)
        if state.converged:  # an unfinished state may touch anything on its way
            self._refuse_rim(pose, state)
        return state

    def _pose(self, doi_mm: float) -> Pose:
        return Pose(self.indentor, self.place, self.zero_mm - doi_mm, max(doi_mm, 1e-3))

    def refuse_touch_outside(self) -> None:
        """Refuse a scene in which the indentor first touches skin beside the patch."""
        for axis, at, nodes in zip(self.indentor.axes, self.touch.at_mm, self.model.patch.tangential_mm, strict=True):
            if not nodes.min() < at < nodes.max():
                self._refuse(f"touches the skin at {_AXIS_NAMES[axis]} = {at:.2f} mm, outside the patch")

    def _refuse_rim(self, pose: Pose, state: ContactState) -> None:
        """Refuse an answer when the indentor touches skin that the patch does not hold."""
        patch, beside = self.model.patch, self.model.outside_mm
        at_rim = np.flatnonzero(state.active & patch.rim)
        y = beside[:, Y] + state.displacement[-1][self.model.outside_neighbour]
        gap = pose.gap(beside[:, list(self.indentor.axes)].T, y).height_mm
        if len(at_rim) or (gap < 0).any():
            x, _, z = patch.position_mm[at_rim[0]] if len(at_rim) else beside[np.argmin(gap)]
            self._refuse(f"contact reaches the patch's rim at x = {x:.2f}, z = {z:.2f} mm")

    def _refuse(self, what: str) -> None:
        names = [_AXIS_NAMES[axis] for axis in self.indentor.axes]
        where = ", ".join(f"{name} = {at:g}" for name, at in zip(names, self.place, strict=True))
        size = "mesh.round_patch_mm" if len(names) > 1 else "mesh.patch_x_mm / patch_z_mm"
        raise _RimError(
            f"{self.indentor.name} at {where} mm: {what}; expected a smaller depth, a position nearer the pad's "
            f"centre, or a wider {size}"
        )


def _positive(force_gwt: float) -> float:
    if not (math.isfinite(force_gwt) and force_gwt > 0):
        raise ModelRangeError(f"force {force_gwt:g} gwt: expected a positive number")
    return force_gwt


def _indentor(shape: Indentor | Profile | str) -> Indentor:
    if isinstance(shape, Indentor):
        return shape
    return parse_shape(shape) if isinstance(shape, str) else Indentor.along(shape)
