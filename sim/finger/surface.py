"""The skin: a smooth parametric surface through published points, a user's own points, or a user's sections.

Source of the published points: Raju (1998), Figure 6-3, copied into `sim/data/fingertip_surface_points.csv`.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline
from scipy.optimize import least_squares

from sim.config import Geometry
from sim.errors import SimError
from sim.tables import warn_once

# --- section ---
#
# A section is a second-order Fourier curve in the angle φ:
# x = a cos φ + s ((1 + sin φ)/2)², y = b (½(1 + r) sin φ + ½(1 − r) sin² φ) with half-width a, height b and lean s in
# mm, and r the depth of the nail side divided by the height.

Array = NDArray[np.float64]


def shape(phi: ArrayLike, ratio: float) -> tuple[Array, Array, Array]:
    """Return the factors of half-width, height and lean at angle φ."""
    s = np.sin(phi)
    return np.cos(phi), 0.5 * (1 + ratio) * s + 0.5 * (1 - ratio) * s * s, (0.5 * (1 + s)) ** 2


def position(phi: ArrayLike, parameters: Array, ratio: float) -> tuple[Array, Array]:
    """Return x and y in mm of sections with (3, …) half-widths, heights and leans in mm (broadcast)."""
    a, b, lean = parameters
    across, up, sideways = shape(phi, ratio)
    return a * across + lean * sideways, b * up


def first_derivative(phi: ArrayLike, parameters: Array, ratio: float) -> tuple[Array, Array]:
    """Return dx/dφ and dy/dφ in mm/rad."""
    a, b, lean = parameters
    s, c = np.sin(phi), np.cos(phi)
    return -a * s + 0.5 * lean * (1 + s) * c, b * c * (0.5 * (1 + ratio) + (1 - ratio) * s)


def second_derivative(phi: ArrayLike, parameters: Array, ratio: float) -> tuple[Array, Array]:
    """Return d²x/dφ² and d²y/dφ² in mm/rad²."""
    a, b, lean = parameters
    s, c = np.sin(phi), np.cos(phi)
    return (
        -a * c + 0.5 * lean * (c * c - s * (1 + s)),
        b * ((1 - ratio) * (c * c - s * s) - 0.5 * (1 + ratio) * s),
    )


def normal(phi: ArrayLike, parameters: Array, ratio: float) -> Array:
    """Return the (…, 2) outward unit normal within the plane of the section."""
    d_x, d_y = first_derivative(phi, parameters, ratio)
    return np.stack([d_y, -d_x], -1) / np.hypot(d_x, d_y)[..., None]


def nearest_angle(x: Array, y: Array, parameters: Array, ratio: float) -> Array:
    """Return (n,) angles of the points closest to (n,) x and y in mm, each on its own section."""
    a, b, lean = parameters
    phi = np.arctan2(y / b, (x - lean) / a)
    for _ in range(50):
        at_x, at_y = position(phi, parameters, ratio)
        d_x, d_y = first_derivative(phi, parameters, ratio)
        dd_x, dd_y = second_derivative(phi, parameters, ratio)
        speed2 = d_x**2 + d_y**2
        bend = np.maximum(
            speed2 + (at_x - x) * dd_x + (at_y - y) * dd_y, 0.5 * speed2
        )  # stays positive far from the curve
        step = ((at_x - x) * d_x + (at_y - y) * d_y) / bend
        phi = phi - step
        if np.abs(step).max() < 1e-13:
            break
    return np.asarray(phi)


# --- fit ---

_KNOTS = np.array([3.0, 5.0, 7.0, 9.0, 11.0]) / 12.75  # of the finger's length
_ANCHOR_WEIGHT = 0.02 / 0.5  # a deviation of 0.5 mm at an anchor costs as much as 0.02 mm at a point


def fit_curves(geometry: Geometry, points: Array) -> BSpline:
    """Return (half-width, height, lean) in mm as a cubic spline of z, closest to (n, 3) points in mm.

    Least squares of the distances within the sections, with weak anchors at both ends and a bending penalty.
    """
    basis = _basis(geometry.length_mm)
    at_points, (prior, target) = basis(points[:, 2]), _prior(geometry, basis)

    def distances(v: Array) -> tuple[Array, Array]:
        parameters = v.reshape(3, -1) @ at_points.T
        return _distances(points[:, :2], parameters, geometry.nail_depth_ratio)

    def residual(v: Array) -> Array:
        return np.concatenate([distances(v)[0], prior @ v - target])

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
    """Return matrix and right-hand side of the anchors and the bending penalty, for all curves' coefficients."""
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
    target = np.concatenate([_ANCHOR_WEIGHT * ends, np.zeros((3, len(bend)))], axis=1)
    return np.kron(np.eye(3), rows), target.ravel()


