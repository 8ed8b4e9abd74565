"""Where a finger's models and columns come from: the disk, or made anew each time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from sim.config.fingertip_config import FingertipConfig
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet
from sim.models.cache import Arrays, cached_arrays, content_key, path_of
from sim.models.condensed import CondensedModel, from_arrays, to_arrays
from sim.models.inside.columns import STORED, Columns
from sim.models.inside.interior import Interior
from sim.models.patches import HalfWidths, widened
from sim.models.whole_finger import build_finger

MeshKey = tuple[tuple[int, ...], HalfWidths | None]
"""The axes along which indentors slope, and the half-widths of a patch that is not the mesh's own."""


class Source(Protocol):
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
