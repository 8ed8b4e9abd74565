"""Strain inside hexahedra."""

import numpy as np
from numpy.typing import NDArray

from sim.fem.elements import dilatation_moments, pressures
from sim.fem.shape_functions import HEX8, gauss_points, gradients

Array = NDArray[np.float64]


def strain_matrix(corners: Array, local: Array) -> Array:
    """(n, 6, 3k) engineering strain e11 e22 e33 e12 e23 e13 of (n, k, 3) elements, each at its (n, 3) local point.

    The dilatation is the mean of eight nodes and projected as in the stiffness of 27. The bubbles of "incompatible"
    elements are left out; at the centre of a brick they strain nothing.
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
