"""Stiffness of hexahedra for nearly incompressible tissue.

"full": eight nodes, 2×2×2 points. "bbar": the same with the element's mean dilatation (Hughes 1980; the selectively
reduced kind ABAQUS uses for first-order bricks). "incompatible": with the bubbles of Wilson et al. (1973), made to
pass the patch test by Taylor, Beresford & Wilson (1976) and condensed. "quadratic": 27 nodes, 3×3×3 points. In the
last two the dilatation is projected onto linear functions of position, as if by a discontinuous linear pressure
(Hughes 2000, §4.4): with bubbles and the mean alone, quadratic conformal maps cost no energy, three zero modes on a
brick.
"""

from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

# --- shape functions ---
#
# Hexahedra are trilinear with eight nodes or triquadratic Lagrange with 27. Nodes are in VTK order: corners, then
# centers of edges, of faces, of the element.

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
    """Return (n³, 3) local points and (n³,) weights of the product rule."""
    s, w = np.polynomial.legendre.leggauss(n)
    points = np.stack(np.meshgrid(s, s, s, indexing="ij"), -1).reshape(-1, 3)
    return points, np.einsum("i,j,k->ijk", w, w, w).ravel()


def shape_functions(n_nodes: int, points: Array) -> tuple[Array, Array]:
    """Return (…, k) values and (…, k, 3) local gradients of 8 or 27 nodes' functions at (…, 3) local points."""
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
    """Return gradients (n, g, k, 3) in 1/mm, det J (n, g) and J⁻ᵀ (n, g, 3, 3) of (n, k, 3) elements.

    The local points are (g, 3), or (n, g, 3) where each element has its own.
    """
    local = shape_functions(corners.shape[1], points)[1]
    of = "gak,nai->ngki" if points.ndim == 2 else "ngak,nai->ngki"
    inverse_t, det = _inverse3(np.einsum(of, local, corners, optimize=True))
    return np.matmul(local, inverse_t), det, inverse_t


def local_coordinates(corners: Array, point: Array) -> Array:
    """Return the (3,) local coordinates of a point in one (k, 3) element, by Newton's iteration.

    They extend beyond the element.
    """
    local = np.zeros(3)
    for _ in range(_NEWTON_STEPS):
        value, gradient = shape_functions(len(corners), local)
        step = np.linalg.solve(corners.T @ gradient, point - value @ corners)
        local = local + step
        if np.abs(step).max() < _LOCATED:
            break
    return local


def _inverse3(m: Array) -> tuple[Array, Array]:
    """Return the (…, 3, 3) inverse transposed by cofactors, and the determinant."""
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


Ints = NDArray[np.int64]
Element = Literal["bbar", "full", "incompatible", "quadratic"]

NODES: dict[Element, int] = {"bbar": 8, "full": 8, "incompatible": 8, "quadratic": 27}
_LINEAR_PRESSURE = frozenset({"incompatible", "quadratic"})

_CHUNK_FLOATS = 400_000  # gradients that stay in the second-level cache


def lame(young: Array, poisson: float) -> tuple[Array, Array]:
    """Return shear modulus μ and bulk modulus κ, in the unit of E."""
    return young / (2 * (1 + poisson)), young / (3 * (1 - 2 * poisson))


