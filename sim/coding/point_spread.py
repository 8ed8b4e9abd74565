"""Spread of SED under equal point loads: power-law decay and isotropy."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator

from sim.coding.point_loaded_finger import (
    Direction,
    LoadedFinger,
    PointLoad,
    PublishedPowerLaw,
    Site,
    energy_density,
    spread_over_mean,
)
from sim.coding.power_law import FIT_KINDS, PowerLaw, fitted
from sim.contact.patch import X, Z
from sim.errors import ModelRangeError
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.factored_interior import Recovery
from sim.units import GWT_N

Array = NDArray[np.float64]

SPACING_MM = 0.17
"""Receptor spacing (mm) across and along the finger, as fine as the source's mesh (Raju 1998, ch. 3)."""

HALF_WIDTH_MM = 1.5
"""Half-width (mm) of the area around a site along x and z, where SED has fallen to a twentieth. The source gives
none."""

SECTORS = 8
"""Sectors of the azimuth about a load; the first is centered on +x, the third on +z."""

_FEWEST = 12  # fewest samples for a fit


class Sheet(NamedTuple):
    """Receptors under equally spaced points of the pulp's skin (mm)."""

    skin_mm: Array  # (n, 3)
    at_mm: Array  # (n, 3)


def receptor_sheet(finger: LoadedFinger, spacing_mm: float = SPACING_MM, depth_mm: float = DEFAULT_DEPTH_MM) -> Sheet:
    """Return receptors at a perpendicular depth all over the pulp, on a grid about x = 0 and the receptor plane."""
    plane, length = finger.config.receptor_plane_mm, finger.config.geometry.length_mm
    reach = int(length / spacing_mm)
    steps = spacing_mm * np.arange(-reach, reach + 1)
    x, z = np.meshgrid(steps, plane + steps)
    skin = finger.skin(x.ravel(), z.ravel())
    skin = skin[np.isfinite(skin[:, X])]
    at = skin - depth_mm * finger.normals(skin)
    low, high = finger.recovered_z_mm
    inside = (at[:, Z] > low) & (at[:, Z] < high)
    return Sheet(skin[inside], at[inside])


@dataclass(frozen=True)
class PointSpread:
    """SED at the receptors around a load."""

    site: Site
    load_mm: Array  # (3,)
    sheet: Sheet  # with (n,) receptors
    sed: Array  # (n,) pseudo-units
    young_ratio: Array  # (n,) E / E(epidermis) at the receptors

    @property
    def distance_mm(self) -> Array:
        """(n,) distances in space from the load to the receptors (mm)."""
        return np.asarray(np.linalg.norm(self.sheet.at_mm - self.load_mm, axis=1))

    def by_azimuth(self, law: PowerLaw) -> Array:
        """Return (SECTORS,) mean SED / the law's, by direction on the skin; nan without receptors.

        Receptors lie in the disc that fits into the area, so that all sectors reach equally far. Those nearer than
        half their depth have no clear direction and are left out.
        """
        x, _, z = (self.sheet.skin_mm - self.load_mm).T
        away = np.hypot(x, z)
        there = (away > 0.5 * self.distance_mm.min()) & (away <= np.abs(x).max())
        sector = np.round(np.arctan2(z, x) * SECTORS / (2 * np.pi)).astype(int) % SECTORS
        over = self.sed / law.at(self.distance_mm)
        count, total = (np.bincount(sector[there], w, SECTORS) for w in (None, over[there]))
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def spreads(
    finger: LoadedFinger,
    sheet: Sheet,
    sites: Sequence[Site],
    force_gwt: float = 1.0,
    half_width_mm: float = HALF_WIDTH_MM,
    direction: Direction = "normal",
    *,
    at_node: bool = False,
) -> list[PointSpread]:
    """Return the spreads under equal forces at sites. Raises ModelRangeError off the pulp or with few receptors."""
    loads = [PointLoad(site.x_mm, site.z_mm, direction, at_node) for site in sites]
    feet = [finger.foot_mm(load) for load in loads]
    near = [_near(sheet, foot, half_width_mm, site) for foot, site in zip(feet, sites, strict=True)]
    recovery = finger.recovery(sheet.at_mm)
    strain = force_gwt * GWT_N / finger.config.tissue.e_epidermis_mpa * recovery.strain(finger.moved(loads))
    sed = energy_density(strain, recovery.young_ratio, finger.config.tissue.poisson)
    return [
        PointSpread(
            site, foot, Sheet(sheet.skin_mm[there], sheet.at_mm[there]), values[there], recovery.young_ratio[there]
        )
        for site, foot, there, values in zip(sites, feet, near, sed, strict=True)
    ]


