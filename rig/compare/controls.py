"""Controls: what a measure inside the finger has to beat, at the same receptors and positions.

Pressure on the skin above a receptor and the skin's displacement there, the curvature of the indentor above it, and
the strain that a uniform elastic half-space would have at its depth under the same pressures (Phillips and Johnson,
J. Neurophysiol. 46, 1204, 1981). A constant rate, the fifth, needs no value.
"""

import numpy as np
from numpy.typing import NDArray

from sim.contact.patch import X, Z
from sim.models.result import IndentationResult
from sim.units import PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]

CONTROLS = ("skin pressure", "skin displacement", "indentor curvature", "half-space strain")
"""Pseudo-units, mm downwards, 1/mm (convex is positive), the maximum compressive strain as a magnitude."""

_ACROSS_MM = 0.17  # the spacing of schedules: over it a corner's curvature is averaged
_POISSON = 0.48


def controls(result: IndentationResult) -> Array:
    """(4, receptors) of one indentation, in the order of `CONTROLS`."""
    x_mm, pressure = result.pressure_profile
    receptors = result.model.receptors
    at_mm = receptors.position_mm[:, X]
    order = np.argsort(x_mm)
    down_mm = -result.state.displacement[-1][result.model.across]
    strain = half_space_strain(x_mm[order], pressure[order], at_mm, receptors.depths_mm)
    return np.array(
        [
            np.interp(at_mm, x_mm[order], pressure[order]),
            np.interp(at_mm, x_mm[order], down_mm[order]),
            _curvature(result),
            strain,
        ]
    )


def half_space_strain(x_mm: Array, pressure: Array, at_mm: Array, depth_mm: Array) -> Array:
    """(k,) maximum compressive strain (magnitude) at x and depth (k,) mm under pressures (n,) at ascending x (n,).

    Plane strain, line loads summed (Johnson, Contact Mechanics, 1985, Eq. 2.17); E is the epidermis's 10 000.
    """
    load = pressure * np.gradient(x_mm)
    s, d = x_mm - at_mm[:, None], depth_mm[:, None]
    radial = -2 * load * d / (np.pi * (s * s + d * d) ** 2)
    sxx, syy, sxy = ((radial * part).sum(axis=1) for part in (s * s, d * d, s * d))
    shear = 2 * (1 + _POISSON) / PSEUDO_E_EPIDERMIS
    middle = (1 + _POISSON) * (1 - 2 * _POISSON) / PSEUDO_E_EPIDERMIS * (sxx + syy) / 2
    return np.asarray(shear / 2 * np.hypot((sxx - syy) / 2, sxy) - middle)


def _curvature(result: IndentationResult) -> Array:
    """(receptors,) turn of the indentor's surface above each, over the length in which it turns."""
    receptors = result.model.receptors.position_mm
    place = {X: receptors[:, X] - result.x_mm, Z: receptors[:, Z] - result.z_mm}
    offset = np.array([place[axis] for axis in result.indentor.axes])
    half = np.zeros_like(offset)
    half[0] = _ACROSS_MM / 2
    before, after = (np.arctan(result.indentor.evaluate(offset + side * half).slope[0]) for side in (-1, 1))
    return np.asarray((after - before) / _ACROSS_MM)
