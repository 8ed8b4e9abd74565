"""The whole finger with receptors anywhere: how forces on the patch of its skin strain them, and move it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.coding.energy import Energy, squared_parts
from sim.config.fingertip_config import FingertipConfig
from sim.config.units import PSEUDO_E_EPIDERMIS
from sim.contact.patch import X, Z
from sim.finger.surface import FingertipSurface
from sim.measures.measures import Elastic
from sim.measures.receptors import ReceptorSet
from sim.models.condensed import CondensedModel
from sim.models.sources import OnDisk

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FeltSkin:
    """A condensed finger; forces are of pressures in pseudo-units that nodes of its patch bear, each on its area."""

    config: FingertipConfig
    model: CondensedModel

    @property
    def nodes_mm(self) -> Array:
        """(k, 3) undeformed."""
        return self.model.patch.position_mm

    def frames(self, x_mm: Array, z_mm: Array) -> tuple[Array, Array, Array]:
        """(3, k) unit vectors at places of the skin: across the finger, outward, along it."""
        surface = self.model.surface
        phi = surface.angle_at(x_mm, z_mm)
        across = -surface.tangents(phi, z_mm)[0]  # φ falls with x
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        outward = surface.normal(phi, z_mm)
        return across.T, outward.T, np.cross(across, outward).T

    def parts(self, direction: Array, share: Array, energy: Energy) -> Array:
        """(c, m, n) squares of the SED at m receptors under n pressures.

        The skin's nodes bear (k, n) shares of each, along (3, k) directions.
        """
        return self.squared(self.strained(direction), share, energy)

    def strained(self, direction: Array) -> Array:
        """(6, m, k) strains at receptors under a pressure on each node alone."""
        per_force = self.model.strain_per_force.reshape(-1, 6, *self._force(direction).shape)
        return np.einsum("mcak,ak->cmk", per_force, self._force(direction))

    def squared(self, strained: Array, share: Array, energy: Energy) -> Array:
        """(c, m, n) squares of the SED from what each node alone does."""
        unit = Elastic(PSEUDO_E_EPIDERMIS, self.config.tissue.poisson)
        return squared_parts(strained @ share, unit, energy) * np.sqrt(self.model.columns.young_ratio)[:, None]

    def moved(self, direction: Array, share: Array, seen: Array) -> Array:
        """(3, l, n) mm by which (k, l) mixtures of nodes move under each of n pressures; 0 along other axes."""
        return self.mobility(direction, seen) @ share

    def mobility(self, direction: Array, seen: Array) -> Array:
        """(3, l, k) the same under a pressure on each node alone."""
        patch, force = self.model.patch, self._force(direction)
        axes, there = list(patch.axes), np.flatnonzero(seen.any(axis=1))
        compliance = patch.compliance.reshape(*force.shape, *force.shape)
        moved = np.zeros((3, seen.shape[1], len(patch)))
        for axis, rows in zip(axes, compliance, strict=True):
            for rows_by_axis, by_axis in zip(rows[there].swapaxes(0, 1), force, strict=True):
                moved[axis] += seen[there].T @ rows_by_axis * by_axis
        return moved

    def _force(self, direction: Array) -> Array:
        """(a, k) of a pressure on each node alone, along the axes that the patch knows."""
        patch = self.model.patch
        return np.asarray(direction[list(patch.axes)] * patch.area_mm2 / PSEUDO_E_EPIDERMIS)


def felt_skin(
    config: FingertipConfig, points_mm: Array, depth_mm: Array, slopes: tuple[int, ...] = (X, Z)
) -> FeltSkin:
    """With receptors at (m, 3) points so far below the skin: from the cache, or built (some ten seconds).

    Its patch is that for indentors that slope along some axes. Raises ReceptorError.
    """
    receptors = ReceptorSet(points_mm, depth_mm)
    source = OnDisk(config, FingertipSurface.fit(config.geometry), receptors, "auto")
    model, _ = source.model((slopes, None))
    return FeltSkin(config, model)
