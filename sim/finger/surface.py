"""The skin: a smooth parametric surface fitted through the published points.

Source of the points: Raju (1998), Figure 6-3, copied into `sim/data/fingertip_surface_points.csv`.
"""

from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline
from scipy.optimize import least_squares

from sim.config import Geometry

Array = NDArray[np.float64]

_KNOTS_MM = (3.0, 5.0, 7.0, 9.0, 11.0)
_ANCHOR_MM = 0.5  # how far the surface may stay off a free anchor for the price of 0.02 mm off a point
_RIDGE_STEP_MM = 0.02


def published_points() -> tuple[NDArray[np.int64], Array, list[str]]:
    """Sites, (24, 3) coordinates in mm and regions of Raju (1998), Figure 6-3."""
    lines = (files("sim") / "data" / "fingertip_surface_points.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines if line and line[0].isdigit()]
    xyz = np.array([[float(v) for v in row[1:4]] for row in rows])
    return np.array([int(row[0]) for row in rows]), xyz, [row[4] for row in rows]


@dataclass(frozen=True)
class FingertipSurface:
    """Sections at constant z, each a second-order Fourier curve in the angle φ, smooth (C²) along z.

    x = a cos φ + s ((1 + sin φ)/2)²,  y = ½(b + n) sin φ + ½(b − n) sin² φ,  n = nail_depth_ratio · b,
    so that φ = π/2 is the pulp's apex at (s, b) and φ = −π/2 the nail at (0, −n). The half-width a, the
    height b and the lean s are cubic B-splines of z.
    """

    geometry: Geometry
    coefficients: Array  # (3, n_basis) mm, rows a, b, s

    @classmethod
    def fit(cls, geometry: Geometry, points: Array | None = None) -> "FingertipSurface":
        """Least-squares fit through (n, 3) points in mm, the published ones by default."""
        xyz = published_points()[1] if points is None else points
        n_basis = len(_KNOTS_MM) + 4
        start = np.concatenate([np.full(2 * n_basis, 4.4), np.zeros(n_basis), np.arctan2(xyz[:, 1], xyz[:, 0])])
        z_mm = np.linspace(0.0, geometry.length_mm, 60)
        bend = np.sqrt(z_mm[1]) * geometry.stiffness_of_fit * _spline(geometry, np.eye(n_basis)).derivative(2)(z_mm)
        ends = np.array([0.0, geometry.length_mm])
        tip = geometry.tip_radius_mm
        targets = np.array(
            [
                [geometry.proximal_half_width_mm, tip],
                [geometry.proximal_apex_mm, tip],
                [geometry.proximal_lean_mm, 0],
            ]
        )

        def residual(v: Array) -> Array:
            surface = cls(geometry, v[: 3 * n_basis].reshape(3, n_basis))
            x, y = surface.section(v[3 * n_basis :], xyz[:, 2])
            anchors = (surface.parameters(ends) - targets) * (0.02 / _ANCHOR_MM)
            bending = bend @ surface.coefficients.T
            return np.concatenate([x - xyz[:, 0], y - xyz[:, 1], anchors.ravel(), bending.ravel()])

        solution = least_squares(residual, start, method="lm")
        return cls(geometry, solution.x[: 3 * n_basis].reshape(3, n_basis))

    @cached_property
    def _splines(self) -> BSpline:
        return _spline(self.geometry, self.coefficients.T)

    def parameters(self, z_mm: ArrayLike) -> Array:
        """(3, …) half-width, height and lean in mm at axial positions z."""
        return np.moveaxis(self._splines(np.asarray(z_mm, dtype=float)), -1, 0)

    def section(self, phi: ArrayLike, z_mm: ArrayLike) -> tuple[Array, Array]:
        """x and y in mm at angle φ (rad) of the section at z (broadcast)."""
        a, b, lean = self.parameters(z_mm)
        s = np.sin(phi)
        n = self.geometry.nail_depth_ratio * b
        return a * np.cos(phi) + lean * (0.5 * (1 + s)) ** 2, 0.5 * (b + n) * s + 0.5 * (b - n) * s * s

    def tangents(self, phi: ArrayLike, z_mm: ArrayLike) -> tuple[Array, Array]:
        """(…, 3) derivatives of the position with respect to φ (mm/rad) and z (mm/mm)."""
        angle, z = np.broadcast_arrays(np.asarray(phi, float), np.asarray(z_mm, float))
        a, b, lean = self.parameters(z)
        da, db, dlean = np.moveaxis(self._splines.derivative()(z), -1, 0)
        s, c, r = np.sin(angle), np.cos(angle), self.geometry.nail_depth_ratio
        height, width = 0.5 * (1 + r) * s + 0.5 * (1 - r) * s * s, (0.5 * (1 + s)) ** 2
        d_phi = np.stack([-a * s + 0.5 * lean * (1 + s) * c, b * c * (0.5 * (1 + r) + (1 - r) * s), 0 * a], -1)
        d_z = np.stack([da * c + dlean * width, db * height, 1 + 0 * a], -1)
        return d_phi, d_z

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
        """y in mm of the pulp at (x, z)."""
        return self.section(self.angle_at(x_mm, z_mm), z_mm)[1]

    @cached_property
    def ridge(self) -> CubicSpline:
        """Highest y in mm over all z as a function of x: what a shape prismatic along z can touch first."""
        x_mm, _, y = self._pulp
        return CubicSpline(x_mm, _summit(y), extrapolate=False)

    @cached_property
    def crest(self) -> CubicSpline:
        """Highest y in mm over all x as a function of z: what a shape prismatic along x can touch first."""
        _, z_mm, y = self._pulp
        return CubicSpline(z_mm, _summit(y.T), extrapolate=False)

    @cached_property
    def _pulp(self) -> tuple[Array, Array, Array]:
        """x and z in mm and the (n_x, n_z) heights of the pulp there, −inf beside it."""
        z_mm = np.linspace(2.0, 11.0, 451)
        half = 0.93 * self.parameters(np.array([7.0]))[0, 0]
        x_mm = np.arange(-half, half, _RIDGE_STEP_MM)
        inside = np.abs(x_mm[:, None]) < 0.95 * self.parameters(z_mm)[0][None]
        y = np.where(inside, self.height(np.where(inside, x_mm[:, None], 0.0), z_mm[None]), -np.inf)
        return x_mm, z_mm, y

    def residuals_mm(self, points: Array | None = None) -> Array:
        """Distance in mm, within its section, of each point from the surface."""
        xyz = published_points()[1] if points is None else points
        phi = np.linspace(0, np.pi, 20001)
        x, y = self.section(phi[None], xyz[:, 2:])
        return np.asarray(np.hypot(x - xyz[:, :1], y - xyz[:, 1:2]).min(axis=1))


def _summit(y: Array) -> Array:
    """(n,) highest value of each row, by a parabola through the highest sample and its neighbours."""
    k = np.clip(np.argmax(y, axis=1), 1, y.shape[1] - 2)
    rows = np.arange(len(y))
    left, mid, right = y[rows, k - 1], y[rows, k], y[rows, k + 1]
    return mid + (left - right) ** 2 / (8 * (2 * mid - left - right))


def _spline(geometry: Geometry, coefficients: Array) -> BSpline:
    knots = np.concatenate([np.zeros(4), _KNOTS_MM, np.full(4, geometry.length_mm)])
    return BSpline(knots, coefficients, 3)
