"""SED about each of many equal point loads, the power law that it falls off by, and how round it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.point_spread.loaded_finger import Direction, Load, LoadedFinger, energy_density
from sim.coding.point_spread.power_law import FIT_KINDS, PowerLaw, fitted
from sim.coding.point_spread.sites import Published, Site, spread_over_mean
from sim.config.units import GWT_N
from sim.contact.patch import X, Z
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.errors import ModelRangeError

Array = NDArray[np.float64]

SPACING_MM = 0.17
"""Between receptors, across and along the finger; the source's mesh is as fine (Raju 1998, ch. 3)."""

HALF_WIDTH_MM = 1.5
"""Of the neighbourhood of a site, along x and along z: there SED is down to a twentieth. The source does not say."""

SECTORS = 8
"""Of the azimuth about a load; the first is centred on +x, the third on +z."""

_FEWEST = 12  # samples that a law is fitted to


class Sheet(NamedTuple):
    """Receptors under equally spaced places of the pulp's skin; mm."""

    skin_mm: Array  # (n, 3)
    at_mm: Array  # (n, 3)


def receptor_sheet(finger: LoadedFinger, spacing_mm: float = SPACING_MM, depth_mm: float = DEFAULT_DEPTH_MM) -> Sheet:
    """All over the pulp, perpendicularly so far below it; places are counted from x = 0 and the receptor plane."""
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
class Spread:
    """SED at the receptors in the neighbourhood of a load."""

    site: Site
    load_mm: Array  # (3,)
    sheet: Sheet  # (n,) receptors of it
    sed: Array  # (n,) pseudo-units
    young_ratio: Array  # (n,) E / E(epidermis) there

    @property
    def distance_mm(self) -> Array:
        """(n,) from the load to the receptors, in space."""
        return np.asarray(np.linalg.norm(self.sheet.at_mm - self.load_mm, axis=1))

    def by_azimuth(self, law: PowerLaw) -> Array:
        """(SECTORS,) mean SED over the law's, by the direction on the skin; nan where there is no receptor.

        Of the disc that fits into the neighbourhood, so that all sectors are as far away; receptors nearer than half
        their depth have no direction to speak of, and are left out.
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
) -> list[Spread]:
    """Equal forces at sites, one at a time. Raises ModelRangeError beside the pulp, and where too few are near."""
    loads = [Load(site.x_mm, site.z_mm, direction, at_node) for site in sites]
    feet = [finger.foot_mm(load) for load in loads]
    near = [_near(sheet, foot, half_width_mm, site) for foot, site in zip(feet, sites, strict=True)]
    recovery = finger.recovery(sheet.at_mm)
    strain = force_gwt * GWT_N / finger.config.tissue.e_epidermis_mpa * recovery.strain(finger.moved(loads))
    sed = energy_density(strain, recovery.young_ratio, finger.config.tissue.poisson)
    return [
        Spread(
            site, foot, Sheet(sheet.skin_mm[there], sheet.at_mm[there]), values[there], recovery.young_ratio[there]
        )
        for site, foot, there, values in zip(sites, feet, near, sed, strict=True)
    ]


def _near(sheet: Sheet, foot: Array, half_width_mm: float, site: Site) -> NDArray[np.bool_]:
    away = np.abs(sheet.skin_mm - foot)[:, [X, Z]].max(axis=1)
    near = np.asarray(away <= half_width_mm)
    if near.sum() < _FEWEST:
        raise ModelRangeError(
            "site {site}: {receptors} receptors near it, expected {fewest} or more",
            code="too_few_receptors",
            site=site.number,
            receptors=int(near.sum()),
            fewest=_FEWEST,
        )
    return near


class Judged(NamedTuple):
    """A site's spread and what was fitted to it."""

    spread: Spread
    linear: PowerLaw
    logarithmic: PowerLaw

    @property
    def asymmetry(self) -> float:
        """Highest less lowest sector, of the SED over its law."""
        sectors = self.spread.by_azimuth(self.linear)
        return float(np.nanmax(sectors) - np.nanmin(sectors))


def judged(spread: Spread) -> Judged:
    """Both fits."""
    linear, logarithmic = (fitted(spread.distance_mm, spread.sed, kind) for kind in FIT_KINDS)
    return Judged(spread, linear, logarithmic)


class Mean(NamedTuple):
    """Of A and m over sites: means, and standard deviations over them."""

    a: float
    a_spread: float
    m: float
    m_spread: float


def mean_over(laws: Sequence[PowerLaw] | Sequence[Published]) -> Mean:
    """Over all that are given."""
    a, m = np.array([law.a for law in laws]), np.array([law.m for law in laws])
    return Mean(float(a.mean()), spread_over_mean(a), float(m.mean()), spread_over_mean(m))
