"""An indentor as a surface: a profile carried along the finger, across it, or turned about the vertical."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.contact.patch import X, Z
from sim.contact.profiles import Profile

Array = NDArray[np.float64]

ALONG: tuple[int, ...] = (X,)
ACROSS: tuple[int, ...] = (Z,)
ROUND: tuple[int, ...] = (X, Z)


class Surface(NamedTuple):
    """Height (k,) in mm, slope (m, k) and second derivatives (m, m, k) in 1/mm along the axes of slope."""

    height_mm: Array
    slope: Array
    curvature: Array


@dataclass(frozen=True)
class Indentor:
    """A rigid shape: its profile and the axes along which its surface slopes."""

    name: str
    profile: Profile
    axes: tuple[int, ...] = ALONG

    @classmethod
    def along(cls, profile: Profile) -> "Indentor":
        """Prismatic along the finger, named like its profile."""
        return cls(profile.name, profile)

    @cached_property
    def sharp(self) -> bool:
        """Whether the profile turns within less than about a node's spacing."""
        return self.profile.sharpest_radius_mm < SHARP_RADIUS_MM

    def turning(self, offset_mm: Array, reach_mm: float) -> Array:
        """(k,) rad by which the profile's normal turns within a reach on either side of (m, k) offsets."""
        s, _ = self._arm(offset_mm)
        before, after = (np.arctan(self.profile.evaluate(at)[1]) for at in (s - reach_mm, s + reach_mm))
        return np.asarray(np.abs(after - before))

    def evaluate(self, offset_mm: Array) -> Surface:
        """The surface at (m, k) offsets from the reference point, above the lowest point."""
        s, direction = self._arm(offset_mm)
        return self._swept(s, direction, *self.profile.evaluate(s))

    def tangent(self, offset_mm: Array, y_mm: Array) -> Surface:
        """As `evaluate`, but past an edge the tangent plane closest to a node at the height y."""
        s, direction = self._arm(offset_mm)
        return self._swept(s, direction, *self.profile.tangent(s, y_mm))

    def _arm(self, offset_mm: Array) -> tuple[Array, Array]:
        """Coordinate of the profile and the unit vector along which it grows."""
        if len(offset_mm) == 1:
            return offset_mm[0], np.ones_like(offset_mm)
        s = np.hypot(*offset_mm)
        safe = np.where(s > 0, s, 1.0)
        return s, np.where(s > 0, offset_mm / safe, np.array([[1.0], [0.0]]))

    def _swept(self, s: Array, direction: Array, height: Array, slope: Array, curvature: Array) -> Surface:
        if len(direction) == 1:
            return Surface(height, slope[None], curvature[None, None])
        radial = direction[:, None] * direction[None]
        around = np.where(s > 0, slope / np.where(s > 0, s, 1.0), curvature)
        hessian = curvature * radial + around * (np.eye(2)[:, :, None] - radial)
        return Surface(height, slope * direction, hessian)


SHARP_RADIUS_MM = 0.5
