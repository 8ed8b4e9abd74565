"""Profiles of rigid indentors: height above the lowest point, and two derivatives.

Shapes and dimensions: Raju (1998, ch. 4). The lateral coordinate s is measured from the reference point.
Compiled loops are imported where a profile is evaluated: a program that only names shapes never waits for numba.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BAR_EDGE_RADIUS_MM = 0.05
"""Radius of the quarter circles at a bar's edges (mm); the source does not state it. [free]"""

STEP_HEIGHT_MM = 0.5
STEP_HALF_WAVELENGTH_MM = {"1": 0.450, "3": 1.3, "5": 3.134}
"""Radii of the steps (mm): Raju (1998, ch. 4) for steps 1 and 5; step 3 lies between them. [free]"""

GROOVE_DEPTH_MM = 0.5
WEDGE_TIP_RADIUS_MM = 0.05
"""Radius of a wedge's edge (mm), the same as a bar's. [free]"""

STEEPEST_SLOPE = 1000.0
"""Slope of the flanks of bars and cylinders: 0.06 degrees off the vertical, so that a profile is a function of x."""

_MEASURED_TO_MM, _MEASURED_STEP_MM, _MEASURED_KEPT = 25.0, 0.005, 64
_BENT_RAD, _EDGE_RAD, _MOST_CLOSELY = 0.005, 0.5, 100
_STRAIGHT_RAD = 1e-9  # round-off turns a flank by less


class IndentorProfile(Protocol):
    """Profile of a rigid indentor."""

    @property
    def name(self) -> str:
        """Name of the shape on the command line."""

    @property
    def sharpest_radius_mm(self) -> float:
        """Smallest radius of curvature of the convex parts (mm); 0 for an edge."""

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Return height h (mm), dh/ds and d²h/ds² (1/mm) at s."""

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """Return the same; past an edge, the tangent at the profile's point closest to a node at (s, y).

        y is measured from the lowest point. Such planes keep a node that slid past the edge out of the indentor
        without dragging one that is below the edge towards the flank. A shape without sides has none.
        """
        return self.evaluate(s_mm)


@dataclass(frozen=True)
class Bar:
    """Flat bar with quarter-circle edges."""

    width_mm: float
    edge_radius_mm: float = BAR_EDGE_RADIUS_MM

    @property
    def name(self) -> str:
        return f"bar:{self.width_mm:g}"

    @property
    def sharpest_radius_mm(self) -> float:
        return self.edge_radius_mm

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        r = self.edge_radius_mm
        return arc(np.abs(s_mm) - (0.5 * self.width_mm - r), r, np.sign(s_mm))

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """Return the same; past an edge, the tangent of the quarter circle closest to the node."""
        r = self.edge_radius_mm
        return arc_tangent(np.abs(s_mm) - (0.5 * self.width_mm - r), y_mm, r, np.sign(s_mm))


@dataclass(frozen=True)
class Cylinder:
    """Circular cylinder with its axis along z."""

    diameter_mm: float

    @property
    def name(self) -> str:
        return f"cylinder:{self.diameter_mm:g}"

    @property
    def sharpest_radius_mm(self) -> float:
        return 0.5 * self.diameter_mm

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Return height, slope and curvature of the lower half."""
        return arc(np.abs(s_mm), 0.5 * self.diameter_mm, np.sign(s_mm))

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """Return the same; beyond the radius, the tangent closest to the node."""
        return arc_tangent(np.abs(s_mm), y_mm, 0.5 * self.diameter_mm, np.sign(s_mm))


@dataclass(frozen=True)
class SinusoidalStep(IndentorProfile):
    """Sinusoidal step: the lower flat at s < 0, the upper one 0.5 mm higher at s > half-wavelength."""

    number: str

    @property
    def name(self) -> str:
        return f"step:{self.number}"

    @property
    def sharpest_radius_mm(self) -> float:
        return (STEP_HALF_WAVELENGTH_MM[self.number] / np.pi) ** 2 / (0.5 * STEP_HEIGHT_MM)

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Return height, slope and curvature: h = 0.25 (1 − cos πs/L) on the flank."""
        from sim.contact.compiled import profile_curves

        return profile_curves.flank(s_mm, 0.5 * STEP_HEIGHT_MM, np.pi / STEP_HALF_WAVELENGTH_MM[self.number])


@dataclass(frozen=True)
class Wedge(IndentorProfile):
    """Wedge with its edge along z, rounded at the tip."""

    half_angle_deg: float
    tip_radius_mm: float = WEDGE_TIP_RADIUS_MM

    @property
    def name(self) -> str:
        return f"wedge:{self.half_angle_deg:g}"

    @property
    def sharpest_radius_mm(self) -> float:
        return self.tip_radius_mm

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Return height, slope and curvature: a circle up to the flank's slope, then the flank."""
        steepest = 1.0 / np.tan(np.radians(self.half_angle_deg))
        return arc(np.abs(s_mm), self.tip_radius_mm, np.sign(s_mm), steepest)


