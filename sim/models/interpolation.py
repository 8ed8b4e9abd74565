"""Another finger in a moment: where only the moduli of dermis and fat differ, full builds are interpolated.

Source of the errors: `studies/accuracy/another_finger.py`, 50 fingers that were held out (`docs/performance.md`).
"""

from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from sim.config.fingertip_config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.finger.grading import MeshError
from sim.finger.surface import FingertipSurface
from sim.measures.reach import ReceptorPlaces, receptors_at
from sim.measures.receptors import ReceptorError, ReceptorSet
from sim.models.cache import content_key
from sim.models.condensed import CondensedModel
from sim.models.errors import ModelRangeError
from sim.models.inside.columns import Columns
from sim.models.inside.interior import Interior
from sim.models.moduli.node_builds import Node, NodeBuilds, nodes_of
from sim.models.moduli.weights import DERMIS, FAT, FULL_BUILDS, in_range
from sim.models.sources import MeshKey, OnDisk

FORCE_ERROR, SED_ERROR = 0.005, 0.015
"""None was larger, relative, against full builds of fingers that were held out."""

HOW_MADE = (
    f"interpolated between {FULL_BUILDS} full builds over the moduli of dermis and fat: against full builds at most "
    f"{100 * FORCE_ERROR:g} % off in force and {100 * SED_ERROR:g} % in SED"
)

_SETS_KEPT = 2  # in memory: 0.25 GB each
_kept: OrderedDict[str, NodeBuilds] = OrderedDict()


@dataclass(frozen=True)
class Interpolated:
    """Models by interpolation on the mesh's own patch; larger patches and other points are the finger's own."""

    exact: OnDisk

    def __post_init__(self) -> None:
        tissue = self.exact.config.tissue
        if not in_range(tissue):
            raise ModelRangeError(
                "e_dermis = {e_dermis:g}, e_fat = {e_fat:g}: interpolated for e_dermis from {dermis_low:g} to "
                "{dermis_high:g} and e_fat from {fat_low:g} to {fat_high:g}, expected exact=True",
                code="not_interpolated",
                e_dermis=tissue.e_dermis,
                e_fat=tissue.e_fat,
                dermis_low=DERMIS.low,
                dermis_high=DERMIS.high,
                fat_low=FAT.low,
                fat_high=FAT.high,
            )

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """In a moment, once the nodes were built."""
        slopes, patch = key
        if patch is not None:
            return self.exact.model(key)
        builds, read = node_builds(self.exact, slopes)
        return builds.model(self.exact), read

    def interior(self, key: MeshKey) -> Interior | None:
        """The finger's own."""
        return self.exact.interior(key)

    def columns(self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None = None) -> Columns:
        """The finger's own."""
        return self.exact.columns(key, receptors, solve)


def node_builds(source: OnDisk, slopes: tuple[int, ...]) -> tuple[NodeBuilds, bool]:
    """From the memory, the disk or built, and whether nothing was built."""
    nodes = nodes_of(source, slopes)
    name = content_key([nodes[0].source.made_of((slopes, None)), source.receptors.position_mm.tolist()])
    if name in _kept:
        _kept.move_to_end(name)
        return _kept[name], True
    _kept[name], read = NodeBuilds.of(nodes)
    while len(_kept) > _SETS_KEPT:
        _kept.popitem(last=False)
    return _kept[name], read


def forget_kept() -> None:
    """Free what is in memory; what is on disk stays."""
    _kept.clear()


def nodes_for(config: FingertipConfig, places: ReceptorPlaces, slopes: tuple[int, ...] = ALONG) -> list[Node]:
    """The full builds that a finger and all that differ from it in the moduli alone are interpolated between."""
    surface = FingertipSurface.fit(config.geometry)
    return nodes_of(OnDisk(config, surface, receptors_at(config, surface, places), "auto"), slopes)


def make_node(node: Node) -> None:
    """Have it on disk: work that may be given to another process. What cannot be built says so when it is pressed."""
    with suppress(MeshError, ReceptorError):
        node.compliance()
        node.columns()
