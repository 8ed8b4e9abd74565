"""Layered hexahedral mesh of the fingertip, graded away from the contact patch."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig, Tissue
from sim.fem.shape_functions import HEX8, HEX27
from sim.finger.grading import MeshError, angles_around, axial_places, order_of, with_middles
from sim.finger.layers import nodes_on_rays
from sim.finger.quality import corner_edges
from sim.finger.skin import tributary_areas
from sim.finger.surface import FingertipSurface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_PATCH_NODES = 6000
"""Their compliance alone is 1.2 GB; more would not fit beside its factor."""


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
        """Intervals between nodes along an element: 1, or 2 where it is quadratic."""
        return 1 if self.hexes.shape[1] == len(HEX8) else 2

    @cached_property
    def element_grid(self) -> Ints:
        """Element numbers on the (axial, circumferential, radial) grid."""
        n_z, n_phi, _ = self.grid
        return np.arange(len(self.hexes)).reshape((n_z - 1) // self.order, n_phi // self.order, -1)

    @cached_property
    def centre_mm(self) -> Array:
        """(n_elements, 3) means of the elements' corners."""
        return np.asarray(self.nodes[self.hexes[:, : len(HEX8)]].mean(axis=1))

    def column_at(self, phi: float, z_mm: float) -> Array:
        """(n_r, 3) positions in mm of the nodes from the skin inwards on the ray nearest to φ (rad) and z."""
        k, j = np.argmin(np.abs(self.z_mm - z_mm)), np.argmin(np.abs(_wrap(self.phi - phi)))
        return np.asarray(self.nodes.reshape(*self.grid, 3)[k, j])


def build_mesh(config: FingertipConfig, surface: FingertipSurface) -> FingerMesh:
    """Mesh with element faces on the layer interfaces; raises MeshError when an element is folded."""
    z_mm, z_fine = axial_places(config)
    phi, phi_fine = angles_around(config, surface)
    n_patch = int(z_fine.sum() * phi_fine.sum())
    if n_patch > MOST_PATCH_NODES:
        raise MeshError(
            "a patch of {nodes} nodes: expected at most {most}; coarser, or a smaller patch",
            code="too_many_nodes",
            nodes=n_patch,
            most=MOST_PATCH_NODES,
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
    """A slab of three equal slices, 1 mm thick in all, around the receptor plane of a prismatic skin.

    Nothing but nail and bone is fixed; the patch is one row of nodes. Three slices let strains be recovered in the
    middle one as in the finger.
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
    """(n_elements,) from the layers along a ray."""
    return np.broadcast_to(layers, ((len(number) - 1) // order, number.shape[1] // order, len(layers))).ravel()


def _under_nail(tissue: Tissue, phi: Array) -> NDArray[np.bool_]:
    """(n_phi,) angles at which the nail holds the skin."""
    return np.asarray(np.abs(_wrap(phi + np.pi / 2)) <= np.radians(tissue.nail_arc_deg / 2) + 1e-6)


def _connect(number: Ints, order: int) -> Ints:
    """VTK-ordered hexahedra of the grid, closed along φ, with positive volume; of order 2 with 27 nodes."""
    local = HEX8 if order == 1 else HEX27
    inwards, around, along = (order * (1 + local * [-1, 1, 1]) / 2).astype(int).T
    n_z, n_phi, n_r = number.shape
    corner = np.ix_(range(0, n_z - 1, order), range(0, n_phi, order), range(0, n_r - 1, order), [0])
    k, j, i, _ = (np.asarray(c) for c in corner)
    return number[k + along, (j + around) % n_phi, i + inwards].reshape(-1, len(local))


def _refuse_folded(nodes: Array, hexes: Ints) -> None:
    """Raise MeshError naming the worst element when the Jacobian at one of its corners is not positive."""
    jacobian = np.linalg.det(corner_edges(nodes, hexes))
    worst = np.unravel_index(np.argmin(jacobian), jacobian.shape)
    if jacobian[worst] <= 0:
        x, y, z = nodes[hexes[worst]]
        raise MeshError(
            "element {element} is folded at ({x_mm:.2f}, {y_mm:.2f}, {z_mm:.2f}) mm: corner volume {volume_mm3:.3g} "
            "mm³, expected > 0",
            code="folded",
            element=int(worst[0]),
            x_mm=float(x),
            y_mm=float(y),
            z_mm=float(z),
            volume_mm3=float(jacobian[worst]),
        )


def _wrap(angle: Array) -> Array:
    return (angle + np.pi) % (2 * np.pi) - np.pi
