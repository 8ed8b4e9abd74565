"""Fingertip that indentors can press, whatever its model."""

import math
import time
from collections.abc import Hashable, Sequence
from copy import copy
from dataclasses import replace
from functools import cache, cached_property, lru_cache, partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from sim.config import FingertipConfig, finger_config
from sim.contact.first_contact import first_touch
from sim.contact.indentor import ALONG, Indentor
from sim.contact.patch import X, Z
from sim.contact.profiles import IndentorProfile
from sim.contact.shapes import parse_shape
from sim.contact.solver import TARGET_RESIDUAL, ContactState
from sim.contact.warmup import make_ready
from sim.errors import (
    ArgumentError,
    ModelRangeError,
    positive,
    refuse_unless_numbers,
    refuse_unless_one,
    z_outside,
)
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, ReceptorPlaces, receptors_at
from sim.models.cache import keep_tops
from sim.models.condensed import CondensedModel
from sim.models.default_finger import is_default_finger
from sim.models.friction import (
    INCREMENT_MM,
    FrictionResult,
    PathOptions,
    Rubbed,
    checked_friction,
    rubbing_finger,
    with_all_axes,
)
from sim.models.interpolation import Interpolated
from sim.models.pictures import ModelOutline, finger_as_html
from sim.models.pressing import PlacedIndentor, Pressing, refuse_beside_the_finger, refuse_meaningless
from sim.models.result import IndentationResult, PointLoadResult
from sim.models.sources import ByRecipe, HalfWidths, MeshKey, ModelSource, OnDisk, Recipe, on_large_enough
from sim.models.stiffening import Under, refuse_stiffening, thickness_mm
from sim.models.strain_at_points import Anywhere, StrainAtAnyPoint
from sim.tables import numbers_of
from sim.units import GWT_N

Array = NDArray[np.float64]
Reference = Literal["contact", "apex"]

DEEPEST_DOI_MM, DEEPEST_SHARE = 2.0, 0.6
"""Largest DOI (mm), or this share of the tissue's thickness if that is more; the source's largest is 1.33 mm."""

_TOUCHES_KEPT = 64
_threads = cache(ThreadpoolController)  # looking for the libraries of BLAS takes some milliseconds
_SIDE_RAD = 0.05  # of the section's widest places; below them the skin is no function of x


