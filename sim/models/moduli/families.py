"""Which of many fingers are interpolated: those that differ from others in the moduli of dermis and fat alone."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from sim.config.fingertip_config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.finger.surface import SurfaceError
from sim.measures.reach import ReceptorPlaces
from sim.measures.receptors import ReceptorError
from sim.models.moduli.interpolated import nodes_for
from sim.models.moduli.node_builds import Node
from sim.models.moduli.weights import in_range, node_tissues

PAYS_FROM = 9
"""Fingers of a family for which it is made: 16 builds instead of 9, and none for those that come later."""


class Asked(NamedTuple):
    """A finger with its receptors."""

    config: FingertipConfig
    places: ReceptorPlaces

    @classmethod
    def of(cls, config_json: str, receptor_x_mm: Sequence[float], receptor_depth_mm: float) -> "Asked":
        """As a piece of work names it."""
        config = FingertipConfig.model_validate_json(config_json)
        return cls(config, ReceptorPlaces.of(receptor_x_mm, receptor_depth_mm, None))

    @property
    def family(self) -> "Asked":
        """The same for all that differ in the moduli alone."""
        first = node_tissues(self.config.tissue)[0]
        return self._replace(config=self.config.model_copy(update={"tissue": first}))


def worth_interpolating(fingers: Sequence[Asked]) -> list[bool]:
    """Whether each is to be interpolated: where full builds are kept for its family, or it has enough members."""
    members: dict[Asked, set[tuple[float, float]]] = defaultdict(set)
    for one in fingers:
        if in_range(one.config.tissue):
            members[one.family].add((one.config.tissue.e_dermis, one.config.tissue.e_fat))
    chosen = {family for family, moduli in members.items() if _pays(family, len(moduli))}
    return [in_range(one.config.tissue) and one.family in chosen for one in fingers]


def _pays(family: Asked, members: int) -> bool:
    return members >= PAYS_FROM or (members > 1 and not missing_nodes([family], [ALONG]))


def missing_nodes(fingers: Iterable[Asked], slopes: Iterable[tuple[int, ...]]) -> list[Node]:
    """The full builds that are not on disk, for indentors that slope along some axes."""
    families = dict.fromkeys(one.family for one in fingers)
    every = (node for one in families for axes in slopes for node in _nodes(one, axes))
    return [node for node in every if not node.kept]


def _nodes(family: Asked, slopes: tuple[int, ...]) -> list[Node]:
    """None where there is no such finger: whoever presses it is told why."""
    try:
        return nodes_for(family.config, family.places, slopes)
    except (SurfaceError, ReceptorError):
        return []
