"""The finger's plane-strain section with receptors below its skin: anywhere, or equally spaced."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from sim.config import FingertipConfig
from sim.contact.patch import X, Y
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.measures import Elastic
from sim.measures.receptors import DEFAULT_DEPTH_MM, ReceptorSet, points_below
from sim.models.catalogue import load
from sim.models.condensed import Columns, CondensedModel
from sim.models.fingertip import Fingertip
from sim.models.section import build_section, prismatic
from sim.units import PSEUDO_E_EPIDERMIS

# --- skin line ---
#
# Locations on the skin are measured along it or across the finger, from x = 0.

Array = NDArray[np.float64]

Axes = Literal["skin", "cartesian"]
AXES: tuple[Axes, ...] = get_args(Axes)
"""skin: positions along the skin, strains tangent and normal to it; cartesian, as in the source: by x, along x and
y."""

_SIDE_RAD = 0.3  # beyond the section's widest points, near the nail
_TABLE = np.linspace(np.pi - _SIDE_RAD, _SIDE_RAD, 2001)


@dataclass(frozen=True)
class SkinLine:
    """Pulp's skin in a plane across the finger."""

    surface: FingertipSurface
    plane_mm: float
    axes: Axes

    @cached_property
    def _angle(self) -> CubicSpline:
        """Angle of the section (rad) as a function of the location (mm)."""
        return CubicSpline(self._places_at(_TABLE), _TABLE, extrapolate=False)

    def _places_at(self, angle: Array) -> Array:
        if self.axes == "cartesian":
            return np.asarray(self.surface.section(angle, self.plane_mm)[0])
        speed = np.linalg.norm(self.surface.tangents(angle, self.plane_mm)[0], axis=-1)
        length = cumulative_simpson(speed, x=-angle, initial=0)
        middle = float(self.surface.angle_at(0.0, self.plane_mm))
        return np.asarray(length - CubicSpline(-angle, length)(-middle))

    @property
    def reach_mm(self) -> tuple[float, float]:
        """First and last location (mm)."""
        return float(self._angle.x[0]), float(self._angle.x[-1])

    def angles(self, place_mm: ArrayLike) -> Array:
        """Return (n,) angles of the section in rad at locations in mm. Raises ModelRangeError beside the pulp."""
        location, (low, high) = np.atleast_1d(place_mm), self.reach_mm
        beside = location[~((location >= low) & (location <= high))]
        if len(beside):
            raise ModelRangeError(
                f"place {float(beside[0]):g} mm: must be {low:.2f} to {high:.2f} mm on the skin of the pulp",
                "place_beside_pulp",
            )
        return np.asarray(self._angle(location))

    def places(self, x_mm: ArrayLike) -> Array:
        """Return (n,) locations in mm of skin at x."""
        x = np.atleast_1d(x_mm)
        if self.axes == "cartesian":
            return x.astype(float)
        angle = self.surface.angle_at(x, self.plane_mm)
        return np.asarray(CubicSpline(-_TABLE, self._angle.x)(-angle))

    def normals(self, angle: Array) -> Array:
        """Return (n, 2) outward unit normals, x and y."""
        along_x, along_y, _ = np.moveaxis(self.surface.tangents(angle, self.plane_mm)[0], -1, 0)
        return np.stack([along_y, -along_x], axis=-1) / np.hypot(along_x, along_y)[..., None]

    def below(self, angle: Array, depth_mm: float | Array) -> Array:
        """Return (n, 2) points at a depth below the skin, along its normal (mm)."""
        return np.stack(self.surface.section(angle, self.plane_mm), axis=-1) - depth_mm * self.normals(angle)

    def above(self, x_mm: float, depth_mm: float) -> float:
        """Return the location on the skin above a point at a depth (mm). Raises ModelRangeError beside the pulp."""
        reach = np.linspace(*self.reach_mm, len(_TABLE))
        x = self.below(self.angles(reach), depth_mm)[:, X]
        if not x[0] <= x_mm <= x[-1]:
            raise ModelRangeError(
                f"x {float(x_mm):g} mm: must be {float(x[0]):.2f} to {float(x[-1]):.2f} mm, below the skin of the "
                "pulp",
                "x_beside_pulp",
            )
        return float(np.interp(x_mm, x, reach))

    def in_axes(self, strain: Array, angle: Array) -> Array:
        """Return (3, n, …) strains e11 e22 e12 in these axes, from (n, 6, …) Cartesian ones at skin angles."""
        e11, e22, e12 = (strain[:, k] for k in (0, 1, 3))
        if self.axes == "cartesian":
            return np.stack([e11, e22, e12])
        normal = self.normals(angle).reshape(len(angle), 2, *[1] * (strain.ndim - 2))
        s, c = -normal[:, X], normal[:, Y]  # the tangent, rising with x, is (c, s)
        return np.stack(
            [
                c * c * e11 + s * s * e22 + s * c * e12,
                s * s * e11 + c * c * e22 - s * c * e12,
                2 * s * c * (e22 - e11) + (c * c - s * s) * e12,
            ]
        )


