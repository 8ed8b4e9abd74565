"""The finger's plane-strain section with receptors below its skin: anywhere, or under equally spaced places."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.coding.skin_line import Axes, SkinLine
from sim.config.fingertip_config import FingertipConfig
from sim.config.units import PSEUDO_E_EPIDERMIS
from sim.contact.patch import X, Y
from sim.finger.surface import FingertipSurface
from sim.measures.measures import Elastic
from sim.measures.reach import points_below
from sim.measures.receptors import DEFAULT_DEPTH_MM, ReceptorSet
from sim.models.catalogue import load
from sim.models.condensed import CondensedModel
from sim.models.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.inside.columns import Columns
from sim.models.plane_section import build_section, prismatic

Array = NDArray[np.float64]

SPACING_MM = 0.17
"""Between samples (Raju 1998, §6.5)."""

HALF_LENGTH = 24
"""Samples to each side of the middle; the source does not say."""


@dataclass(frozen=True)
class Sampling:
    """Where receptors lie: under 2 half_length + 1 places of the skin, all at one depth; mm."""

    spacing_mm: float = SPACING_MM
    half_length: int = HALF_LENGTH
    axes: Axes = "skin"
    depth_mm: float = DEFAULT_DEPTH_MM

    @property
    def place_mm(self) -> Array:
        """(2 half_length + 1,) on the skin, ascending, 0 in the middle."""
        return np.asarray(self.spacing_mm * np.arange(-self.half_length, self.half_length + 1))


@dataclass(frozen=True)
class FeltSection:
    """The strain at receptors under any force on the section's skin. Forces are per mm of its length."""

    line: SkinLine
    model: CondensedModel  # its skin's nodes, and how forces on the patch move them
    place_mm: Array  # (n,) of the skin above each receptor
    material: Elastic  # about the receptors; E in pseudo-units
    strain_per_node: Array  # (3, n, n_phi, 2) e11 e22 e12 in the line's axes, per pseudo-unit · mm along x and y

    def under_loads(self, place_mm: ArrayLike) -> Array:
        """(3, n, k, 2) strains under 1 pseudo-unit of pressure on 1 mm of skin, as a force on each of k places.

        The force goes along the skin's inward normal, or along its tangent that rises with x; it is shared between
        the two skin nodes beside the place. Raises ModelRangeError beside the pulp.
        """
        angle, grid = self.line.angles(place_mm), self.model.skin_phi
        after = np.searchsorted(grid, angle)
        share = (angle - grid[after - 1]) / (grid[after] - grid[after - 1])
        by_place = np.stack([self.strain_per_node[:, :, after - 1], self.strain_per_node[:, :, after]], axis=-1)
        normal = self.line.normals(angle)
        tangent = np.stack([normal[:, Y], -normal[:, X]], axis=-1)
        return np.einsum("cnkis,sk,dki->cnkd", by_place, [1 - share, share], np.stack([-normal, tangent]))


def skin_of(config: FingertipConfig, axes: Axes = "skin") -> SkinLine:
    """The skin of the section in the receptor plane."""
    plane = config.receptor_plane_mm
    return SkinLine(prismatic(FingertipSurface.fit(config.geometry), plane), plane, axes)


def receptor_points(config: FingertipConfig, line: SkinLine, place_mm: ArrayLike, depth_mm: ArrayLike) -> Array:
    """(n, 3) the points at depths below places of the skin. Raises ModelRangeError or ReceptorError beside tissue."""
    place, depth = np.broadcast_arrays(np.atleast_1d(place_mm).astype(float), depth_mm)
    angle = line.angles(place)
    x_mm = line.below(angle, depth[:, None])[:, X]
    return points_below(config, line.surface, x_mm, depth, line.plane_mm)


def felt_section(config: FingertipConfig, place_mm: Array, depth_mm: Array) -> FeltSection:
    """Build it (about a second). Raises ModelRangeError or ReceptorError where there is no place for a receptor."""
    line = skin_of(config)
    receptors = ReceptorSet(receptor_points(config, line, place_mm, depth_mm), depth_mm)
    model = build_section(config, line.surface, receptors)
    material = _material_about(config, model.columns, f"{depth_mm.min():g} … {depth_mm.max():g}")
    strain = _strain_per_node(line, model.columns, line.angles(place_mm))
    return FeltSection(line, model, place_mm, material, strain)


@dataclass(frozen=True)
class SampledSection(FeltSection):
    """The section, which can be pressed, with receptors under equally spaced places."""

    finger: Fingertip
    sampling: Sampling


def sampled_section(config: FingertipConfig, sampling: Sampling) -> SampledSection:
    """Build it (about a second). Raises ModelRangeError or ReceptorError where there is no place for a receptor."""
    line = skin_of(config, sampling.axes)
    angle = line.angles(sampling.place_mm)
    x_mm = line.below(angle, sampling.depth_mm)[:, 0].tolist()
    finger = load("section", config, receptor_x_mm=x_mm, receptor_depth_mm=sampling.depth_mm)
    columns = finger.model.columns
    material = _material_about(config, columns, f"{sampling.depth_mm:g}")
    strain = _strain_per_node(line, columns, angle)
    return SampledSection(line, finger.model, sampling.place_mm, material, strain, finger, sampling)


def _material_about(config: FingertipConfig, columns: Columns, deep: str) -> Elastic:
    """Of the one layer that all receptors lie in. Raises ModelRangeError where it is not one."""
    ratio = columns.young_ratio
    if (ratio != ratio[0]).any():
        raise ModelRangeError(
            "receptors {depths} mm deep: expected a depth inside one layer", code="several_layers", depths=deep
        )
    return Elastic(PSEUDO_E_EPIDERMIS * float(ratio[0]), config.tissue.poisson)


def _strain_per_node(line: SkinLine, columns: Columns, angle: Array) -> Array:
    """(3, n, n_phi, 2) strains in the line's axes under skin at (n,) angles, per pseudo-unit · mm on a skin node."""
    strain = columns.per_skin_force[:, 0, :, :2]
    return line.in_axes(strain.reshape(len(angle), 6, *strain.shape[1:]) / PSEUDO_E_EPIDERMIS, angle)
