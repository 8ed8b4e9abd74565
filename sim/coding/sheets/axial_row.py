"""Pressures across x at one plane of the whole finger, which vary along z by a shape that is named.

A row of receptors feels what presses beside its plane too, but cannot tell it apart: what it decodes are pressures in
the plane, under an axial shape that is told, or that of several which explains its readings best.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.energy import Energy
from sim.coding.frictionless import Frictionless, Skin
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


@dataclass(frozen=True)
class FeltRow:
    """The finger with a row of receptors in the receptor plane."""

    felt: FeltSkin
    line: SkinLine  # of the skin in that plane
    place_mm: Array  # (m,) along it, above each receptor

    def under(self, shape: AxialShape, ends_mm: Array, energy: Energy) -> Frictionless:
        """SED under pressures on n samples of skin between (n + 1,) equally spaced places, all of one axial shape."""
        nodes = self.felt.nodes_mm
        place = self.line.places(nodes[:, X])
        middle = 0.5 * (ends_mm[1:] + ends_mm[:-1])
        along = shape.over(self.line.plane_mm, nodes[:, Z])
        share = hats(place, middle) * along[:, None]
        outward = self.line.normals(self.line.angles(place)).T
        normal = np.stack([-outward[X], -outward[Y], np.zeros(len(place))])
        lateral = np.stack([outward[Y], -outward[X], np.zeros(len(place))])
        parts = [self.felt.parts(direction, share, energy) for direction in (normal, lateral)]
        skin = self._skin(ends_mm, middle, share, (normal, lateral))
        return Frictionless("influence", energy, parts[0], middle, self.place_mm, parts[1], skin)

    def _skin(self, ends_mm: Array, middle: Array, share: Array, directions: tuple[Array, Array]) -> Skin:
        row = self.felt.model.receptor_row * self.felt.model.patch.shape[1] + np.arange(
            self.felt.model.patch.shape[1]
        )
        place = self.line.places(self.felt.nodes_mm[row, X])
        order = np.argsort(place)
        seen = np.zeros((len(self.felt.nodes_mm), len(ends_mm)))
        seen[row[order]] = np.stack([np.interp(ends_mm, place[order], one) for one in np.eye(len(row))])
        at_rest = (self.felt.nodes_mm.T @ seen)[[X, Y]]
        moved = np.concatenate([self.felt.moved(d, share, seen) for d in directions], axis=-1)[[X, Y]]
        return Skin(at_rest, moved, self.line.normals(self.line.angles(middle)))


class DecodedRow(NamedTuple):
    """Pressures, and under which axial shape."""

    shape: AxialShape
    operator: Frictionless
    profile: Profile


def decode_row(
    row: FeltRow, shapes: Sequence[AxialShape], ends_mm: Array, readings: Readings, error: ModelError = ROW_ERROR
) -> DecodedRow:
    """By the shape that explains the readings best; SED `finite`. Raises DecodingError."""
    tried = [(shape, row.under(shape, ends_mm, "finite")) for shape in shapes]
    found = [DecodedRow(shape, by, decode_profile(by, readings, error)) for shape, by in tried]
    return min(found, key=lambda one: one.profile.misfit)


def felt_row(config: FingertipConfig, place_mm: Array, depth_mm: float) -> FeltRow:
    """Receptors so far below places of the skin in the receptor plane. Raises ModelRangeError and ReceptorError."""
    plane = config.receptor_plane_mm
    line = SkinLine(FingertipSurface.fit(config.geometry), plane, "skin")
    x_mm = line.below(line.angles(place_mm), depth_mm)[:, X]
    points = points_below(config, line.surface, x_mm, depth_mm, plane)
    return FeltRow(felt_skin(config, points, np.full(len(x_mm), depth_mm), (X,)), line, place_mm)
