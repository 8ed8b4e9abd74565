"""Receptors under the skin, and the linear map from nodal displacements to the strain at each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import root

from sim.config import FingertipConfig
from sim.errors import SimError
from sim.fem.elements import local_coordinates, shape_functions, strain_matrix
from sim.finger.mesh import FingerMesh, axial_places
from sim.finger.surface import FingertipSurface
from sim.tables import broadcast, numbers_of

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

DEFAULT_X_MM = (-2.0, -1.5, -1.25, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
"""Lateral positions of the ten receptors (mm; Raju 1998, ch. 5)."""

DEFAULT_DEPTH_MM = 0.76
"""Perpendicular distance below the skin (mm; Raju 1998, ch. 5, which does not state that it is perpendicular)."""

_PLACED_MM = 1e-9
_TURNS = (0.0, 0.1, -0.1, 0.3, -0.3)  # rad; around strongly curved skin the first may fail
_ON_FACE = 1e-9
_MOST_STEPS = 10  # from the nearest element to the one that contains the point


class ReceptorError(SimError, ValueError):
    """Error of a receptor outside the part of the finger where strains are recovered."""

    default_code = "no_receptor"


@dataclass(frozen=True)
class ReceptorSet:
    """Undeformed locations inside the finger at which strain is recovered."""

    position_mm: Array  # (n, 3)
    depths_mm: Array  # (n,) perpendicular distances to the skin; nan where not computed

    @property
    def depth_mm(self) -> float:
        """Common depth (mm); nan where depths differ or there are no receptors."""
        first = float(self.depths_mm[0]) if len(self.depths_mm) else np.nan
        return first if (self.depths_mm == first).all() else np.nan


def place_receptors(surface: FingertipSurface, x_mm: ArrayLike, depth_mm: ArrayLike, z_mm: ArrayLike) -> ReceptorSet:
    """Return the points at x and z whose perpendicular distance to the skin is the depth, broadcast (mm)."""
    x, depth, z = (values.ravel() for values in np.broadcast_arrays(*np.atleast_1d(x_mm, depth_mm, z_mm)))
    points = [point_below(surface, *location) for location in np.stack([x, depth, z], axis=1).astype(float)]
    return ReceptorSet(np.array(points).reshape(-1, 3), depth.astype(float))


def point_below(surface: FingertipSurface, x_mm: float, depth_mm: float, z_mm: float) -> Array:
    """Return the (3,) point at x and z at a depth below the pulp's skin (mm). Raises ReceptorError."""

    def below(v: Array) -> Array:
        phi, z = v
        return np.asarray(np.append(surface.section(phi, z), z) - depth_mm * surface.normal(phi, z))

    phi = float(surface.angle_at(x_mm, z_mm))
    found = _solved(lambda v: below(v)[[0, 2]] - [x_mm, z_mm], np.array([phi, z_mm]))
    if found is None:
        raise ReceptorError(
            f"no receptor at x = {float(x_mm):g} mm, {float(depth_mm):g} mm below the skin", "nowhere"
        )
    return below(found)


def _solved(missed: Callable[[Array], Array], start: Array) -> Array | None:
    """Return a root to within `_PLACED_MM`, or None; other starts of the first unknown, an angle, are tried too."""
    for turn in _TURNS:
        found = root(missed, start + np.eye(len(start))[0] * turn, tol=1e-13)
        if np.abs(found.fun).max() < _PLACED_MM:  # at round-off the solver may report a failure
            return np.asarray(found.x)
    return None


def depths_of(surface: FingertipSurface, points_mm: Array) -> Array:
    """Return (n,) perpendicular depths in mm of (n, 3) points below the skin. Raises ReceptorError."""
    return np.array([_depth_of(surface, point) for point in points_mm])


def _depth_of(surface: FingertipSurface, point: Array) -> float:
    def missed(v: Array) -> Array:
        phi, z, depth = v
        foot = np.append(surface.section(phi, z), z)
        return np.asarray(foot - depth * surface.normal(phi, z) - point)

    phi = np.arctan2(point[1], point[0])
    there = np.hypot(*surface.section(phi, point[2])) - np.hypot(*point[:2])
    found = _solved(missed, np.array([phi, point[2], there]))
    if found is None:
        raise ReceptorError(f"{_named(point)} has no foot on the skin", "no_way_up")
    return float(found[2])


def _named(point: Array) -> str:
    x, y, z = point
    return f"the point ({x:.2f}, {y:.2f}, {z:.2f}) mm"