def _distances(xy: Array, parameters: Array, ratio: float) -> tuple[Array, Array]:
    """Return (n,) signed distances of sections from (n, 2) points, and (n, 3) derivatives by the parameters.

    At the closest point the distance does not change with the angle: only the section's own motion along its normal
    counts.
    """
    phi = nearest_angle(xy[:, 0], xy[:, 1], parameters, ratio)
    outward = normal(phi, parameters, ratio)
    off = np.stack(position(phi, parameters, ratio), -1) - xy
    across, up, sideways = shape(phi, ratio)
    n_x, n_y = outward.T
    return (off * outward).sum(axis=-1), np.stack([n_x * across, n_y * up, n_x * sideways], -1)


_TOUCHABLE = np.array([2.0, 11.0]) / 12.75  # of the finger's length: beyond, the skin ends or is steep
_BESIDE_MM = 1e-6
_RIDGE_STEP_MM = 0.02
FAR_MM = 0.5
"""Distance (mm) from the fitted skin beyond which a point is named; the largest of the published ones is 0.03."""
_MOST_NAMED = 3


class SurfaceError(SimError, ValueError):
    """Error of measurements that do not make the skin of a finger."""

    default_code = "bad_surface"


def published_points() -> tuple[NDArray[np.int64], Array, list[str]]:
    """Return sites, (24, 3) coordinates in mm and regions of Raju (1998), Figure 6-3."""
    lines = (files("sim") / "data" / "fingertip_surface_points.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines if line and line[0].isdigit()]
    xyz = np.array([[float(v) for v in row[1:4]] for row in rows])
    return np.array([int(row[0]) for row in rows]), xyz, [row[4] for row in rows]


@dataclass(frozen=True)
class Apex:
    """Topmost point of the skin and its radii of curvature across and along the finger (mm)."""

    position_mm: tuple[float, float, float]
    lateral_radius_mm: float
    axial_radius_mm: float  # infinite or negative where the skin does not fall to both sides
    inside: bool  # false where the skin still rises at an end of the part that can be touched


@dataclass(frozen=True)
class FingertipSurface:
    """Sections at constant z, each a second-order Fourier curve in the angle φ, smooth (C²) along z.

    φ = π/2 is the pulp's apex at (lean, height), φ = −π/2 the nail at (0, −nail_depth_ratio · height); half-width,
    height and lean are cubic splines of z.
    """

    geometry: Geometry
    curves: BSpline  # of z in mm: half-width, height, lean in mm

    @classmethod
    @lru_cache(maxsize=64)  # fingers of a study share their skin
    def fit(cls, geometry: Geometry) -> "FingertipSurface":
        """Fit the skin through a geometry's sections, or to its points, the published ones by default.

        Raises SurfaceError when it does not enclose the bone's axis everywhere.
        """
        if geometry.sections:
            z_mm, *parameters = np.array(geometry.sections).T
            surface = cls(geometry, make_interp_spline(z_mm, np.stack(parameters, -1), 3))
        else:
            surface = cls(geometry, fit_curves(geometry, _points(geometry)))
        _name_far_points(surface)
        _refuse_unusable(surface)
        return surface

    @cached_property
    def points_mm(self) -> Array:
        """(n, 3) points of the fit (mm); empty for a table of sections."""
        return np.zeros((0, 3)) if self.geometry.sections else _points(self.geometry)

    @cached_property
    def _slopes(self) -> BSpline:
        return self.curves.derivative()

    def parameters(self, z_mm: ArrayLike) -> Array:
        """Return (3, …) half-width, height and lean in mm at axial positions z."""
        return np.moveaxis(self.curves(np.asarray(z_mm, dtype=float)), -1, 0)

    def section(self, phi: ArrayLike, z_mm: ArrayLike) -> tuple[Array, Array]:
        """Return x and y in mm at angle φ (rad) of the section at z (broadcast)."""
        return position(phi, self.parameters(z_mm), self.geometry.nail_depth_ratio)

    def tangents(self, phi: ArrayLike, z_mm: ArrayLike) -> tuple[Array, Array]:
        """Return (…, 3) derivatives of the position with respect to φ (mm/rad) and z (mm/mm)."""
        angle, z = np.broadcast_arrays(np.asarray(phi, float), np.asarray(z_mm, float))
        slopes, ratio = np.moveaxis(self._slopes(z), -1, 0), self.geometry.nail_depth_ratio
        d_phi = first_derivative(angle, self.parameters(z), ratio)
        d_z = position(angle, slopes, ratio)  # the section is linear in its parameters
        return np.stack([*d_phi, np.zeros(z.shape)], -1), np.stack([*d_z, np.ones(z.shape)], -1)

    def normal(self, phi: ArrayLike, z_mm: ArrayLike) -> Array:
        """Return the (…, 3) outward unit normal."""
        d_phi, d_z = self.tangents(phi, z_mm)
        n = np.cross(d_phi, d_z)
        return n / np.linalg.norm(n, axis=-1, keepdims=True)

    def angle_at(self, x_mm: ArrayLike, z_mm: ArrayLike) -> Array:
        """Return φ (rad) in the pulp half of the section at z whose lateral position is x, within the half-width."""
        x, z = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(z_mm, float))
        a, _, lean = self.parameters(z)
        phi = np.arccos(np.clip((x - lean) / a, -0.98, 0.98))
        for _ in range(20):
            s, c = np.sin(phi), np.cos(phi)
            f = a * c + lean * (0.5 * (1 + s)) ** 2 - x
            step = f / (-a * s + 0.5 * lean * (1 + s) * c)
            phi = np.clip(phi - step, 0.02, np.pi - 0.02)
            if np.abs(step).max() < 1e-14:
                break
        return phi

    def height(self, x_mm: ArrayLike, z_mm: ArrayLike) -> Array:
        """Return y in mm of the pulp at (x, z); −inf beside the section at z, where there is no skin."""
        there, y = self.section(self.angle_at(x_mm, z_mm), z_mm)
        return np.where(np.abs(there - np.asarray(x_mm)) < _BESIDE_MM, y, -np.inf)

    @cached_property
    def ridge(self) -> CubicSpline:
        """Apex line along x: highest y over all z, where a shape prismatic along z touches first (mm)."""
        x_mm, _, y = self._pulp
        return CubicSpline(x_mm, _largest(y), extrapolate=False)

    @cached_property
    def crest(self) -> CubicSpline:
        """Apex line along z: highest y over all x, where a shape prismatic along x touches first (mm)."""
        _, z_mm, y = self._pulp
        return CubicSpline(z_mm, _largest(y.T), extrapolate=False)

    @cached_property
    def _pulp(self) -> tuple[Array, Array, Array]:
        """x and z in mm and the (n_x, n_z) heights of the pulp there, −inf beside it."""
        low, high = _TOUCHABLE * self.geometry.length_mm
        z_mm = np.linspace(low, high, 451)
        a = self.parameters(z_mm)[0]
        half = 0.93 * a.max()
        x_mm = np.arange(-half, half, _RIDGE_STEP_MM)
        inside = np.abs(x_mm[:, None]) < 0.95 * a[None]
        y = np.where(inside, self.height(np.where(inside, x_mm[:, None], 0.0), z_mm[None]), -np.inf)
        there = np.isfinite(y).any(axis=1)  # an off-center finger extends less far on one side
        return x_mm[there], z_mm, y[there]

    @cached_property
    def apex(self) -> Apex:
        """Topmost point of the touchable part; radii from the parametrization at φ = π/2."""
        low, high = _TOUCHABLE * self.geometry.length_mm
        table = np.linspace(low, high, 2001)
        height = CubicSpline(table, self.parameters(table)[1])
        level = height.derivative().roots(extrapolate=False)
        z = max([low, high, *level], key=height)
        a, b, lean = self.parameters(z)
        _, _, d_lean = self._slopes(z)
        fall = b * (1.5 - 0.5 * self.geometry.nail_depth_ratio)  # −∂²y/∂φ²
        axial = fall * (d_lean / a) ** 2 - self.curves.derivative(2)(z)[1]
        radius = float(1 / axial) if axial else np.inf
        return Apex((float(lean), float(b), float(z)), float(a**2 / fall), radius, inside=bool(low < z < high))

    def residuals_mm(self, points: Array | None = None) -> Array:
        """Return (n,) in-section distances in mm of points from the skin; default: the points of the fit."""
        x, y, z = (self.points_mm if points is None else points).T
        parameters, ratio = self.parameters(z), self.geometry.nail_depth_ratio
        at_x, at_y = position(nearest_angle(x, y, parameters, ratio), parameters, ratio)
        return np.hypot(at_x - x, at_y - y)


