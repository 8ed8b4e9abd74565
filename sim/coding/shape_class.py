"""Class and size of an indentor, from the shape of the skin in contact.

Decoded pressures move the skin by the finger's compliance, and in contact the skin follows the indentor's outline:
flat, round or stepped across the finger, or round both ways. The class is the outline that explains the skin, within
its error, with the fewest parameters.
"""

from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from sim.coding.sheet import SkinOver

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SolidClass = Literal["bar", "cylinder", "step", "sphere"]
SOLIDS: tuple[SolidClass, ...] = get_args(SolidClass)

SKIN_SD_MM = 0.02
"""Standard deviation of skin under decoded pressures (mm); chosen on other scenes than those reported
(docs/validation/coding.md)."""

STEP_MM = 0.5
"""Height of the source's steps (mm)."""

_PRESSED = 0.25  # threshold of certain contact, relative to the highest pressure
_NEIGHBOURS = 2  # of four: pressed neighbors of a point in contact
_NUMBERS: dict[SolidClass, int] = {"bar": 1, "cylinder": 3, "step": 3, "sphere": 4}  # of fitted parameters
_HALF_WAVES_MM = np.geomspace(0.3, 4.5, 28)
_PLACES_MM = 0.04  # between candidate references of a step
_WIDEST_MM = 20.0  # cylinder or sphere


class SolidEstimate(NamedTuple):
    """Class with its size, and the cost of each class: less is better."""

    name: SolidClass
    size_mm: float  # diameter of a cylinder or a sphere, half a wavelength of a step, width of a bar
    extent_mm: tuple[float, float]  # of contact along x and along z
    cost: dict[SolidClass, float]


class _Outline(NamedTuple):
    squares: float  # mm²
    size_mm: float


def classify_solid(skin: SkinOver, pressure: Array) -> SolidEstimate:
    """Classify the solid from (n,) pressures at the grid's points, some above 0."""
    inside = contact(skin, pressure)
    at = skin.pressed(pressure, skin.lean(pressure))[:, inside]
    extent = extent_mm(skin, pressure)
    x, y, z = at - at.mean(axis=1, keepdims=True)
    outlines = {
        "bar": _Outline(float(y @ y), extent[0]),
        "cylinder": _round(y, x),
        "step": _step(x, y),
        "sphere": _round(y, x, z),
    }
    per_number = np.log(max(2, len(y)))
    cost = {name: outlines[name].squares / SKIN_SD_MM**2 + per_number * _NUMBERS[name] for name in SOLIDS}
    best = min(SOLIDS, key=cost.__getitem__)
    return SolidEstimate(best, outlines[best].size_mm, extent, cost)


def contact(skin: SkinOver, pressure: Array) -> Flags:
    """Return (n,) points certainly in contact: pressed, with at least two pressed neighbors."""
    pressed = (pressure > _PRESSED * pressure.max()).reshape(skin.grid.shape)
    beside = np.pad(pressed, 1).astype(int)
    neighbours = beside[:-2, 1:-1] + beside[2:, 1:-1] + beside[1:-1, :-2] + beside[1:-1, 2:]
    inside = pressed & (neighbours >= _NEIGHBOURS)
    return np.asarray((inside if inside.any() else pressed).ravel())


def extent_mm(skin: SkinOver, pressure: Array) -> tuple[float, float]:
    """Return the extent of contact along x and z: that of a uniform pressure of the same spread."""
    inside = contact(skin, pressure)
    weight = pressure[inside] / pressure[inside].sum()
    x, z = (float(np.sqrt(12 * weight @ (v - weight @ v) ** 2)) for v in skin.grid.place_mm[inside].T)
    return x, z


def _round(up: Array, *flat: Array) -> _Outline:
    """Fit a convex surface by algebraic least squares: a circle for one flat direction, a sphere for two."""
    if len(up) < 3 + len(flat):
        return _Outline(np.inf, np.nan)
    level = sum(v * v for v in flat) + up * up
    terms = np.stack([*flat, up, np.ones_like(up)], axis=1)
    *across, b, c = np.linalg.lstsq(terms, -level, rcond=None)[0]
    radius = np.sqrt(max(0.0, (sum(a * a for a in across) + b * b) / 4 - c))
    if b > 0 or 2 * radius > _WIDEST_MM:  # the center is below the surface: concave
        return _Outline(np.inf, 2 * radius)
    apart = np.sqrt(sum((v + a / 2) ** 2 for v, a in zip(flat, across, strict=True)) + (up + b / 2) ** 2)
    return _Outline(float(((apart - radius) ** 2).sum()), float(2 * radius))


def _step(along: Array, up: Array) -> _Outline:
    """Fit the best half-wavelength and reference of a step, at its best height."""
    reference = np.arange(along.min() - 1.0, along.max() + 0.5, _PLACES_MM)
    s = (along - reference[:, None])[None] / _HALF_WAVES_MM[:, None, None]
    left = up - 0.5 * STEP_MM * (1 - np.cos(np.pi * np.clip(s, 0.0, 1.0)))
    squares = ((left - left.mean(axis=-1, keepdims=True)) ** 2).sum(axis=-1)
    best = np.unravel_index(squares.argmin(), squares.shape)
    return _Outline(float(squares[best]), float(_HALF_WAVES_MM[best[0]]))