def strain_operator(mesh: FingerMesh, points_mm: Array) -> tuple[sp.csr_array, Ints]:
    """Return the (6n, 3 n_nodes) map from nodal displacements (mm) to strains at (n, 3) points, and their layers.

    The strain is a mean of least-squares quadratics around the cells about the point (`blended`).
    """
    locations = [located(mesh, point) for point in points_mm]
    samples = [blended(mesh, location, point) for location, point in zip(locations, points_mm, strict=True)]
    return operator_of(mesh, samples), mesh.layer[[location.element for location in locations]]


@dataclass(frozen=True)
class MeshLocation:
    """Location of a point in the mesh; axes are the grid's: axial, circumferential, radial."""

    element: int
    cell: tuple[int, int, int]  # interval between grid nodes that contains the point
    local: Array  # (3,) local coordinates in that cell, −1 … 1


class StrainSamples(NamedTuple):
    """Weighted sum of strains within elements."""

    elements: Ints  # (m,)
    local: Array  # (m, 3) local coordinates in the element
    weights: Array  # (m,)


def located(mesh: FingerMesh, point: Array) -> MeshLocation:
    """Return the cell that contains a point. Raises ReceptorError at an end of the finger and beyond."""
    grid, order = mesh.element_grid, mesh.order
    at = np.array(np.unravel_index(np.argmin(((mesh.centre_mm - point) ** 2).sum(axis=1)), grid.shape))
    for _ in range(_MOST_STEPS):
        element = int(grid[tuple(at)])
        local = (local_coordinates(mesh.nodes[mesh.hexes[element]], point) * [-1, 1, 1])[::-1]
        away = np.where(np.abs(local) > 1 + _ON_FACE, np.sign(local), 0).astype(int)
        if not away.any():
            half = np.where(local > 0, 1, 0) * (order - 1)
            cell = order * at + half
            if not 1 <= cell[0] < mesh.grid[0] - 2:
                break
            return MeshLocation(element, tuple(cell.tolist()), local if order == 1 else 2 * local - (2 * half - 1))
        at = at + away
        at[1] %= grid.shape[1]
        if (at[[0, 2]] < 0).any() or (at >= grid.shape).any():
            break
    low, high = mesh.z_mm[[1, -2]]
    inside = low < point[2] < high
    where = "outside the tissue, above the skin or in the bone" if inside else "at an end of the finger or beyond it"
    raise ReceptorError(
        f"{_named(point)} lies {where}; z must be {low:.2f} to {high:.2f} mm, and y between skin and bone",
        "outside_finger",
    )


def blended(mesh: FingerMesh, location: MeshLocation, point: Array) -> StrainSamples:
    """Return a mean of quadratics around the point's cell and its neighbors, weighted by proximity.

    Weights are products of 1 − |ξ|/2 for a cell and |ξ|/2 for its neighbor on the point's side: on a face between two
    cells both have the same weight, so that the strain is continuous within a layer.
    """
    share = np.abs(location.local) / 2
    steps = np.where(location.local < 0, -1, 1)
    corners = np.array(list(np.ndindex(2, 2, 2)))
    beside = [_neighbour(mesh, location.cell, steps * corner) for corner in corners]
    fits = _quadratic_fits(mesh, beside, point)
    weights = np.where(corners, share, 1 - share).prod(axis=1)
    return fits._replace(weights=(weights[:, None] * fits.weights.reshape(len(beside), -1)).ravel())


def _quadratic_fits(mesh: FingerMesh, cells: Sequence[tuple[int, int, int]], point: Array) -> StrainSamples:
    """Return the fits around several cells of one layer, one after the other."""
    elements, local = sampled(mesh, np.concatenate([patch_around(mesh, cell) for cell in cells]))
    corners = mesh.nodes[mesh.hexes[elements]]
    position = np.einsum("mk,mki->mi", shape_functions(corners.shape[1], local)[0], corners)
    return StrainSamples(elements, local, _fit_weights((position - point).reshape(len(cells), -1, 3)).ravel())


def patch_around(mesh: FingerMesh, cell: tuple[int, int, int]) -> Ints:
    """Return (m, 3) the 3 × 3 × 3 cells around one, shifted to stay within its layer and the grid."""
    k, j, i = cell
    n_z, n_phi = mesh.grid[0] - 1, mesh.grid[1]
    same = _rows_of_layer(mesh, i)
    first = int(np.clip(i - 1, same[0], max(same[0], same[-1] - 2)))
    axial = int(np.clip(k - 1, 0, n_z - 3)) + np.arange(3)
    radial = np.arange(first, min(first + 3, same[-1] + 1))
    return np.stack(np.meshgrid(axial, np.arange(j - 1, j + 2) % n_phi, radial, indexing="ij"), -1).reshape(-1, 3)


