"""The skin: a smooth parametric surface through the published points, a user's own points, or a user's sections.

Source of the published points: Raju (1998), Figure 6-3, copied into `sim/data/fingertip_surface_points.csv`.
"""

from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from sim.config.fingertip_config import Geometry
from sim.errors import SimError
from sim.finger import section
from sim.finger.fit import fit_curves

Array = NDArray[np.float64]

_TOUCHABLE = np.array([2.0, 11.0]) / 12.75  # of the finger's length: beyond, it ends or is steep
_BESIDE_MM = 1e-6
_RIDGE_STEP_MM = 0.02


class SurfaceError(SimError, ValueError):
    """What was measured does not make the skin of a finger."""

    default_code = "bad_surface"


def published_points() -> tuple[NDArray[np.int64], Array, list[str]]:
    """Sites, (24, 3) coordinates in mm and regions of Raju (1998), Figure 6-3."""
    lines = (files("sim") / "data" / "fingertip_surface_points.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines if line and line[0].isdigit()]
    xyz = np.array([[float(v) for v in row[1:4]] for row in rows])
    return np.array([int(row[0]) for row in rows]), xyz, [row[4] for row in rows]


@dataclass(frozen=True)
class Apex:
    """The skin's topmost point, and its radii of curvature across and along the finger; mm."""

    position_mm: tuple[float, float, float]
    lateral_radius_mm: float
    axial_radius_mm: float  # infinite or negative where the skin does not fall to both sides
    inside: bool  # false where the skin still rises at an end of the part that can be touched


@dataclass(frozen=True)
class FingertipSurface:
    """Sections at constant z, each a second-order Fourier curve in the angle φ, smooth (C²) along z.

    φ = π/2 is the pulp's apex at (lean, height), φ = −π/2 the nail at (0, −nail_depth_ratio · height); half-width,
    height and lean are cubic splines of z. `sim/finger/section.py` has the curve.
    """

    geometry: Geometry
    curves: BSpline  # of z in mm: half-width, height, lean in mm

    @classmethod
    def fit(cls, geometry: Geometry) -> "FingertipSurface":
        """The skin through a geometry's sections, or closest to its points, the published ones by default.

        Raises SurfaceError when it does not enclose the bone's axis everywhere.
        """
        if geometry.sections:
            z_mm, *parameters = np.array(geometry.sections).T
            surface = cls(geometry, make_interp_spline(z_mm, np.stack(parameters, -1), 3))
        else:
            surface = cls(geometry, fit_curves(geometry, _points(geometry)))
        _refuse_unusable(surface)
        return surface

    @cached_property
    def points_mm(self) -> Array:
        """(n, 3) points that the skin was fitted to; none for a table of sections."""
        return np.zeros((0, 3)) if self.geometry.sections else _points(self.geometry)

    @cached_property
    def _slopes(self) -> BSpline:
        return self.curves.derivative()

    def parameters(self, z_mm: ArrayLike) -> Array:
        """(3, …) half-width, height and lean in mm at axial positions z."""
        return np.moveaxis(self.curves(np.asarray(z_mm, dtype=float)), -1, 0)

    def section(self, phi: ArrayLike, z_mm: ArrayLike) -> tuple[Array, Array]:
        """x and y in mm at angle φ (rad) of the section at z (broadcast)."""
        return section.position(phi, self.parameters(z_mm), self.geometry.nail_depth_ratio)

    def tangents(self, phi: ArrayLike, z_mm: ArrayLike) -> tuple[Array, Array]:
        """(…, 3) derivatives of the position with respect to φ (mm/rad) and z (mm/mm)."""
        angle, z = np.broadcast_arrays(np.asarray(phi, float), np.asarray(z_mm, float))
        slopes, ratio = np.moveaxis(self._slopes(z), -1, 0), self.geometry.nail_depth_ratio
        d_phi = section.first_derivative(angle, self.parameters(z), ratio)
        d_z = section.position(angle, slopes, ratio)  # the section is linear in its parameters
        return np.stack([*d_phi, np.zeros(z.shape)], -1), np.stack([*d_z, np.ones(z.shape)], -1)

    def normal(self, phi: ArrayLike, z_mm: ArrayLike) -> Array:
        """(…, 3) outward unit normal."""
        d_phi, d_z = self.tangents(phi, z_mm)
        n = np.cross(d_phi, d_z)
        return n / np.linalg.norm(n, axis=-1, keepdims=True)

    def angle_at(self, x_mm: ArrayLike, z_mm: ArrayLike) -> Array:
        """φ (rad) in the pulp half of the section at z whose lateral position is x; x within the half-width."""
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
        """y in mm of the pulp at (x, z); −inf beside the section at z, where there is no skin."""
        there, y = self.section(self.angle_at(x_mm, z_mm), z_mm)
        return np.where(np.abs(there - np.asarray(x_mm)) < _BESIDE_MM, y, -np.inf)

    @cached_property
    def ridge(self) -> CubicSpline:
        """Highest y in mm over all z as a function of x: what a shape prismatic along z can touch first."""
        x_mm, _, y = self._pulp
        return CubicSpline(x_mm, _largest(y), extrapolate=False)

    @cached_property
    def crest(self) -> CubicSpline:
        """Highest y in mm over all x as a function of z: what a shape prismatic along x can touch first."""
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
        there = np.isfinite(y).any(axis=1)  # a finger that lies off the middle does not reach as far on one side
        return x_mm[there], z_mm, y[there]

    @cached_property
    def apex(self) -> Apex:
        """The topmost point of the part that can be touched; radii from the parametrisation at φ = π/2."""
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
        """(n,) distances in mm, within its section, of each point from the skin; of those it was fitted to."""
        x, y, z = (self.points_mm if points is None else points).T
        parameters, ratio = self.parameters(z), self.geometry.nail_depth_ratio
        at_x, at_y = section.position(section.nearest_angle(x, y, parameters, ratio), parameters, ratio)
        return np.hypot(at_x - x, at_y - y)


def _points(geometry: Geometry) -> Array:
    return np.array(geometry.points) if geometry.points else published_points()[1]


def _largest(y: Array) -> Array:
    """(n,) maxima of (n, m) equally spaced samples, refined by a parabola where both neighbours are finite."""
    rows, k = np.arange(len(y)), np.argmax(y, axis=1)
    mid, left, right = y[rows, k], y[rows, np.maximum(k - 1, 0)], y[rows, np.minimum(k + 1, y.shape[1] - 1)]
    inner = (k > 0) & (k < y.shape[1] - 1) & np.isfinite(left) & np.isfinite(right) & (left + right < 2 * mid)
    left, right = np.where(inner, left, mid - 1.0), np.where(inner, right, mid - 1.0)
    return np.asarray(mid + (left - right) ** 2 / (8 * (2 * mid - left - right)))


def _refuse_unusable(surface: FingertipSurface) -> None:
    """Raise SurfaceError where a section does not go once around the bone's axis, seen from it, at any angle."""
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
            "the skin crosses the bone's axis at z = {z_mm:.2f} mm (half-width {half_width_mm:.2f}, height "
            "{height_mm:.2f}, lean {lean_mm:.2f} mm): expected sections around x = y = 0",
            code="crosses_axis",
            z_mm=float(z_mm[k]),
            half_width_mm=float(a[k]),
            height_mm=float(b[k]),
            lean_mm=float(lean[k]),
        )