def _near(sheet: Sheet, foot: Array, half_width_mm: float, site: Site) -> NDArray[np.bool_]:
    away = np.abs(sheet.skin_mm - foot)[:, [X, Z]].max(axis=1)
    near = np.asarray(away <= half_width_mm)
    if near.sum() < _FEWEST:
        raise ModelRangeError(
            f"site {site.number}: {int(near.sum())} receptors near it, at least {_FEWEST} are required; reduce "
            "the spacing or widen the area",
            "too_few_receptors",
        )
    return near


class Judged(NamedTuple):
    """Spread at a site with its fits."""

    spread: PointSpread
    linear: PowerLaw
    logarithmic: PowerLaw

    @property
    def asymmetry(self) -> float:
        """Highest minus lowest sector of SED / its law."""
        sectors = self.spread.by_azimuth(self.linear)
        return float(np.nanmax(sectors) - np.nanmin(sectors))


def judged(spread: PointSpread) -> Judged:
    """Return a spread with both fits."""
    linear, logarithmic = (fitted(spread.distance_mm, spread.sed, kind) for kind in FIT_KINDS)
    return Judged(spread, linear, logarithmic)


class Mean(NamedTuple):
    """Means and standard deviations of A and m over sites."""

    a: float
    a_spread: float
    m: float
    m_spread: float


def mean_over(laws: Sequence[PowerLaw] | Sequence[PublishedPowerLaw]) -> Mean:
    """Return the means over laws."""
    a, m = np.array([law.a for law in laws]), np.array([law.m for law in laws])
    return Mean(float(a.mean()), spread_over_mean(a), float(m.mean()), spread_over_mean(m))


# --- moved response ---
#
# Convolution on the whole finger uses one response for all forces. Offsets along the skin have the length of the
# chord and the direction of its projection onto the tangent plane under the force. Strains are across the finger,
# outward and along it, at each receptor.

_PAIRS = np.array([[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [0, 2]])  # e11 e22 e33 e12 e23 e13
_ENGINEERING = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def in_frames(strain: Array, frames: Array) -> Array:
    """Return (…, n, 6) engineering strains in (n, 3, 3) frames, from Cartesian ones."""
    tensor = np.empty((*strain.shape[:-1], 3, 3))
    for (i, j), one in zip(_PAIRS.tolist(), np.moveaxis(strain / _ENGINEERING, -1, 0), strict=True):
        tensor[..., i, j] = tensor[..., j, i] = one
    turned = np.einsum("nai,...nij,nbj->...nab", frames, tensor, frames)
    return np.asarray(turned[..., _PAIRS[:, 0], _PAIRS[:, 1]] * _ENGINEERING)


@dataclass(frozen=True)
class MovedResponse:
    """Strain in the skin's axes around a unit normal force in the middle of the pad, for use elsewhere."""

    finger: LoadedFinger
    sheet: Sheet
    recovery: Recovery
    strain_at: CloughTocher2DInterpolator  # of (…, 2) offsets across and along in mm; 0 beyond the data

    @classmethod
    def of(cls, finger: LoadedFinger, sheet: Sheet) -> "MovedResponse":
        """Compute the response by one solve. Raises ModelRangeError."""
        middle = PointLoad(0.0, finger.config.receptor_plane_mm)
        recovery = finger.recovery(sheet.at_mm)
        strain = recovery.strain(finger.moved([middle]))[0]
        offset = _offsets(finger, finger.foot_mm(middle)[None], sheet.skin_mm)[0]
        turned = in_frames(strain, finger.frames(sheet.skin_mm))
        return cls(finger, sheet, recovery, CloughTocher2DInterpolator(offset, turned, fill_value=0.0))

    def convolved(self, at_mm: Array, force_n: Array, skin_mm: Array) -> Array:
        """Return (n, 6) strains in the skin's axes below (n, 3) points, under k inward forces with this response."""
        by_force = self.strain_at(_offsets(self.finger, at_mm, skin_mm))
        return np.einsum("k,knc->nc", force_n, by_force)

    def missed(self, spread: PointSpread, force_gwt: float) -> float:
        """Return the relative L2 error of SED about a site: this response against finite elements of that load."""
        force = np.array([force_gwt * GWT_N / self.finger.config.tissue.e_epidermis_mpa])
        strain = self.convolved(spread.load_mm[None], force, spread.sheet.skin_mm)
        sed = energy_density(strain, spread.young_ratio, self.finger.config.tissue.poisson)
        return float(np.linalg.norm(sed - spread.sed) / np.linalg.norm(spread.sed))


def _offsets(finger: LoadedFinger, from_mm: Array, to_mm: Array) -> Array:
    """Return (k, n, 2) offsets from k points of the skin to n others, across and along."""
    chord = to_mm[None] - from_mm[:, None]
    across, _, along = np.moveaxis(finger.frames(from_mm), -2, 0)
    flat = np.stack([np.einsum("knc,kc->kn", chord, axis) for axis in (across, along)], axis=-1)
    length, projected = np.linalg.norm(chord, axis=-1), np.linalg.norm(flat, axis=-1)
    return flat * (length / np.maximum(projected, 1e-12))[..., None]
