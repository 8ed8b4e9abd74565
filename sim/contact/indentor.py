"""Indentor surfaces: a profile swept along a line or turned about the vertical, or any height over x and z."""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from sim.contact.patch import X, Z
from sim.contact.profiles import IndentorProfile, measured_radius_mm
from sim.errors import ArgumentError, SimError, refuse_unless_numbers

Array = NDArray[np.float64]

ALONG: tuple[int, ...] = (X,)
ACROSS: tuple[int, ...] = (Z,)
BOTH: tuple[int, ...] = (X, Z)

MOST_TURN_DEG = 360.0

SHARP_RADIUS_MM = 0.5
RADIUS_TOLERANCE = 0.1
"""Allowed difference between the stated sharpest radius of a profile and the measured one."""

EDGE_RADIUS_MM = 0.02
"""Radius below which a profile has an edge (mm)."""


_ALONG_ITSELF = np.ones((1, 1))


class ShapeWarning(SimError, UserWarning):  # noqa: N818
    """Warning that a shape states a property that measurements on it contradict."""

    default_code = "not_so"


class Surface(NamedTuple):
    """Height (k,) in mm, slope (m, k) and second derivatives (m, m, k) in 1/mm of an indentor along its m axes."""

    height_mm: Array
    slope: Array
    curvature: Array


class Indentor(ABC):
    """A rigid surface over offsets from its reference point, and the axes along which it slopes.

    `parse_shape` and `HeightMap.from_arrays` make indentors; `Indentor.along` makes one from a profile.

    Attributes
    ----------
    name : str
        Name in results and errors.
    axes : tuple of int
        Axes along which the surface slopes.
    """

    name: str
    axes: tuple[int, ...]

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    @staticmethod
    def along(profile: IndentorProfile) -> "Prismatic":
        """Return an indentor that is prismatic along the finger, with the name of its profile.

        Parameters
        ----------
        profile : IndentorProfile
            For example a `MeasuredProfile`.

        Returns
        -------
        Prismatic
            The indentor.

        Examples
        --------
        >>> from sim import Indentor, MeasuredProfile
        >>> Indentor.along(MeasuredProfile.from_arrays([-1.0, 0.0, 1.0], [0.2, 0.0, 0.2], name="groove")).sharp
        True
        """
        return Prismatic(profile.name, profile)

    @property
    def placed_by(self) -> tuple[int, ...]:
        """Axes along which the position of the indentor makes a difference."""
        return self.axes

    def lateral_mm(self, x_mm: float) -> float:
        """Return the lateral position of the indentor, 0 where it makes no difference.

        Parameters
        ----------
        x_mm : float
            Lateral position of the carriage (mm).

        Returns
        -------
        float
            Lateral position (mm).
        """
        return x_mm if X in self.placed_by else 0.0

    @property
    def between_nodes(self) -> bool:
        """Whether contact is enforced between nodes too."""
        return self.sharp

    @property
    def corners_only(self) -> bool:
        """Whether that is needed only where the surface turns within less than the spacing of nodes."""
        return False

    @property
    @abstractmethod
    def sharp(self) -> bool:
        """Whether the surface turns somewhere within less than about the spacing of nodes."""

    @abstractmethod
    def turned(self, turn_deg: float) -> "Indentor":
        """Return the indentor, turned about the vertical through its reference point.

        Parameters
        ----------
        turn_deg : float
            Angle, x towards the tip (degrees).

        Returns
        -------
        Indentor
            The turned indentor.

        Raises
        ------
        ArgumentError
            If a turn makes no difference, or the shape cannot be turned.
        """

    @abstractmethod
    def turning(self, offset_mm: Array, reach_mm: float) -> Array:
        """Return the angle by which the surface's normal turns about places.

        Parameters
        ----------
        offset_mm : ndarray of shape (m, k)
            Offsets from the reference point along the axes (mm).
        reach_mm : float
            Distance to either side (mm).

        Returns
        -------
        ndarray of shape (k,)
            Angles (rad).
        """

    @abstractmethod
    def evaluate(self, offset_mm: Array) -> Surface:
        """Return the surface above its lowest point.

        Parameters
        ----------
        offset_mm : ndarray of shape (m, k)
            Offsets from the reference point along the axes (mm).

        Returns
        -------
        Surface
            Height, slope and curvature.
        """

    @abstractmethod
    def tangent(self, offset_mm: Array, y_mm: Array) -> Surface:
        """Return the surface; past an edge, the tangent plane that is closest to a node.

        Parameters
        ----------
        offset_mm : ndarray of shape (m, k)
            Offsets from the reference point along the axes (mm).
        y_mm : ndarray of shape (k,)
            Heights of the nodes (mm).

        Returns
        -------
        Surface
            Height, slope and curvature.
        """


