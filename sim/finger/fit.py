"""Half-width, height and lean as splines of z, fitted to points of the skin."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from sim.config.fingertip_config import Geometry
from sim.finger import section

Array = NDArray[np.float64]

_KNOTS = np.array([3.0, 5.0, 7.0, 9.0, 11.0]) / 12.75  # of the finger's length
_ANCHOR_WEIGHT = 0.02 / 0.5  # 0.5 mm off an anchor costs as much as 0.02 mm off a point


def fit_curves(geometry: Geometry, points: Array) -> BSpline:
    """(half-width, height, lean) in mm as a cubic spline of z, closest to (n, 3) points in mm.

    Least squares of the distances within the sections, with weak anchors at both ends and a bending penalty.
    """
    basis = _basis(geometry.length_mm)
    at_points, (prior, wanted) = basis(points[:, 2]), _prior(geometry, basis)

    def distances(v: Array) -> tuple[Array, Array]:
        parameters = v.reshape(3, -1) @ at_points.T
        return _distances(points[:, :2], parameters, geometry.nail_depth_ratio)

    def residual(v: Array) -> Array:
        return np.concatenate([distances(v)[0], prior @ v - wanted])

    def jacobian(v: Array) -> Array:
        by_parameter = distances(v)[1]
        return np.concatenate([(by_parameter[:, :, None] * at_points[:, None, :]).reshape(len(points), -1), prior])

    highest = points[:, 1].max()
    start = np.repeat([highest, highest, 0.0], at_points.shape[1])
    found = least_squares(residual, start, jacobian, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return BSpline(basis.t, found.x.reshape(3, -1).T, 3)


def _basis(length_mm: float) -> BSpline:
    knots = np.concatenate([np.zeros(4), _KNOTS * length_mm, np.full(4, length_mm)])
    return BSpline(knots, np.eye(len(knots) - 4), 3)


def _prior(geometry: Geometry, basis: BSpline) -> tuple[Array, Array]:
    """Matrix and right-hand side of the anchors and the bending penalty, on the coefficients of all three curves."""
    z_mm = np.linspace(0.0, geometry.length_mm, 60)
    bend = np.sqrt(z_mm[1]) * geometry.stiffness_of_fit * basis.derivative(2)(z_mm)
    ends = np.array(
        [
            [geometry.proximal_half_width_mm, geometry.tip_radius_mm],
            [geometry.proximal_apex_mm, geometry.tip_radius_mm],
            [geometry.proximal_lean_mm, 0.0],
        ]
    )
    rows = np.concatenate([_ANCHOR_WEIGHT * basis(z_mm[[0, -1]]), bend])
    wanted = np.concatenate([_ANCHOR_WEIGHT * ends, np.zeros((3, len(bend)))], axis=1)
    return np.kron(np.eye(3), rows), wanted.ravel()


def _distances(xy: Array, parameters: Array, ratio: float) -> tuple[Array, Array]:
    """(n,) signed distances of the sections from (n, 2) points, and their (n, 3) derivatives by the parameters.

    At the closest point the distance does not change with the angle: only the section's own move along its normal
    counts.
    """
    phi = section.nearest_angle(xy[:, 0], xy[:, 1], parameters, ratio)
    normal = section.normal(phi, parameters, ratio)
    off = np.stack(section.position(phi, parameters, ratio), -1) - xy
    across, up, sideways = section.shape(phi, ratio)
    n_x, n_y = normal.T
    return (off * normal).sum(axis=-1), np.stack([n_x * across, n_y * up, n_x * sideways], -1)
