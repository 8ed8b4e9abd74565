"""Condensed skin: nodes that an indentor may touch, the points between them, and their compliance."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

X, Y, Z = range(3)

STRIPS_ACROSS = (0.25, 0.5, 0.75)
"""How far from one side of a face to the other its strips lie; along them points divide it into as many parts."""

_ROWS_AT_ONCE = 64


@dataclass(frozen=True)
class PatchNodes:
    """Skin nodes on a (rows along z, columns along φ) grid that an indentor may touch."""

    position_mm: Array  # (n, 3) undeformed
    area_mm2: Array  # (n,) tributary, undeformed
    shape: tuple[int, int]
    axes: tuple[int, ...] = (X, Y)  # axes along which indentors may slope, then the vertical

    def __len__(self) -> int:
        return len(self.position_mm)

    @property
    def x(self) -> Array:
        """(n,) undeformed lateral positions (mm)."""
        return self.position_mm[:, X]

    @property
    def y(self) -> Array:
        """(n,) undeformed heights (mm)."""
        return self.position_mm[:, Y]

    @cached_property
    def tangential_mm(self) -> Array:
        """(m − 1, n) undeformed positions along the axes in which indentors slope."""
        return np.ascontiguousarray(self.position_mm[:, list(self.axes[:-1])].T)

    @cached_property
    def rim(self) -> NDArray[np.bool_]:
        """(n,) mask of the outermost rows and columns; a section has no outermost row."""
        rim = np.ones(self.shape, dtype=bool)
        rim[:, 1:-1] = False
        if self.shape[0] > 1:
            rim[[0, -1]] = True
        return rim.ravel()

    def spacing_mm(self, at_mm: tuple[float, ...]) -> float:
        """Return the longer side of the elements around a place (mm) on a patch with two axes of slope."""
        grid = self.position_mm.reshape(*self.shape, 3)
        away = np.abs(grid[..., list(self.axes[:-1])] - np.array(at_mm)).max(axis=-1)
        row, column = np.unravel_index(int(np.argmin(away)), self.shape)
        around = grid[max(row - 1, 0) : row + 2, column], grid[row, max(column - 1, 0) : column + 2]
        return max(float(np.linalg.norm(np.diff(line, axis=0), axis=1).max(initial=0.0)) for line in around)

    @cached_property
    def strips(self) -> Ints:
        """(4, n) nodes of both sides of strips of skin.

        Segments between neighbors along each axis of slope come first, both sides the same; then, if there are two
        such axes, the faces between them, once for each of their strips.
        """
        number = np.arange(len(self)).reshape(self.shape)
        along = {X: (number[:, :-1], number[:, 1:]), Z: (number[:-1], number[1:])}
        sides = [(*along[axis], *along[axis]) for axis in self.axes[:-1]]
        if len(sides) == 2:
            first, second = along[X]
            sides += [(first[:-1], second[:-1], first[1:], second[1:])] * len(STRIPS_ACROSS)
        return np.concatenate([np.stack([nodes.ravel() for nodes in side]) for side in sides], axis=1)

    @cached_property
    def across(self) -> Array:
        """(n,) how far from its first side to its second each strip lies."""
        rows, columns = self.shape
        faces = (rows - 1) * (columns - 1) if len(self.axes) == 3 else 0
        segments = self.strips.shape[1] - len(STRIPS_ACROSS) * faces
        return np.concatenate([np.zeros(segments), np.repeat(STRIPS_ACROSS, faces)])


@dataclass(frozen=True)
class Patch(PatchNodes):
    """Skin nodes with their compliance along the axes.

    Forces and pressures are per unit of E(epidermis) = 1 MPa: N and MPa for a finger that stiff.
    """

    compliance: Array = field(kw_only=True)  # (m n, m n) mm/N, displacements ordered by axis

    @property
    def nodes(self) -> PatchNodes:
        """The nodes without their compliance."""
        return PatchNodes(self.position_mm, self.area_mm2, self.shape, self.axes)

    def displaced(self, force: Array) -> Array:
        """Return (…, m, n) displacements in mm of all nodes under (…, m, n) forces in N.

        The loop takes a few loaded rows at a time, so that they stay in the processor's cache.
        """
        forces = force.reshape(-1, len(self.compliance))
        moved = np.zeros(forces.shape)
        loaded = np.flatnonzero(forces.any(axis=0))
        for rows in np.split(loaded, range(_ROWS_AT_ONCE, len(loaded), _ROWS_AT_ONCE)):
            response = self.compliance[rows]
            for u, f in zip(moved, forces[:, rows], strict=True):
                u += f @ response
        return moved.reshape(force.shape)
