"""All 24 sites of the finger, beside the printed Table 6.1."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.point_spread.loaded_finger import Load, LoadedFinger
from sim.coding.point_spread.moved_response import MovedResponse
from sim.coding.point_spread.power_law import FitKind, PowerLaw
from sim.coding.point_spread.sites import Published, published_sites, published_table
from sim.coding.point_spread.spreads import HALF_WIDTH_MM, Judged, judged, mean_over, spreads
from sim.config.units import GWT_N
from sim.contact.patch import X, Y

Array = NDArray[np.float64]

Where = Literal["pulp", "all"]

DRAWN = 9
"""Index of the site that is drawn: the tenth, in the receptor plane and nearest to the pad's middle."""


class AllSites(NamedTuple):
    """Each site's spread, what shift invariance misses there, and the printed table."""

    sites: list[Judged]
    missed: list[float]  # relative L2 of SED, the response of the pad's middle moved to the site
    printed: tuple[Published, ...]

    @property
    def common_factor(self) -> float:
        """What makes the mean A over the pulp the printed one: the source's loads are not printed."""
        return mean_over(self.published("pulp")).a / mean_over(self.laws("pulp")).a

    def laws(self, where: Where, kind: FitKind = "linear") -> list[PowerLaw]:
        """Of the sites on the pulp, or of all."""
        return [getattr(site, kind) for site in self.sites if where == "all" or site.spread.site.on_pulp]

    def published(self, where: Where) -> list[Published]:
        """The same sites of the printed table."""
        rows = zip(self.sites, self.printed, strict=True)
        return [row for site, row in rows if where == "all" or site.spread.site.on_pulp]


def all_sites(response: MovedResponse, force_gwt: float = 1.0, half_width_mm: float = HALF_WIDTH_MM) -> AllSites:
    """Equal forces at the source's sites, seen at a response's receptors. Raises ModelRangeError."""
    found = spreads(response.finger, response.sheet, published_sites(), force_gwt, half_width_mm)
    missed = [response.missed(spread, force_gwt) for spread in found]
    return AllSites([judged(spread) for spread in found], missed, published_table())


class Deformed(NamedTuple):
    """Nodes of the mesh in the plane of a load, (n_phi, n_r, 2) mm, x and y, and how far they move."""

    at_mm: Array
    moved_mm: Array


def deformed_by(finger: LoadedFinger, site: Judged, force_gwt: float) -> Deformed:
    """The plane of nodes nearest to a site, under its load."""
    mesh, place = finger.interior.mesh, site.spread.site
    per_n = finger.moved([Load(place.x_mm, place.z_mm)]).reshape(*mesh.grid, 3)
    k = int(np.argmin(np.abs(mesh.z_mm - place.z_mm)))
    moved = force_gwt * GWT_N / finger.config.tissue.e_epidermis_mpa * per_n[k][..., [X, Y]]
    return Deformed(mesh.nodes.reshape(*mesh.grid, 3)[k][..., [X, Y]], moved)
