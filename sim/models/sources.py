"""Sources of a finger's models and columns: the disk, or a new build each time."""

from collections.abc import Callable, Hashable
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.errors import ModelRangeError
from sim.finger.mesh import MeshError, angles_around, axial_places
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet
from sim.models.cache import Arrays, Layout, cached_arrays, content_key, path_of
from sim.models.condensed import STORED, Columns, CondensedModel, from_arrays, meshed_for, to_arrays
from sim.models.factored_interior import Interior
from sim.models.finger_3d import build_finger
from sim.models.pressing import RimError

if TYPE_CHECKING:
    from sim.models.fingertip import Fingertip

Solved = TypeVar("Solved")

# --- patches ---

Array = NDArray[np.float64]
HalfWidths = tuple[float, float]
"""Half-widths along x and z, in the receptor plane (mm)."""

_GROWTH = 1.25  # widths are the mesh's own times a power of this, so that presses share patches
_TOUCHED = 0.85  # contact width relative to the width over which the indentor lies below the undeformed skin
_MARGIN_MM = 1.5  # beyond a first touch
_FROM_ENDS_MM = 0.5  # distance from the finger's ends that the mesh requires
_OF_HALF_WIDTH = 0.93  # of the section: y is no function of x at its sides
_COPIES = 10  # of the compliance in memory during a build, including its factor; measured
_BYTES = 8


def half_widths(config: FingertipConfig, slopes: tuple[int, ...]) -> HalfWidths:
    """Return the half-widths of the mesh's own patch, for indentors that slope along some axes."""
    mesh = meshed_for(config, slopes).mesh
    return mesh.patch_x_mm, mesh.patch_z_mm


def widened(config: FingertipConfig, patch: HalfWidths | None) -> FingertipConfig:
    """Return the same finger with another patch."""
    if patch is None:
        return config
    sizes = {"patch_x_mm": patch[0], "patch_z_mm": patch[1], "round_patch_mm": 0.0}
    return config.model_copy(update={"mesh": config.mesh.model_copy(update=sizes)})


def on_large_enough(
    finger: "Fingertip", slopes: tuple[int, ...], solve: Callable[[CondensedModel], Solved]
) -> tuple[Solved, HalfWidths | None]:
    """Return the solution on the first patch that contact does not leave; the patch, or None for the mesh's own."""
    patch = None
    while True:
        model = finger.model_for(slopes, patch)
        try:
            return solve(model), patch
        except RimError as error:
            current = patch or half_widths(finger.config, slopes)
            patch = larger(finger.config, finger.surface, slopes, current, error)


def larger(
    config: FingertipConfig, surface: FingertipSurface, slopes: tuple[int, ...], patch: HalfWidths, error: RimError
) -> HalfWidths:
    """Return the next larger patch after contact reached the rim of one.

    Raises the RimError where there is none, and ModelRangeError where it would take too much memory.
    """
    if not config.contact.patch_gb:
        raise error
    centre = np.array([0.0, config.receptor_plane_mm])
    reach, others = np.abs(error.at_mm - centre), np.abs(error.others_mm - centre)
    spacing = np.array([config.mesh.spacing_mm, meshed_for(config, slopes).mesh.axial_mm])
    current, own, most = np.array(patch), np.array(half_widths(config, slopes)), _most(config, surface, spacing[1])
    at_rim = reach > current - 1.5 * spacing
    least = np.where(at_rim | ~at_rim.any(), _GROWTH * current, current)
    touched = _TOUCHED * others.max(axis=0) if len(others) else np.where(at_rim, reach + _MARGIN_MM, 0.0)
    steps = np.ceil(np.log(np.maximum(least, touched) / own) / np.log(_GROWTH) - 1e-6)
    next_mm = np.minimum(own * _GROWTH**steps, np.maximum(most, current))
    if (next_mm <= current).all() or (not len(others) and (reach >= next_mm).any()):
        raise error
    found = float(next_mm[0]), float(next_mm[1])
    _refuse_memory(config, surface, slopes, found, error)
    return found


def _most(config: FingertipConfig, surface: FingertipSurface, axial_mm: float) -> Array:
    """Return (2,) the largest half-widths that fit on the finger (mm)."""
    x, _ = surface.section(np.linspace(0.0, np.pi, 181), config.receptor_plane_mm)
    along = min(config.receptor_plane_mm, config.geometry.length_mm - config.receptor_plane_mm) - _FROM_ENDS_MM
    return np.array([_OF_HALF_WIDTH * min(x.max(), -x.min()), axial_mm * np.floor(along / axial_mm)])


def _refuse_memory(
    config: FingertipConfig, surface: FingertipSurface, slopes: tuple[int, ...], patch: HalfWidths, error: RimError
) -> None:
    meshed = meshed_for(widened(config, patch), slopes)
    try:
        nodes = int(axial_places(meshed)[1].sum()) * int(angles_around(meshed, surface)[1].sum())
    except MeshError:
        raise error from None
    needed_gb = _COPIES * _BYTES * (nodes * (len(slopes) + 1)) ** 2 / 1e9
    if needed_gb > config.contact.patch_gb:
        raise ModelRangeError(
            f"{error}; a patch of ± {patch[0]:.2f} × ± {patch[1]:.2f} mm would take {needed_gb:.2g} GB, more than "
            f"contact.patch_gb = {config.contact.patch_gb:g} GB",
            "patch_too_large",
        )


MeshKey = tuple[tuple[int, ...], HalfWidths | None]
"""Axes along which indentors slope, and the half-widths (mm) of a patch larger than the mesh's own."""