def _points(geometry: Geometry) -> Array:
    return np.array(geometry.points) if geometry.points else published_points()[1]


def _largest(y: Array) -> Array:
    """Return (n,) maxima of (n, m) equally spaced samples, refined by a parabola where both neighbors are finite."""
    rows, k = np.arange(len(y)), np.argmax(y, axis=1)
    mid, left, right = y[rows, k], y[rows, np.maximum(k - 1, 0)], y[rows, np.minimum(k + 1, y.shape[1] - 1)]
    inner = (k > 0) & (k < y.shape[1] - 1) & np.isfinite(left) & np.isfinite(right) & (left + right < 2 * mid)
    left, right = np.where(inner, left, mid - 1.0), np.where(inner, right, mid - 1.0)
    return np.asarray(mid + (left - right) ** 2 / (8 * (2 * mid - left - right)))


def _name_far_points(surface: FingertipSurface) -> None:
    """Warn of points of the user that are far from the skin: an outlier, or a row of means."""
    residuals_mm = surface.residuals_mm() if surface.geometry.points else np.zeros(0)
    far = [n for n in np.argsort(-residuals_mm).tolist() if residuals_mm[n] > FAR_MM]
    if far:
        named = ", ".join(
            f"{n + 1} at ({', '.join(f'{value:g}' for value in surface.points_mm[n])}) mm" for n in far[:_MOST_NAMED]
        )
        lie = "point {} lies" if len(far) == 1 else "points {} lie"
        more = f" and {len(far) - _MOST_NAMED} more" * (len(far) > _MOST_NAMED)
        warn_once(
            f"finger.geometry.points: {lie.format(named + more)} more than {FAR_MM:g} mm from the skin that is "
            "fitted to all; remove what is no point of the skin, such as a mean"
        )


def _refuse_unusable(surface: FingertipSurface) -> None:
    """Raise SurfaceError where a section does not wind once around the bone's axis."""
    z_mm = np.linspace(0.0, surface.geometry.length_mm, 301)
    phi = np.linspace(-np.pi, np.pi, 181)
    x, y = surface.section(phi[None], z_mm[:, None])
    t_x, t_y, _ = np.moveaxis(surface.tangents(phi[None], z_mm[:, None])[0], -1, 0)
    turning = (x * t_y - y * t_x).min(axis=1)
    a, b, lean = surface.parameters(z_mm)
    bad = np.flatnonzero((turning <= 0) | (a <= 0) | (b <= 0))
    if len(bad):
        k = bad[0]
        raise SurfaceError(
            f"the skin crosses the bone's axis at z = {float(z_mm[k]):.2f} mm (half-width {float(a[k]):.2f}, "
            f"height {float(b[k]):.2f}, lean {float(lean[k]):.2f} mm); every section must enclose x = y = 0",
            "crosses_axis",
        )
