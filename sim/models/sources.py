"""Where a finger's models and columns come from: the disk, or made anew each time."""

from collections.abc import Callable, Hashable
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.errors import ModelRangeError
from sim.finger.mesh import MeshError, angles_around, axial_places
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet
from sim.models.cache import Arrays, cached_arrays, content_key, path_of
from sim.models.condensed import STORED, Columns, CondensedModel, from_arrays, meshed_for, to_arrays
from sim.models.factored_interior import Interior
from sim.models.finger_3d import build_finger
from sim.models.pressing import RimError

# --- patches ---
#
# A larger patch for a scene that leaves the mesh's own: how large, and whether it fits into the memory.

Array = NDArray[np.float64]
HalfWidths = tuple[float, float]
"""Half-widths along x and z, in the receptor plane (mm)."""

_GROWTH = 1.25  # a patch is so many times as wide as the mesh's own, or a power of that: scenes share them
_TOUCHED = 0.85  # how far contact goes of how far the indentor would lie below the undeformed skin
_MARGIN_MM = 1.5  # beyond a first touch
_FROM_ENDS_MM = 0.5  # of the finger, as the mesh wants it
_OF_HALF_WIDTH = 0.93  # of the section; its sides are no function of x
_COPIES = 10  # of the compliance while it is made, the factor that it comes from counted in; measured
_BYTES = 8


def half_widths(config: FingertipConfig, slopes: tuple[int, ...]) -> HalfWidths:
    """Of the patch that the mesh has by itself, for indentors that slope along some axes."""
    mesh = meshed_for(config, slopes).mesh
    return mesh.patch_x_mm, mesh.patch_z_mm


def widened(config: FingertipConfig, patch: HalfWidths | None) -> FingertipConfig:
    """The same finger with another patch."""
    if patch is None:
        return config
    sizes = {"patch_x_mm": patch[0], "patch_z_mm": patch[1], "round_patch_mm": 0.0}
    return config.model_copy(update={"mesh": config.mesh.model_copy(update=sizes)})


def larger(
    config: FingertipConfig, surface: FingertipSurface, slopes: tuple[int, ...], patch: HalfWidths, met: RimError
) -> HalfWidths:
    """The next larger patch where an indentor met the rim of one.

    Raises `met` where there is none, and ModelRangeError where it would take too much memory.
    """
    if not config.contact.patch_gb:
        raise met
    centre = np.array([0.0, config.receptor_plane_mm])
    reach, others = np.abs(met.at_mm - centre), np.abs(met.others_mm - centre)
    spacing = np.array([config.mesh.spacing_mm, meshed_for(config, slopes).mesh.axial_mm])
    now, own, most = np.array(patch), np.array(half_widths(config, slopes)), _most(config, surface, spacing[1])
    at_rim = reach > now - 1.5 * spacing
    least = np.where(at_rim | ~at_rim.any(), _GROWTH * now, now)
    touched = _TOUCHED * others.max(axis=0) if len(others) else np.where(at_rim, reach + _MARGIN_MM, 0.0)
    steps = np.ceil(np.log(np.maximum(least, touched) / own) / np.log(_GROWTH) - 1e-6)
    then = np.minimum(own * _GROWTH**steps, np.maximum(most, now))
    if (then <= now).all() or (not len(others) and (reach >= then).any()):
        raise met
    found = float(then[0]), float(then[1])
    _refuse_memory(config, surface, slopes, found, met)
    return found


def _most(config: FingertipConfig, surface: FingertipSurface, axial_mm: float) -> Array:
    """(2,) the largest half-widths that the finger has room for."""
    x, _ = surface.section(np.linspace(0.0, np.pi, 181), config.receptor_plane_mm)
    along = min(config.receptor_plane_mm, config.geometry.length_mm - config.receptor_plane_mm) - _FROM_ENDS_MM
    return np.array([_OF_HALF_WIDTH * min(x.max(), -x.min()), axial_mm * np.floor(along / axial_mm)])


def _refuse_memory(
    config: FingertipConfig, surface: FingertipSurface, slopes: tuple[int, ...], patch: HalfWidths, met: RimError
) -> None:
    meshed = meshed_for(widened(config, patch), slopes)
    try:
        nodes = int(axial_places(meshed)[1].sum()) * int(angles_around(meshed, surface)[1].sum())
    except MeshError:
        raise met from None
    needed_gb = _COPIES * _BYTES * (nodes * (len(slopes) + 1)) ** 2 / 1e9
    if needed_gb > config.contact.patch_gb:
        raise ModelRangeError(
            "{problem}; a patch of ± {patch_x_mm:.2f} × ± {patch_z_mm:.2f} mm would take {needed_gb:.2g} GB, "
            "more than contact.patch_gb = {patch_gb:g} GB",
            code="patch_too_large",
            problem=str(met),
            patch_x_mm=patch[0],
            patch_z_mm=patch[1],
            needed_gb=needed_gb,
            patch_gb=config.contact.patch_gb,
        )


