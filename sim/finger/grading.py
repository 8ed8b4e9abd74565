"""Where a mesh's nodes lie along the finger and around it: close under the patch, farther apart away from it."""

import numpy as np
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig, MeshSpec
from sim.errors import SimError
from sim.fem.elements import NODES
from sim.fem.shape_functions import HEX8
from sim.finger.surface import FingertipSurface

Array = NDArray[np.float64]


class MeshError(SimError, ValueError):
    """The geometry and the mesh settings do not make a valid mesh."""

    default_code = "bad_mesh"


def axial_places(config: FingertipConfig) -> tuple[Array, NDArray[np.bool_]]:
    """Places along z (mm), and which of them are the patch's; its middle is the receptor plane."""
    mesh, middle, length = config.mesh, config.receptor_plane_mm, config.geometry.length_mm
    spacing = mesh.axial_mm
    n = int(np.ceil(mesh.patch_z_mm / spacing - 1e-9))
    fine = middle + np.arange(-n, n + 1) * spacing
    if fine[0] < 0.5 or fine[-1] > length - 0.5:
        raise MeshError(
            "patch_z_mm = {patch_z_mm}: the patch leaves the finger, z 0 … {length_mm} mm",
            code="patch_leaves_finger",
            patch_z_mm=mesh.patch_z_mm,
            length_mm=length,
        )
    below = fine[0] - _graded(mesh, spacing, fine[0])
    above = fine[-1] + _graded(mesh, spacing, length - fine[-1])
    z = np.concatenate([below[::-1], fine, above])
    is_fine = np.zeros(len(z))
    is_fine[len(below) : len(below) + len(fine)] = 1
    order = order_of(mesh)
    return with_middles(z, order), with_middles(is_fine, order) == 1


def angles_around(config: FingertipConfig, surface: FingertipSurface) -> tuple[Array, NDArray[np.bool_]]:
    """Angles (rad) and which of them are the patch's.

    Spaced by arc length on the skin in the receptor plane, one of them at the pulp's apex.
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
            "patch_x_mm = {patch_x_mm}: the patch leaves the pulp, which is x {low_mm:.2f} … {high_mm:.2f} mm in the "
            "receptor plane, z = {z_mm:.2f} mm",
            code="patch_leaves_pulp",
            patch_x_mm=mesh.patch_x_mm,
            low_mm=float(x.min()),
            high_mm=float(x.max()),
            z_mm=config.receptor_plane_mm,
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
    """Intervals between nodes along an element: 1, or 2 where it is quadratic."""
    return 1 if NODES[mesh.element] == len(HEX8) else 2


def with_middles(ends: Array, order: int) -> Array:
    """Places of nodes from the places of the elements' ends: the same, or with the middles between them."""
    return np.interp(np.arange(order * (len(ends) - 1) + 1) / order, np.arange(len(ends)), ends)


def _through(mesh: MeshSpec, edge_mm: float, distance_mm: float) -> Array:
    """Distances from the patch's edge, across the finger, of nodes that grow towards the nail's middle.

    With `nail_on_nodes` one lies at the nail's edge: where the skin is held else depends on the mesh.
    """
    if not (mesh.nail_on_nodes and 0 < edge_mm < distance_mm):
        return _graded(mesh, mesh.spacing_mm, distance_mm)
    beyond = np.linspace(edge_mm, distance_mm, 1 + int(np.ceil((distance_mm - edge_mm) / mesh.far_spacing_mm)))
    return np.concatenate([_graded(mesh, mesh.spacing_mm, edge_mm), beyond[1:]])


def _graded(mesh: MeshSpec, spacing_mm: float, distance_mm: float) -> Array:
    """Distances from the patch's edge of nodes that grow from the fine spacing to the far one."""
    steps, x = [spacing_mm], spacing_mm
    while x < distance_mm:
        near = x < mesh.near_width_mm
        growth, limit = (mesh.growth, mesh.near_spacing_mm) if near else (mesh.far_growth, mesh.far_spacing_mm)
        steps.append(min(steps[-1] * growth, limit))
        x += steps[-1]
    if len(steps) > 1 and x - distance_mm > distance_mm - (x - steps[-1]):
        steps.pop()
    return np.cumsum(steps) * (distance_mm / np.sum(steps))
