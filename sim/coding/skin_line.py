"""The section's skin as a line: places on it, counted along the skin or across the finger, 0 where x is 0."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from sim.contact.patch import X, Y
from sim.finger.surface import FingertipSurface
from sim.models.errors import ModelRangeError

Array = NDArray[np.float64]

Axes = Literal["skin", "cartesian"]
AXES: tuple[Axes, ...] = get_args(Axes)
"""skin: places by length of skin, strains tangent and normal to it; cartesian, as the source: by x, along x and y."""

_SIDE_RAD = 0.3  # of the section's widest places, where the nail is near
_TABLE = np.linspace(np.pi - _SIDE_RAD, _SIDE_RAD, 2001)


@dataclass(frozen=True)
class SkinLine:
    """The pulp's skin in a plane across the finger."""

    surface: FingertipSurface
    plane_mm: float
    axes: Axes

    @cached_property
    def _angle(self) -> CubicSpline:
        """Angle of the section (rad) at a place (mm)."""
        return CubicSpline(self._places_at(_TABLE), _TABLE, extrapolate=False)

    def _places_at(self, angle: Array) -> Array:
        if self.axes == "cartesian":
            return np.asarray(self.surface.section(angle, self.plane_mm)[0])
        speed = np.linalg.norm(self.surface.tangents(angle, self.plane_mm)[0], axis=-1)
        length = cumulative_simpson(speed, x=-angle, initial=0)
        middle = float(self.surface.angle_at(0.0, self.plane_mm))
        return np.asarray(length - CubicSpline(-angle, length)(-middle))

    @property
    def reach_mm(self) -> tuple[float, float]:
        """The first and the last place."""
        return float(self._angle.x[0]), float(self._angle.x[-1])

    def angles(self, place_mm: ArrayLike) -> Array:
        """(n,) angles of the section, rad, at places in mm. Raises ModelRangeError beside the pulp."""
        place, (low, high) = np.atleast_1d(place_mm), self.reach_mm
        beside = place[~((place >= low) & (place <= high))]
        if len(beside):
            raise ModelRangeError(
                "place {place_mm:g} mm: expected {low_mm:.2f} … {high_mm:.2f} mm on the pulp's skin",
                code="place_beside_pulp",
                place_mm=float(beside[0]),
                low_mm=low,
                high_mm=high,
            )
        return np.asarray(self._angle(place))

    def places(self, x_mm: ArrayLike) -> Array:
        """(n,) places in mm of skin at x."""
        x = np.atleast_1d(x_mm)
        if self.axes == "cartesian":
            return x.astype(float)
        angle = self.surface.angle_at(x, self.plane_mm)
        return np.asarray(CubicSpline(-_TABLE, self._angle.x)(-angle))

    def normals(self, angle: Array) -> Array:
        """(n, 2) outward unit normals, x and y."""
        along_x, along_y, _ = np.moveaxis(self.surface.tangents(angle, self.plane_mm)[0], -1, 0)
        return np.stack([along_y, -along_x], axis=-1) / np.hypot(along_x, along_y)[..., None]

    def below(self, angle: Array, depth_mm: float | Array) -> Array:
        """(n, 2) the points so far below the skin, along its normal; mm."""
        return np.stack(self.surface.section(angle, self.plane_mm), axis=-1) - depth_mm * self.normals(angle)

    def above(self, x_mm: float, depth_mm: float) -> float:
        """The place of the skin above a point so deep below it; mm. Raises ModelRangeError beside the pulp."""
        reach = np.linspace(*self.reach_mm, len(_TABLE))
        x = self.below(self.angles(reach), depth_mm)[:, X]
        if not x[0] <= x_mm <= x[-1]:
            raise ModelRangeError(
                "x {x_mm:g} mm: expected {low_mm:.2f} … {high_mm:.2f} mm, below the pulp's skin",
                code="x_beside_pulp",
                x_mm=float(x_mm),
                low_mm=float(x[0]),
                high_mm=float(x[-1]),
            )
        return float(np.interp(x_mm, x, reach))

    def in_axes(self, strain: Array, angle: Array) -> Array:
        """(3, n, …) strains e11 e22 e12 in these axes, from (n, 6, …) Cartesian ones under skin at these angles."""
        e11, e22, e12 = (strain[:, k] for k in (0, 1, 3))
        if self.axes == "cartesian":
            return np.stack([e11, e22, e12])
        normal = self.normals(angle).reshape(len(angle), 2, *[1] * (strain.ndim - 2))
        s, c = -normal[:, X], normal[:, Y]  # the tangent, rising with x, is (c, s)
        return np.stack(
            [
                c * c * e11 + s * s * e22 + s * c * e12,
                s * s * e11 + c * c * e22 - s * c * e12,
                2 * s * c * (e22 - e11) + (c * c - s * s) * e12,
            ]
        )