def sampled(mesh: FingerMesh, cells: Ints) -> tuple[Ints, Array]:
    """Return elements of (m, 3) cells and the local coordinates of their most accurate strains (Barlow 1976).

    Those are the center of an eight-node element and the 2×2×2 Gauss points of a quadratic one, one in each cell.
    """
    elements = mesh.element_grid[tuple((cells // mesh.order).T)]
    side = 2 * (cells % mesh.order) - 1
    return elements, (0.0 if mesh.order == 1 else 1 / np.sqrt(3)) * (side * [1, 1, -1])[:, ::-1]


def operator_of(mesh: FingerMesh, samples: Sequence[StrainSamples]) -> sp.csr_array:
    """Return the (6n, 3 n_nodes) map from nodal displacements (mm) to the strains of n sets of samples.

    Points near one another share samples: each is evaluated once.
    """
    if not samples:
        return sp.csr_array((0, 3 * len(mesh.nodes)))
    elements, local, weights = (np.concatenate(parts) for parts in zip(*samples, strict=True))
    receptor = np.repeat(np.arange(len(samples)), [len(s.weights) for s in samples])
    _, once, of = np.unique(np.column_stack([elements, local]), axis=0, return_index=True, return_inverse=True)
    hexes = mesh.hexes[elements[once]]
    b = strain_matrix(mesh.nodes[hexes], local[once])
    row = 6 * np.arange(len(once))[:, None, None] + np.arange(6)[None, :, None]
    dof = (3 * hexes[:, :, None] + np.arange(3)).reshape(len(hexes), 1, -1)
    row, dof = np.broadcast_arrays(row, dof)
    strains = sp.coo_array((b.ravel(), (row.ravel(), dof.ravel())), shape=(6 * len(once), 3 * len(mesh.nodes)))
    summed = sp.coo_array((weights, (receptor, of.ravel())), shape=(len(samples), len(once)))
    return sp.csr_array(sp.kron(summed, sp.eye_array(6), format="csr") @ strains.tocsr())


def _neighbour(mesh: FingerMesh, cell: tuple[int, int, int], step: Ints) -> tuple[int, int, int]:
    """Return the cell beside another; the same cell where the grid or its layer ends."""
    k, j, i = cell
    same = _rows_of_layer(mesh, i)
    return (
        int(np.clip(k + step[0], 0, mesh.grid[0] - 2)),
        int(j + step[1]) % mesh.grid[1],
        int(np.clip(i + step[2], same[0], same[-1])),
    )


def _rows_of_layer(mesh: FingerMesh, row: int) -> Ints:
    """Return the radial rows of cells in the same layer as a row."""
    layer = np.repeat(mesh.layer[mesh.element_grid[0, 0]], mesh.order)
    return np.flatnonzero(layer == layer[row])


def _fit_weights(offset: Array) -> Array:
    """Return (…, n) weights that evaluate a least-squares quadratic of values at (…, n, 3) offsets at the origin."""
    s = offset / np.abs(offset).max(axis=(-2, -1), keepdims=True)
    x, y, z = np.moveaxis(s, -1, 0)
    basis = np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, x * z], axis=-1)
    return np.asarray(np.linalg.pinv(basis, rcond=1e-6)[..., 0, :])


# --- locations ---

MOST_RECEPTORS = 1000
"""Maximum number of receptors; their columns take 0.4 GB and a minute. For more points use `fields`."""

_AROUND = np.linspace(-np.pi, np.pi, 1441)
_PLACED = 1e-6
_BISECTIONS = 24
_ROUND = 100  # bounds are rounded inwards to hundredths of a millimeter


class ReceptorPlaces(NamedTuple):
    """Every combination of x, depth below the skin and z along the finger (mm)."""

    x_mm: tuple[float, ...] = DEFAULT_X_MM
    depth_mm: tuple[float, ...] = (DEFAULT_DEPTH_MM,)
    z_mm: tuple[float, ...] | None = None  # None: the receptor plane

    @classmethod
    def of(
        cls, x_mm: Sequence[float], depth_mm: float | Sequence[float], z_mm: float | Sequence[float] | None
    ) -> "ReceptorPlaces":
        """Accept numbers and sequences."""
        named = {"receptor_x_mm": x_mm, "receptor_depth_mm": depth_mm, "receptor_z_mm": z_mm}
        return cls(*(None if some is None else _several(name, some) for name, some in named.items()))  # type: ignore[arg-type]

    def as_options(self) -> dict[str, Any]:
        """Return the keyword arguments for loading a finger with these receptors."""
        return {f"receptor_{name}": values for name, values in self._asdict().items()}


NOWHERE = ReceptorPlaces((), (), ())
"""No receptors, for fingers that compute forces only."""


def _several(name: str, values: float | Sequence[float]) -> tuple[float, ...]:
    return tuple(np.atleast_1d(numbers_of(name, values)).tolist())


def receptors_at(config: FingertipConfig, surface: FingertipSurface, places: ReceptorPlaces) -> ReceptorSet:
    """Return the receptors at these locations, x varying fastest and z slowest; none at NOWHERE.

    Raises ReceptorError, as `points_below` does.
    """
    if places == NOWHERE:
        return ReceptorSet(np.zeros((0, 3)), np.zeros(0))
    z = (config.receptor_plane_mm,) if places.z_mm is None else places.z_mm
    count = len(z) * len(places.depth_mm) * len(places.x_mm)
    if not 0 < count <= MOST_RECEPTORS:
        raise ReceptorError(f"{count} receptors; must be 1 to {MOST_RECEPTORS}", "how_many")
    z_mm, depth_mm, x_mm = np.meshgrid(z, places.depth_mm, places.x_mm, indexing="ij")
    points = points_below(config, surface, x_mm, depth_mm, z_mm)
    return ReceptorSet(points.reshape(-1, 3), depth_mm.ravel())


def points_below(
    config: FingertipConfig, surface: FingertipSurface, x_mm: ArrayLike, depth_mm: ArrayLike, z_mm: ArrayLike
) -> Array:
    """Return (…, 3) points in mm at x and z whose perpendicular distance to the pulp's skin is the depth, broadcast.

    Raises ReceptorError, with the allowed range, for the first above the skin, in the bone or at the finger's ends.
    """
    named = {"x_mm": x_mm, "depth_mm": depth_mm, "z_mm": z_mm}
    x, depth, z = broadcast(**{name: numbers_of(name, values) for name, values in named.items()})
    _refuse_ends(config, z.ravel())
    points = []
    for location in zip(x.ravel().tolist(), depth.ravel().tolist(), z.ravel().tolist(), strict=True):
        point = _tissue_at(config, surface, *location)
        if point is None:
            raise _out_of_tissue(config, surface, *location)
        points.append(point)
    return np.array(points).reshape(*x.shape, 3)


def tissue_below(
    config: FingertipConfig, surface: FingertipSurface, x_mm: ArrayLike, depth_mm: float, z_mm: ArrayLike
) -> Array:
    """Return (n, 3) points in mm as `points_below`, of many places at once; nan where there is no tissue.

    Newton's method finds all roots together, to within `_PLACED_MM`; those that it misses are found one by one.
    """
    x, z = (np.ravel(values).astype(float) for values in np.broadcast_arrays(x_mm, z_mm))
    found = np.full((len(x), 3), np.nan)
    ends = axial_places(config)[0][[1, -2]]
    around = surface.section(_AROUND, z[:, None])
    # A disc of this radius about a point lies within the section, whose width therefore bounds x.
    beside = 0.999 * depth_mm
    there = (z > ends[0]) & (z < ends[1])
    there &= (x > around[0].min(axis=1) + beside) & (x < around[0].max(axis=1) - beside)
    if there.any():
        found[there] = _points_together(surface, x[there], depth_mm, z[there])
    for k in np.flatnonzero(there):
        if np.isnan(found[k, 0]):
            point = _tissue_at(config, surface, float(x[k]), depth_mm, float(z[k]))
            found[k] = np.nan if point is None else point
        elif not _in_tissue(config, np.stack([around[0][k], around[1][k]]), found[k], depth_mm):
            found[k] = np.nan
    return found


_NEWTON_STEPS = 12
_DIFFERENCE = 1e-6  # of the angle (rad) and of z (mm)


def _points_together(surface: FingertipSurface, x: Array, depth_mm: float, z: Array) -> Array:
    """Return (n, 3) points at x and z at a depth below the pulp's skin (mm); nan where Newton's method fails."""

    def below(phi: Array, foot: Array) -> Array:
        return np.stack([*surface.section(phi, foot), foot], axis=-1) - depth_mm * surface.normal(phi, foot)

    v = np.stack([surface.angle_at(x, z), z], axis=-1)
    for _ in range(_NEWTON_STEPS):
        missed = below(*v.T)[:, [0, 2]] - np.stack([x, z], axis=-1)
        if np.abs(missed).max(initial=0.0) < 1e-12:
            break
        slopes = np.stack(
            [
                (below(*(v + step).T) - below(*(v - step).T))[:, [0, 2]] / (2 * _DIFFERENCE)
                for step in _DIFFERENCE * np.eye(2)
            ],
            axis=-1,
        )
        det = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]
        det = np.where(np.abs(det) > 1e-9, det, np.nan)
        back = np.stack(
            [
                slopes[:, 1, 1] * missed[:, 0] - slopes[:, 0, 1] * missed[:, 1],
                slopes[:, 0, 0] * missed[:, 1] - slopes[:, 1, 0] * missed[:, 0],
            ],
            axis=-1,
        )
        v = np.clip(v - np.clip(back / det[:, None], -0.3, 0.3), [-np.pi, z.min() - 3], [np.pi, z.max() + 3])
    points = below(*v.T)
    off = np.abs(points[:, [0, 2]] - np.stack([x, z], axis=-1)).max(axis=-1, initial=0.0)
    return np.asarray(np.where((off < _PLACED_MM)[:, None], points, np.nan))


