"""Eight-node hexahedron: stiffness by full or selectively reduced (B-bar) integration, strain at the centroid."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Element = Literal["bbar", "full"]

_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    float,
)
_CHUNK = 2048  # elements whose gradients stay in the second-level cache


def lame(young: Array, poisson: float) -> tuple[Array, Array]:
    """Shear modulus μ and bulk modulus κ, in the unit of E."""
    return young / (2 * (1 + poisson)), young / (3 * (1 - 2 * poisson))


def hex8_stiffness(nodes: Array, hexes: Ints, young: Array, poisson: float, element: Element) -> Array:
    """(n, 24, 24) stiffness in E·mm, degrees of freedom node by node.

    The deviatoric part is integrated at 2×2×2 points; the volumetric part there too ("full") or from the
    element's mean dilatation ("bbar", Hughes 1980; the selectively reduced kind ABAQUS uses for first-order bricks).
    """
    out = np.empty((len(hexes), 24, 24))
    for start in range(0, len(hexes), _CHUNK):
        part = slice(start, start + _CHUNK)
        out[part] = _stiffness(nodes[hexes[part]], young[part], poisson, element)
    return out


def _stiffness(corners: Array, young: Array, poisson: float, element: Element) -> Array:
    gradient, weight = _gradients(corners, _CORNERS / np.sqrt(3))
    mu, kappa = lame(young, poisson)
    n, n_gauss = weight.shape
    g = gradient.reshape(n, n_gauss, 24)
    outer = (g * weight[..., None]).swapaxes(1, 2) @ g  # ∫ ∂i Na ∂j Nb, rows (a, i), columns (b, j)
    blocks = outer.reshape(n, 8, 3, 8, 3)
    laplace = np.einsum("naibi->nab", blocks)
    k = blocks.swapaxes(2, 4) - (2 / 3) * blocks
    for i in range(3):
        k[:, :, i, :, i] += laplace
    k *= mu[:, None, None, None, None]
    if element == "full":
        return np.asarray((k + kappa[:, None, None, None, None] * blocks).reshape(n, 24, 24))
    divergence = np.einsum("ng,ngk->nk", weight, g)
    scaled = divergence * (kappa / weight.sum(axis=1))[:, None]
    return np.asarray(k.reshape(n, 24, 24) + scaled[:, :, None] * divergence[:, None, :])


def hex8_centroid_strain(nodes: Array, hexes: Ints) -> Array:
    """(n, 6, 24) engineering strain e11 e22 e33 e12 e23 e13 at the centroid, dilatation averaged as in B-bar."""
    gradient, weight = _gradients(nodes[hexes], _CORNERS / np.sqrt(3))
    mean = np.einsum("ng,ngai->nai", weight, gradient) / weight.sum(axis=1)[:, None, None]
    centre = _gradients(nodes[hexes], np.zeros((1, 3)))[0][:, 0]
    b = np.zeros((len(hexes), 6, 8, 3))
    for i in range(3):
        b[:, i, :, i] = centre[:, :, i]
    b[:, :3] += ((mean - centre) / 3)[:, None]
    for row, (i, j) in zip((3, 4, 5), ((0, 1), (1, 2), (0, 2)), strict=True):
        b[:, row, :, i] = centre[:, :, j]
        b[:, row, :, j] = centre[:, :, i]
    return b.reshape(-1, 6, 24)


def _gradients(corners: Array, points: Array) -> tuple[Array, Array]:
    """(n, g, 8, 3) shape-function gradients in 1/mm and (n, g) det J at local points, for unit weights."""
    one = 1 + points[:, None] * _CORNERS[None]
    local = (
        np.stack(
            [
                _CORNERS[:, 0] * one[..., 1] * one[..., 2],
                _CORNERS[:, 1] * one[..., 0] * one[..., 2],
                _CORNERS[:, 2] * one[..., 0] * one[..., 1],
            ],
            axis=-1,
        )
        * 0.125
    )
    jacobian = np.einsum("gak,nai->ngki", local, corners, optimize=True)
    inverse_t, det = _inverse3(jacobian)
    return np.asarray(np.matmul(local[None], inverse_t)), det


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