MeshKey = tuple[tuple[int, ...], HalfWidths | None]
"""The axes along which indentors slope, and the half-widths (mm) of a patch that is not the mesh's own."""


class ModelSource(Protocol):
    """Gives a finger's models, and columns of strain under them."""

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """A model with the columns of the finger's own receptors, and whether all of it was on disk."""
        ...

    def interior(self, key: MeshKey) -> Interior | None:
        """The whole mesh of a model; None where strain anywhere is to be had without."""
        ...

    def columns(self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None = None) -> Columns:
        """Columns of any places; `solve` makes them where they are not known. Raises ReceptorError."""
        ...


@dataclass(frozen=True)
class OnDisk:
    """A finger's models and columns in files of their own: other receptors are a small one beside the same model."""

    config: FingertipConfig
    surface: FingertipSurface
    receptors: ReceptorSet
    solver: str

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """Read, or built: then one factorisation makes model and columns."""
        slopes, patch = key
        timing_s: dict[str, float] = {}

        def make() -> Arrays:
            built = build_finger(widened(self.config, patch), self.surface, self.receptors, slopes, self.solver)
            timing_s.update(built.timing_s)
            self.columns(key, self.receptors, lambda: built.columns)
            return {name: np.ascontiguousarray(array) for name, array in to_arrays(built).items()}

        arrays, read = cached_arrays(content_key(self.made_of(key)), make)  # the same to the last bit, made or read
        columns, as_well = self._columns(key, self.receptors, None)
        return replace(from_arrays(arrays, self.surface, columns), timing_s=timing_s), read and as_well

    def interior(self, key: MeshKey) -> Interior:
        """The mesh and, when it is needed, its factor."""
        slopes, patch = key
        return Interior(widened(self.config, patch), self.surface, slopes, self.solver)

    def columns(self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None = None) -> Columns:
        """Read, or solved for."""
        return self._columns(key, receptors, solve)[0]

    def _columns(
        self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None
    ) -> tuple[Columns, bool]:
        solve = solve or (lambda: self.interior(key).columns(receptors))
        arrays, read = cached_arrays(self._columns_key(key, receptors), lambda: solve().as_arrays(), "columns")
        return Columns(receptors, *(np.asarray(arrays[name], dtype=float) for name in STORED)), read

    def columns_path(self, key: MeshKey) -> Path:
        """Where those of the finger's own receptors are kept."""
        return path_of(self._columns_key(key, self.receptors), "columns")

    def _columns_key(self, key: MeshKey, receptors: ReceptorSet) -> str:
        return content_key([*self.made_of(key), receptors.position_mm.tolist()])

    def made_of(self, key: MeshKey) -> list[object]:
        """What says how a model comes out, but for the code."""
        slopes, patch = key
        described = self.config.model_dump(
            mode="json", exclude={"contact": True, "tissue": {"stiffness", "stiffening"}}
        )
        return [described, self.solver, list(slopes), patch and list(patch)]


@dataclass(frozen=True)
class Anew:
    """Made each time; `build` gives a model with the columns of some receptors, or `whole` the mesh of a finger."""

    build: Callable[[MeshKey, ReceptorSet], CondensedModel]
    receptors: ReceptorSet
    whole: Callable[[MeshKey], Interior] | None = None

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """Built."""
        return self.build(key, self.receptors), False

    def interior(self, key: MeshKey) -> Interior | None:
        """Of a finger."""
        return None if self.whole is None else self.whole(key)

    def columns(self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None = None) -> Columns:
        """By an adjoint solve where there is a whole mesh, else with a model that is built for them."""
        return self.build(key, receptors).columns if solve is None else solve()


# --- recipe ---
#
# How a finger crosses processes: by what it was made from, never by its matrices.

_KEPT = 2


class Recipe(NamedTuple):
    """A call that makes the finger: an importable function, its arguments, and those that go by name."""

    make: Callable[..., Any]
    arguments: tuple[Hashable, ...]
    options: tuple[tuple[str, Hashable], ...]

    @classmethod
    def of(cls, make: Callable[..., Any], *arguments: Hashable, **options: Hashable) -> "Recipe":
        """The recipe that calls it so."""
        return cls(make, arguments, tuple(options.items()))


@lru_cache(maxsize=_KEPT)
def made(recipe: Recipe) -> Any:
    """What a recipe makes, kept: a process to which a finger is sent with each task reads its models once."""
    return recipe.make(*recipe.arguments, **dict(recipe.options))


class ByRecipe:
    """Copies share everything that is costly, and a pickle holds the recipe and the stiffness scale only."""

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
