"""The skin as the surface of a homogeneous elastic half-space: Boussinesq's and Cerruti's solutions.

Source: Johnson, *Contact Mechanics* (1985), Eq. 3.19 (normal point force), Eq. 3.75 (tangential point force) and, for
the surface under a uniformly loaded rectangle, their integrals (Love 1929; Johnson Eq. 3.25). The gap is that of the
real, curved skin; only the compliance is flat, homogeneous and infinite.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.config import FingertipConfig, Tissue
from sim.contact.patch import Patch, X, Y, Z
from sim.errors import ModelRangeError
from sim.finger.mesh import FingerMesh, build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet, depths_of
from sim.models.condensed import Columns, CondensedModel, meshed_for, skin_beside
from sim.models.default_finger import differences

Array = NDArray[np.float64]

EFFECTIVE_MODULUS = 0.21
"""E / E(epidermis) of the half-space for the layers of the default finger.

With it a cylinder 9 mm in diameter at x = 0, pressed 0.4 mm deep, carries the finger's force. Other shapes and depths
would give other values.
"""

_FAR = 10.0
_STEP = 1e-20  # of complex-step differentiation: exact to round-off


def modulus_of(tissue: Tissue) -> float:
    """Return E / E(epidermis) of the half-space. Raises ModelRangeError for layers that no modulus was fitted to."""
    if tissue.e_dermis == tissue.e_fat == 1:
        return 1.0
    if different := differences(tissue):
        raise ModelRangeError(
            "the modulus of the half-space was fitted to the layers of the default finger, and this finger has "
            f"other {', '.join(different)}; choose the model finger or section",
            "no_modulus",
        )
    return EFFECTIVE_MODULUS


def build_halfspace(
    config: FingertipConfig,
    surface: FingertipSurface,
    receptors: ReceptorSet,
    slopes: tuple[int, ...],
    modulus: float | None = None,
) -> CondensedModel:
    """Build the patch of a finger on a half-space of E = modulus · E(epidermis), by default of `modulus_of`."""
    modulus = modulus_of(config.tissue) if modulus is None else modulus
    mesh = build_mesh(meshed_for(config, slopes), surface)
    poisson, axes = config.tissue.poisson, (*slopes, Y)
    position = mesh.nodes[mesh.patch_nodes]
    shear = modulus / (2 * (1 + poisson))
    rows, columns = mesh.patch_shape
    patch = Patch(
        position_mm=position,
        area_mm2=mesh.patch_area_mm2,
        compliance=surface_compliance(position[:, [X, Z]], _half_sides(mesh), axes, shear, poisson),
        shape=mesh.patch_shape,
        axes=axes,
    )
    outside, neighbour = skin_beside(mesh, patch)
    depths_mm = receptors.depths_mm
    if np.isnan(depths_mm).any():
        depths_mm = depths_of(surface, receptors.position_mm)
    per_force = interior_strain(receptors.position_mm, depths_mm, position, shear, poisson)
    return CondensedModel(
        surface=surface,
        patch=patch,
        receptor_row=mesh.receptor_row,
        nodes=len(position),
        columns=Columns(receptors, np.full(len(per_force), modulus), per_force.reshape(-1, rows, columns, 3)),
        skin_z_mm=position[::columns, Z],
        skin_phi=np.arctan2(position[:columns, Y], position[:columns, X]),
        patch_in_skin=np.arange(len(position)),
        outside_mm=outside,
        outside_neighbour=neighbour,
        kind="halfspace",
    )


def _half_sides(mesh: FingerMesh) -> Array:
    """Return (n_patch, 2) half sides in mm along x and z of the rectangle around each node."""
    position = mesh.nodes[mesh.patch_nodes].reshape(*mesh.patch_shape, 3)
    across = np.abs(np.gradient(position[..., X], axis=1))
    along = np.gradient(position[..., Z], axis=0)
    return 0.5 * np.stack([across.ravel(), along.ravel()], axis=1)


def surface_compliance(at_mm: Array, half_mm: Array, axes: tuple[int, ...], shear: float, poisson: float) -> Array:
    """Return (m n, m n) displacements in mm along some axes at n points (x, z) under unit forces.

    Each force is spread evenly over its point's rectangle; beyond _FAR half sides it acts as a point force.
    """
    n, m = len(at_mm), len(axes)
    offset = at_mm[:, None] - at_mm[None]
    to, by = np.nonzero((np.abs(offset) < _FAR * half_mm[None]).all(axis=-1))
    near = offset[to, by]
    corners = near + half_mm[by] * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])[:, None]
    signs = np.array([1, -1, -1, 1]) / 4
    offset[to, by] = 1.0  # any offset but zero; replaced below
    whole = np.empty((m, n, m, n))
    for row, moved in enumerate(axes):
        for column, pushed in enumerate(axes):
            block = _at_point(moved, pushed, offset[..., 0], offset[..., 1], poisson)
            integral = _integral(moved, pushed, corners[..., 0], corners[..., 1], poisson)
            block[to, by] = signs @ integral / half_mm[by].prod(axis=1)
            whole[row, :, column] = block
    square = whole.reshape(m * n, -1) / (2 * np.pi * shear)
    return 0.5 * (square + square.T)  # rectangles of unlike size are reciprocal only on average


def _at_point(moved: int, pushed: int, x: Array, z: Array, poisson: float) -> Array:
    """Return 2πG times the surface displacement along one axis at an offset from a unit force along another."""
    r2 = x * x + z * z
    if moved == pushed:
        along = {X: x * x, Y: 0.0 * x, Z: z * z}[moved]
        return np.asarray(((1 - poisson) + poisson * along / r2) / np.sqrt(r2))
    if Y not in (moved, pushed):
        return poisson * x * z / r2**1.5
    upward = 1.0 if pushed == Y else -1.0
    return upward * (0.5 - poisson) * (x if X in (moved, pushed) else z) / r2


def _integral(moved: int, pushed: int, x: Array, z: Array, poisson: float) -> Array:
    """Return the integral of `_at_point` over x and z."""
    if moved == pushed:
        along_x, along_z = z * np.arcsinh(x / np.abs(z)), x * np.arcsinh(z / np.abs(x))  # of x²/r³ and z²/r³
        extra = {X: along_x, Y: 0.0 * x, Z: along_z}[moved]
        return np.asarray((1 - poisson) * (along_x + along_z) + poisson * extra)
    if Y not in (moved, pushed):
        return np.asarray(-poisson * np.hypot(x, z))
    s, t = (x, z) if X in (moved, pushed) else (z, x)
    upward = 1.0 if pushed == Y else -1.0
    return upward * (0.5 - poisson) * np.asarray(s * np.arctan(t / s) + t * np.log(np.hypot(s, t)))


def interior_strain(point_mm: Array, depth_mm: ArrayLike, skin_mm: Array, shear: float, poisson: float) -> Array:
    """Return (n, 6, k, 3) strains e11 e22 e33 e12 e23 e13 at n points under unit forces at k nodes."""
    offset = point_mm[:, None] - skin_mm[None]
    offset[..., Y] = -np.reshape(depth_mm, (-1, 1))
    slopes = [
        _displacement(offset + 1j * _STEP * np.eye(3)[axis], poisson).imag / (4 * np.pi * shear * _STEP)
        for axis in (X, Y, Z)
    ]  # by direction: (n, k, moved, pushed)
    rows = [slopes[axis][..., axis, :] for axis in (X, Y, Z)]
    rows += [slopes[b][..., a, :] + slopes[a][..., b, :] for a, b in ((X, Y), (Y, Z), (X, Z))]
    return np.stack(rows, axis=1)


def _displacement(offset: NDArray[np.complex128], poisson: float) -> NDArray[np.complex128]:
    """Return (…, moved, pushed) 4πG times the displacement at an offset (y < 0 is inside) from a unit force."""
    x, y, z = np.moveaxis(offset, -1, 0)
    depth, rho = -y, np.sqrt((offset**2).sum(axis=-1))
    sum_, rest = rho + depth, 1 - 2 * poisson
    u = np.empty((*offset.shape[:-1], 3, 3), dtype=complex)
    for s, along in ((x, X), (z, Z)):
        u[..., along, along] = 1 / rho + s * s / rho**3 + rest * (1 / sum_ - s * s / (rho * sum_**2))
        u[..., along, Y] = -s * depth / rho**3 + rest * s / (rho * sum_)
        u[..., Y, along] = -s * depth / rho**3 - rest * s / (rho * sum_)
    u[..., X, Z] = u[..., Z, X] = x * z / rho**3 - rest * x * z / (rho * sum_**2)
    u[..., Y, Y] = depth**2 / rho**3 + 2 * (1 - poisson) / rho
    return u