def skin_frames(surface: FingertipSurface, x_mm: Array, z_mm: Array) -> tuple[Array, Array, Array]:
    """Return (…, 3) unit vectors at points of the pulp's skin: across the finger, outward, along it."""
    phi = surface.angle_at(x_mm, z_mm)
    across = -surface.tangents(phi, z_mm)[0]  # φ falls with x
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    outward = surface.normal(phi, z_mm)
    return across, outward, np.cross(across, outward)


SPACING_MM = 0.17
"""Sample spacing in mm (Raju 1998, §6.5)."""

HALF_LENGTH = 24
"""Number of samples on each side of the middle; the source gives no number."""


@dataclass(frozen=True)
class Sampling:
    """Receptors at one depth under 2 half_length + 1 equally spaced locations of the skin (mm)."""

    spacing_mm: float = SPACING_MM
    half_length: int = HALF_LENGTH
    axes: Axes = "skin"
    depth_mm: float = DEFAULT_DEPTH_MM

    @property
    def place_mm(self) -> Array:
        """(2 half_length + 1,) locations on the skin, ascending, 0 in the middle (mm)."""
        return np.asarray(self.spacing_mm * np.arange(-self.half_length, self.half_length + 1))


@dataclass(frozen=True)
class ReceptorSection:
    """Strain at receptors under any force on the section's skin, per mm of its length."""

    line: SkinLine
    model: CondensedModel  # nodes of the skin, and their compliance
    place_mm: Array  # (n,) locations on the skin above the receptors
    material: Elastic  # at the receptors; E in pseudo-units
    strain_per_node: Array  # (3, n, n_phi, 2) e11 e22 e12 in the line's axes, per pseudo-unit · mm along x and y

    def under_loads(self, place_mm: ArrayLike) -> Array:
        """Return (3, n, k, 2) strains under 1 pseudo-unit of pressure on 1 mm of skin at each of k locations.

        The force acts along the skin's inward normal, or along its tangent that rises with x; the two skin nodes
        beside the location share it. Raises ModelRangeError beside the pulp.
        """
        angle, grid = self.line.angles(place_mm), self.model.skin_phi
        after = np.searchsorted(grid, angle)
        share = (angle - grid[after - 1]) / (grid[after] - grid[after - 1])
        by_place = np.stack([self.strain_per_node[:, :, after - 1], self.strain_per_node[:, :, after]], axis=-1)
        normal = self.line.normals(angle)
        tangent = np.stack([normal[:, Y], -normal[:, X]], axis=-1)
        return np.einsum("cnkis,sk,dki->cnkd", by_place, [1 - share, share], np.stack([-normal, tangent]))


def skin_of(config: FingertipConfig, axes: Axes = "skin") -> SkinLine:
    """Return the skin of the section in the receptor plane."""
    plane = config.receptor_plane_mm
    return SkinLine(prismatic(FingertipSurface.fit(config.geometry), plane), plane, axes)


def receptor_points(config: FingertipConfig, line: SkinLine, place_mm: ArrayLike, depth_mm: ArrayLike) -> Array:
    """Return (n, 3) points at depths below locations of the skin. Raises ModelRangeError or ReceptorError."""
    location, depth = np.broadcast_arrays(np.atleast_1d(place_mm).astype(float), depth_mm)
    angle = line.angles(location)
    x_mm = line.below(angle, depth[:, None])[:, X]
    return points_below(config, line.surface, x_mm, depth, line.plane_mm)


