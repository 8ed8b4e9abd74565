"""Interior strains of a half-space under a concentrated normal force, and the same in a box of our elements.

Sources: Flamant (1892), line load, Johnson, *Contact Mechanics* (1985), Eq. 2.23; Boussinesq (1885), point load,
Johnson Eq. 3.18 and 3.19. The load is 1 N (per mm) on a half-space of E = 1 MPa; our y points up, Johnson's z down.
"""

import numpy as np
from numpy.typing import NDArray

from sim.fem.elements import Element, lame
from studies.verification.box import SLAB, Box, BoxBody, graded

Array = NDArray[np.float64]

POISSON = 0.48
DEPTH_MM = 0.765
"""Depth of the source's receptors, and the middle of the fifth row of elements of 0.17 mm."""


def flamant_strain(x: Array, depth: Array, poisson: float = POISSON) -> Array:
    """(n, 6) engineering strain e11 e22 e33 e12 e23 e13 under a line load, plane strain."""
    r4 = (x * x + depth * depth) ** 2
    s11, s22 = -2 / np.pi * x * x * depth / r4, -2 / np.pi * depth**3 / r4
    e11, e22 = ((1 + poisson) * (s - poisson * (s11 + s22)) for s in (s11, s22))
    e12 = 2 * (1 + poisson) * 2 / np.pi * x * depth**2 / r4
    zero = np.zeros_like(x)
    return np.stack([e11, e22, zero, e12, zero, zero], -1)


def boussinesq_strain(x: Array, depth: Array, z: Array, poisson: float = POISSON) -> Array:
    """(n, 6) engineering strain e11 e22 e33 e12 e23 e13 under a point load."""
    mu, kappa = (float(v) for v in lame(np.array(1.0), poisson))
    r, rho = np.hypot(x, z), np.sqrt(x * x + z * z + depth * depth)
    hoop = (depth / rho**3 - (1 - 2 * poisson) / (rho * (rho + depth))) / (4 * np.pi * mu)
    dilatation = -(1 - 2 * poisson) * (1 + poisson) * depth / (np.pi * rho**3)
    down = (-3 * depth**3 / (2 * np.pi * rho**5) - (kappa - 2 * mu / 3) * dilatation) / (2 * mu)
    radial = dilatation - down - hoop
    shear = 3 * r * depth**2 / (2 * np.pi * rho**5) / mu
    c, s = x / r, z / r
    e11, e33 = radial * c * c + hoop * s * s, radial * s * s + hoop * c * c
    return np.stack([e11, down, e33, shear * c, shear * s, 2 * (radial - hoop) * c * s], -1)


def line_load(
    spacing_mm: float, size_mm: float, element: Element = "bbar", poisson: float = POISSON
) -> tuple[Array, Array]:
    """Centroid strains (n, 6) at the receptors' depth, |x| < 2 depths, in a box of this size; and the exact ones."""
    x = graded(2.0, spacing_mm, size_mm)
    return _strains(Box(x, -x[::-1], SLAB), element, poisson)


def point_load(
    spacing_mm: float, size_mm: float, element: Element = "bbar", poisson: float = POISSON
) -> tuple[Array, Array]:
    """As `line_load`, in three dimensions."""
    x = graded(1.7, spacing_mm, size_mm, growth=1.25)
    return _strains(Box(x, -x[::-1], x), element, poisson)


def largest_error(strain: Array, exact: Array) -> float:
    """Over all components and places, relative to the largest exact strain."""
    return float(np.abs(strain - exact).max() / np.abs(exact).max())


def _strains(box: Box, element: Element, poisson: float) -> tuple[Array, Array]:
    body = BoxBody(box, np.ones(len(box.hexes)), poisson, element)
    load = np.zeros((1, len(box.nodes), 3))
    load[0, box.number[0, -1, 0], 1] = -0.5 if box.plane else -0.25  # the other half, or quarters, are mirror images
    u = body.solve(load)[0]
    depth = -box.centroids[:, 1]
    row = depth[np.argmin(np.abs(depth - DEPTH_MM))]
    x, _, z = box.centroids.T
    near = np.flatnonzero(np.isclose(depth, row) & (x < 2 * DEPTH_MM) & ((z < 2 * DEPTH_MM) | box.plane))
    x, depth, z = x[near], depth[near], z[near]
    exact = flamant_strain(x, depth, poisson) if box.plane else boussinesq_strain(x, depth, z, poisson)
    return body.strain(u, near), exact
