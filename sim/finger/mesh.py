"""Layered hexahedral mesh of the fingertip, graded away from the contact patch."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig, MeshSpec, Tissue
from sim.errors import SimError
from sim.fem.elements import HEX8, HEX27, NODES
from sim.finger.surface import FingertipSurface

# --- skin ---

Array = NDArray[np.float64]

_SLOPES = np.array([[-1.5, 2.0, -0.5], [-0.5, 0.0, 0.5], [0.5, -2.0, 1.5]])  # of a parabola through −1, 0, 1
_SIMPSON = np.array([1.0, 4.0, 1.0]) / 3


def tributary_areas(skin: Array, order: int) -> Array:
    """Return (n_z, n_phi) areas in mm² of (n_z, n_phi, 3) nodes closed along φ: their share of a unit pressure.

    Order 1 adds a quarter of each adjacent bilinear quadrilateral; order 2 uses Simpson's rule on faces of nine
    nodes.
    """
    return _of_quadrilaterals(skin) if order == 1 else _of_nine_nodes(skin)


def _of_quadrilaterals(skin: Array) -> Array:
    turned = np.roll(skin, -1, axis=1)
    d1, d2 = turned[1:] - skin[:-1], turned[:-1] - skin[1:]
    quads = 0.125 * np.linalg.norm(np.cross(d1, d2), axis=-1)
    quads = quads + np.roll(quads, 1, axis=1)
    area = np.zeros(skin.shape[:2])
    area[:-1] += quads
    area[1:] += quads
    return area


def _of_nine_nodes(skin: Array) -> Array:
    n_z, n_phi, _ = skin.shape
    number = np.arange(n_z * n_phi).reshape(n_z, n_phi)
    across, around = np.arange(0, n_z - 1, 2), np.arange(0, n_phi, 2)
    k, j = (across[:, None] + np.arange(3)).ravel(), (around[:, None] + np.arange(3)).ravel() % n_phi
    faces = number[np.ix_(k, j)].reshape(len(across), 3, len(around), 3).swapaxes(1, 2)
    p = skin.reshape(-1, 3)[faces]
    along_z, along_phi = np.einsum("ab,kjbpi->kjapi", _SLOPES, p), np.einsum("ab,kjpbi->kjpai", _SLOPES, p)
    area = np.linalg.norm(np.cross(along_z, along_phi), axis=-1) * _SIMPSON[:, None] * _SIMPSON
    return np.asarray(np.bincount(faces.ravel(), area.ravel()).reshape(n_z, n_phi), float)


# --- grading ---
#
# Nodes are close under the patch and farther apart away from it.


class MeshError(SimError, ValueError):
    """Error of geometry and mesh settings that do not make a valid mesh."""

    default_code = "bad_mesh"


def axial_places(config: FingertipConfig) -> tuple[Array, NDArray[np.bool_]]:
    """Return positions along z (mm) and a mask of the patch's; the patch's middle is the receptor plane."""
    mesh, middle, length = config.mesh, config.receptor_plane_mm, config.geometry.length_mm
    spacing = mesh.axial_mm
    n = int(np.ceil(mesh.patch_z_mm / spacing - 1e-9))
    fine = middle + np.arange(-n, n + 1) * spacing
    if fine[0] < 0.5 or fine[-1] > length - 0.5:
        raise MeshError(
            f"patch_z_mm = {mesh.patch_z_mm}: the patch leaves the finger, z = 0 to {length} mm; reduce patch_z_mm",
            "patch_leaves_finger",
        )
    below = fine[0] - _graded(mesh, spacing, fine[0])
    above = fine[-1] + _graded(mesh, spacing, length - fine[-1])
    z = np.concatenate([below[::-1], fine, above])
    is_fine = np.zeros(len(z))
    is_fine[len(below) : len(below) + len(fine)] = 1
    order = order_of(mesh)
    return with_middles(z, order), with_middles(is_fine, order) == 1


def angles_around(config: FingertipConfig, surface: FingertipSurface) -> tuple[Array, NDArray[np.bool_]]:
    """Return angles (rad) and a mask of the patch's.

    Nodes are spaced by arc length on the skin in the receptor plane, one of them at the pulp's apex.
    """
    mesh = config.mesh
    table = np.linspace(-np.pi / 2, 3 * np.pi / 2, 20001)
    x, y = surface.section(table, config.receptor_plane_mm)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    apex = float(np.interp(np.pi / 2, table, arc))
    sides = np.array([mesh.patch_x_mm, -mesh.patch_x_mm])
    angles = surface.angle_at(sides, config.receptor_plane_mm)
    if np.abs(surface.section(angles, config.receptor_plane_mm)[0] - sides).max() > 1e-6:
        raise MeshError(
            f"patch_x_mm = {mesh.patch_x_mm}: the patch leaves the pulp, x = {float(x.min()):.2f} to "
            f"{float(x.max()):.2f} mm in the receptor plane, z = {config.receptor_plane_mm:.2f} mm; reduce "
            "patch_x_mm",
            "patch_leaves_pulp",
        )
    edges = np.interp(angles, table, arc)
    right = int(np.ceil((apex - edges[0]) / mesh.spacing_mm - 1e-9))
    left = int(np.ceil((edges[1] - apex) / mesh.spacing_mm - 1e-9))
    fine = apex + np.arange(-right, left + 1) * mesh.spacing_mm
    half_nail = np.radians(config.tissue.nail_arc_deg / 2)
    nail = np.interp([-np.pi / 2 + half_nail, 3 * np.pi / 2 - half_nail], table, arc)
    towards_right = fine[0] - _through(mesh, fine[0] - nail[0], fine[0])
    towards_left = fine[-1] + _through(mesh, nail[1] - fine[-1], arc[-1] - fine[-1])
    s = np.concatenate([towards_right[::-1], fine, towards_left])
    is_fine = np.zeros(len(s))
    is_fine[len(towards_right) : len(towards_right) + len(fine)] = 1
    order = order_of(mesh)
    s, is_fine = with_middles(s, order)[:-1], with_middles(is_fine, order)[:-1]  # both ends are the nail's middle
    return np.interp(s, arc, table), is_fine == 1


def order_of(mesh: MeshSpec) -> int:
    """Return the number of intervals between nodes along an element: 1, or 2 where it is quadratic."""
    return 1 if NODES[mesh.element] == len(HEX8) else 2


def with_middles(ends: Array, order: int) -> Array:
    """Return node positions from the positions of element ends, with the midpoints added for order 2."""
    return np.interp(np.arange(order * (len(ends) - 1) + 1) / order, np.arange(len(ends)), ends)


def _through(mesh: MeshSpec, edge_mm: float, distance_mm: float) -> Array:
    """Return distances from the patch's edge, across the finger, of nodes that grow towards the nail's middle.

    With `nail_on_nodes` one lies at the nail's edge; otherwise the edge of the fixed skin depends on the mesh.
    """
    if not (mesh.nail_on_nodes and 0 < edge_mm < distance_mm):
        return _graded(mesh, mesh.spacing_mm, distance_mm)
    beyond = np.linspace(edge_mm, distance_mm, 1 + int(np.ceil((distance_mm - edge_mm) / mesh.far_spacing_mm)))
    return np.concatenate([_graded(mesh, mesh.spacing_mm, edge_mm), beyond[1:]])


def _graded(mesh: MeshSpec, spacing_mm: float, distance_mm: float) -> Array:
    """Return distances from the patch's edge of nodes that grow from the fine spacing to the far one."""
    steps, x = [spacing_mm], spacing_mm
    while x < distance_mm:
        near = x < mesh.near_width_mm
        growth, limit = (mesh.growth, mesh.near_spacing_mm) if near else (mesh.far_growth, mesh.far_spacing_mm)
        steps.append(min(steps[-1] * growth, limit))
        x += steps[-1]
    if len(steps) > 1 and x - distance_mm > distance_mm - (x - steps[-1]):
        steps.pop()
    return np.cumsum(steps) * (distance_mm / np.sum(steps))