class Fingertip(ByRecipe, StrainAtAnyPoint):
    """A condensed 3-D fingertip that indentors can press.

    `load` makes one. It stores no state: an indentation starts from rest unless it receives a start. A model is
    condensed for indentors that slope along some axes, when it is first needed. Copies share models. A pickle holds
    the configuration only; the process that reads it takes the models from the cache.

    Parameters
    ----------
    config : FingertipConfig
        Geometry, tissue, mesh and contact.
    surface : FingertipSurface
        The skin.
    source : ModelSource
        Where condensed models come from.
    recipe : Recipe
        How to load the finger again in another process.

    Notes
    -----
    Linear elasticity at small strain: skin displacement u = C p, with the compliance C condensed from finite
    elements, under unilateral frictionless contact, gap ≥ 0, p ≥ 0, p · gap = 0 (`docs/model.md`, `docs/contact.md`).
    Geometry and tissue: Raju (1998, ch. 3).

    Examples
    --------
    >>> from sim import Fingertip, FingertipConfig, MeshSpec
    >>> finger = Fingertip.load(FingertipConfig(mesh=MeshSpec(level="coarse")))
    >>> result = finger.indent("bar:3.0", x_mm=0.0, doi_mm=0.5)
    >>> 1.0 < result.force_gwt < 10.0
    True
    """

    def __init__(
        self, config: FingertipConfig, surface: FingertipSurface, source: ModelSource, recipe: Recipe
    ) -> None:
        self.config = config
        self.surface = surface
        self.recipe = recipe
        self.e_epidermis_mpa = config.tissue.e_epidermis_mpa
        self.from_cache = True
        self.build_s = 0.0
        self._source = source
        self._anywhere = Anywhere(source, config.tissue.poisson)
        self._models: dict[MeshKey, CondensedModel] = {}
        self._outlines: dict[MeshKey, ModelOutline] = {}
        self._paths: dict[Hashable, dict[float, ContactState]] | None = None
        self._held_mm: Array | None = None
        self.friction = 0.0
        self._with_all_axes: dict[tuple[int, ...], Fingertip] = {}
        self._first_touch = lru_cache(maxsize=_TOUCHES_KEPT)(partial(first_touch, skin=surface))
        self._under = lru_cache(maxsize=_TOUCHES_KEPT)(partial(Under, config, surface))

    @classmethod
    def load(
        cls,
        config: FingertipConfig | None = None,
        *,
        slopes: tuple[int, ...] = ALONG,
        receptor_x_mm: Sequence[float] = DEFAULT_X_MM,
        receptor_depth_mm: float | Sequence[float] = DEFAULT_DEPTH_MM,
        receptor_z_mm: float | Sequence[float] | None = None,
        exact: bool = True,
    ) -> "Fingertip":
        """Load the fingertip of a configuration: read its model from the cache, or build it in seconds.

        Receptors lie at every combination of x, depth and z. Other receptors are added to the same model.

        Parameters
        ----------
        config : FingertipConfig, optional
            Default: the default finger.
        slopes : tuple of int, optional
            Axes along which the first indentor slopes. Default: across the finger.
        receptor_x_mm : sequence of float, optional
            Lateral positions of the receptors (mm). Default: the ten of Raju (1998, ch. 5).
        receptor_depth_mm : float or sequence of float, optional
            Perpendicular depths below the skin (mm). Default: 0.76.
        receptor_z_mm : float or sequence of float, optional
            Positions along the finger (mm). Default: the receptor plane.
        exact : bool, optional
            If False, interpolate between fingers that differ in the moduli of dermis and fat (`docs/library.md`).

        Returns
        -------
        Fingertip
            The finger.

        Raises
        ------
        SurfaceError
            If no skin goes through the measured points.
        MeshError
            If the skin cannot be meshed.
        ReceptorError
            If a receptor lies outside the tissue.
        ModelRangeError
            If `exact` is False and a modulus is outside the interpolated range.
        """
        config = finger_config(config)
        surface = FingertipSurface.fit(config.geometry)
        keep_tops(surface)
        locations = ReceptorPlaces.of(receptor_x_mm, receptor_depth_mm, receptor_z_mm)
        receptors = receptors_at(config, surface, locations)
        recipe = Recipe.of(cls.load, config, slopes=slopes, exact=exact, **locations.as_options())
        full = OnDisk(config, surface, receptors)
        finger = cls(config, surface, full if exact else Interpolated(full), recipe)
        finger.model_for(slopes)
        return finger

    def __repr__(self) -> str:
        kind = next(iter(self._outlines.values())).kind if self._outlines else "finger"
        return f"<Fingertip {kind}, {self.config!r}>"

    def _repr_html_(self) -> str:
        section = np.stack(self.surface.section(np.linspace(0, 2 * np.pi, 181), self.config.receptor_plane_mm))
        return finger_as_html(section, next(iter(self._outlines.values())), repr(self))

    def model_for(self, slopes: tuple[int, ...], patch: HalfWidths | None = None) -> CondensedModel:
        """Return the model for indentors that slope along some axes; build it in seconds if there is none.

        Parameters
        ----------
        slopes : tuple of int
            Axes along which the indentor slopes.
        patch : tuple of float, optional
            Half-widths of the skin that an indentor may touch (mm). Default: those of the mesh.

        Returns
        -------
        CondensedModel
            The model.
        """
        key = slopes, patch
        if key not in self._models:
            make_ready()
            start = time.perf_counter()
            self._models[key], from_cache = self._source.model(key)
            self._outlines[key] = _outline(self._models[key], self.config, patch)
            self.from_cache = self.from_cache and from_cache
            self.build_s += time.perf_counter() - start
        return self._models[key]

    @property
    def model(self) -> CondensedModel:
        """Model for shapes that are prismatic along the finger."""
        return self.model_for(ALONG)

    @cached_property
    def apex_height_mm(self) -> float:
        """Height of the highest point of the skin (mm)."""
        ridge = self.surface.ridge
        return float(ridge(ridge.derivative().roots(extrapolate=False)).max())

    @cached_property
    def deepest_doi_mm(self) -> float:
        """Largest allowed depth of indentation (mm)."""
        share_mm = DEEPEST_SHARE * thickness_mm(self.config, self.surface)
        return max(DEEPEST_DOI_MM, math.floor(10 * share_mm) / 10)

    def touch_height_mm(
        self,
        indentor: Indentor | IndentorProfile | str,
        x_mm: float,
        reference: Reference = "contact",
        z_mm: float | None = None,
    ) -> float:
        """Return the height of the indentor's lowest point at DOI 0.

        Parameters
        ----------
        indentor : Indentor, IndentorProfile or str
            The shape, for example ``"bar:3.0"``.
        x_mm : float
            Lateral position of its reference point (mm).
        reference : {'contact', 'apex'}, optional
            DOI 0 is the first touch of the undeformed skin at this position, or the height of the finger's highest
            point.
        z_mm : float, optional
            Position along the finger (mm). Default: the receptor plane.

        Returns
        -------
        float
            Height (mm).

        Raises
        ------
        ShapeError
            If there is no such indentor.
        ModelRangeError
            If the position has no meaning for this shape.
        """
        shape = _indentor(indentor)
        refuse_unless_numbers(x_mm=x_mm, **({} if z_mm is None else {"z_mm": z_mm}))
        at_mm = self._place(shape, x_mm, z_mm)
        return self.apex_height_mm if reference == "apex" else self._first_touch(shape, at_mm).height_mm

    def indent(
        self,
        indentor: Indentor | IndentorProfile | str,
        x_mm: float = 0.0,
        *,
        z_mm: float | None = None,
        doi_mm: float | None = None,
        force_gwt: float | None = None,
        reference: Reference = "contact",
        start: ContactState | None = None,
        target: float = TARGET_RESIDUAL,
        other_paths: bool = False,
        friction: float | None = None,
        increment_mm: float | None = None,
    ) -> IndentationResult:
        """Press an indentor to a depth or to a force.

        Shapes along the finger are placed by x, those across it by z, all others by both, a plane by neither. Where
        contact leaves the mesh's patch a larger one is built (minutes, then cached).

        Parameters
        ----------
        indentor : Indentor, IndentorProfile or str
            The shape, for example ``"bar:3.0"``.
        x_mm : float, optional
            Lateral position of its reference point (mm).
        z_mm : float, optional
            Position along the finger (mm). Default: the receptor plane.
        doi_mm : float, optional
            Depth of indentation (mm). Pass either a depth or a force.
        force_gwt : float, optional
            Force (gwt).
        reference : {'contact', 'apex'}, optional
            DOI 0 is the first touch of the undeformed skin at this position, or the height of the finger's highest
            point.
        start : ContactState, optional
            Nearby state to continue from. Default: rest.
        target : float, optional
            Residual to reach.
        other_paths : bool, optional
            If the answer may depend on how it was reached, reach it by finer steps too, in five to eight times the
            time.
        friction : float, optional
            Coefficient of friction between indentor and skin, 0 to 10. Default: that of the finger, 0 unless
            `with_friction` set it. The first press with friction builds a model with the displacement along every
            axis (`docs/contact.md`).
        increment_mm : float, optional
            Longest increment of a path with friction (mm). Default: 0.05.

        Returns
        -------
        IndentationResult
            Force, pressure, contact and measures at the receptors; a `FrictionResult` with friction.

        Raises
        ------
        ArgumentError
            If the friction is out of range, or cannot be combined with another argument.
        ModelRangeError
            If the position, depth or force is out of range, or the contact needs a larger patch than there can be.
        ForceOutOfReachError
            If the force is not reached at the deepest allowed indentation.
        ShapeError
            If there is no such indentor.

        Notes
        -----
        Each pass freezes the indentor's tangent planes and solves the convex problem, gap ≥ 0, p ≥ 0, p · gap = 0,
        exactly (`docs/contact.md`).

        Examples
        --------
        >>> from sim import load
        >>> finger = load("halfspace")
        >>> by_force = finger.indent("cylinder:9", force_gwt=2.0)
        >>> by_depth = finger.indent("cylinder:9", doi_mm=by_force.doi_mm)
        >>> abs(by_depth.force_gwt - 2.0) < 1e-6
        True
        """
        shape = _indentor(indentor)
        refuse_unless_one(doi_mm, force_gwt)
        how = {"target": target, "friction": friction, "increment_mm": increment_mm}
        refuse_unless_numbers(**{name: value for name, value in how.items() if value is not None})
        refuse_beside_the_finger(self.config, x_mm, z_mm)
        at_mm = self._place(shape, x_mm, z_mm)
        touch = self._first_touch(shape, at_mm)
        height = self.apex_height_mm if reference == "apex" else touch.height_mm
        if doi_mm is not None:
            self._refuse_doi(doi_mm)
        if force_gwt is not None:
            positive(force_gwt)
        rubbing = self.friction if friction is None else friction
        if rubbing != 0:
            if other_paths:
                raise ArgumentError(
                    "friction and other paths cannot be combined; remove one", "friction_with_other_paths"
                )
            place = x_mm, self.config.receptor_plane_mm if z_mm is None else z_mm
            rubbed = self._rubbed(shape, rubbing, target, increment_mm)
            began = time.thread_time()
            with _threads().limit(limits=1, user_api="blas"):
                pressed = rubbed.press(place, touch, height, doi_mm, force_gwt, start)
            return replace(pressed, contact_s=time.thread_time() - began)

        def solved(model: CondensedModel) -> tuple[Pressing, float, ContactState, list[ContactState], float]:
            pressing = self._pressing(PlacedIndentor(shape, at_mm, height, touch, model), target)
            began = time.thread_time()
            pressing.placed.refuse_touch_outside()
            pressing.placed.refuse_narrow()
            with _threads().limit(limits=1, user_api="blas"):
                doi, state = self._solve(pressing, doi_mm, force_gwt, start)
                others = pressing.by_other_paths(doi) if other_paths and state.snapped else []
            return pressing, doi, state, others, time.thread_time() - began

        (pressing, doi, state, others, seconds), patch = on_large_enough(self, shape.axes, solved)
        strained, outline = pressing.strained(doi), self._outlines[shape.axes, patch]
        if self._held_mm is not None:
            outline = replace(outline, patch=pressing.lying(doi).placed.model.patch.nodes)
        return IndentationResult(
            indentor=shape,
            x_mm=x_mm,
            z_mm=self.config.receptor_plane_mm if z_mm is None else z_mm,
            doi_mm=doi,
            touch_height_mm=height,
            force_n=state.normal_force * strained.force * self.e_epidermis_mpa,
            state=state,
            model=outline,
            e_epidermis_mpa=self.e_epidermis_mpa,
            contact_s=seconds,
            _strain=partial(pressing.placed.model.strain, state.force),
            other_forces_n=tuple(other.normal_force * strained.force * self.e_epidermis_mpa for other in others),
            strained=strained,
        )

    def with_friction(self, friction: float) -> "Fingertip":
        """Copy the finger; the copy presses with friction.

        Parameters
        ----------
        friction : float
            Coefficient of friction between indentor and skin, 0 to 10.

        Returns
        -------
        Fingertip
            The copy. Without friction its answers are those of the finger.

        Raises
        ------
        ArgumentError
            If the friction is out of range.
        """
        copied = copy(self)
        copied.friction = checked_friction(friction)
        plain = self.recipe.arguments[0] if self.recipe.make is rubbing_finger else self.recipe
        copied.recipe = Recipe.of(rubbing_finger, plain, friction) if friction else plain  # type: ignore[assignment]
        return copied

    def drag(
        self,
        indentor: Indentor | IndentorProfile | str,
        x_mm: Sequence[float],
        doi_mm: float,
        increment_mm: float | None = None,
        *,
        level: bool = False,
    ) -> list[FrictionResult]:
        """Press at the first position, then slide the indentor from position to position at the same depth.

        Parameters
        ----------
        indentor : Indentor, IndentorProfile or str
            The shape, for example ``"bar:3.0"``.
        x_mm : sequence of float
            Lateral positions (mm), in the order in which they are reached.
        doi_mm : float
            Depth of indentation (mm), from first touch at each position.
        increment_mm : float, optional
            Longest increment of the path (mm). Default: 0.05.
        level : bool, optional
            If True, the indentor stays at the height of the first press; depths count from there.

        Returns
        -------
        list of FrictionResult
            One for each position.

        Raises
        ------
        ArgumentError
            If the finger has no friction (`with_friction`).
        ModelRangeError
            If a position or the depth is out of range.
        """
        shape, plane_mm = _indentor(indentor), self.config.receptor_plane_mm
        self._refuse_doi(doi_mm)
        x_mm = numbers_of("x_mm", x_mm).tolist()
        for x in x_mm:
            refuse_beside_the_finger(self.config, x, None)
        rubbed = self._rubbed(shape, self.friction, TARGET_RESIDUAL, increment_mm)
        touches = [self._first_touch(shape, self._place(shape, x, None)) for x in x_mm]
        zeros_mm = [touches[0].height_mm if level else touch.height_mm for touch in touches]
        places = [(x, plane_mm) for x in x_mm]
        began = time.thread_time()
        with _threads().limit(limits=1, user_api="blas"):
            found = rubbed.drag(list(zip(places, touches, zeros_mm, strict=True)), doi_mm)
        seconds = (time.thread_time() - began) / len(found)
        return [replace(one, contact_s=seconds) for one in found]

    def point_load(self, x_mm: float, force_gwt: float, *, z_mm: float | None = None) -> PointLoadResult:
        """Press on one point of the pulp's skin, along its inward normal.

        Parameters
        ----------
        x_mm : float
            Lateral position (mm).
        force_gwt : float
            Force (gwt); of a section, force per mm of its length.
        z_mm : float, optional
            Position along the finger (mm). Default: the receptor plane.

        Returns
        -------
        PointLoadResult
            Strain and measures at the receptors.

        Raises
        ------
        ModelRangeError
            If the point lies beside the pulp, is at another z than that of a section, or the tissue stiffens.
        """
        refuse_stiffening(self.config.tissue, "a point load")
        z = self.config.receptor_plane_mm if z_mm is None else z_mm
        refuse_unless_numbers(x_mm=x_mm, z_mm=z, force_gwt=force_gwt)
        length_mm = self.config.geometry.length_mm
        if not 0 < z < length_mm:
            raise z_outside(z, length_mm)
        left, right = (float(self.surface.section(phi, z)[0]) for phi in (math.pi - _SIDE_RAD, _SIDE_RAD))
        if not left < x_mm < right:
            raise ModelRangeError(
                f"x = {x_mm} mm: must be {left:.2f} to {right:.2f} mm, on the pulp at z = {z:g} mm", "x_beside_pulp"
            )
        force_n = positive(force_gwt) * GWT_N
        key, model = next(iter(self._models.items()))
        if model.kind == "section" and z != self.config.receptor_plane_mm:
            raise ModelRangeError(f"z = {z} mm: a section contains the receptor plane only; remove z", "z_of_section")
        strain = model.point_load(x_mm, z) * (force_n / self.e_epidermis_mpa)
        return PointLoadResult(x_mm, z, force_n, strain.reshape(-1, 6), self._outlines[key])

    def keeping_ways(self) -> "Fingertip":
        """Copy the finger; the copy stores the path to each depth and reuses it for other depths at that position.

        Returns
        -------
        Fingertip
            The copy. Its answers are the same.
        """
        copied = copy(self)
        copied._paths = {}
        return copied

    def held_by(self, slopes: tuple[int, ...], force: Array) -> "Fingertip":
        """Copy the finger with skin that forces already hold displaced; the copy answers for further forces.

        In tissue that has stiffened these are the forces of the tissue: those of its linear twin times a factor.

        Parameters
        ----------
        slopes : tuple of int
            Axes along which the indentor slopes.
        force : ndarray of shape (m, n)
            Forces on the patch's nodes, per unit E(epidermis).

        Returns
        -------
        Fingertip
            The copy.
        """
        copied = copy(self)
        no_larger = {"contact": self.config.contact.model_copy(update={"patch_gb": 0.0})}
        copied.config, copied._paths = self.config.model_copy(update=no_larger), None
        copied._held_mm = self.model_for(slopes).patch.displaced(force)
        return copied

    def _pressing(self, placed: PlacedIndentor, target: float) -> Pressing:
        between_nodes = self.config.contact.between_nodes and placed.indentor.between_nodes
        path = (placed.indentor, placed.place, placed.zero_mm, id(placed.model), target)
        states = {} if self._paths is None else self._paths.setdefault(path, {})
        under = self._under(placed.indentor, placed.place, placed.touch)
        return Pressing(placed, between_nodes, target, states, under, self._held_mm)

    def _refuse_doi(self, doi_mm: float) -> None:
        refuse_unless_numbers(doi_mm=doi_mm)
        if not 0 < doi_mm <= self.deepest_doi_mm:
            raise ModelRangeError(
                f"DOI {doi_mm:g} mm: must be more than 0 and at most {self.deepest_doi_mm:g} mm", "doi_outside"
            )

    def _rubbed(self, shape: Indentor, friction: float, target: float, increment_mm: float | None) -> Rubbed:
        """Return a shape over the model with the displacement along every axis, which is built if there is none."""
        if not checked_friction(friction):
            raise ArgumentError("the finger has no friction; use with_friction", "no_friction")
        refuse_stiffening(self.config.tissue, "friction")
        if self._held_mm is not None:
            raise ArgumentError("friction and relaxation cannot be combined; remove one", "friction_with_relaxation")
        increment = INCREMENT_MM if increment_mm is None else increment_mm
        refuse_unless_numbers(increment_mm=increment)
        how = PathOptions(friction, self.config.contact.between_nodes, target, positive(increment))
        plane_strain = next(iter(self._outlines.values())).kind == "section"
        if plane_strain:
            finger = self
        elif shape.axes in self._with_all_axes:
            finger = self._with_all_axes[shape.axes]
        else:
            finger = self._with_all_axes[shape.axes] = with_all_axes(self.recipe, shape.axes)
            self.build_s += finger.build_s
            self.from_cache = self.from_cache and finger.from_cache
        return Rubbed(finger, self.e_epidermis_mpa, shape, how, plane_strain)

    def _place(self, shape: Indentor, x_mm: float, z_mm: float | None) -> tuple[float, ...]:
        """Return the reference point along the indentor's axes. Raises ModelRangeError."""
        refuse_meaningless(shape, x_mm, z_mm)
        z = self.config.receptor_plane_mm if z_mm is None else z_mm
        return tuple({X: x_mm, Z: z}[axis] for axis in shape.axes)

    def _solve(
        self, pressing: Pressing, doi_mm: float | None, force_gwt: float | None, start: ContactState | None
    ) -> tuple[float, ContactState]:
        """Return DOI and state; a start on another patch is ignored."""
        if force_gwt is not None:
            return pressing.solve_force(positive(force_gwt), self.e_epidermis_mpa, self.deepest_doi_mm)
        assert doi_mm is not None
        fits = start is not None and start.displacement.shape[1] == len(pressing.placed.model.patch)
        return doi_mm, pressing.solve(doi_mm, start if fits else None)


def _outline(model: CondensedModel, config: FingertipConfig, patch: HalfWidths | None) -> ModelOutline:
    """Return the part of a model that results store."""
    return ModelOutline(
        patch=model.patch.nodes,
        patch_in_skin=model.patch_in_skin,
        receptor_row=model.receptor_row,
        receptors=model.receptors,
        receptor_e=model.columns.young_ratio,
        nodes=model.nodes,
        kind=model.kind,
        poisson=config.tissue.poisson,
        default_finger=is_default_finger(config),
        widened_mm=patch,
    )


def _indentor(shape: Indentor | IndentorProfile | str) -> Indentor:
    if isinstance(shape, Indentor):
        return shape
    if not isinstance(shape, str) and not hasattr(shape, "evaluate"):
        raise ArgumentError(
            f"indentor: must be a name such as 'bar:3.0', an Indentor or a profile, not {type(shape).__name__}; "
            "MeasuredProfile and HeightMap take arrays by from_arrays",
            "no_indentor",
        )
    return parse_shape(shape) if isinstance(shape, str) else Indentor.along(shape)