def stiffness(nodes: Array, elements: Ints, young: Array, poisson: float, element: Element) -> Array:
    """Return (n, 3k, 3k) stiffness in E·mm of (n, k) elements, degrees of freedom node by node."""
    points, weights = gauss_points(2 if NODES[element] == 8 else 3)
    n, k = elements.shape
    out = np.empty((n, 3 * k, 3 * k))
    chunk = max(1, _CHUNK_FLOATS // (3 * k * len(points)))
    for start in range(0, n, chunk):
        part = slice(start, start + chunk)
        mu, kappa = lame(young[part], poisson)
        corners = nodes[elements[part]]
        gradient, det, inverse_t = gradients(corners, points)
        weight = det * weights
        if element == "incompatible":
            gradient = np.concatenate([gradient, _bubbles(corners, points, det, inverse_t)], axis=2)
        outer = _outer(gradient, weight)
        if element == "full":
            dilatation = outer
        else:
            p = pressures(corners, points, linear=element in _LINEAR_PRESSURE)
            moments, mass = dilatation_moments(p, gradient, weight)
            dilatation = moments.swapaxes(1, 2) @ np.linalg.solve(mass, moments)
        matrix = mu[:, None, None] * _deviatoric(outer) + kappa[:, None, None] * dilatation
        out[part] = _condensed(matrix, 3 * k) if element == "incompatible" else matrix
    return out


def dilatation_moments(p: Array, gradient: Array, weight: Array) -> tuple[Array, Array]:
    """Return ∫ p div u (n, m, 3k) and ∫ p pᵀ (n, m, m) of functions p (n, g, m) at the integration points."""
    weighted = (p * weight[..., None]).swapaxes(1, 2)
    return weighted @ gradient.reshape(*weight.shape, -1), weighted @ p


def pressures(corners: Array, points: Array, *, linear: bool) -> Array:
    """Return (n, g, m) functions onto which the dilatation is projected: 1, and if linear also scaled positions.

    They are linear in position, not in local coordinates, which lose an order on distorted elements (Boffi & Gastaldi
    2002).
    """
    one = np.ones((len(corners), points.shape[-2], 1))
    if not linear:
        return one
    middle = corners.mean(axis=1, keepdims=True)
    offset = shape_functions(corners.shape[1], points)[0] @ corners - middle
    return np.concatenate([one, offset / np.abs(corners - middle).max(axis=1, keepdims=True)], axis=2)


def _outer(gradient: Array, weight: Array) -> Array:
    """Return (n, 3k, 3k) ∫ ∂i Na ∂j Nb, rows (a, i), columns (b, j)."""
    g = gradient.reshape(*weight.shape, -1)
    return np.asarray((g * weight[..., None]).swapaxes(1, 2) @ g)


def _deviatoric(outer: Array) -> Array:
    """Return (n, 3k, 3k) ∫ 2 dev ε : dev ε."""
    k = outer.shape[1] // 3
    blocks = outer.reshape(-1, k, 3, k, 3)
    out = blocks.swapaxes(2, 4) - (2 / 3) * blocks
    laplace = np.einsum("naibi->nab", blocks)
    for i in range(3):
        out[:, :, i, :, i] += laplace
    return np.asarray(out.reshape(outer.shape))


def _bubbles(corners: Array, points: Array, det: Array, inverse_t: Array) -> Array:
    """Return (n, g, 3, 3) gradients of 1 − ξ², 1 − η², 1 − ζ² by the central Jacobian, scaled by det J₀ / det J.

    Their integrals vanish, so that a constant stress does no work on them: the patch test is passed.
    """
    _, det_0, inverse_0 = gradients(corners, np.zeros((1, 3)))
    return np.asarray(-2 * (det_0 / det)[..., None, None] * points[:, :, None] * inverse_0)


def _condensed(matrix: Array, kept: int) -> Array:
    """Return the (n, kept, kept) Schur complement on the first `kept` unknowns."""
    coupling = matrix[:, kept:, :kept]
    relaxed = coupling.swapaxes(1, 2) @ np.linalg.solve(matrix[:, kept:, kept:], coupling)
    return np.asarray(matrix[:, :kept, :kept] - relaxed)


# --- strain ---


def strain_matrix(corners: Array, local: Array) -> Array:
    """Return (n, 6, 3k) engineering strains e11 e22 e33 e12 e23 e13 of (n, k, 3) elements at (n, 3) local points.

    The dilatation is the mean with eight nodes, and projected as in the stiffness with 27. The bubbles of
    "incompatible" elements are left out; at the center of a brick they contribute no strain.
    """
    n, k, _ = corners.shape
    points, weights = gauss_points(2 if k == len(HEX8) else 3)
    gradient, det, _ = gradients(corners, points)
    linear = k > len(HEX8)
    moments, mass = dilatation_moments(pressures(corners, points, linear=linear), gradient, det * weights)
    here = gradients(corners, local[:, None])[0][:, 0]
    dilatation = pressures(corners, local[:, None], linear=linear) @ np.linalg.solve(mass, moments)
    b = np.zeros((n, 6, k, 3))
    for i in range(3):
        b[:, i, :, i] = here[:, :, i]
    b[:, :3] += (dilatation.reshape(n, 1, k, 3) - here[:, None]) / 3
    for row, (i, j) in zip((3, 4, 5), ((0, 1), (1, 2), (0, 2)), strict=True):
        b[:, row, :, i] = here[:, :, j]
        b[:, row, :, j] = here[:, :, i]
    return b.reshape(n, 6, 3 * k)


# --- assembly ---
#
# Assembly works on 3×3 blocks.


def assemble_upper(stiffness: Array, elements: Ints, n_nodes: int) -> sp.csr_array:
    """Assemble the upper triangle of the (3 n_nodes, 3 n_nodes) stiffness from (n, 3k, 3k) element matrices."""
    k = elements.shape[1]
    a, b = np.triu_indices(k)
    rows, cols = elements[:, a], elements[:, b]
    blocks = stiffness.reshape(-1, k, 3, k, 3).swapaxes(2, 3)[:, a, b]
    below = rows > cols
    blocks[below] = blocks[below].swapaxes(-1, -2)
    folded = (rows == cols) & (a != b)  # both triangles of a wedge's coinciding nodes fall on one block
    blocks[folded] += blocks[folded].swapaxes(-1, -2)
    key = np.where(below, cols * n_nodes + rows, rows * n_nodes + cols).ravel()
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.concatenate([[True], np.diff(key[order]) > 0]))
    gather = sp.csr_array(
        (np.ones(len(order)), order, np.append(starts, len(order))), shape=(len(starts), len(order))
    )
    summed = (gather @ blocks.reshape(-1, 9)).reshape(-1, 3, 3)
    unique = key[order][starts]
    indptr = np.searchsorted(unique // n_nodes, np.arange(n_nodes + 1))
    shape = (3 * n_nodes, 3 * n_nodes)
    return sp.triu(sp.bsr_array((summed, unique % n_nodes, indptr), shape=shape), format="csr")


def symmetric(upper: sp.csr_array) -> sp.csr_array:
    """Return the full matrix of an upper triangle."""
    return sp.csr_array(upper + sp.triu(upper, k=1).T)