# --- layers ---
#
# Nodes lie on rays from the skin towards the bone's axis.

Ints = NDArray[np.int64]

LAYERS = ("epidermis", "dermis", "fat", "bone")
EPIDERMIS, DERMIS, FAT, BONE = range(4)

_DEEPEST_DERMIS = 0.7
"""Largest depth of the dermis relative to the depth of the bone, so that the elements of fat do not vanish."""


def nodes_on_rays(config: FingertipConfig, surface: FingertipSurface, phi: Array, z_mm: Array) -> tuple[Array, Ints]:
    """Return (n_z, n_phi, n_r, 3) nodes on rays from the bone's axis, and the layer of each radial element."""
    tissue = config.tissue
    p, z = np.meshgrid(phi, z_mm)
    x, y = surface.section(p, z)
    skin = np.stack([x, y, z], -1)
    radius = np.hypot(x, y)
    ray = np.stack([x, y, 0 * z], -1) / radius[..., None]
    cosine = np.clip(np.einsum("zpk,zpk->zp", surface.normal(p, z), ray), 0.6, 1.0)
    thickness = radius * (1 - tissue.bone_fraction)
    stretch = np.minimum(1 / cosine, _DEEPEST_DERMIS * thickness / (tissue.epidermis_mm + tissue.dermis_mm))

    # The fractions between the interfaces are the same on every ray.
    apex_depth = float(thickness[np.argmin(np.abs(z_mm - config.receptor_plane_mm))].max())
    ends, layers = _radial_fractions(config.mesh, tissue, apex_depth)
    order = order_of(config.mesh)
    fractions = with_middles(ends, order)
    knots = np.stack(
        [
            0 * thickness,
            tissue.epidermis_mm * stretch,
            (tissue.epidermis_mm + tissue.dermis_mm) * stretch,
            thickness,
        ]
    )
    piece = np.minimum(fractions.astype(int), 2)
    depth = knots[piece] + (knots[piece + 1] - knots[piece]) * (fractions - piece)[:, None, None]
    nodes = skin[:, :, None] - np.moveaxis(depth, 0, -1)[..., None] * ray[:, :, None]
    if tissue.bone == "elastic":
        inwards = 1 - 0.5 * np.arange(1, order + 1)[:, None] / order
        core = nodes[:, :, -1:] * np.concatenate([inwards, inwards, np.ones((order, 1))], axis=1)
        nodes, layers = np.concatenate([nodes, core], axis=2), np.append(layers, BONE)
    return nodes, layers


