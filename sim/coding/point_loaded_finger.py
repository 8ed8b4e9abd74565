"""Whole finger under unit forces on its skin, with a uniform mesh over the pulp."""

from collections.abc import Sequence
from functools import cached_property
from importlib.resources import as_file, files
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.section import skin_frames
from sim.config import FingertipConfig
from sim.contact.patch import X, Y, Z
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface, published_points
from sim.measures.measures import Elastic, strain_energy_density, stress_from_strain
from sim.models.adjoint import Progress
from sim.models.condensed import point_force
from sim.models.factored_interior import Interior, Recovery
from sim.models.sources import HalfWidths, widened
from sim.models.stiffening import refuse_stiffening
from sim.tables import read_columns
from sim.units import PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]

Direction = Literal["normal", "vertical"]
"""Direction of a force: along the skin's inward normal, or along −y."""

_WIDEST_Z_MM = 4.5  # to each side of the receptor plane: largest uniform mesh
_FROM_ENDS_MM = 0.5
_BESIDE_MM = 1e-6
_SIDE_RAD = 0.3  # beyond a section's widest points, near the nail


class PointLoad(NamedTuple):
    """Unit force at a point of the skin."""

    x_mm: float
    z_mm: float
    direction: Direction = "normal"
    at_node: bool = False  # on the nearest node, else shared between the four nodes around the point


class LoadedFinger:
    """Finger's mesh with a factor computed on first use (seconds), and points on and below its skin."""

    def __init__(self, config: FingertipConfig, even: HalfWidths | None = None) -> None:
        """Make the mesh uniform over half-widths about the receptor plane; by default as long as possible.

        Raises ModelRangeError for tissue that stiffens.
        """
        refuse_stiffening(config.tissue, "a finger under point loads")
        self.config = config
        self.surface = FingertipSurface.fit(config.geometry)
        self.interior = Interior(widened(config, even or _all_along(config)), self.surface, (Z,))
        self._recovered: dict[bytes, Recovery] = {}

    @cached_property
    def recovered_z_mm(self) -> tuple[float, float]:
        """Range of z where strain is recovered: not in the last elements at both ends (mm)."""
        z_mm = self.interior.mesh.z_mm
        return float(z_mm[1]), float(z_mm[-2])

    def skin(self, x_mm: Array, z_mm: Array) -> Array:
        """Return (…, 3) points on the pulp's skin at x and z in mm; nan beside it."""
        phi = self.surface.angle_at(x_mm, z_mm)
        there, y = self.surface.section(phi, z_mm)
        inside = (np.abs(there - x_mm) < _BESIDE_MM) & (phi > _SIDE_RAD) & (phi < np.pi - _SIDE_RAD)
        inside &= (z_mm > 0) & (z_mm < self.config.geometry.length_mm)
        return np.where(inside[..., None], np.stack([there, y, z_mm], axis=-1), np.nan)

    def normals(self, skin_mm: Array) -> Array:
        """Return (…, 3) outward unit normals at points on the skin."""
        x, _, z = np.moveaxis(skin_mm, -1, 0)
        return self.surface.normal(self.surface.angle_at(x, z), z)

    def frames(self, skin_mm: Array) -> Array:
        """Return (…, 3, 3) unit vectors at points on the skin: across the finger, outward, along it."""
        x, _, z = np.moveaxis(skin_mm, -1, 0)
        return np.stack(skin_frames(self.surface, x, z), axis=-2)

    def foot_mm(self, load: PointLoad) -> Array:
        """Return the (3,) point of a load. Raises ModelRangeError beside the pulp."""
        foot = self.skin(np.array(load.x_mm), np.array(load.z_mm))
        if np.isnan(foot).any():
            raise ModelRangeError(
                f"a load at x = {load.x_mm:g}, z = {load.z_mm:g} mm: must lie on the pulp", "load_beside_pulp"
            )
        if not load.at_node:
            return foot
        mesh = self.interior.mesh
        skin = mesh.nodes.reshape(*mesh.grid, 3)[:, :, 0].reshape(-1, 3)
        return np.asarray(skin[np.argmin(((skin - foot) ** 2).sum(axis=1))])

    def recovery(self, at_mm: Array, progress: Progress | None = None) -> Recovery:
        """Return the map from nodal displacements to strain at (n, 3) receptors. Raises ReceptorError."""
        name = at_mm.tobytes()
        if name not in self._recovered:
            self._recovered = {name: self.interior.recovery(at_mm, progress)}
        return self._recovered[name]

    def moved(self, loads: Sequence[PointLoad]) -> Array:
        """Return (k, n_nodes, 3) displacements in mm·MPa/N under each load, for E(epidermis) = 1 MPa."""
        return self.interior.moved(np.stack([self._under(load) for load in loads]))

    def _under(self, load: PointLoad) -> Array:
        foot = self.foot_mm(load)
        towards = -self.normals(foot) if load.direction == "normal" else -np.eye(3)[Y]
        return self.on_nodes(foot[None], towards[None])

    def on_nodes(self, skin_mm: Array, force: Array) -> Array:
        """Distribute (k, 3) forces at points of the skin to (n_nodes, 3) forces on the four nodes around each."""
        mesh = self.interior.mesh
        phi = self.surface.angle_at(skin_mm[:, X], skin_mm[:, Z])
        shares = point_force(mesh.z_mm, mesh.phi, np.stack([skin_mm[:, Z], phi], axis=1))
        on_all = np.zeros((*mesh.grid, 3))
        on_all[:, :, 0] = np.tensordot(shares, force, axes=(0, 0))
        return on_all.reshape(-1, 3)


