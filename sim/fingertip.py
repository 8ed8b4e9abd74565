"""The door to the simulator: a fingertip that can be indented."""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from sim.cache import cached_arrays, content_key
from sim.config import FingertipConfig
from sim.contact.control import ForceNotReachedError, solve_for_force
from sim.contact.indentors import Profile
from sim.contact.shapes import parse_shape
from sim.contact.solver import TARGET_RESIDUAL, ContactState, Pose, solve_contact
from sim.contact.touch import first_touch
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, place_receptors
from sim.model import CondensedModel, build_model, from_arrays, to_arrays
from sim.result import IndentationResult
from sim.stiffness import E_EPIDERMIS_MPA
from sim.units import GWT_N

Array = NDArray[np.float64]
Reference = Literal["contact", "apex"]

DEEPEST_DOI_MM = 2.0
"""The small-displacement model is not asked beyond this depth; the source's deepest is 1.33 mm."""

FARTHEST_X_MM = 20.0
"""Beyond this no part of a shape is over the pad."""

_FORCE_GUESS_MM = 0.3
_PRESS_IN_MM = 0.05


class ModelRangeError(ValueError):
    """The scene asks for something outside what the model can answer."""


class Fingertip:
    """A condensed 3-D fingertip. It keeps no state: an indentation starts from rest unless told where from."""

    def __init__(self, config: FingertipConfig, model: CondensedModel, *, from_cache: bool, build_s: float) -> None:
        self.config = config
        self.model = model
        self.from_cache = from_cache
        self.build_s = build_s
        self.e_epidermis_mpa = E_EPIDERMIS_MPA
        self._threads = ThreadpoolController()

    @classmethod
    def load(
        cls,
        config: FingertipConfig | None = None,
        *,
        receptor_x_mm: Sequence[float] = DEFAULT_X_MM,
        receptor_depth_mm: float = DEFAULT_DEPTH_MM,
        solver: Literal["auto", "pardiso", "slabs"] = "auto",
    ) -> "Fingertip":
        """The fingertip of a configuration, from the cache or built (seconds).

        Raises SurfaceError, MeshError or ReceptorError when geometry, mesh or receptors do not go together.
        """
        start = time.perf_counter()
        config = FingertipConfig() if config is None else config
        surface = FingertipSurface.fit(config.geometry)
        receptors = place_receptors(surface, np.array(receptor_x_mm), receptor_depth_mm, config.receptor_plane_mm)
        key = content_key([config.model_dump(mode="json"), list(receptor_x_mm), receptor_depth_mm, solver])
        built: list[CondensedModel] = []

        def make() -> dict[str, NDArray[np.generic]]:
            built.append(build_model(config, surface, receptors, solver))
            return to_arrays(built[0])

        arrays, from_cache = cached_arrays(key, make)
        model = from_arrays(arrays, surface, receptors) if from_cache else built[0]
        return cls(config, model, from_cache=from_cache, build_s=time.perf_counter() - start)

    @cached_property
    def apex_height_mm(self) -> float:
        """Height of the skin's topmost point."""
        ridge = self.model.surface.ridge
        return float(ridge(ridge.derivative().roots(extrapolate=False)).max())

    def touch_height_mm(self, indentor: Profile | str, x_mm: float, reference: Reference = "contact") -> float:
        """Height of the indentor's lowest point where DOI is zero.

        "contact" is first touch of the continuous skin at this x; "apex" the finger's topmost point.
        """
        return self._touch(_profile(indentor), x_mm, reference)[0]

    def indent(
        self,
        indentor: Profile | str,
        x_mm: float,
        *,
        doi_mm: float | None = None,
        force_gwt: float | None = None,
        reference: Reference = "contact",
        start: ContactState | None = None,
    ) -> IndentationResult:
        """Press an indentor at x to a depth or to a force, from rest or on from a nearby state.

        Raises ModelRangeError when the scene leaves the model: contact at the patch's rim, a depth or force
        out of range.
        """
        profile = _profile(indentor)
        if (doi_mm is None) == (force_gwt is None):
            raise ModelRangeError("expected exactly one of a depth (doi_mm) and a force (force_gwt)")
        if not abs(x_mm) <= FARTHEST_X_MM:
            raise ModelRangeError(f"x = {x_mm} mm: expected a finite number within ± {FARTHEST_X_MM:g} mm")
        touch, touch_x = self._touch(profile, x_mm, reference)
        began = time.perf_counter()
        with self._threads.limit(limits=1, user_api="blas"):
            if doi_mm is not None:
                if not 0 < doi_mm <= DEEPEST_DOI_MM:
                    raise ModelRangeError(f"DOI {doi_mm:g} mm: expected 0 < DOI ≤ {DEEPEST_DOI_MM:g} mm")
                doi, state = doi_mm, self._solve(profile, x_mm, touch, doi_mm, start)
            else:
                assert force_gwt is not None
                doi, state = self._solve_force(profile, x_mm, touch, force_gwt)
        self._refuse_rim(profile, x_mm, touch_x, touch - doi, state)
        return IndentationResult(
            profile=profile,
            x_mm=x_mm,
            doi_mm=doi,
            touch_height_mm=touch,
            force_n=state.normal_force * self.e_epidermis_mpa,
            state=state,
            model=self.model,
            e_epidermis_mpa=self.e_epidermis_mpa,
            contact_s=time.perf_counter() - began,
            poisson=self.config.tissue.poisson,
        )

    def _touch(self, profile: Profile, x_mm: float, reference: Reference) -> tuple[float, float]:
        height, at = first_touch(profile, x_mm, self.model.surface.ridge)
        return (self.apex_height_mm if reference == "apex" else height), at

    def _solve(
        self, profile: Profile, x_mm: float, touch: float, doi: float, start: ContactState | None
    ) -> ContactState:
        """At once; where that misses the target, by pressing in from first touch."""

        def at(depth: float, near: ContactState | None) -> ContactState:
            return solve_contact(self.model.patch, Pose(profile, x_mm, touch - depth, max(depth, 1e-3)), near)

        state = at(doi, start)
        if state.residual <= TARGET_RESIDUAL:
            return state
        pressed = None
        for depth in np.linspace(0.0, doi, math.ceil(doi / _PRESS_IN_MM) + 1)[1:]:
            pressed = at(float(depth), pressed)
        assert pressed is not None
        better = min((state, pressed), key=lambda s: s.residual)
        return replace(better, passes=state.passes + pressed.passes)

    def _solve_force(
        self, profile: Profile, x_mm: float, touch: float, force_gwt: float
    ) -> tuple[float, ContactState]:
        if not (math.isfinite(force_gwt) and force_gwt > 0):
            raise ModelRangeError(f"force {force_gwt:g} gwt: expected a positive number")
        force = force_gwt * GWT_N / self.e_epidermis_mpa
        try:
            return solve_for_force(
                force, _FORCE_GUESS_MM, DEEPEST_DOI_MM, lambda d, s: self._solve(profile, x_mm, touch, d, s)
            )
        except ForceNotReachedError as error:
            raise ModelRangeError(f"force {force_gwt:g} gwt: {error}") from None

    def _refuse_rim(self, profile: Profile, x_mm: float, touch_x: float, height: float, state: ContactState) -> None:
        """Refuse an answer when the indentor touches skin that the patch does not hold."""
        patch = self.model.patch
        scene = f"{profile.name} at x = {x_mm:g} mm"
        hint = "expected a smaller depth, a position nearer the pad's centre, or a wider mesh.patch_x_mm / patch_z_mm"
        low, high = patch.x.min(), patch.x.max()
        if not low < touch_x < high:
            raise ModelRangeError(f"{scene}: touches the skin at x = {touch_x:.2f} mm, outside the patch; {hint}")
        at_rim = np.flatnonzero(state.active & patch.rim)
        beside, nearest = self.model.outside_mm, self.model.outside_neighbour
        gap = height + profile.evaluate(beside[:, 0] - x_mm)[0] - beside[:, 1] - state.displacement[1][nearest]
        if len(at_rim) or (gap < 0).any():
            x, _, z = patch.position_mm[at_rim[0]] if len(at_rim) else beside[np.argmin(gap)]
            where = f"x = {x:.2f}, z = {z:.2f} mm"
            raise ModelRangeError(f"{scene}: contact reaches the patch's rim at {where}; {hint}")


def _profile(indentor: Profile | str) -> Profile:
    return parse_shape(indentor) if isinstance(indentor, str) else indentor
