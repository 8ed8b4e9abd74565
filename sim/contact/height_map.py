"""An indentor as a table of heights over x and z: embossed dots, letters, anything without overhangs."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.contact.indentor import BOTH, Indentor, Surface, refuse_turn, turn_suffix
from sim.contact.profiles import STEEPEST_SLOPE, arc_tangent
from sim.contact.sizes import wrong_size
from sim.errors import ArgumentError, SimError
from sim.tables import numbers_of

Array = NDArray[np.float64]

LEAST_POINTS, MOST_POINTS = 4, 1_000_000
STEEPEST_OF_A_MAP = 20.0
"""Largest slope of a map, 87 degrees; a steeper wall cannot be distinguished from an overhang."""

RAISED = ("high", "low")
"""Numbers that touch the skin first: the highest, as of raised dots, or the lowest."""

_UNEVEN = 1e-3  # of the spacing
_UNDERSHOOT = 0.05  # of the relief: how far the spline may lie below the lowest height
_ROUNDING_MM = 1e-9
_PARTS = 4  # of a cell, at which the lowest point and the curvature are searched
_LEAST_STEP_MM = 1e-6
_FARTHEST_MM = 1000.0


class HeightMapError(SimError, ValueError):
    """Error of heights that cannot form an indentor."""

    default_code = "bad_height_map"


@dataclass(frozen=True, eq=False)
class HeightMap(Indentor):
    """An indentor from a table of heights: embossed dots, letters, any surface without overhangs.

    Maps with the same name, grid, heights and turn are equal.

    Attributes
    ----------
    name : str
        Name in results and errors.
    x_mm : ndarray of shape (n_x,)
        Evenly spaced lateral positions, ascending, 0 at the reference point (mm).
    z_mm : ndarray of shape (n_z,)
        The same along the finger, towards the tip (mm).
    height_mm : ndarray of shape (n_z, n_x)
        Heights above any level, growing away from the skin (mm).
    turn_deg : float
        Turn about the vertical, x towards the tip (degrees).

    Notes
    -----
    The surface is a bicubic spline (C²) through the heights, with flanks of slope 1000 beyond its rim.

    Examples
    --------
    >>> import numpy as np
    >>> from sim import HeightMap
    >>> x = np.linspace(-1.0, 1.0, 21)
    >>> dome = HeightMap.from_arrays(x, x, -0.1 * (x**2 + x[:, None] ** 2), raised="high", name="dome")
    >>> dome
    HeightMap('dome', 21 × 21 points)
    """

    name: str
    x_mm: Array
    z_mm: Array
    height_mm: Array
    turn_deg: float = 0.0

    axes = BOTH
    sharp = True  # its rim is an edge
    corners_only = True

    def __post_init__(self) -> None:
        for end in (self.x_mm, self.z_mm, self.height_mm):
            end.setflags(write=False)

    @classmethod
    def from_arrays(
        cls,
        x_mm: ArrayLike,
        z_mm: ArrayLike,
        height_mm: ArrayLike,
        *,
        raised: str = "",
        name: str = "heightmap",
        turn_deg: float = 0.0,
    ) -> "HeightMap":
        """Make an indentor from arrays.

        Parameters
        ----------
        x_mm : array_like of shape (n_x,)
            Evenly spaced lateral positions, ascending, 0 at the reference point (mm).
        z_mm : array_like of shape (n_z,)
            The same along the finger, towards the tip (mm).
        height_mm : array_like of shape (n_z, n_x)
            Heights above any level (mm).
        raised : {"high", "low"}
            Which heights touch the skin first; required. "high": the largest, as of raised dots; "low": the smallest.
        name : str, optional
            Name in results and errors.
        turn_deg : float, optional
            Turn about the vertical, x towards the tip (degrees).

        Returns
        -------
        HeightMap
            The indentor.

        Raises
        ------
        HeightMapError
            If `raised` is missing, there are too few or too many points, the spacing is uneven, a height is not a
            number, or the surface has a wall.
        """
        refuse_turn(turn_deg)
        named = {"x_mm": x_mm, "z_mm": z_mm, "height_mm": height_mm}
        x, z, height = (np.array(numbers_of(name, values)) for name, values in named.items())
        if height.shape != (z.size, x.size) or x.ndim != 1 or z.ndim != 1:
            raise HeightMapError(
                f"{name}: heights of shape {height.shape} over {x.size} x and {z.size} z: must have the shape "
                f"{(z.size, x.size)}",
                "heights_unlike_grid",
            )
        _refuse_size(name, *height.shape)
        for axis, positions in (("x", x), ("z", z)):
            refuse_uneven(name, axis, positions)
        missing = np.argwhere(~np.isfinite(height))
        if len(missing):
            k, i = missing[0]
            raise HeightMapError(
                f"{name}: no height at x = {float(x[i]):g}, z = {float(z[k]):g} mm ({len(missing)} of "
                f"{height.size} points); every point must have a finite height",
                "missing_height",
            )
        refuse_far(name, "height", height)
        for axis, positions in (("x", x), ("z", z)):
            wrong = wrong_size(float(np.ptp(positions)), float(np.ptp(height)), axis)
            if wrong is not None:
                raise HeightMapError(f"{name}: {wrong[0]}", wrong[1])
        height = height * away_from_skin(name, raised, 'raised="{}"')
        found = cls(name + turn_suffix(turn_deg), x, z, height, turn_deg)
        found._refuse_walls()
        return found

    def __eq__(self, other: object) -> bool:
        return isinstance(other, HeightMap) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    def __repr__(self) -> str:
        return f"HeightMap({self.name!r}, {len(self.x_mm)} × {len(self.z_mm)} points)"

    @cached_property
    def _identity(self) -> tuple[str, float, str]:
        digest = hashlib.sha256()
        for part in (self.x_mm, self.z_mm, self.height_mm):
            digest.update(np.ascontiguousarray(part).tobytes())
        return self.name, self.turn_deg, digest.hexdigest()

    def __getstate__(self) -> dict[str, object]:
        """Return the defining fields; the spline is rebuilt when needed."""
        fields = ("name", "x_mm", "z_mm", "height_mm", "turn_deg")
        return {field: self.__dict__[field] for field in fields}

    def turned(self, turn_deg: float) -> "HeightMap":
        """Return the indentor, turned about the vertical.

        Parameters
        ----------
        turn_deg : float
            Angle, x towards the tip (degrees).

        Returns
        -------
        HeightMap
            The turned indentor.

        Raises
        ------
        ArgumentError
            If it is turned already.
        """
        refuse_turn(turn_deg)
        if self.turn_deg:
            raise ArgumentError("it is turned already", "turned_already")
        return replace(self, name=self.name + turn_suffix(turn_deg), turn_deg=turn_deg)

    @cached_property
    def sharpest_radius_mm(self) -> float:
        """Smallest radius of curvature of the convex parts within the rim, as measured on the spline (mm)."""
        points = self._in_cells()
        surface = self._within(points)
        slope, hessian = np.moveaxis(surface.slope, -1, 0), np.moveaxis(surface.curvature, -1, 0)
        metric = np.eye(2) + slope[:, :, None] * slope[:, None]
        shape = np.linalg.solve(metric, hessian) / np.sqrt(1 + (slope**2).sum(axis=1))[:, None, None]
        half, det = 0.5 * np.trace(shape, axis1=1, axis2=2), np.linalg.det(shape)
        largest = (half + np.sqrt(np.maximum(half**2 - det, 0.0))).max()
        return float(1 / largest) if largest > 0 else np.inf

    def turning(self, offset_mm: Array, reach_mm: float) -> Array:
        """Return the angle by which the surface turns about places, along x or z; the larger.

        Parameters
        ----------
        offset_mm : ndarray of shape (2, k)
            Offsets from the reference point (mm).
        reach_mm : float
            Distance to either side (mm).

        Returns
        -------
        ndarray of shape (k,)
            Angles (rad).
        """
        shifts = reach_mm * np.eye(2)[:, :, None]
        found = [
            _angle(self.evaluate(offset_mm - shift).slope, self.evaluate(offset_mm + shift).slope) for shift in shifts
        ]
        return np.maximum(*found)

    def evaluate(self, offset_mm: Array) -> Surface:
        """Return the surface above its lowest point.

        Parameters
        ----------
        offset_mm : ndarray of shape (2, k)
            Offsets from the reference point (mm).

        Returns
        -------
        Surface
            Height, slope and curvature.
        """
        return self._walled(offset_mm, lambda beyond_mm, _: (STEEPEST_SLOPE * beyond_mm, STEEPEST_SLOPE))

    def tangent(self, offset_mm: Array, y_mm: Array) -> Surface:
        """Return the surface; beyond the rim, the closest plane through the nearest point of the rim.

        Parameters
        ----------
        offset_mm : ndarray of shape (2, k)
            Offsets from the reference point (mm).
        y_mm : ndarray of shape (k,)
            Heights of the nodes (mm).

        Returns
        -------
        Surface
            Height, slope and curvature.
        """

        def plane(beyond_mm: Array, rim_mm: Array) -> tuple[Array, Array]:
            height, steepness, _ = arc_tangent(beyond_mm, y_mm - rim_mm, 0.0, np.ones_like(beyond_mm))
            outside = beyond_mm > 0
            return np.where(outside, height, 0.0), np.where(outside, steepness, 0.0)

        return self._walled(offset_mm, plane)

    def _walled(self, offset_mm: Array, wall: Callable[[Array, Array], tuple[Array, Array | float]]) -> Surface:
        """Return the surface with a wall beyond its rim, whose rise and slope follow from distance and rim height."""
        at = self._turn @ offset_mm
        clipped = self._clipped(at)
        surface, beyond, inside = self._within(clipped), at - clipped, at == clipped
        distance = np.hypot(*beyond)
        rise, steepness = wall(distance, surface.height_mm)
        back = self._turn.T
        slope = surface.slope * inside + steepness * beyond / np.where(distance > 0, distance, 1.0)
        curvature = surface.curvature * (inside[:, None] & inside[None])
        return Surface(surface.height_mm + rise, back @ slope, np.einsum("ia,abk,jb->ijk", back, curvature, back))

    @property
    def _turn(self) -> Array:
        """Rotation matrix (2, 2) from the finger's x and z to the map's."""
        c, s = np.cos(np.radians(self.turn_deg)), np.sin(np.radians(self.turn_deg))
        return np.array([[c, s], [-s, c]])

    def _clipped(self, at: Array) -> Array:
        """Return (2, k) the nearest positions on the map."""
        ends = np.array([[self.x_mm[0], self.x_mm[-1]], [self.z_mm[0], self.z_mm[-1]]])
        return np.clip(at, ends[:, :1], ends[:, 1:])

    def _within(self, at: Array) -> Surface:
        """Return height above the lowest point, slope and curvature of the spline at (2, k) positions on the map."""
        steps, corners, basis = self._steps, [], []
        for positions, step, where in zip((self.x_mm, self.z_mm), steps, at, strict=True):
            t = (where - positions[0]) / step
            cell = np.clip(t.astype(np.int64), 0, len(positions) - 2)
            corners.append(cell)
            basis.append(_hermite(t - cell))
        (i, k), (of_x, of_z) = corners, basis
        low, high = (np.concatenate([self._hermite[k + a, i], self._hermite[k + a, i + 1]], axis=2) for a in (0, 1))
        table = np.concatenate([low, high], axis=1)  # (k, z: value and slope at both ends, x: the same)
        along_x = np.einsum("kzx,dxk->dzk", table, of_x)
        orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        h, x, z, xx, xz, zz = (
            (along_x[a] * of_z[b]).sum(axis=0) / (steps[0] ** a * steps[1] ** b) for a, b in orders
        )
        return Surface(h - self._lowest_mm, np.stack([x, z]), np.stack([np.stack([xx, xz]), np.stack([xz, zz])]))

    @property
    def _steps(self) -> tuple[float, float]:
        """Spacing along x and z (mm)."""
        x, z = (float((positions[-1] - positions[0]) / (len(positions) - 1)) for positions in (self.x_mm, self.z_mm))
        return x, z

    @cached_property
    def _hermite(self) -> Array:
        """(n_z, n_x, 2, 2) heights and derivatives of the spline per cell, by order along z, then along x."""
        step_x, step_z = self._steps
        across = step_x * _slopes(self.x_mm, self.height_mm.T).T
        both = step_z * np.stack([_slopes(self.z_mm, self.height_mm), _slopes(self.z_mm, across)], axis=-1)
        return np.stack([np.stack([self.height_mm, across], axis=-1), both], axis=-2)

    @cached_property
    def _lowest_mm(self) -> float:
        """Lowest height of the spline, by repeated refinement around the lowest sample."""
        self.__dict__["_lowest_mm"] = 0.0  # until it is known, heights count from the input's level
        points, steps = self._in_cells(), np.array(self._steps)[:, None]
        around = np.stack([side.ravel() for side in np.meshgrid(*[np.linspace(-1, 1, 2 * _PARTS + 1)] * 2)])
        while True:
            heights = self._within(points).height_mm
            if steps[0] < _LEAST_STEP_MM:
                return float(heights.min())
            steps = steps / _PARTS
            centre = points[:, [int(np.argmin(heights))]]
            points = self._clipped(np.concatenate([centre, centre + steps * around], axis=1))

    def _in_cells(self) -> Array:
        """Return (2, k) positions, several in each cell; of a large map only its points."""
        parts = _PARTS if self.height_mm.size * _PARTS**2 <= MOST_POINTS else 1
        x, z = (np.linspace(p[0], p[-1], parts * (len(p) - 1) + 1) for p in (self.x_mm, self.z_mm))
        return np.stack([side.ravel() for side in np.meshgrid(x, z)])

    def _refuse_walls(self) -> None:
        """Raise HeightMapError where the spline is too steep or undershoots its points."""
        surface = self._within(self._in_cells())
        steepest = float(np.hypot(*surface.slope).max())
        relief = float(np.ptp(self.height_mm))
        below = float(self.height_mm.min()) - self._lowest_mm
        if steepest > STEEPEST_OF_A_MAP:
            raise HeightMapError(
                f"{self.name}: a slope of {steepest:.3g}, {float(np.degrees(np.arctan(steepest))):.1f}° (an "
                f"overhang, a wall or a wrong spacing); at most {STEEPEST_OF_A_MAP:g} is allowed; round the edges "
                "with edge_mm",
                "too_steep",
            )
        if below > max(_UNDERSHOOT * relief, _ROUNDING_MM):
            raise HeightMapError(
                f"{self.name}: between its points the surface would reach {below:.2g} mm below the lowest point, "
                f"of {relief:.2g} mm in all; use a finer map, or round the edges with edge_mm",
                "swings_below",
            )


def _hermite(u: Array) -> Array:
    """Return (3, 4, k) value, first and second derivative of the Hermite cubics on 0 ≤ u ≤ 1.

    The four cubics belong to value and slope at 0, then at 1.
    """
    u2, u3 = u * u, u * u * u
    value = [2 * u3 - 3 * u2 + 1, u3 - 2 * u2 + u, 3 * u2 - 2 * u3, u3 - u2]
    first = [6 * u2 - 6 * u, 3 * u2 - 4 * u + 1, 6 * u - 6 * u2, 3 * u2 - 2 * u]
    second = [12 * u - 6, 6 * u - 4, 6 - 12 * u, 6 * u - 2]
    return np.stack([np.stack(row) for row in (value, first, second)])


def _slopes(knots: Array, values: Array) -> Array:
    """Return derivatives of the cubic splines along the first axis, at the knots."""
    from scipy.interpolate import CubicSpline  # slow to import, and few shapes are maps

    return np.asarray(CubicSpline(knots, values, axis=0)(knots, 1))


def _angle(slope: Array, other: Array) -> Array:
    """Return (k,) angles in rad between the normals of two slopes (2, k)."""
    one, two = (np.concatenate([s, -np.ones_like(s[:1])]) / np.sqrt(1 + (s**2).sum(axis=0)) for s in (slope, other))
    return np.asarray(2 * np.arcsin(np.clip(0.5 * np.linalg.norm(one - two, axis=0), 0.0, 1.0)))


def _refuse_size(name: str, rows: int, columns: int) -> None:
    if min(rows, columns) < LEAST_POINTS:
        raise HeightMapError(
            f"{name}: {columns} × {rows} points; at least {LEAST_POINTS} × {LEAST_POINTS} are required", "too_small"
        )
    if rows * columns > MOST_POINTS:
        raise HeightMapError(
            f"{name}: {columns} × {rows} points; at most {MOST_POINTS} in all are allowed", "too_large"
        )


def away_from_skin(name: str, raised: str, as_written: str) -> float:
    """Return the sign of heights that grow away from the skin. Raises HeightMapError."""
    if raised not in RAISED:
        high, low = (as_written.format(word) for word in RAISED)
        raise HeightMapError(
            f"{name}: the numbers do not tell which side is up; add {high} if the largest touch the skin first "
            f"(raised dots), or {low} if the smallest do",
            "which_side_is_up",
        )
    return -1.0 if raised == "high" else 1.0


def refuse_far(name: str, what: str, values: Array) -> None:
    """Raise HeightMapError for finite values (mm) beyond any indentor."""
    far = values[np.isfinite(values) & (np.abs(values) > _FARTHEST_MM)]
    if len(far):
        raise HeightMapError(
            f"{name}: {what} = {float(far[0]):g} mm: must lie within ± {_FARTHEST_MM:g} mm", "too_far"
        )


def refuse_uneven(name: str, axis: str, positions: Array) -> None:
    """Raise HeightMapError for positions (mm) that do not rise by even steps."""
    refuse_far(name, axis, positions)
    steps = np.diff(positions)
    if not np.isfinite(positions).all() or not (steps > _LEAST_STEP_MM).all():
        raise HeightMapError(f"{name}: {axis} must rise", "axis_not_rising")
    worst = int(np.argmax(np.abs(steps - steps.mean())))
    if abs(steps[worst] - steps.mean()) > _UNEVEN * steps.mean():
        raise HeightMapError(
            f"{name}: {axis} changes from {float(positions[worst]):g} to {float(positions[worst + 1]):g} mm but "
            f"by {float(steps.mean()):.4g} mm elsewhere; the spacing must be even",
            "uneven_spacing",
        )
