"""Pressures across x at one plane of the whole finger, which vary along z by a shape that is named.

A row of receptors feels what presses beside its plane too, but cannot tell it apart: what it decodes are pressures in
the plane, under an axial shape that is told, or that of several which explains its readings best.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.energy import Energy
from sim.coding.frictionless import Frictionless, Skin
from sim.coding.operators import Operator
from sim.coding.profile_decoder import ModelError, Profile, decode_profile
from sim.coding.readings import Readings
from sim.coding.sheets.felt_skin import FeltSkin, felt_skin
from sim.coding.sheets.sheet_operator import hats
from sim.coding.skin_line import SkinLine
from sim.config.fingertip_config import FingertipConfig
from sim.contact.patch import X, Y, Z
from sim.finger.surface import FingertipSurface
from sim.measures.reach import points_below

Array = NDArray[np.float64]

ROW_ERROR = ModelError(share=0.06)
"""Of SED: between meshes, and what an axial shape that is the same at all x leaves (3 to 6 %)."""


@dataclass(frozen=True)
class AxialShape:
    """Pressure at z over that in the receptor plane: an ellipse about the pad's apex, of this half-length."""

    half_length_mm: float
    centre_mm: float

    @property
    def name(self) -> str:
        """As it is told."""
        return f"ellipse:{self.half_length_mm:g}"

    def at(self, z_mm: Array) -> Array:
        """(…) over its highest."""
        return np.asarray(np.sqrt(np.maximum(0.0, 1 - ((z_mm - self.centre_mm) / self.half_length_mm) ** 2)))

    def over(self, plane_mm: float, z_mm: Array) -> Array:
        """(…) over what it is in a plane."""
        return np.asarray(self.at(z_mm) / self.at(np.array(plane_mm)))


HALF_LENGTHS_MM = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.3)
"""Of the ellipses that are tried where none is named."""


@dataclass(frozen=True)
class FeltRow:
    """The finger with a row of receptors in the receptor plane."""

    felt: FeltSkin
    line: SkinLine  # of the skin in that plane
    place_mm: Array  # (m,) along it, above each receptor

    def under(self, shape: AxialShape, ends_mm: Array, energy: Energy) -> Frictionless:
        """SED under pressures on n samples of skin between (n + 1,) equally spaced places, all of one axial shape."""
        (operator,) = self.under_each([shape], ends_mm, energy)
        return operator

    def under_each(self, shapes: Sequence[AxialShape], ends_mm: Array, energy: Energy) -> Iterator[Frictionless]:
        """The same of several shapes: what a node alone does to receptors and skin is the same for them all."""
        middle, place = 0.5 * (ends_mm[1:] + ends_mm[:-1]), self.line.places(self.felt.nodes_mm[:, X])
        seen, directions = self._seen(ends_mm), self._directions(place)
        strained = [self.felt.strained(direction) for direction in directions]
        mobility = [self.felt.mobility(direction, seen)[[X, Y]] for direction in directions]
        at_rest, normal = (self.felt.nodes_mm.T @ seen)[[X, Y]], self.line.normals(self.line.angles(middle))
        across = hats(place, middle)
        for shape in shapes:
            share = across * shape.over(self.line.plane_mm, self.felt.nodes_mm[:, Z])[:, None]
            parts, lateral = (self.felt.squared(one, share, energy) for one in strained)
            skin = Skin(at_rest, np.concatenate([one @ share for one in mobility], axis=-1), normal)
            yield Frictionless("influence", energy, parts, middle, self.place_mm, lateral, skin)

    def _directions(self, place: Array) -> tuple[Array, Array]:
        """(3, k) of normal and of lateral pressures on nodes at these places."""
        x, y = self.line.normals(self.line.angles(place)).T
        return np.stack([-x, -y, np.zeros(len(place))]), np.stack([y, -x, np.zeros(len(place))])

    def _seen(self, ends_mm: Array) -> Array:
        """(k, n + 1) shares of the skin's nodes, those of the receptor plane, in the samples' ends."""
        across = self.felt.model.patch.shape[1]
        row = self.felt.model.receptor_row * across + np.arange(across)
        place = self.line.places(self.felt.nodes_mm[row, X])
        order = np.argsort(place)
        seen = np.zeros((len(self.felt.nodes_mm), len(ends_mm)))
        seen[row[order]] = np.stack([np.interp(ends_mm, place[order], one) for one in np.eye(across)])
        return seen


class DecodedRow(NamedTuple):
    """Pressures, and under which axial shape."""

    shape: AxialShape
    operator: Frictionless
    profile: Profile


def decode_row(
    row: FeltRow, shapes: Sequence[AxialShape], ends_mm: Array, readings: Readings, error: ModelError = ROW_ERROR
) -> DecodedRow:
    """By the shape that explains the readings best; SED `finite`. Raises DecodingError."""
    tried = list(zip(shapes, row.under_each(shapes, ends_mm, "finite"), strict=True))
    shape, operator = min(tried, key=lambda one: quick_misfit(one[1], readings, error))
    return DecodedRow(shape, operator, decode_profile(operator, readings, error))


def quick_misfit(operator: Operator, readings: Readings, error: ModelError) -> float:
    """How badly pressures explain readings, by the search alone: a table takes longer than all the rest."""
    return decode_profile(operator, readings, error, table=False).misfit


def felt_row(config: FingertipConfig, place_mm: Array, depth_mm: float | Array) -> FeltRow:
    """Receptors so far below places of the skin in the receptor plane. Raises ModelRangeError and ReceptorError."""
    plane = config.receptor_plane_mm
    line = SkinLine(FingertipSurface.fit(config.geometry), plane, "skin")
    depth = np.broadcast_to(depth_mm, place_mm.shape)
    x_mm = line.below(line.angles(place_mm), depth[:, None])[:, X]
    points = points_below(config, line.surface, x_mm, depth, plane)
    return FeltRow(felt_skin(config, points, depth, (X,)), line, place_mm)
