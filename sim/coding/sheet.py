"""SED at any receptors of the whole finger under pressures over x and z of its skin, leaning as the skin does.

As in the section (`frictionless`): without friction each force stands normal to the skin as it lies under all of
them. Here it may lean both across the finger and along it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from sim.coding.energy import Energy
from sim.coding.operators import Operator
from sim.coding.sheets.felt_skin import FeltSkin
from sim.contact.patch import X, Z
from sim.models.errors import ModelRangeError

Array = NDArray[np.float64]

SHEET_SPACING_MM = 0.3
"""Between pressures, both ways: SED under a sphere is then right to 3 %, to 1 % at 0.2 mm."""

GRID_MM = 2.1
"""From the middle of the pad: as far as pressures are sought, on the patch of the default finger."""

FEWEST_PLACES = 3  # along x, and along z

_ROUNDS = 4  # pressures that lean move the skin
_STEEPEST = 1.0  # a lean by more than 45° is no contact


class Grid(NamedTuple):
    """Equally spaced places over x and z, z going fastest; mm."""

    x_mm: Array  # (n_x,) ascending
    z_mm: Array  # (n_z,) ascending

    @property
    def place_mm(self) -> Array:
        """(n_x n_z, 2) x and z."""
        return np.stack(np.meshgrid(self.x_mm, self.z_mm, indexing="ij"), axis=-1).reshape(-1, 2)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of places along x and along z."""
        return len(self.x_mm), len(self.z_mm)

    def shares(self, x_mm: Array, z_mm: Array) -> Array:
        """(k, n_x n_z) of pressures at the places in that at k others: bilinear between them, none beside them."""
        return np.einsum("ki,kj->kij", hats(x_mm, self.x_mm), hats(z_mm, self.z_mm)).reshape(len(x_mm), -1)

    def nearest(self, at_mm: Array, area_mm2: Array, pressure: Array) -> Array:
        """(n_x n_z,) pressures, none below 0, whose straight lines come nearest to (k,) at (k, 3) nodes of skin."""
        root = np.sqrt(area_mm2)
        return np.asarray(nnls(self.shares(at_mm[:, X], at_mm[:, Z]) * root[:, None], root * pressure)[0])


def hats(at: Array, place: Array) -> Array:
    """(len(at), n) shares of n equally spaced places, straight between them; none beside them."""
    return np.maximum(0.0, 1 - np.abs(np.subtract.outer(at, place)) / (place[1] - place[0]))


@dataclass(frozen=True)
class SkinOver:
    """The skin about each place of a grid, and how pressures move it; mm and pseudo-units."""

    grid: Grid
    at_rest_mm: Array  # (3, n)
    moved_mm: Array  # (3, n, 3 n) per pressure: normal ones, then those across, then those along
    frames: Array  # (n, 3, 3) across, outward, along, of the undeformed skin

    def pressed(self, pressure: Array, lean: Array) -> Array:
        """(3, n) where it lies under (n,) pressures that lean by (2, n)."""
        return np.asarray(self.at_rest_mm + self.moved_mm @ np.concatenate([pressure, *(lean * pressure)]))

    def lean(self, pressure: Array) -> Array:
        """(2, n) force across, and along, over the normal one."""
        lean = np.zeros((2, len(pressure)))
        for _ in range(_ROUNDS):
            at = self.pressed(pressure, lean).reshape(3, *self.grid.shape)
            by_x, by_z = (np.asarray(np.gradient(at, axis=k)).reshape(3, -1).T for k in (1, 2))
            across, outward, along = np.einsum("nai,ni->an", self.frames, np.cross(by_z, by_x))
            lean = np.clip(-np.stack([across, along]) / outward, -_STEEPEST, _STEEPEST)
        return lean


@dataclass(frozen=True)
class SheetOperator(Operator):
    """SED under normal pressures over x and z with all that they bear along the skin."""

    lateral: Array  # (2, c, m, n) beside `parts`, of pressures across and along
    skin: SkinOver

    def per_receptor(self, change: Callable[[Array], Array]) -> Operator:
        """With what stands for the receptors, the second axis of (c, m, n), changed."""
        return replace(self, parts=change(self.parts), lateral=np.stack([change(one) for one in self.lateral]))

    def leaning(self, pressure: Array) -> Operator:
        """Quadratic: leans held as they are under these pressures."""
        across, along = self.skin.lean(pressure)
        parts = self.parts + self.lateral[0] * across + self.lateral[1] * along
        return Operator(self.name, self.energy, parts, self.place_mm, self.receptor_mm)

    def sed(self, pressure: Array) -> Array:
        """(m,) SED under (n,) pressures."""
        return self.leaning(pressure).sed(pressure)

    def slope(self, pressure: Array) -> Array:
        """(m, n) derivatives of the SED, leans held."""
        return self.leaning(pressure).slope(pressure)

    def pulled_back(self, pressure: Array, weight: Array) -> Array:
        """(n,) gradient of Σ weight · SED, leans held."""
        return self.leaning(pressure).pulled_back(pressure, weight)


def sheet_operator(felt: FeltSkin, grid: Grid, energy: Energy) -> SheetOperator:
    """Of pressures at a grid's places. Raises ModelRangeError where one has no node of the patch about it."""
    nodes = felt.nodes_mm
    share = grid.shares(nodes[:, X], nodes[:, Z])
    bare = np.flatnonzero(share.sum(axis=0) == 0)
    if len(bare):
        x, z = grid.place_mm[bare[0]]
        raise ModelRangeError(
            "pressure at x = {x_mm:.2f}, z = {z_mm:.2f} mm: expected a place on the patch of the skin",
            code="pressure_beside_patch",
            x_mm=float(x),
            z_mm=float(z),
        )
    seen = share / share.sum(axis=0)
    across, outward, along = felt.frames(nodes[:, X], nodes[:, Z])
    directions = (-outward, across, along)
    normal, *lateral = (felt.parts(direction, share, energy) for direction in directions)
    moved = np.concatenate([felt.moved(direction, share, seen) for direction in directions], axis=-1)
    frames = np.stack(felt.frames(*grid.place_mm.T), axis=0).transpose(2, 0, 1)
    skin = SkinOver(grid, nodes.T @ seen, moved, frames)
    receptor = felt.model.receptors.position_mm[:, [X, Z]]
    return SheetOperator("influence", energy, normal, grid.place_mm, receptor, np.stack(lateral), skin)