def _all_along(config: FingertipConfig) -> HalfWidths:
    plane, length = config.receptor_plane_mm, config.geometry.length_mm
    most = min(_WIDEST_Z_MM, plane - _FROM_ENDS_MM, length - plane - _FROM_ENDS_MM)
    spacing = config.mesh.axial_spacing_mm or config.mesh.spacing_mm
    return config.mesh.patch_x_mm, float(spacing * np.floor(most / spacing + 1e-9))


def energy_density(strain: Array, young_ratio: Array, poisson: float) -> Array:
    """Return (…, n) SED in pseudo-units of (…, n, 6) strains where E / E(epidermis) is (n,)."""
    return young_ratio * strain_energy_density(
        stress_from_strain(strain, Elastic(PSEUDO_E_EPIDERMIS, poisson)), strain
    )


# --- sites ---
#
# The source loads its finger at 24 sites (Raju 1998, Fig. 6-3, Table 6.1).


class Site(NamedTuple):
    """Site on the pulp's skin."""

    number: int
    x_mm: float
    z_mm: float
    on_pulp: bool  # on the pulp rather than the distal tip


class PublishedPowerLaw(NamedTuple):
    """Row of Table 6.1: SED = A / r^m; the load's size is not printed."""

    number: int
    a: float
    m: float
    r2: float


def published_sites() -> tuple[Site, ...]:
    """Return the sites of Figure 6-3, in its order."""
    numbers, xyz, regions = published_points()
    rows = zip(numbers.tolist(), xyz.tolist(), regions, strict=True)
    return tuple(Site(number, x, z, region == "top") for number, (x, _, z), region in rows)


def published_table() -> tuple[PublishedPowerLaw, ...]:
    """Return the rows of Table 6.1, in its order."""
    with as_file(files("sim") / "data" / "table_6_1.csv") as path:
        rows = read_columns(path, ("site", "a", "m", "r2"))
    return tuple(PublishedPowerLaw(int(number), a, m, r2) for number, a, m, r2 in rows)


def spread_over_mean(values: Array) -> float:
    """Return the standard deviation (n − 1, as in the source) / mean."""
    return float(values.std(ddof=1) / values.mean())
