"""First contact of an indentor with the undeformed, continuous skin: the zero of DOI."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize, minimize_scalar

from sim.contact.indentor import ACROSS, ALONG, Indentor, Revolved

Array = NDArray[np.float64]

_GRID_MM = 0.004
_ROUND_GRID_MM = 0.1
_BEST_POINTS, _FINER, _FINEST_GRID_MM = 60, 4, 1e-5


class SkinSurface(Protocol):
    """Undeformed, continuous skin."""

    @property
    def ridge(self) -> CubicSpline:
        """Apex line along x: highest y over all z as a function of x (mm)."""

    @property
    def crest(self) -> CubicSpline:
        """Apex line along z: highest y over all x as a function of z (mm)."""

    def height(self, x_mm: ArrayLike, z_mm: ArrayLike) -> Array:
        """Return y at (x, z) in mm, −inf where there is no skin."""


class FirstTouch(NamedTuple):
    """Height of the indentor's lowest point at first touch and the touched point along its axes (mm)."""

    height_mm: float
    at_mm: tuple[float, ...]


def first_touch(indentor: Indentor, at_mm: tuple[float, ...], skin: SkinSurface) -> FirstTouch:
    """Lower an indentor above a reference point until it touches the skin."""
    if indentor.axes == ALONG:
        return _prismatic(indentor, at_mm[0], skin.ridge)
    if indentor.axes == ACROSS:
        return _prismatic(indentor, at_mm[0], skin.crest)
    return _round(indentor, at_mm, skin) if isinstance(indentor, Revolved) else _anywhere(indentor, at_mm, skin)


def _prismatic(indentor: Indentor, at_mm: float, top: CubicSpline) -> FirstTouch:
    low, high = top.x[0], top.x[-1]
    s = np.linspace(low, high, int((high - low) / _GRID_MM) + 1)
    gaps = indentor.evaluate((s - at_mm)[None]).height_mm - top(s)
    best = int(np.argmin(gaps))
    bounds = (s[max(best - 1, 0)], s[min(best + 1, len(s) - 1)])

    def gap(at: float) -> float:
        return float(indentor.evaluate(np.array([[at - at_mm]])).height_mm[0] - top(at))

    found = minimize_scalar(gap, bounds=bounds, method="bounded", options={"xatol": 1e-12})
    return _lower(gap(float(s[best])), (float(s[best]),), float(found.fun), (float(found.x),))


def _round(indentor: Indentor, at_mm: tuple[float, ...], skin: SkinSurface) -> FirstTouch:
    centre = np.array(at_mm)
    ends = np.array([skin.ridge.x[[0, -1]], skin.crest.x[[0, -1]]])

    def gap(point: Array) -> Array:
        inside = np.clip(point.T, ends[:, 0], ends[:, 1]).T
        return np.asarray(indentor.evaluate(inside - centre[:, None]).height_mm - skin.height(*inside))

    sides = [np.arange(low, high, _ROUND_GRID_MM) for low, high in ends]
    grid = np.stack([side.ravel() for side in np.meshgrid(*sides, indexing="ij")])
    gaps = gap(grid)
    best = grid[:, int(np.argmin(gaps))]
    simplex = best + 0.5 * _ROUND_GRID_MM * np.array([[0, 0], [1, 0], [0, 1]])
    found = minimize(
        lambda point: float(gap(np.array(point)[:, None])[0]),
        best,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-10, "fatol": 1e-14, "maxfev": 600},
    )
    return _lower(
        float(gaps.min()), (float(best[0]), float(best[1])), float(found.fun), (float(found.x[0]), float(found.x[1]))
    )


def _lower(gap: float, at: tuple[float, ...], other_gap: float, other_at: tuple[float, ...]) -> FirstTouch:
    return FirstTouch(-gap, at) if gap < other_gap else FirstTouch(-other_gap, other_at)


def _anywhere(indentor: Indentor, at_mm: tuple[float, ...], skin: SkinSurface) -> FirstTouch:
    """Find the first touch of a surface with features finer than `_round`'s grid, by repeated refinement."""
    centre = np.array(at_mm)[:, None]
    ends = np.array([skin.ridge.x[[0, -1]], skin.crest.x[[0, -1]]])
    sides = [np.arange(low, high, _ROUND_GRID_MM) for low, high in ends]
    points, spacing = np.stack([side.ravel() for side in np.meshgrid(*sides, indexing="ij")]), _ROUND_GRID_MM
    while True:
        gaps = indentor.evaluate(points - centre).height_mm - skin.height(*points)
        best = points[:, np.argsort(gaps, kind="stable")[:_BEST_POINTS]]
        if spacing < _FINEST_GRID_MM:
            return FirstTouch(-float(gaps.min()), (float(best[0, 0]), float(best[1, 0])))
        spacing /= _FINER
        around = np.stack(np.meshgrid(*[np.arange(-_FINER, _FINER + 1) * spacing] * 2)).reshape(2, 1, -1)
        points = np.unique((best[:, :, None] + around).reshape(2, -1), axis=1)
        points = np.clip(points, ends[:, :1], ends[:, 1:])