def _radial_fractions(mesh: MeshSpec, tissue: Tissue, depth_mm: float) -> tuple[Array, Ints]:
    """Return node positions through the layers (0–1 epidermis, 1–2 dermis, 2–3 fat) and the elements' layers."""
    epidermis = np.linspace(0, 1, mesh.epidermis_elements + 1)
    n_dermis = max(1, round(tissue.dermis_mm / mesh.dermis_spacing_mm))
    dermis = 1 + np.linspace(0, 1, n_dermis + 1)[1:]
    top = tissue.epidermis_mm + tissue.dermis_mm
    below = depth_mm - top
    if top > _DEEPEST_DERMIS * depth_mm:
        raise MeshError(
            f"epidermis + dermis = {top:.2f} mm leave no fat above the bone, {float(depth_mm):.2f} mm below the "
            f"skin; at most {float(_DEEPEST_DERMIS * depth_mm):.2f} mm is allowed",
            "no_fat",
        )
    steps, x = [], 0.0
    step = mesh.dermis_spacing_mm
    while x < below:
        step = step if top + x < mesh.dermis_fine_depth_mm - 1e-9 else step * mesh.growth
        steps.append(min(step, mesh.near_spacing_mm))
        x += steps[-1]
    fat = 2 + np.cumsum(steps) / np.sum(steps)
    layers = np.repeat([EPIDERMIS, DERMIS, FAT], [mesh.epidermis_elements, n_dermis, len(steps)])
    return np.concatenate([epidermis, dermis, fat]), layers


# --- quality ---

POOR_SCALED_JACOBIAN = 0.1
"""Scaled Jacobian below which an element is nearly flat at a corner."""

# Each corner of a hexahedron in VTK order, and its three neighbors, right-handed.
_CORNERS = np.array(
    [
        [0, 1, 3, 4],
        [1, 2, 0, 5],
        [2, 3, 1, 6],
        [3, 0, 2, 7],
        [4, 7, 5, 0],
        [5, 4, 6, 1],
        [6, 5, 7, 2],
        [7, 6, 4, 3],
    ]
)


@dataclass(frozen=True)
class MeshQuality:
    """Shape measures of a mesh's elements."""

    scaled_jacobian: Array  # (n,) smallest of the corners: 1 a box, 0 flat, negative folded
    aspect_ratio: Array  # (n,) longest edge over shortest edge
    centroid_mm: Array  # (n, 3)