@dataclass(frozen=True)
class Grating:
    """Endless ridges, 0.5 mm high, with edges rounded as a bar's; the reference is the center of a ridge."""

    ridge_mm: float
    pitch_mm: float
    edge_radius_mm: float = BAR_EDGE_RADIUS_MM

    @property
    def name(self) -> str:
        return f"grating:{self.ridge_mm:g},{self.pitch_mm:g}"

    @property
    def sharpest_radius_mm(self) -> float:
        return self.edge_radius_mm

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Return height, slope and curvature; the groove's floor where the flank would rise above it."""
        t, side = self._into_edge(s_mm)
        profile = arc(t, self.edge_radius_mm, side)
        return _floored(profile, profile[0] > GROOVE_DEPTH_MM)

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """Return the same; in a groove, the closer of the nearest edge's tangent and the floor."""
        t, side = self._into_edge(s_mm)
        tangent = arc_tangent(t, y_mm, self.edge_radius_mm, side)
        to_edge = (tangent[0] - y_mm) / np.hypot(1.0, tangent[1])
        return _floored(tangent, (t > self.edge_radius_mm) & (GROOVE_DEPTH_MM - y_mm < to_edge))

    def _into_edge(self, s_mm: Array) -> tuple[Array, Array]:
        nearest = s_mm - self.pitch_mm * np.round(s_mm / self.pitch_mm)
        return np.abs(nearest) - (0.5 * self.ridge_mm - self.edge_radius_mm), np.sign(nearest)


@dataclass(frozen=True)
class Plane(IndentorProfile):
    """Plate wider than the finger."""

    @property
    def name(self) -> str:
        return "flat"

    @property
    def sharpest_radius_mm(self) -> float:
        """Smallest radius of curvature (mm): infinite."""
        return np.inf

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Return height, slope and curvature: zero."""
        return np.zeros_like(s_mm), np.zeros_like(s_mm), np.zeros_like(s_mm)


@lru_cache(maxsize=_MEASURED_KEPT)
def measured_radius_mm(profile: IndentorProfile) -> float:
    """Return the smallest radius of curvature of a profile's convex parts in mm; 0 for an edge, inf for a plane.

    Heights and slopes are sampled every 5 µm and joined by chords; in the hundred intervals that turn most, by more
    than 0.005 rad, every 0.05 µm. A turn of half a radian within that is an edge.
    """
    s = np.arange(-_MEASURED_TO_MM, _MEASURED_TO_MM, _MEASURED_STEP_MM)
    turn, chord = _turns(profile, s)
    coarse = turn < _BENT_RAD
    if np.count_nonzero(~coarse) > _MOST_CLOSELY:
        coarse[np.argsort(turn, kind="stable")[:-_MOST_CLOSELY]] = True
    fine = s[:-1][~coarse, None] + np.linspace(0.0, _MEASURED_STEP_MM, 101)
    turn_within, chord_within = _turns(profile, fine)
    if (turn_within > _EDGE_RAD).any():
        return 0.0
    found = np.concatenate([turn[coarse], turn_within.ravel()]), np.concatenate([chord[coarse], chord_within.ravel()])
    convex = found[0] > _STRAIGHT_RAD
    return float((found[1][convex] / found[0][convex]).min(initial=np.inf))


def _turns(profile: IndentorProfile, s_mm: Array) -> tuple[Array, Array]:
    """Return the turn (rad, positive where convex) and the chord (mm) between neighbors along the last axis."""
    height, slope, _ = (value.reshape(s_mm.shape) for value in profile.evaluate(s_mm.ravel()))
    return np.diff(np.arctan(slope)), np.hypot(np.diff(s_mm), np.diff(height))


def _floored(profile: tuple[Array, Array, Array], floor: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Return the profile, replaced by the groove's floor where the mask says so."""
    height, slope, curvature = profile
    return np.where(floor, GROOVE_DEPTH_MM, height), np.where(floor, 0.0, slope), np.where(floor, 0.0, curvature)


def arc(t: Array, radius: float, side: Array, steepest: float = STEEPEST_SLOPE) -> tuple[Array, Array, Array]:
    """Return a circle's lower part at distance t from its lowest point, then a flank; flat at t < 0."""
    from sim.contact.compiled import profile_curves

    return profile_curves.arc(t, radius, side, steepest)


def arc_tangent(t: Array, y_mm: Array, radius: float, side: Array) -> tuple[Array, Array, Array]:
    """Return `arc`, but past its end the tangent that is closest to the node at height y."""
    from sim.contact.compiled import profile_curves

    height, slope, curvature = arc(t, radius, side)
    profile_curves.lean(height, slope, t, y_mm, radius, side, STEEPEST_SLOPE)
    return height, slope, curvature