def _tissue_at(
    config: FingertipConfig, surface: FingertipSurface, x_mm: float, depth_mm: float, z_mm: float
) -> Array | None:
    """Return the (3,) point at x and z at a depth below the pulp's skin, or None where there is no tissue."""
    if not (np.isfinite([x_mm, depth_mm]).all() and depth_mm > 0):
        return None
    try:
        point = point_below(surface, x_mm, depth_mm, z_mm)
    except ReceptorError:
        return None
    return point if _in_tissue(config, np.stack(surface.section(_AROUND, z_mm)), point, depth_mm) else None


def _in_tissue(config: FingertipConfig, skin: Array, point: Array, depth_mm: float) -> bool:
    """Return whether a point lies outside the bone, with no nearer skin in its (2, n) section elsewhere."""
    nearest = np.hypot(*(skin - point[:2, None])).min() > (1 - _PLACED) * depth_mm
    return bool(nearest and _radial_fraction(skin, point) > _bone(config))


def _bone(config: FingertipConfig) -> float:
    """Return the mesh's inner end as a fraction of the distance from the bone's axis to the skin."""
    return config.tissue.bone_fraction * (0.5 if config.tissue.bone == "elastic" else 1.0)


def _radial_fraction(skin: Array, point: Array) -> float:
    """Return a point's distance from the bone's axis over that of a (2, n) section of the skin in its direction."""
    x, y = skin
    direction = np.unwrap(np.arctan2(y, x))
    turn = (np.arctan2(point[1], point[0]) - direction[0]) % (2 * np.pi)
    return float(np.hypot(*point[:2]) / np.interp(turn, direction - direction[0], np.hypot(x, y)))


