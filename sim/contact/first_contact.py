"""First contact of an indentor with the undeformed, continuous skin: the zero of DOI."""

from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize, minimize_scalar

from sim.contact.indentor import ACROSS, ALONG, Indentor, Revolved
from sim.contact.profiles import IndentorProfile

Array = NDArray[np.float64]

_GRID_MM = 0.004
_ROUND_GRID_MM = 0.1
_SKINS_KEPT = 8
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

    def __hash__(self) -> int:
        """Return a hash, by which heights of the same skin are cached."""


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
    if isinstance(indentor, Revolved):
        return _round(indentor.profile, at_mm, skin)
    return _anywhere(indentor, at_mm, skin)


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


def _round(profile: IndentorProfile, at_mm: tuple[float, ...], skin: SkinSurface) -> FirstTouch:
    """Lower a round indentor. Only heights are asked: an indentor over a turned finger asks at every sample."""
    centre = np.array(at_mm)[:, None]
    (low, high), grid, skin_mm = _grid_of(skin)

    def gap(point: Array) -> float:
        inside = np.minimum(np.maximum(point[:, None], low), high)
        return float((profile.evaluate(np.hypot(*(inside - centre)))[0] - skin.height(*inside))[0])

    gaps = profile.evaluate(np.hypot(*(grid - centre)))[0] - skin_mm
    best = grid[:, int(np.argmin(gaps))]
    simplex = best + 0.5 * _ROUND_GRID_MM * np.array([[0, 0], [1, 0], [0, 1]])
    found = minimize(
        gap,
        best,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-10, "fatol": 1e-14, "maxfev": 600},
    )
    return _lower(
        float(gaps.min()), (float(best[0]), float(best[1])), float(found.fun), (float(found.x[0]), float(found.x[1]))
    )


@lru_cache(maxsize=_SKINS_KEPT)
def _grid_of(skin: SkinSurface) -> tuple[tuple[Array, Array], Array, Array]:
    """Return the ends (2, 1) of the skin that can be touched, points (2, k) of it, and heights (k,) there in mm."""
    ends = np.array([skin.ridge.x[[0, -1]], skin.crest.x[[0, -1]]])
    sides = [np.arange(low, high, _ROUND_GRID_MM) for low, high in ends]
    grid = np.stack([side.ravel() for side in np.meshgrid(*sides, indexing="ij")])
    inside = np.clip(grid.T, ends[:, 0], ends[:, 1]).T
    return (ends[:, :1], ends[:, 1:]), inside, np.asarray(skin.height(*inside))


def _lower(gap: float, at: tuple[float, ...], other_gap: float, other_at: tuple[float, ...]) -> FirstTouch:
    return FirstTouch(-gap, at) if gap < other_gap else FirstTouch(-other_gap, other_at)


def _anywhere(indentor: Indentor, at_mm: tuple[float, ...], skin: SkinSurface) -> FirstTouch:
    """Find the first touch of a surface with features finer than `_round`'s grid, by repeated refinement."""
    centre, spacing = np.array(at_mm)[:, None], _ROUND_GRID_MM
    (low, high), points, skin_mm = _grid_of(skin)
    while True:
        gaps = indentor.evaluate(points - centre).height_mm - skin_mm
        best = points[:, np.argsort(gaps, kind="stable")[:_BEST_POINTS]]
        if spacing < _FINEST_GRID_MM:
            return FirstTouch(-float(gaps.min()), (float(best[0, 0]), float(best[1, 0])))
        spacing /= _FINER
        around = np.stack(np.meshgrid(*[np.arange(-_FINER, _FINER + 1) * spacing] * 2)).reshape(2, 1, -1)
        points = np.unique((best[:, :, None] + around).reshape(2, -1), axis=1)
        points = np.clip(points, low, high)
        skin_mm = skin.height(*points)
