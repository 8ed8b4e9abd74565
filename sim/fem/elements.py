"""Stiffness of hexahedra for nearly incompressible tissue.

"full": eight nodes, 2×2×2 points. "bbar": the same with the element's mean dilatation (Hughes 1980; the selectively
reduced kind ABAQUS uses for first-order bricks). "incompatible": with the bubbles of Wilson et al. (1973), made to
pass the patch test by Taylor, Beresford & Wilson (1976) and condensed. "quadratic": 27 nodes, 3×3×3 points. In the
last two the dilatation is projected onto linear functions of place, as if by a discontinuous linear pressure (Hughes
2000, §4.4): with bubbles and the mean alone, quadratic conformal maps cost no energy, three zero modes on a brick.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.fem.shape_functions import gauss_points, gradients, shape_functions

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Element = Literal["bbar", "full", "incompatible", "quadratic"]

NODES: dict[Element, int] = {"bbar": 8, "full": 8, "incompatible": 8, "quadratic": 27}
_LINEAR_PRESSURE = frozenset({"incompatible", "quadratic"})

_CHUNK_FLOATS = 400_000  # gradients that stay in the second-level cache


def lame(young: Array, poisson: float) -> tuple[Array, Array]:
    """Shear modulus μ and bulk modulus κ, in the unit of E."""
    return young / (2 * (1 + poisson)), young / (3 * (1 - 2 * poisson))


def stiffness(nodes: Array, elements: Ints, young: Array, poisson: float, element: Element) -> Array:
    """(n, 3k, 3k) stiffness in E·mm of (n, k) elements, degrees of freedom node by node."""
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
    """∫ p div u, (n, m, 3k), and ∫ p pᵀ, (n, m, m), with (n, g, m) functions p at the integration points."""
    weighted = (p * weight[..., None]).swapaxes(1, 2)
    return weighted @ gradient.reshape(*weight.shape, -1), weighted @ p


def pressures(corners: Array, points: Array, *, linear: bool) -> Array:
    """(n, g, m) functions that the dilatation is projected onto: 1, and if linear also place over the element's size.

    Linear in place, not in the local coordinates: those lose an order on distorted elements (Boffi & Gastaldi 2002).
    """
    one = np.ones((len(corners), points.shape[-2], 1))
    if not linear:
        return one
    middle = corners.mean(axis=1, keepdims=True)
    offset = shape_functions(corners.shape[1], points)[0] @ corners - middle
    return np.concatenate([one, offset / np.abs(corners - middle).max(axis=1, keepdims=True)], axis=2)


def _outer(gradient: Array, weight: Array) -> Array:
    """(n, 3k, 3k) ∫ ∂i Na ∂j Nb, rows (a, i), columns (b, j)."""
    g = gradient.reshape(*weight.shape, -1)
    return np.asarray((g * weight[..., None]).swapaxes(1, 2) @ g)


def _deviatoric(outer: Array) -> Array:
    """(n, 3k, 3k) ∫ 2 dev ε : dev ε."""
    k = outer.shape[1] // 3
    blocks = outer.reshape(-1, k, 3, k, 3)
    out = blocks.swapaxes(2, 4) - (2 / 3) * blocks
    laplace = np.einsum("naibi->nab", blocks)
    for i in range(3):
        out[:, :, i, :, i] += laplace
    return np.asarray(out.reshape(outer.shape))


def _bubbles(corners: Array, points: Array, det: Array, inverse_t: Array) -> Array:
    """(n, g, 3, 3) gradients of 1 − ξ², 1 − η², 1 − ζ² by the Jacobian at the centre, scaled by det J₀ / det J.

    Their integrals vanish, so that a constant stress does no work on them: the patch test is passed.
    """
    _, det_0, inverse_0 = gradients(corners, np.zeros((1, 3)))
    return np.asarray(-2 * (det_0 / det)[..., None, None] * points[:, :, None] * inverse_0)


def _condensed(matrix: Array, kept: int) -> Array:
    """(n, kept, kept) Schur complement after the unknowns beyond the first `kept` are eliminated."""
    coupling = matrix[:, kept:, :kept]
    relaxed = coupling.swapaxes(1, 2) @ np.linalg.solve(matrix[:, kept:, kept:], coupling)
    return np.asarray(matrix[:, :kept, :kept] - relaxed)