def _refuse_ends(config: FingertipConfig, z_mm: Array) -> None:
    ends = axial_places(config)[0][[1, -2]]
    outside = z_mm[~((z_mm > ends[0]) & (z_mm < ends[1]))]
    if len(outside):
        raise ReceptorError(f"no receptor at z = {outside[0]:g} mm: z must be {_range(*ends)}", "z_outside")


def _out_of_tissue(
    config: FingertipConfig, surface: FingertipSurface, x_mm: float, depth_mm: float, z_mm: float
) -> ReceptorError:
    what = f"no receptor at x = {x_mm:g} mm, {depth_mm:g} mm below the skin"
    x, _ = surface.section(np.linspace(0.0, np.pi, 721), z_mm)
    if not x.min() < x_mm < x.max():
        return ReceptorError(f"{what}; choose x from {_range(x.min(), x.max())} at z = {z_mm:g} mm", "x_outside")
    least, most = 0.0, float(np.hypot(*surface.section(np.pi / 2, z_mm)))
    for _ in range(_BISECTIONS):
        middle = 0.5 * (least + most)
        there = _tissue_at(config, surface, x_mm, middle, z_mm)
        least, most = (middle, most) if there is not None else (least, middle)
    return ReceptorError(
        f"{what}; choose depths from {_range(0.0, least)} at x = {x_mm:g}, z = {z_mm:g} mm", "depth_outside"
    )


def _range(low: float, high: float) -> str:
    return f"{np.ceil(_ROUND * low) / _ROUND:g} to {np.floor(_ROUND * high) / _ROUND:g} mm"