def corner_edges(nodes: Array, hexes: Ints) -> Array:
    """Return (n, 8, 3, 3) edge vectors in mm from each corner of (n, 8 or 27) hexahedra, right-handed by rows."""
    p = nodes[hexes[:, :8]]
    return np.asarray(p[:, _CORNERS[:, 1:]] - p[:, _CORNERS[:, :1]])


def mesh_quality(nodes: Array, hexes: Ints) -> MeshQuality:
    """Return the quality of (n, 8) hexahedra in VTK order; of (n, 27) hexahedra, that of their corners.

    Source: Knupp, Ernst, Thompson, Stimpson, Pébay, The Verdict library reference manual, Sandia 2007: hexahedron,
    "scaled Jacobian" (here at the corners only) and "edge ratio".
    """
    edges = corner_edges(nodes, hexes)
    length = np.linalg.norm(edges, axis=-1)
    scaled = np.linalg.det(edges) / length.prod(axis=-1)
    return MeshQuality(
        scaled_jacobian=scaled.min(axis=1),
        aspect_ratio=length.max(axis=(1, 2)) / length.min(axis=(1, 2)),
        centroid_mm=nodes[hexes[:, :8]].mean(axis=1),
    )


MOST_PATCH_NODES = 6000
"""Maximum number of patch nodes; their compliance takes 1.2 GB, and more would not fit beside its factor."""


