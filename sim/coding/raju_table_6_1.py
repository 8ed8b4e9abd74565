"""Power laws at all 24 sites of the finger, compared with the printed Table 6.1."""

from typing import Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from sim.coding.point_loaded_finger import (
    LoadedFinger,
    PointLoad,
    PublishedPowerLaw,
    published_sites,
    published_table,
)
from sim.coding.point_spread import (
    HALF_WIDTH_MM,
    SPACING_MM,
    Judged,
    MovedResponse,
    PointSpread,
    Sheet,
    judged,
    mean_over,
    receptor_sheet,
    spreads,
)
from sim.coding.power_law import FitKind, PowerLaw
from sim.config import FingertipConfig
from sim.contact.patch import X, Y
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.adjoint import Progress
from sim.models.cache import Arrays, cached_arrays, content_key, simulator_code
from sim.units import GWT_N

Array = NDArray[np.float64]

Where = Literal["pulp", "all"]

DRAWN = 9
"""Index of the plotted site: the tenth, in the receptor plane and nearest to the pad center."""


class AllSites(NamedTuple):
    """Spread at each site, error of shift invariance there, and the printed table."""

    sites: list[Judged]
    missed: list[float]  # relative L2 error of SED by the response of the pad's middle
    printed: tuple[PublishedPowerLaw, ...]

    @property
    def common_factor(self) -> float:
        """Ratio of the printed mean A over the pulp to the fitted one: the source's loads are not printed."""
        return mean_over(self.published("pulp")).a / mean_over(self.laws("pulp")).a

    def laws(self, where: Where, kind: FitKind = "linear") -> list[PowerLaw]:
        """Return the laws of the sites on the pulp, or of all."""
        return [getattr(site, kind) for site in self.sites if where == "all" or site.spread.site.on_pulp]

    def published(self, where: Where) -> list[PublishedPowerLaw]:
        """Return the printed rows of the same sites."""
        rows = zip(self.sites, self.printed, strict=True)
        return [row for site, row in rows if where == "all" or site.spread.site.on_pulp]


def all_sites(response: MovedResponse, force_gwt: float = 1.0, half_width_mm: float = HALF_WIDTH_MM) -> AllSites:
    """Return the spreads at the source's sites under equal forces. Raises ModelRangeError."""
    found = spreads(response.finger, response.sheet, published_sites(), force_gwt, half_width_mm)
    missed = [response.missed(spread, force_gwt) for spread in found]
    return AllSites([judged(spread) for spread in found], missed, published_table())


class Deformed(NamedTuple):
    """Mesh nodes (n_phi, n_r, 2) in the plane of a load, x and y in mm, and their displacements."""

    at_mm: Array
    moved_mm: Array


def deformed_by(finger: LoadedFinger, site: Judged, force_gwt: float) -> Deformed:
    """Return the plane of nodes nearest to a site, under its load."""
    mesh, location = finger.interior.mesh, site.spread.site
    per_n = finger.moved([PointLoad(location.x_mm, location.z_mm)]).reshape(*mesh.grid, 3)
    k = int(np.argmin(np.abs(mesh.z_mm - location.z_mm)))
    moved = force_gwt * GWT_N / finger.config.tissue.e_epidermis_mpa * per_n[k][..., [X, Y]]
    return Deformed(mesh.nodes.reshape(*mesh.grid, 3)[k][..., [X, Y]], moved)


# --- cached sites ---
#
# Results are cached because they need the mesh and its factor.

_PER_RECEPTOR = ("skin_mm", "at_mm", "sed", "young_ratio")


class Sampled(NamedTuple):
    """Parameters that the source leaves open, and the size of the loads."""

    spacing_mm: float = SPACING_MM
    half_width_mm: float = HALF_WIDTH_MM
    depth_mm: float = DEFAULT_DEPTH_MM
    force_gwt: float = 1.0


class CachedSites(NamedTuple):
    """Sites, and the mesh under the load of the plotted one."""

    sites: AllSites
    deformed: Deformed


def cached_sites(config: FingertipConfig, sampled: Sampled, progress: Progress | None = None) -> CachedSites:
    """Read the sites from the cache, or solve in some twenty seconds; `progress(done, of)` then counts receptors.

    Both are equal to the last bit. Raises ModelRangeError and ReceptorError.
    """
    described = config.model_dump(mode="json", exclude={"contact"})
    key = content_key(["sites", simulator_code(), described, *sampled])
    arrays, _ = cached_arrays(key, lambda: _arrays(_solved(config, sampled, progress)), "sites")
    return _read(cast(dict[str, Array], arrays))


def _solved(config: FingertipConfig, sampled: Sampled, progress: Progress | None) -> CachedSites:
    finger = LoadedFinger(config)
    sheet = receptor_sheet(finger, sampled.spacing_mm, sampled.depth_mm)
    finger.recovery(sheet.at_mm, progress)
    found = all_sites(MovedResponse.of(finger, sheet), sampled.force_gwt, sampled.half_width_mm)
    return CachedSites(found, deformed_by(finger, found.sites[DRAWN], sampled.force_gwt))


def _arrays(kept: CachedSites) -> Arrays:
    spreads = [site.spread for site in kept.sites.sites]
    each = [(*spread.sheet, spread.sed, spread.young_ratio) for spread in spreads]
    return {
        **dict(zip(_PER_RECEPTOR, map(np.concatenate, zip(*each, strict=True)), strict=True)),
        **{f"plane {name}": value for name, value in kept.deformed._asdict().items()},
        "load_mm": np.stack([spread.load_mm for spread in spreads]),
        "receptors": np.array([len(spread.sed) for spread in spreads]),
        "missed": np.array(kept.sites.missed),
    }


def _read(arrays: dict[str, Array]) -> CachedSites:
    """Restore the sites; fits are quick to repeat."""
    cuts = np.cumsum(arrays["receptors"])[:-1].astype(np.int64)
    each = zip(*(np.split(arrays[name], cuts) for name in _PER_RECEPTOR), strict=True)
    spreads = [
        PointSpread(site, load, Sheet(skin, at), sed, young)
        for site, load, (skin, at, sed, young) in zip(published_sites(), arrays["load_mm"], each, strict=True)
    ]
    found = AllSites([judged(spread) for spread in spreads], arrays["missed"].tolist(), published_table())
    return CachedSites(found, Deformed(**{name: arrays[f"plane {name}"] for name in Deformed._fields}))