class _OfProfile(Indentor):
    """Indentor swept from a profile."""

    profile: IndentorProfile

    @cached_property
    def sharp(self) -> bool:
        """Whether the measured profile turns within less than about the spacing of nodes."""
        stated, measured = self.profile.sharpest_radius_mm, measured_radius_mm(cast(Hashable, self.profile))
        if (
            stated in (measured, 0.0)  # 0: nothing is sharper
            or max(stated, measured) < EDGE_RADIUS_MM
            or abs(measured / stated - 1) <= RADIUS_TOLERANCE
        ):
            return stated < SHARP_RADIUS_MM
        warnings.warn(
            ShapeWarning(
                f"{self.name}: sharpest_radius_mm is {stated:g} mm, but the profile turns within {measured:.3g} mm; "
                "using the measured value",
                "other_radius",
            ),
            stacklevel=2,
        )
        return measured < SHARP_RADIUS_MM

    def turning(self, offset_mm: Array, reach_mm: float) -> Array:
        """Return (k,) angles in rad by which the profile's normal turns within a reach of (m, k) offsets."""
        s, _ = self._arm(offset_mm)
        before, after = (np.arctan(self.profile.evaluate(at)[1]) for at in (s - reach_mm, s + reach_mm))
        return np.asarray(np.abs(after - before))

    def evaluate(self, offset_mm: Array) -> Surface:
        """Return the surface at (m, k) offsets from the reference point, above the lowest point."""
        s, direction = self._arm(offset_mm)
        return self._swept(s, direction, *self.profile.evaluate(s))

    def tangent(self, offset_mm: Array, y_mm: Array) -> Surface:
        """Return the surface; past an edge, the tangent plane closest to a node at the height y."""
        s, direction = self._arm(offset_mm)
        return self._swept(s, direction, *self.profile.tangent(s, y_mm))

    @abstractmethod
    def _arm(self, offset_mm: Array) -> tuple[Array, Array]:
        """Return the profile's coordinate and the unit vector along which it grows."""

    @abstractmethod
    def _swept(self, s: Array, direction: Array, height: Array, slope: Array, curvature: Array) -> Surface: ...


@dataclass(frozen=True, repr=False)
class Prismatic(_OfProfile):
    """Profile swept along a line: along the finger, across it, or at an angle."""

    name: str
    profile: IndentorProfile
    axes: tuple[int, ...] = ALONG
    direction: tuple[float, ...] = (1.0,)  # unit vector along which the profile's coordinate grows

    @cached_property
    def placed_by(self) -> tuple[int, ...]:
        """Axes along which the position makes a difference: none for a plane."""
        return () if np.isinf(self.profile.sharpest_radius_mm) and not self.sharp else self.axes

    def turned(self, turn_deg: float) -> "Prismatic":
        """Turn a shape that lies along the finger. Raises ArgumentError for any other, and for a plane."""
        refuse_turn(turn_deg)
        if not self.placed_by:
            raise ArgumentError("it is the same everywhere and cannot be turned", "same_everywhere")
        if self.axes != ALONG or self.direction != (1.0,):
            raise ArgumentError("only a shape that lies along the finger can be turned", "not_along")
        turn = 180.0 - (180.0 - turn_deg) % 360.0  # above −180 to 180
        quarters = {0.0: (ALONG, 1.0), 90.0: (ACROSS, 1.0), 180.0: (ALONG, -1.0), -90.0: (ACROSS, -1.0)}
        if turn in quarters:
            axes, sign = quarters[turn]
            return Prismatic(self.name + turn_suffix(turn), self.profile, axes, (sign,))
        angle = np.radians(turn)
        return Prismatic(
            self.name + turn_suffix(turn), self.profile, BOTH, (float(np.cos(angle)), float(np.sin(angle)))
        )

    def _arm(self, offset_mm: Array) -> tuple[Array, Array]:
        if self.direction == (1.0,):
            return offset_mm[0], _ALONG_ITSELF
        direction = np.array(self.direction)[:, None]
        return (direction * offset_mm).sum(axis=0), direction

    def _swept(self, s: Array, direction: Array, height: Array, slope: Array, curvature: Array) -> Surface:
        if direction is _ALONG_ITSELF:
            return Surface(height, slope[None], curvature[None, None])
        return Surface(height, direction * slope, direction[:, None] * direction * curvature)


@dataclass(frozen=True, repr=False)
class Revolved(_OfProfile):
    """Profile turned about the vertical."""

    name: str
    profile: IndentorProfile

    axes = BOTH

    corners_only = True

    def turned(self, turn_deg: float) -> Indentor:
        """Raise ArgumentError: a round shape cannot be turned."""
        raise ArgumentError("it is round and cannot be turned", "round")

    def _arm(self, offset_mm: Array) -> tuple[Array, Array]:
        from sim.contact.compiled import profile_curves

        return profile_curves.arm(offset_mm)

    def _swept(self, s: Array, direction: Array, height: Array, slope: Array, curvature: Array) -> Surface:
        from sim.contact.compiled import profile_curves

        return Surface(height, *profile_curves.revolved(s, direction, slope, curvature))


def refuse_turn(turn_deg: float) -> None:
    """Raise ArgumentError unless a turn is one number within a full turn."""
    refuse_unless_numbers(turn_deg=turn_deg)
    if not abs(turn_deg) <= MOST_TURN_DEG:
        raise ArgumentError(
            f"turn_deg = {turn_deg}: must be an angle within ± {MOST_TURN_DEG:g} degrees", "turn_out_of_range"
        )


def turn_suffix(turn_deg: float) -> str:
    """Return the suffix that a turn adds to a shape's name."""
    return {0.0: "", 90.0: ",across"}.get(turn_deg, f",turn_deg={turn_deg:g}")
