"""User-defined profile, prismatic along z, from a CSV file or arrays."""

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.contact.profiles import STEEPEST_SLOPE, arc_tangent
from sim.contact.sizes import wrong_size
from sim.errors import SimError
from sim.tables import TableError, numbers_of, read_columns

if TYPE_CHECKING:
    from scipy.interpolate import PPoly  # slow to import, and few shapes are measured

Array = NDArray[np.float64]

COLUMNS = ("x_mm", "height_mm")
LINEAR = ",linear"
_FILLET_MM = 0.02


class ProfileError(SimError, ValueError):
    """Error of a file or arrays without a usable profile."""

    default_code = "bad_profile"


@dataclass(frozen=True, repr=False)
class MeasuredProfile:
    """A measured profile that is prismatic along the finger.

    Concave parts are allowed. `sim.Fingertip.indent` accepts a profile as an indentor.

    Attributes
    ----------
    path : str
        File or name that the profile comes from.
    x_mm : tuple of float
        Positions, ascending, 0 at the reference point (mm).
    height_mm : tuple of float
        Heights above the lowest point (mm).
    linear : bool
        Whether straight lines join the points, instead of a cubic.

    Notes
    -----
    A monotone C¹ cubic joins the points (PCHIP; Fritsch & Carlson, SIAM J. Numer. Anal. 17, 1980). Straight lines
    have fillets of ± 0.02 mm about the points. Flanks rise beyond the first and the last point.

    Examples
    --------
    >>> from sim import MeasuredProfile
    >>> MeasuredProfile.from_arrays([-1.0, 0.0, 1.0], [0.2, 0.0, 0.2], name="groove")
    <MeasuredProfile profile:groove, 3 points from -1 to 1 mm>
    """

    path: str
    x_mm: tuple[float, ...]
    height_mm: tuple[float, ...]
    linear: bool = False

    @classmethod
    def from_arrays(
        cls, x_mm: ArrayLike, height_mm: ArrayLike, *, name: str = "own", linear: bool = False
    ) -> "MeasuredProfile":
        """Make a profile from arrays.

        Parameters
        ----------
        x_mm : array_like of shape (n,)
            Positions, ascending, 0 at the reference point (mm).
        height_mm : array_like of shape (n,)
            Heights above any level (mm).
        name : str, optional
            Name in results and errors.
        linear : bool, optional
            Whether straight lines join the points, instead of a cubic.

        Returns
        -------
        MeasuredProfile
            The profile.

        Raises
        ------
        ProfileError
            If the arrays differ in length, hold fewer than two points or no numbers, or x does not rise.
        """
        x, height = numbers_of("x_mm", x_mm), numbers_of("height_mm", height_mm)
        if x.ndim != 1 or x.shape != height.shape:
            raise ProfileError(
                f"profile {name}: {height.shape} heights for {x.shape} values of x_mm; the numbers must be equal",
                "heights_unlike_x",
            )
        points = np.stack([x, height], axis=1)
        if not np.isfinite(points).all():
            row = int(np.argmin(np.isfinite(points).all(axis=1)))
            raise ProfileError(
                f"profile {name}, point {row}: {float(x[row]):g} and {float(height[row]):g} must be finite numbers",
                "point_of_no_numbers",
            )
        return cls._checked(name, points, linear)

    @classmethod
    def _checked(cls, path: str, points: Array, linear: bool) -> "MeasuredProfile":
        """Make a profile of (n, 2) points, the lowest at height zero. Raises ProfileError."""
        if len(points) < 2:
            raise ProfileError(f"profile {path}: {len(points)} points; at least two are required", "too_few_points")
        backwards = np.flatnonzero(np.diff(points[:, 0]) <= 0)
        if len(backwards):
            raise ProfileError(
                f"profile {path}: x_mm must rise; it does not after {float(points[backwards[0], 0]):g} mm",
                "x_not_rising",
            )
        heights = points[:, 1] - points[:, 1].min()
        wrong = wrong_size(float(points[-1, 0] - points[0, 0]), float(heights.max()))
        if wrong is not None:
            raise ProfileError(f"profile {path}: {wrong[0]}", wrong[1])
        return cls(path, tuple(points[:, 0].tolist()), tuple(heights.tolist()), linear)

    def __getstate__(self) -> dict[str, object]:
        return {field.name: getattr(self, field.name) for field in fields(self)}  # without the cached curve

    def __repr__(self) -> str:
        return f"<MeasuredProfile {self.name}, {len(self.x_mm)} points from {self.x_mm[0]:g} to {self.x_mm[-1]:g} mm>"

    @property
    def name(self) -> str:
        """Name of the shape as on the command line."""
        return f"profile:{self.path}{LINEAR if self.linear else ''}"

    @property
    def sharpest_radius_mm(self) -> float:
        """Smallest radius of curvature (mm), 0 because the profile ends in edges."""
        return 0.0

    @cached_property
    def _curve(self) -> "PPoly":
        from scipy.interpolate import PchipInterpolator

        return (_filleted if self.linear else PchipInterpolator)(self.x_mm, self.height_mm)

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Return the profile.

        Parameters
        ----------
        s_mm : ndarray of shape (k,)
            Positions from the reference point (mm).

        Returns
        -------
        tuple of ndarray
            Height (mm), slope and curvature (1/mm), each of shape (k,).
        """
        from sim.contact.compiled import profile_curves

        curve = self._curve
        return profile_curves.measured(s_mm, curve.x, curve.c, self.x_mm[0], self.x_mm[-1], STEEPEST_SLOPE)

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """Return the profile; beyond an end, the closest plane through that end.

        Parameters
        ----------
        s_mm : ndarray of shape (k,)
            Positions from the reference point (mm).
        y_mm : ndarray of shape (k,)
            Heights of the nodes (mm).

        Returns
        -------
        tuple of ndarray
            Height (mm), slope and curvature (1/mm), each of shape (k,).
        """
        from sim.contact.compiled import profile_curves

        beyond, side, clipped = self._beyond(s_mm)
        profile = profile_curves.joined(clipped, self._curve.x, self._curve.c)
        height, slope, _ = arc_tangent(beyond, y_mm - profile[0], 0.0, side)
        inside = beyond <= 0
        return (
            np.where(inside, profile[0], profile[0] + height),
            np.where(inside, profile[1], slope),
            np.where(inside, profile[2], 0.0),
        )

    def _beyond(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Return the distance beyond the nearer end (negative inside), its side, and s clipped to the profile."""
        first, last = self.x_mm[0], self.x_mm[-1]
        return np.maximum(s_mm - last, first - s_mm), np.sign(s_mm - 0.5 * (first + last)), np.clip(s_mm, first, last)


def _filleted(x_mm: tuple[float, ...], height_mm: tuple[float, ...]) -> "PPoly":
    """Return straight lines whose slope changes linearly about each point."""
    from scipy.interpolate import BSpline, PPoly, make_interp_spline

    x, height = np.array(x_mm), np.array(height_mm)
    slope, half = np.diff(height) / np.diff(x), np.minimum(_FILLET_MM, 0.4 * np.diff(x))
    reach = np.minimum(half[:-1], half[1:])
    knots = np.concatenate([x[:1], np.stack([x[1:-1] - reach, x[1:-1] + reach], axis=1).ravel(), x[-1:]])
    curve = make_interp_spline(knots, np.repeat(slope, 2), k=1).antiderivative()
    return PPoly.from_spline(BSpline(curve.t, curve.c + height[0], curve.k))


def read_profile(path: str, *, linear: bool = False) -> MeasuredProfile:
    """Read a profile from a CSV file with the columns x_mm and height_mm. Raises ProfileError."""
    try:
        points = np.array(read_columns(Path(path), COLUMNS))
    except TableError as error:
        raise ProfileError(f"profile {error}", error.code) from None
    return MeasuredProfile._checked(path, points, linear)
