"""Receptors under the skin, and the linear map from nodal displacements to the strain at each."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import root

from sim.fem.elements import hex8_centroid_strain
from sim.finger.mesh import FingerMesh
from sim.finger.surface import FingertipSurface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

DEFAULT_X_MM = (-2.0, -1.5, -1.25, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
"""Lateral positions of the ten receptors (Raju 1998, ch. 5)."""

DEFAULT_DEPTH_MM = 0.76
"""Perpendicular distance below the skin (Raju 1998, ch. 5; that it is perpendicular is ours)."""


_PLACED_MM = 1e-9


class ReceptorError(ValueError):
    """A receptor lies outside the part of the finger where strains are recovered."""


@dataclass(frozen=True)
class ReceptorSet:
    """Undeformed positions of receptors in one axial plane."""

    position_mm: Array  # (n, 3)
    depth_mm: float


def place_receptors(surface: FingertipSurface, x_mm: Array, depth_mm: float, plane_mm: float) -> ReceptorSet:
    """The points at each x in the plane z whose perpendicular distance to the skin is the depth; mm."""

    def below(v: Array) -> Array:
        phi, z = v
        return np.asarray(np.append(surface.section(phi, z), z) - depth_mm * surface.normal(phi, z))

    points = []
    for x in x_mm:
        start = np.array([float(surface.angle_at(x, plane_mm)), plane_mm])
        target = np.array([x, plane_mm])
        found = root(lambda v, target=target: below(v)[[0, 2]] - target, start, tol=1e-13)
        if not np.abs(found.fun).max() < _PLACED_MM:  # at round-off the solver may call its own answer a failure
            raise ReceptorError(f"no receptor at x = {x:g} mm, {depth_mm:g} mm below the skin")
        points.append(below(found.x))
    return ReceptorSet(np.array(points).reshape(-1, 3), depth_mm)


def strain_operator(mesh: FingerMesh, receptors: ReceptorSet) -> tuple[sp.csr_array, Ints]:
    """(6n, 3 n_nodes) map from nodal displacements (mm) to strains, and each receptor's layer.

    The strain is a least-squares quadratic through the centroids of 3 × 3 × 3 elements of the receptor's layer
    (in the radius only as many rows as the layer has), evaluated at the receptor.
    """
    centroid = mesh.nodes[mesh.hexes].mean(axis=1)
    rows: list[Array] = []
    elements: list[Ints] = []
    layers = []
    for point in receptors.position_mm:
        nearest = int(np.argmin(((centroid - point) ** 2).sum(axis=1)))
        layers.append(mesh.layer[nearest])
        patch = _neighbours(mesh, nearest)
        elements.append(patch)
        rows.append(_fit_weights(centroid[patch] - point))
    count = [len(e) for e in elements]
    patches, weights = np.concatenate(elements), np.concatenate(rows)
    b = hex8_centroid_strain(mesh.nodes, mesh.hexes[patches]) * weights[:, None, None]
    row = 6 * np.repeat(np.arange(len(count)), count)[:, None, None] + np.arange(6)[None, :, None]
    dof = (3 * mesh.hexes[patches][:, :, None] + np.arange(3)).reshape(-1, 1, 24)
    row, dof = np.broadcast_arrays(row, dof)
    shape = (6 * len(count), 3 * len(mesh.nodes))
    return sp.csr_array(sp.coo_array((b.ravel(), (row.ravel(), dof.ravel())), shape=shape)), np.array(layers)


def _neighbours(mesh: FingerMesh, element: int) -> Ints:
    """Numbers of the 3 × 3 × 3 elements around one, shifted to stay within its layer and the grid."""
    grid = mesh.element_grid
    n_z, n_phi, _ = grid.shape
    k, j, i = np.unravel_index(element, grid.shape)
    if not 1 <= k < n_z - 1:
        raise ReceptorError(f"receptor in element {element} lies at an end of the finger")
    same = np.flatnonzero(mesh.layer[grid[k, j]] == mesh.layer[element])
    first = int(np.clip(i - 1, same[0], max(same[0], same[-1] - 2)))
    radial = np.arange(first, min(first + 3, same[-1] + 1))
    return grid[np.ix_([k - 1, k, k + 1], np.arange(j - 1, j + 2) % n_phi, radial)].ravel()


def _fit_weights(offset: Array) -> Array:
    """(n,) weights that evaluate at the origin the least-squares quadratic through values at (n, 3) offsets."""
    s = offset / np.abs(offset).max()
    x, y, z = s.T
    basis = np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, x * z], axis=1)
    return np.asarray(np.linalg.pinv(basis, rcond=1e-6)[0])