class ModelSource(Protocol):
    """Source of a finger's models, and of columns of strain under them."""

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """Return a model with the columns of the finger's own receptors, and whether all of it was on disk."""
        ...

    def interior(self, key: MeshKey) -> Interior | None:
        """Return the whole mesh of a model; None where strain anywhere does not need it."""
        ...

    def columns(self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None = None) -> Columns:
        """Return columns of any points, computed by `solve` if they are not stored. Raises ReceptorError."""
        ...


MODEL_LAYOUT: Layout = {
    **{"skin_z_mm": ("f", "z"), "skin_phi": ("f", "p"), "patch_in_skin": ("i", "n")},
    **{"outside_mm": ("f", "m3"), "outside_neighbour": ("i", "m")},
    **{"position_mm": ("f", "n3"), "area_mm2": ("f", "n"), "compliance": ("f", "kk")},
    **{"shape": ("i", "2"), "axes": ("i", "a"), "counts": ("i", "2")},
}
_COLUMNS_LAYOUT: Layout = {"young_ratio": ("f", "r"), "per_skin_force": ("f", "szp3")}


@dataclass(frozen=True)
class OnDisk:
    """Source with models and columns in separate files, so that other receptors reuse the same model."""

    config: FingertipConfig
    surface: FingertipSurface
    receptors: ReceptorSet

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """Read a model, or build it: one factorization gives model and columns."""
        slopes, patch = key
        timing_s: dict[str, float] = {}

        def make() -> Arrays:
            built = build_finger(widened(self.config, patch), self.surface, self.receptors, slopes)
            timing_s.update(built.timing_s)
            self.columns(key, self.receptors, lambda: built.columns)
            return {name: np.ascontiguousarray(array) for name, array in to_arrays(built).items()}

        # the same to the last bit, made or read
        arrays, read = cached_arrays(content_key(self.made_of(key)), make, layout=MODEL_LAYOUT)
        columns, columns_read = self._columns(key, self.receptors, None)
        return replace(from_arrays(arrays, self.surface, columns), timing_s=timing_s), read and columns_read

    def interior(self, key: MeshKey) -> Interior:
        """Return the mesh, which is factored on first use."""
        slopes, patch = key
        return Interior(widened(self.config, patch), self.surface, slopes)

    def columns(self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None = None) -> Columns:
        """Read columns, or solve for them."""
        return self._columns(key, receptors, solve)[0]

    def _columns(
        self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None
    ) -> tuple[Columns, bool]:
        solve = solve or (lambda: self.interior(key).columns(receptors))
        arrays, read = cached_arrays(
            self._columns_key(key, receptors), lambda: solve().as_arrays(), "columns", _COLUMNS_LAYOUT
        )
        return Columns(receptors, *(np.asarray(arrays[name], dtype=float) for name in STORED)), read

    def columns_path(self, key: MeshKey) -> Path:
        """Return the path of the columns of the finger's own receptors."""
        return path_of(self._columns_key(key, self.receptors), "columns")

    def _columns_key(self, key: MeshKey, receptors: ReceptorSet) -> str:
        return content_key([*self.made_of(key), receptors.position_mm.tolist()])

    def made_of(self, key: MeshKey) -> list[object]:
        """Return all inputs that determine a model, except the code."""
        slopes, patch = key
        described = self.config.model_dump(
            mode="json", exclude={"contact": True, "tissue": {"stiffness", "strain", "stiffening"}}
        )
        return [described, list(slopes), patch and list(patch)]


@dataclass(frozen=True)
class Anew:
    """Source that builds each time: `build` a model with columns of receptors, `whole` the mesh of a finger."""

    build: Callable[[MeshKey, ReceptorSet], CondensedModel]
    receptors: ReceptorSet
    whole: Callable[[MeshKey], Interior] | None = None

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """Build a model."""
        return self.build(key, self.receptors), False

    def interior(self, key: MeshKey) -> Interior | None:
        """Return the mesh of a finger, None for other models."""
        return None if self.whole is None else self.whole(key)

    def columns(self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None = None) -> Columns:
        """Compute columns by an adjoint solve where there is a whole mesh, else build a model for them."""
        return self.build(key, receptors).columns if solve is None else solve()


# --- recipe ---
#
# A pickled finger holds the call that made it instead of its matrices.

_KEPT = 2


class Recipe(NamedTuple):
    """Call that makes a finger: an importable function, its positional and its keyword arguments."""

    make: Callable[..., Any]
    arguments: tuple[Hashable, ...]
    options: tuple[tuple[str, Hashable], ...]

    @classmethod
    def of(cls, make: Callable[..., Any], *arguments: Hashable, **options: Hashable) -> "Recipe":
        """Return the recipe of a call."""
        return cls(make, arguments, tuple(options.items()))


@lru_cache(maxsize=_KEPT)
def made(recipe: Recipe) -> Any:
    """Return the result of a recipe, cached, so that a process reads a finger's models once for all its tasks."""
    return recipe.make(*recipe.arguments, **dict(recipe.options))


class ByRecipe:
    """Base class whose copies share all that is costly, and whose pickles hold recipe and stiffness scale only."""

    recipe: Recipe
    e_epidermis_mpa: float

    def __copy__(self) -> Self:
        copied = object.__new__(type(self))
        copied.__dict__.update(self.__dict__)
        return copied

    def __deepcopy__(self, _: dict[int, object]) -> Self:
        return copy(self)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Recipe, float]]:
        return _anew, (self.recipe, self.e_epidermis_mpa)


def _anew(recipe: Recipe, e_epidermis_mpa: float) -> Any:
    finger = copy(made(recipe))
    finger.e_epidermis_mpa = e_epidermis_mpa
    return finger
