"""Shape functions of hexahedra: trilinear in eight nodes, triquadratic in 27 (Lagrange's, products of three).

Nodes are in VTK's order: corners, then middles of edges, of faces, the centre.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HEX8 = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    float,
)
"""(8, 3) local coordinates of the nodes."""

_NEWTON_STEPS = 30
_LOCATED = 1e-12

_EDGES = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
_FACES = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1], [0, 0, 0]], float)
HEX27 = np.concatenate([HEX8, HEX8[_EDGES].mean(axis=1), _FACES])
"""(27, 3) local coordinates of the nodes."""


def gauss_points(n: int) -> tuple[Array, Array]:
    """(n³, 3) local points and (n³,) weights of the product rule."""
    s, w = np.polynomial.legendre.leggauss(n)
    points = np.stack(np.meshgrid(s, s, s, indexing="ij"), -1).reshape(-1, 3)
    return points, np.einsum("i,j,k->ijk", w, w, w).ravel()


def shape_functions(n_nodes: int, points: Array) -> tuple[Array, Array]:
    """(…, k) values and (…, k, 3) local gradients of the functions of 8 or 27 nodes at (…, 3) local points."""
    at = HEX8 if n_nodes == len(HEX8) else HEX27
    s = points[..., None, :]
    if n_nodes == len(HEX8):
        value, slope = 0.5 * (1 + at * s), np.broadcast_to(0.5 * at, np.broadcast_shapes(at.shape, s.shape))
    else:
        value = np.where(at == 0, 1 - s * s, 0.5 * s * (s + at))
        slope = np.where(at == 0, -2 * s, s + 0.5 * at)
    x, y, z = np.moveaxis(value, -1, 0)
    dx, dy, dz = np.moveaxis(slope, -1, 0)
    return x * y * z, np.stack([dx * y * z, x * dy * z, x * y * dz], axis=-1)


def gradients(corners: Array, points: Array) -> tuple[Array, Array, Array]:
    """Of (n, k, 3) elements: (n, g, k, 3) gradients in 1/mm, (n, g) det J and (n, g, 3, 3) inverse of J transposed.

    The local points are (g, 3), or (n, g, 3) where each element has its own.
    """
    local = shape_functions(corners.shape[1], points)[1]
    of = "gak,nai->ngki" if points.ndim == 2 else "ngak,nai->ngki"
    inverse_t, det = _inverse3(np.einsum(of, local, corners, optimize=True))
    return np.matmul(local, inverse_t), det, inverse_t


def local_coordinates(corners: Array, point: Array) -> Array:
    """(3,) local coordinates of a point in one (k, 3) element, by Newton's iteration; outside of it they go on."""
    local = np.zeros(3)
    for _ in range(_NEWTON_STEPS):
        value, gradient = shape_functions(len(corners), local)
        step = np.linalg.solve(corners.T @ gradient, point - value @ corners)
        local = local + step
        if np.abs(step).max() < _LOCATED:
            break
    return local


def _inverse3(m: Array) -> tuple[Array, Array]:
    """(…, 3, 3) inverse transposed by cofactors, and the determinant."""
    cofactor = np.stack(
        [
            np.cross(m[..., 1, :], m[..., 2, :]),
            np.cross(m[..., 2, :], m[..., 0, :]),
            np.cross(m[..., 0, :], m[..., 1, :]),
        ],
        axis=-2,
    )
    det = np.einsum("...k,...k->...", m[..., 0, :], cofactor[..., 0, :])
    return cofactor / det[..., None, None], det