@dataclass(frozen=True)
class FingerMesh:
    """Hexahedra on a grid of nodes (axial, circumferential, radial); radial index 0 is the skin."""

    nodes: Array  # (n_nodes, 3) mm
    hexes: Ints  # (n_elements, 8), or 27 of quadratic ones, VTK order
    layer: Ints  # (n_elements,) EPIDERMIS, DERMIS, FAT or BONE
    fixed: NDArray[np.bool_]  # (n_nodes,)
    grid: tuple[int, int, int]  # nodes along z, φ and the radius
    phi: Array  # (grid[1],) rad
    z_mm: Array  # (grid[0],)
    patch_nodes: Ints  # skin nodes that an indentor may touch
    patch_shape: tuple[int, int]  # rows along z, columns along φ
    patch_area_mm2: Array  # (n_patch,) tributary undeformed area
    receptor_row: int  # row of the patch that lies in the receptor plane

    @property
    def order(self) -> int:
        """Number of intervals between nodes along an element: 1, or 2 where it is quadratic."""
        return 1 if self.hexes.shape[1] == len(HEX8) else 2

    @cached_property
    def element_grid(self) -> Ints:
        """Element numbers on the (axial, circumferential, radial) grid."""
        n_z, n_phi, _ = self.grid
        return np.arange(len(self.hexes)).reshape((n_z - 1) // self.order, n_phi // self.order, -1)

    @cached_property
    def centre_mm(self) -> Array:
        """(n_elements, 3) means of the elements' corners (mm)."""
        return np.asarray(self.nodes[self.hexes[:, : len(HEX8)]].mean(axis=1))

    def column_at(self, phi: float, z_mm: float) -> Array:
        """Return (n_r, 3) node positions in mm from the skin inwards on the ray nearest to φ (rad) and z."""
        k, j = np.argmin(np.abs(self.z_mm - z_mm)), np.argmin(np.abs(_wrap(self.phi - phi)))
        return np.asarray(self.nodes.reshape(*self.grid, 3)[k, j])


def build_mesh(config: FingertipConfig, surface: FingertipSurface) -> FingerMesh:
    """Build a mesh with element faces on the layer interfaces. Raises MeshError when an element is folded."""
    z_mm, z_fine = axial_places(config)
    phi, phi_fine = angles_around(config, surface)
    n_patch = int(z_fine.sum() * phi_fine.sum())
    if n_patch > MOST_PATCH_NODES:
        raise MeshError(
            f"a patch of {n_patch} nodes; at most {MOST_PATCH_NODES} are allowed; use a coarser mesh or a smaller "
            "patch",
            "too_many_nodes",
        )
    nodes, layers = nodes_on_rays(config, surface, phi, z_mm)
    order = order_of(config.mesh)
    number = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    flat = nodes.reshape(-1, 3)
    _refuse_folded(flat, _connect(number, 1))

    fixed = np.zeros(number.shape, dtype=bool)
    fixed[0] = True
    if config.tissue.bone == "rigid":
        fixed[:, :, -1] = True
    fixed[:, :, 0] |= (z_mm >= config.tissue.nail_from_z_mm)[:, None] & _under_nail(config.tissue, phi)

    patch = number[z_fine][:, phi_fine, 0]
    return FingerMesh(
        nodes=flat,
        hexes=_connect(number, order),
        layer=_on_every_ray(layers, number, order),
        fixed=fixed.ravel(),
        grid=(len(z_mm), len(phi), nodes.shape[2]),
        phi=phi,
        z_mm=z_mm,
        patch_nodes=patch.ravel(),
        patch_shape=(patch.shape[0], patch.shape[1]),
        patch_area_mm2=tributary_areas(nodes[:, :, 0], order)[z_fine][:, phi_fine].ravel(),
        receptor_row=int(np.argmin(np.abs(z_mm[z_fine] - config.receptor_plane_mm))),
    )


def section_mesh(config: FingertipConfig, surface: FingertipSurface) -> FingerMesh:
    """Build a slab of three equal slices, 1 mm thick in all, around the receptor plane of a prismatic skin.

    Only nail and bone are fixed; the patch is one row of nodes. Three slices allow strain recovery in the middle one
    as in the finger.
    """
    plane = config.receptor_plane_mm
    phi, fine = angles_around(config, surface)
    order = order_of(config.mesh)
    z_mm = with_middles(plane + np.arange(-1.5, 2.0) / 3, order)
    nodes, layers = nodes_on_rays(config, surface, phi, z_mm)
    number = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    fixed = np.zeros(number.shape, dtype=bool)
    fixed[:, :, -1] = True
    fixed[:, _under_nail(config.tissue, phi), 0] = plane >= config.tissue.nail_from_z_mm
    patch = number[0, fine, 0]
    return FingerMesh(
        nodes=nodes.reshape(-1, 3),
        hexes=_connect(number, order),
        layer=_on_every_ray(layers, number, order),
        fixed=fixed.ravel(),
        grid=(len(z_mm), len(phi), nodes.shape[2]),
        phi=phi,
        z_mm=z_mm,
        patch_nodes=patch,
        patch_shape=(1, len(patch)),
        patch_area_mm2=tributary_areas(nodes[:, :, 0], order).sum(axis=0)[fine],
        receptor_row=0,
    )


def _on_every_ray(layers: Ints, number: Ints, order: int) -> Ints:
    """Repeat the layers along one ray for all (n_elements,) elements."""
    return np.broadcast_to(layers, ((len(number) - 1) // order, number.shape[1] // order, len(layers))).ravel()


def _under_nail(tissue: Tissue, phi: Array) -> NDArray[np.bool_]:
    """Return (n_phi,) whether the nail fixes the skin at an angle."""
    return np.asarray(np.abs(_wrap(phi + np.pi / 2)) <= np.radians(tissue.nail_arc_deg / 2) + 1e-6)


def _connect(number: Ints, order: int) -> Ints:
    """Return VTK-ordered hexahedra of the grid, closed along φ, with positive volume; with 27 nodes for order 2."""
    local = HEX8 if order == 1 else HEX27
    inwards, around, along = (order * (1 + local * [-1, 1, 1]) / 2).astype(int).T
    n_z, n_phi, n_r = number.shape
    corner = np.ix_(range(0, n_z - 1, order), range(0, n_phi, order), range(0, n_r - 1, order), [0])
    k, j, i, _ = (np.asarray(c) for c in corner)
    return number[k + along, (j + around) % n_phi, i + inwards].reshape(-1, len(local))


def _refuse_folded(nodes: Array, hexes: Ints) -> None:
    """Raise MeshError with the worst element when the Jacobian at one of its corners is not positive."""
    jacobian = np.linalg.det(corner_edges(nodes, hexes))
    worst = np.unravel_index(np.argmin(jacobian), jacobian.shape)
    if jacobian[worst] <= 0:
        x, y, z = nodes[hexes[worst]]
        raise MeshError(
            f"element {int(worst[0])} is folded at ({float(x):.2f}, {float(y):.2f}, {float(z):.2f}) mm: its "
            f"corner volume {float(jacobian[worst]):.3g} mm³ must be positive; check the geometry and the mesh "
            "settings",
            "folded",
        )


def _wrap(angle: Array) -> Array:
    return (angle + np.pi) % (2 * np.pi) - np.pi