def receptor_section(config: FingertipConfig, place_mm: Array, depth_mm: Array) -> ReceptorSection:
    """Build a section with receptors (about a second). Raises ModelRangeError or ReceptorError beside the tissue."""
    line = skin_of(config)
    receptors = ReceptorSet(receptor_points(config, line, place_mm, depth_mm), depth_mm)
    model = build_section(config, line.surface, receptors)
    material = _material_about(config, model.columns, f"{depth_mm.min():g} … {depth_mm.max():g}")
    strain = _strain_per_node(line, model.columns, line.angles(place_mm))
    return ReceptorSection(line, model, place_mm, material, strain)


@dataclass(frozen=True)
class SampledSection(ReceptorSection):
    """Section that indentors can press, with equally spaced receptors."""

    finger: Fingertip
    sampling: Sampling


@lru_cache(maxsize=8)  # a section takes a second to build, and commands and scripts ask for it again
def sampled_section(config: FingertipConfig, sampling: Sampling) -> SampledSection:
    """Build a sampled section (about a second). Raises ModelRangeError or ReceptorError beside the tissue."""
    line = skin_of(config, sampling.axes)
    angle = line.angles(sampling.place_mm)
    x_mm = line.below(angle, sampling.depth_mm)[:, 0].tolist()
    finger = load("section", config, receptor_x_mm=x_mm, receptor_depth_mm=sampling.depth_mm)
    columns = finger.model.columns
    material = _material_about(config, columns, f"{sampling.depth_mm:g}")
    strain = _strain_per_node(line, columns, angle)
    return SampledSection(line, finger.model, sampling.place_mm, material, strain, finger, sampling)


def _material_about(config: FingertipConfig, columns: Columns, deep: str) -> Elastic:
    """Return the material of the single layer around all receptors. Raises ModelRangeError if there are several."""
    ratio = columns.young_ratio
    if (ratio != ratio[0]).any():
        raise ModelRangeError(
            f"receptors {deep} mm deep lie in several layers; all must lie in one", "several_layers"
        )
    return Elastic(PSEUDO_E_EPIDERMIS * float(ratio[0]), config.tissue.poisson)


def _strain_per_node(line: SkinLine, columns: Columns, angle: Array) -> Array:
    """Return (3, n, n_phi, 2) strains in the line's axes at (n,) skin angles, per pseudo-unit · mm on a node."""
    strain = columns.per_skin_force[:, 0, :, :2]
    return line.in_axes(strain.reshape(len(angle), 6, *strain.shape[1:]) / PSEUDO_E_EPIDERMIS, angle)


# --- energy ---
#
# Strain energy density is a sum of squares of linear functions of six strains, or of three in plane strain.

Energy = Literal["incompressible", "finite"]
ENERGIES: tuple[Energy, ...] = get_args(Energy)
"""incompressible: G (e11² + e22² + ½ e12²), Raju (1998) Eq. 6.1; finite: adds ½ λ (e11 + e22)² (Hooke's law).

For six strain components the sums run over all normal and all shear strains."""

_WEIGHT = {3: [1.0, 1.0, 0.5], 6: [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]}


def squared_parts(strain: Array, material: Elastic, energy: Energy) -> Array:
    """Return (3 … 7, …) functions whose squares sum to the SED, in the unit of E, of 3 or 6 engineering strains.

    The three are e11 e22 e12, the six e11 e22 e33 e12 e23 e13.
    """
    shear, n = material.young / (2 * (1 + material.poisson)), len(strain)
    parts = np.sqrt(shear) * strain * np.sqrt(_WEIGHT[n]).reshape(n, *[1] * (strain.ndim - 1))
    if energy == "incompressible":
        return parts
    lame = 2 * shear * material.poisson / (1 - 2 * material.poisson)
    return np.concatenate([parts, np.sqrt(lame / 2) * strain[: 2 if n == 3 else 3].sum(axis=0, keepdims=True)])


def sed_of(strain: Array, material: Elastic, energy: Energy) -> Array:
    """Return (…) SED of (3 or 6, …) strains."""
    return (squared_parts(strain, material, energy) ** 2).sum(axis=0)
