"""Which places there are inside a finger, by its skin and bone alone: receptors at x, depth and z, or a refusal."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.config.fingertip_config import FingertipConfig
from sim.finger.grading import axial_places
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, ReceptorError, ReceptorSet, point_below

Array = NDArray[np.float64]

MOST_RECEPTORS = 1000
"""Their columns take 0.4 GB and a minute; more points than that are for `fields`."""

_AROUND = np.linspace(-np.pi, np.pi, 1441)
_PLACED = 1e-6
_BISECTIONS = 24
_ROUND = 100  # bounds are said to hundredths of a millimetre, inwards


class ReceptorPlaces(NamedTuple):
    """Every combination of x, depth below the skin and z along the finger; mm."""

    x_mm: tuple[float, ...] = DEFAULT_X_MM
    depth_mm: tuple[float, ...] = (DEFAULT_DEPTH_MM,)
    z_mm: tuple[float, ...] | None = None  # the receptor plane

    @classmethod
    def of(
        cls, x_mm: Sequence[float], depth_mm: float | Sequence[float], z_mm: float | Sequence[float] | None
    ) -> "ReceptorPlaces":
        """Numbers and sequences alike."""
        return cls(_several(x_mm), _several(depth_mm), None if z_mm is None else _several(z_mm))

    def as_options(self) -> dict[str, Any]:
        """By the names under which a finger is loaded with them."""
        return {f"receptor_{name}": values for name, values in self._asdict().items()}


NOWHERE = ReceptorPlaces((), (), ())
"""For a finger that is asked for its force alone."""


def _several(values: float | Sequence[float]) -> tuple[float, ...]:
    return tuple(np.atleast_1d(values).astype(float).tolist())


def receptors_at(config: FingertipConfig, surface: FingertipSurface, places: ReceptorPlaces) -> ReceptorSet:
    """The receptors at these places, x going fastest and z slowest; at NOWHERE none.

    Raises ReceptorError, as `points_below`.
    """
    if places == NOWHERE:
        return ReceptorSet(np.zeros((0, 3)), np.zeros(0))
    z = (config.receptor_plane_mm,) if places.z_mm is None else places.z_mm
    asked = len(z) * len(places.depth_mm) * len(places.x_mm)
    if not 0 < asked <= MOST_RECEPTORS:
        raise ReceptorError(
            "{receptors} receptors: expected 1 to {most}", code="how_many", receptors=asked, most=MOST_RECEPTORS
        )
    z_mm, depth_mm, x_mm = np.meshgrid(z, places.depth_mm, places.x_mm, indexing="ij")
    points = points_below(config, surface, x_mm, depth_mm, z_mm)
    return ReceptorSet(points.reshape(-1, 3), depth_mm.ravel())


def points_below(
    config: FingertipConfig, surface: FingertipSurface, x_mm: ArrayLike, depth_mm: ArrayLike, z_mm: ArrayLike
) -> Array:
    """(…, 3) points at x and z whose perpendicular distance to the pulp's skin is the depth, broadcast; mm.

    Raises ReceptorError, naming what there is, for the first above the skin, in the bone or at the finger's ends.
    """
    x, depth, z = np.broadcast_arrays(*(np.asarray(values, dtype=float) for values in (x_mm, depth_mm, z_mm)))
    _refuse_ends(config, z.ravel())
    points = []
    for place in zip(x.ravel().tolist(), depth.ravel().tolist(), z.ravel().tolist(), strict=True):
        point = _tissue_at(config, surface, *place)
        if point is None:
            raise _none_there(config, surface, *place)
        points.append(point)
    return np.array(points).reshape(*x.shape, 3)


def _tissue_at(
    config: FingertipConfig, surface: FingertipSurface, x_mm: float, depth_mm: float, z_mm: float
) -> Array | None:
    """(3,) the point at x and z so far below the pulp's skin, or None where there is no tissue."""
    if not (np.isfinite([x_mm, depth_mm]).all() and depth_mm > 0):
        return None
    try:
        point = point_below(surface, x_mm, depth_mm, z_mm)
    except ReceptorError:
        return None
    skin = np.stack(surface.section(_AROUND, z_mm))
    nearest = np.hypot(*(skin - point[:2, None])).min() > (1 - _PLACED) * depth_mm  # no other skin is nearer
    return point if nearest and _of_the_way_out(skin, point) > _bone(config) else None


def _bone(config: FingertipConfig) -> float:
    """Where the mesh ends, from the bone's axis to the skin."""
    return config.tissue.bone_fraction * (0.5 if config.tissue.bone == "elastic" else 1.0)


def _of_the_way_out(skin: Array, point: Array) -> float:
    """A point's distance from the bone's axis over that of a (2, n) section of the skin in the same direction."""
    x, y = skin
    direction = np.unwrap(np.arctan2(y, x))
    turn = (np.arctan2(point[1], point[0]) - direction[0]) % (2 * np.pi)
    return float(np.hypot(*point[:2]) / np.interp(turn, direction - direction[0], np.hypot(x, y)))


def _refuse_ends(config: FingertipConfig, z_mm: Array) -> None:
    ends = axial_places(config)[0][[1, -2]]
    outside = z_mm[~((z_mm > ends[0]) & (z_mm < ends[1]))]
    if len(outside):
        raise ReceptorError(
            "no receptor at z = {z_mm:g} mm: expected z from {low_mm:g} to {high_mm:g} mm",
            code="z_outside",
            z_mm=float(outside[0]),
            **_range(*ends),
        )


def _none_there(
    config: FingertipConfig, surface: FingertipSurface, x_mm: float, depth_mm: float, z_mm: float
) -> ReceptorError:
    what = "no receptor at x = {x_mm:g} mm, {depth_mm:g} mm below the skin: expected "
    at = {"x_mm": x_mm, "depth_mm": depth_mm, "z_mm": z_mm}
    x, _ = surface.section(np.linspace(0.0, np.pi, 721), z_mm)
    if not x.min() < x_mm < x.max():
        return ReceptorError(
            what + "x from {low_mm:g} to {high_mm:g} mm at z = {z_mm:g} mm",
            code="x_outside",
            **at,
            **_range(x.min(), x.max()),
        )
    least, most = 0.0, float(np.hypot(*surface.section(np.pi / 2, z_mm)))
    for _ in range(_BISECTIONS):
        middle = 0.5 * (least + most)
        there = _tissue_at(config, surface, x_mm, middle, z_mm)
        least, most = (middle, most) if there is not None else (least, middle)
    return ReceptorError(
        what + "depths from {low_mm:g} to {high_mm:g} mm at x = {x_mm:g}, z = {z_mm:g} mm",
        code="depth_outside",
        **at,
        **_range(0.0, least),
    )


def _range(low: float, high: float) -> dict[str, float]:
    return {"low_mm": float(np.ceil(_ROUND * low) / _ROUND), "high_mm": float(np.floor(_ROUND * high) / _ROUND)}
