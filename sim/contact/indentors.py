"""Rigid indentors prismatic along z: height of the profile above its lowest point, and two derivatives.

Shapes and dimensions: Raju (1998, ch. 4). The lateral coordinate s is measured from the reference point.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BAR_EDGE_RADIUS_MM = 0.05
"""Radius of the quarter circles at a bar's edges; the source does not give it. [free]"""

STEP_HEIGHT_MM = 0.5
STEP_HALF_WAVELENGTH_MM = {"1": 0.450, "3": 1.3, "5": 3.134}
"""Raju (1998, ch. 4) for steps 1 and 5; step 3 lies in between. [free]"""

NOT_BUILT = ("grating", "sphere", "flat", "cone", "wedge", "line", "point", "profile")


STEEPEST_SLOPE = 1000.0
"""Slope of the flanks of bars and cylinders: 0.06 degrees off the vertical, so that a profile is a function of x."""


class ShapeError(ValueError):
    """The name of an indentor is not understood, or its dimension is out of range."""


class Profile(Protocol):
    """A rigid profile, constant along z."""

    @property
    def name(self) -> str:
        """The shape as it is written on the command line."""

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Height h (mm), dh/ds and d²h/ds² (1/mm) at s."""

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """As `evaluate`, but past an edge the tangent at the profile's point closest to a node at (s, y).

        y is measured from the lowest point. Such planes keep a node that slid past the edge out of the
        indentor without dragging one that is below the edge towards the flank.
        """


@dataclass(frozen=True)
class Bar:
    """Flat bar with quarter-circle edges."""

    width_mm: float
    edge_radius_mm: float = BAR_EDGE_RADIUS_MM

    @property
    def name(self) -> str:
        """The shape as it is written on the command line."""
        return f"bar:{self.width_mm:g}"

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Height, slope and curvature."""
        r = self.edge_radius_mm
        return _arc(np.abs(s_mm) - (0.5 * self.width_mm - r), r, np.sign(s_mm))

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """As `evaluate`; past an edge, the tangent of the quarter circle closest to the node."""
        r = self.edge_radius_mm
        return _arc_tangent(np.abs(s_mm) - (0.5 * self.width_mm - r), y_mm, r, np.sign(s_mm))


@dataclass(frozen=True)
class Cylinder:
    """Circular cylinder with its axis along z."""

    diameter_mm: float

    @property
    def name(self) -> str:
        """The shape as it is written on the command line."""
        return f"cylinder:{self.diameter_mm:g}"

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Height, slope and curvature of the lower half."""
        return _arc(np.abs(s_mm), 0.5 * self.diameter_mm, np.sign(s_mm))

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """As `evaluate`; beyond the radius, the tangent closest to the node."""
        return _arc_tangent(np.abs(s_mm), y_mm, 0.5 * self.diameter_mm, np.sign(s_mm))


@dataclass(frozen=True)
class Step:
    """Sinusoidal step: the lower flat at s < 0, the upper one 0.5 mm higher at s > half-wavelength."""

    number: str

    @property
    def name(self) -> str:
        """The shape as it is written on the command line."""
        return f"step:{self.number}"

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Height, slope and curvature: h = 0.25 (1 − cos πs/L) on the flank."""
        k = np.pi / STEP_HALF_WAVELENGTH_MM[self.number]
        half = 0.5 * STEP_HEIGHT_MM
        flank = (s_mm >= 0) & (s_mm <= np.pi / k)
        t = np.clip(k * s_mm, 0.0, np.pi)
        return half * (1 - np.cos(t)), half * k * np.sin(t), np.where(flank, half * k * k * np.cos(t), 0.0)

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """As `evaluate`: a step has no sides."""
        return self.evaluate(s_mm)


def _arc(t: Array, radius: float, side: Array) -> tuple[Array, Array, Array]:
    """A circle's lower quarter at distance t from its lowest point, then the flank; flat at t < 0."""
    end = radius * STEEPEST_SLOPE / np.hypot(1.0, STEEPEST_SLOPE)
    on_arc = (t >= 0) & (t <= end) & (radius > 0)
    cosine = np.sqrt(radius * radius - np.clip(t, 0.0, end) ** 2)
    slope = np.where(on_arc, t / np.where(on_arc, cosine, 1.0), np.where(t > end, STEEPEST_SLOPE, 0.0))
    height = radius - cosine + STEEPEST_SLOPE * np.maximum(t - end, 0.0)
    return height, side * slope, np.where(on_arc, radius**2 / np.where(on_arc, cosine, 1.0) ** 3, 0.0)


def _arc_tangent(t: Array, y_mm: Array, radius: float, side: Array) -> tuple[Array, Array, Array]:
    """As `_arc`, but past the end of the arc the tangent that is closest to the node."""
    height, slope, curvature = _arc(t, radius, side)
    end = radius * STEEPEST_SLOPE / np.hypot(1.0, STEEPEST_SLOPE)
    past = t > end
    below = np.maximum(radius - y_mm, 1e-12)
    steepness = np.where(past, np.minimum(t / below, STEEPEST_SLOPE), 0.0)
    tangent = radius - radius * np.hypot(1.0, steepness) + steepness * t
    return np.where(past, tangent, height), np.where(past, side * steepness, slope), curvature


def parse_shape(text: str) -> Profile:
    """Indentor named as on the command line, e.g. "bar:3.0"; raises ShapeError with what was expected."""
    kind, _, argument = text.partition(":")
    if kind in NOT_BUILT:
        raise ShapeError(
            f"shape {text!r}: {kind} is not built yet, expected bar:WIDTH, cylinder:DIAMETER or step:1|3|5"
        )
    if kind == "step":
        if argument not in STEP_HALF_WAVELENGTH_MM:
            raise ShapeError(f"shape {text!r}: expected step:1, step:3 or step:5")
        return Step(argument)
    if kind == "bar":
        return Bar(_dimension(text, argument, "width", 0.2, 20.0))
    if kind == "cylinder":
        return Cylinder(_dimension(text, argument, "diameter", 0.5, 50.0))
    raise ShapeError(f"shape {text!r}: no such indentor, expected bar:WIDTH, cylinder:DIAMETER or step:1|3|5")


def _dimension(text: str, argument: str, what: str, low: float, high: float) -> float:
    try:
        value = float(argument)
    except ValueError:
        raise ShapeError(f"shape {text!r}: expected a {what} in mm after the colon") from None
    if not low <= value <= high:
        raise ShapeError(f"shape {text!r}: {what} {value:g} mm is outside {low:g} … {high:g} mm")
    return value
