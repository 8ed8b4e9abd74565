"""A finger of the project and its section as bodies of either kind, on one mesh, and where they are first touched."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.first_contact import first_touch
from sim.contact.patch import X, Z
from sim.contact.shapes import parse_shape
from sim.fem.elements import lame
from sim.finger.mesh import FingerMesh, build_mesh, section_mesh
from sim.finger.surface import FingertipSurface
from sim.models.condensed import young_ratios
from sim.models.section import prismatic
from studies.finite_strain.solver.body import Body, LinearBricks
from studies.finite_strain.solver.bricks import Dilatation, Moduli, bricks
from studies.finite_strain.solver.laws import Law, NeoHookean
from studies.finite_strain.solver.rigid import Rigid, Skin

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Kind = Literal["finger", "section"]

_SLICES = 3  # of a section, alike: one of them stands for all


@dataclass(frozen=True)
class Specimen:
    """A finger of a configuration, whole or as its section in plane strain (forces then per mm of length)."""

    config: FingertipConfig
    kind: Kind = "finger"

    @cached_property
    def surface(self) -> FingertipSurface:
        """Its skin."""
        surface = FingertipSurface.fit(self.config.geometry)
        return surface if self.kind == "finger" else prismatic(surface, self.config.receptor_plane_mm)

    @cached_property
    def mesh(self) -> FingerMesh:
        """Its mesh."""
        return (build_mesh if self.kind == "finger" else section_mesh)(self.config, self.surface)

    @cached_property
    def unknown(self) -> Ints:
        """(n_nodes, 3) of every displacement, −1 where it is held; alike on the faces of a section."""
        free = np.repeat(~self.mesh.fixed[:, None], 3, axis=1)
        if self.kind == "finger":
            return np.where(free, np.cumsum(free.ravel()).reshape(free.shape) - 1, -1)
        face = free.reshape(*self.mesh.grid, 3)[0].reshape(-1, 3)
        face[:, Z] = False
        number = np.where(face, np.cumsum(face.ravel()).reshape(face.shape) - 1, -1)
        return np.tile(number, (self.mesh.grid[0], 1))

    def body(self, law: Law | None, dilatation: Dilatation = "bbar") -> Body:
        """Of a law's tissue, or linear if there is none."""
        mesh, one = self.mesh, self.one_slice
        poisson = self.config.tissue.poisson
        moduli = Moduli(*lame(young_ratios(self.config.tissue)[mesh.layer[one]], poisson))
        hyperelastic = bricks(mesh.nodes, mesh.hexes[one], moduli, law or NeoHookean(), dilatation)
        elements = hyperelastic if law else LinearBricks.like(hyperelastic, mesh.nodes, poisson)
        return Body(elements, self.unknown, 1.0 if self.kind == "finger" else float(_SLICES))

    @cached_property
    def skin(self) -> Skin:
        """The nodes that may be touched."""
        nodes = self.mesh.patch_nodes
        return Skin(self.mesh.nodes[nodes], self.unknown[nodes], self.mesh.patch_area_mm2)

    def at_the_rim(self, nodes: Ints) -> bool:
        """Whether any of the skin's nodes lie at the end of what may be touched."""
        rows, columns = self.mesh.patch_shape
        row, column = np.divmod(nodes, columns)
        across = (column == 0) | (column == columns - 1)
        along = (row == 0) | (row == rows - 1) if self.kind == "finger" else False
        return bool((across | along).any())

    def touch(self, shape: str, x_mm: float = 0.0) -> Rigid:
        """An indentor where it first touches the continuous skin, at x and in the receptor plane."""
        indentor = parse_shape(shape)
        at = tuple({X: x_mm, Z: self.config.receptor_plane_mm}[axis] for axis in indentor.axes)
        return Rigid(indentor, at, first_touch(indentor, at, self.surface).height_mm)

    @property
    def one_slice(self) -> slice:
        """The elements that stand for all."""
        n = len(self.mesh.hexes)
        return slice(None) if self.kind == "finger" else slice(n // _SLICES, 2 * n // _SLICES)
