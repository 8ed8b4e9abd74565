"""All 24 sites of a finger from the cache, or solved for and kept: the mesh and its factor are then not needed."""

from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from sim.coding.point_spread.all_sites import DRAWN, AllSites, Deformed, all_sites, deformed_by
from sim.coding.point_spread.loaded_finger import LoadedFinger
from sim.coding.point_spread.moved_response import MovedResponse
from sim.coding.point_spread.sites import published_sites, published_table
from sim.coding.point_spread.spreads import HALF_WIDTH_MM, SPACING_MM, Sheet, Spread, judged, receptor_sheet
from sim.config.fingertip_config import FingertipConfig
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.cache import Arrays, cached_arrays, content_key, simulator_code
from sim.models.inside.adjoint import Progress

Array = NDArray[np.float64]

_PER_RECEPTOR = ("skin_mm", "at_mm", "sed", "young_ratio")


class Sampled(NamedTuple):
    """What the source leaves open, and the size of the loads."""

    spacing_mm: float = SPACING_MM
    half_width_mm: float = HALF_WIDTH_MM
    depth_mm: float = DEFAULT_DEPTH_MM
    force_gwt: float = 1.0


class Kept(NamedTuple):
    """The sites, and the mesh under the load of the one that is drawn."""

    sites: AllSites
    deformed: Deformed


def kept_sites(config: FingertipConfig, sampled: Sampled, progress: Progress | None = None) -> Kept:
    """Read, or solved for in some twenty seconds; `progress(done, of)` then counts receptors.

    The same to the last bit either way. Raises ModelRangeError and ReceptorError.
    """
    described = config.model_dump(mode="json", exclude={"contact"})
    key = content_key(["sites", simulator_code(), described, *sampled])
    arrays, _ = cached_arrays(key, lambda: _arrays(_solved(config, sampled, progress)), "sites")
    return _read(cast(dict[str, Array], arrays))


def _solved(config: FingertipConfig, sampled: Sampled, progress: Progress | None) -> Kept:
    finger = LoadedFinger(config)
    sheet = receptor_sheet(finger, sampled.spacing_mm, sampled.depth_mm)
    finger.recovery(sheet.at_mm, progress)
    found = all_sites(MovedResponse.of(finger, sheet), sampled.force_gwt, sampled.half_width_mm)
    return Kept(found, deformed_by(finger, found.sites[DRAWN], sampled.force_gwt))


def _arrays(kept: Kept) -> Arrays:
    spreads = [site.spread for site in kept.sites.sites]
    each = [(*spread.sheet, spread.sed, spread.young_ratio) for spread in spreads]
    return {
        **dict(zip(_PER_RECEPTOR, map(np.concatenate, zip(*each, strict=True)), strict=True)),
        **{f"plane {name}": value for name, value in kept.deformed._asdict().items()},
        "load_mm": np.stack([spread.load_mm for spread in spreads]),
        "receptors": np.array([len(spread.sed) for spread in spreads]),
        "missed": np.array(kept.sites.missed),
    }


def _read(arrays: dict[str, Array]) -> Kept:
    """The fits are made again: that is quick."""
    cuts = np.cumsum(arrays["receptors"])[:-1].astype(np.int64)
    each = zip(*(np.split(arrays[name], cuts) for name in _PER_RECEPTOR), strict=True)
    spreads = [
        Spread(site, load, Sheet(skin, at), sed, young)
        for site, load, (skin, at, sed, young) in zip(published_sites(), arrays["load_mm"], each, strict=True)
    ]
    found = AllSites([judged(spread) for spread in spreads], arrays["missed"].tolist(), published_table())
    return Kept(found, Deformed(**{name: arrays[f"plane {name}"] for name in Deformed._fields}))
