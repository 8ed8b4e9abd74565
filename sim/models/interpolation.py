"""Interpolation between full builds of fingers that differ only in the moduli of dermis and fat.

Builds are stored in single precision and summed with weights (`interpolation_weights`). Families of fingers for which
that saves time are found here, too.
"""

import logging
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.errors import ModelRangeError
from sim.fem.dissection import mirror_lower
from sim.finger.mesh import MeshError
from sim.finger.surface import FingertipSurface, SurfaceError
from sim.measures.receptors import ReceptorError, ReceptorPlaces, ReceptorSet, receptors_at
from sim.models.cache import Arrays, cached_arrays, content_key, path_of
from sim.models.condensed import Columns, CondensedModel, from_arrays, to_arrays, young_ratios
from sim.models.factored_interior import Interior
from sim.models.finger_3d import build_finger
from sim.models.interpolation_weights import DERMIS, FAT, FULL_BUILDS, in_range, node_tissues, node_weights
from sim.models.sources import MODEL_LAYOUT, MeshKey, OnDisk

# --- packed ---
#
# Builds are stored in single precision: rounding by 6e-8 of an entry is far below the interpolation error. Of a
# symmetric matrix the lower triangle is stored, in blocks of rows; the mirrored sum is symmetric to the last bit.

Array = NDArray[np.float64]
Singles = NDArray[np.float32]

_ROWS = 256
_NODE_LAYOUT = {**MODEL_LAYOUT, "compliance": ("f", "k")}


def packed(symmetric: Array) -> Singles:
    """Return (k,) entries of an (n, n) matrix's lower triangle, each block of rows up to its last diagonal entry."""
    return np.concatenate(
        [symmetric[rows, : rows.stop].ravel() for rows in _blocks(len(symmetric))], dtype=np.float32
    )


def unpacked(entries: Singles, n: int) -> Array:
    """Return the (n, n) matrix of packed entries."""
    matrix = np.empty((n, n))
    start = 0
    for rows in _blocks(n):
        block = matrix[rows, : rows.stop]
        block[:] = entries[start : start + block.size].reshape(block.shape)
        start += block.size
    return mirror_lower(matrix)


def summed(weights: Array, stacked: Singles) -> Singles:
    """Return the sum of (m, …) arrays with (m,) weights."""
    flat = weights.astype(np.float32) @ stacked.reshape(len(weights), -1)
    return np.asarray(flat, dtype=np.float32).reshape(stacked.shape[1:])


def _blocks(n: int) -> Iterator[slice]:
    return (slice(start, min(start + _ROWS, n)) for start in range(0, n, _ROWS))


# --- node builds ---

INTERPOLATED = "interpolated finger"
"""Kind of model in results of interpolated fingers."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Node:
    """Finger that is built in full. Compliance and columns have separate files: an abort loses one build."""

    source: OnDisk
    slopes: tuple[int, ...]

    @cached_property
    def key(self) -> str:
        """Cache key of the compliance."""
        return content_key(["node", self.source.made_of((self.slopes, None))])

    @property
    def kept(self) -> bool:
        """Whether both files exist."""
        return all(path.exists() for path in self.files)

    @property
    def files(self) -> tuple[Path, Path]:
        """Paths of compliance and columns."""
        return path_of(self.key, "node"), self.source.columns_path((self.slopes, None))

    def compliance(self) -> tuple[Arrays, bool]:
        """Read or build the packed compliance and all that no modulus changes; return whether it was read."""
        return cached_arrays(self.key, self._build, "node", _NODE_LAYOUT)

    def columns(self) -> Columns:
        """Read the columns of the finger's receptors, or solve for them."""
        return self.source.columns((self.slopes, None), self.source.receptors)

    def _build(self) -> Arrays:
        source = self.source
        built = build_finger(source.config, source.surface, source.receptors, self.slopes)
        source.columns((self.slopes, None), source.receptors, lambda: built.columns)
        return {**to_arrays(built), "compliance": packed(built.patch.compliance)}


def nodes_of(source: OnDisk, slopes: tuple[int, ...]) -> list[Node]:
    """Return the nodes of all fingers that differ from a source's only in the moduli of dermis and fat."""
    config = source.config
    tissues = node_tissues(config.tissue)
    return [Node(replace(source, config=config.model_copy(update={"tissue": t})), slopes) for t in tissues]


@dataclass(frozen=True)
class NodeBuilds:
    """Compliances and columns of the nodes, in their order, and the arrays that they share."""

    compliance: Singles  # (16, k) packed
    columns: Singles  # (16, 6 n_receptors, n_z, n_phi, 3)
    layer: NDArray[np.int64]  # (n_receptors,) layer of each receptor
    shared: Arrays

    @classmethod
    def of(cls, nodes: Sequence[Node]) -> tuple["NodeBuilds", bool]:
        """Read or build all nodes; return whether all were read."""
        compliance, columns, shared, read = [], [], Arrays(), True
        for n, node in enumerate(nodes, 1):
            if not node.kept:
                pieces = {"done": n - 1, "total": len(nodes)}
                _log.info("full build %d of %d for interpolation, done once …", n, len(nodes), extra=pieces)
            shared, was_read = node.compliance()
            compliance.append(shared.pop("compliance"))
            columns.append(node.columns())
            read = read and was_read
        stiff = young_ratios(nodes[0].source.config.tissue)
        layer = np.argmin(np.abs(columns[0].young_ratio[:, None] - stiff), axis=1)
        per_force = np.stack([one.per_skin_force for one in columns], dtype=np.float32, casting="same_kind")
        return cls(np.stack(compliance), per_force, layer, shared), read

    def model(self, source: OnDisk) -> CondensedModel:
        """Return the interpolated model of a source's finger."""
        weights = node_weights(source.config.tissue)
        unknowns = len(self.shared["axes"]) * len(self.shared["position_mm"])
        compliance = unpacked(summed(weights, self.compliance), unknowns)
        young = young_ratios(source.config.tissue)[self.layer]
        columns = Columns(source.receptors, young, summed(weights, self.columns).astype(float))
        model = from_arrays({**self.shared, "compliance": compliance}, source.surface, columns)
        return replace(model, kind=INTERPOLATED)


# --- interpolated ---
#
# Source of the errors: 50 held-out fingers (`docs/validation/performance.md`).

FORCE_ERROR, SED_ERROR = 0.005, 0.015
"""Largest relative errors against full builds of held-out fingers."""

HOW_MADE = (
    f"interpolated between {FULL_BUILDS} full builds over the moduli of dermis and fat; the error against "
    f"full builds is at most {100 * FORCE_ERROR:g} % of force and {100 * SED_ERROR:g} % of SED"
)

_SETS_KEPT = 2  # in memory: 0.25 GB each
_kept: OrderedDict[str, NodeBuilds] = OrderedDict()


@dataclass(frozen=True)
class Interpolated:
    """Source of models by interpolation on the mesh's own patch; larger patches and points use full builds."""

    exact: OnDisk

    def __post_init__(self) -> None:
        tissue = self.exact.config.tissue
        if not in_range(tissue):
            raise ModelRangeError(
                f"e_dermis = {tissue.e_dermis:g}, e_fat = {tissue.e_fat:g}: interpolation covers e_dermis from "
                f"{DERMIS.low:g} to {DERMIS.high:g} and e_fat from {FAT.low:g} to {FAT.high:g}; use exact=True",
                "not_interpolated",
            )

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """Interpolate a model; milliseconds once the nodes are built."""
        slopes, patch = key
        if patch is not None:
            return self.exact.model(key)
        builds, read = node_builds(self.exact, slopes)
        return builds.model(self.exact), read

    def interior(self, key: MeshKey) -> Interior | None:
        """Return the interior of the full build."""
        return self.exact.interior(key)

    def columns(self, key: MeshKey, receptors: ReceptorSet, solve: Callable[[], Columns] | None = None) -> Columns:
        """Return columns of the full build."""
        return self.exact.columns(key, receptors, solve)


def node_builds(source: OnDisk, slopes: tuple[int, ...]) -> tuple[NodeBuilds, bool]:
    """Return the builds of a source's nodes, from memory, from disk or built, and whether nothing was built."""
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
    """Free the builds in memory; those on disk stay."""
    _kept.clear()


def nodes_for(config: FingertipConfig, locations: ReceptorPlaces, slopes: tuple[int, ...] = ALONG) -> list[Node]:
    """Return the full builds between which a finger and its family are interpolated."""
    surface = FingertipSurface.fit(config.geometry)
    return nodes_of(OnDisk(config, surface, receptors_at(config, surface, locations)), slopes)


def make_node(node: Node) -> None:
    """Put a node on disk; suits worker processes. A finger that cannot be built reports its error when pressed."""
    with suppress(MeshError, ReceptorError):
        node.compliance()
        node.columns()


# --- families ---
#
# A family is all fingers that differ only in the moduli of dermis and fat.

PAYS_FROM = 9
"""Number of fingers of one family in one request from which they are interpolated.

The number of requested fingers decides, not the cache: one request has one answer. A later request of the family
finds its 16 builds on disk."""


class FingerWithReceptors(NamedTuple):
    """Finger with its receptor locations."""

    config: FingertipConfig
    places: ReceptorPlaces

    @classmethod
    def of(cls, config_json: str, receptor_x_mm: Sequence[float], receptor_depth_mm: float) -> "FingerWithReceptors":
        """Parse the fields of a work item."""
        config = FingertipConfig.model_validate_json(config_json)
        return cls(config, ReceptorPlaces.of(receptor_x_mm, receptor_depth_mm, None))

    @property
    def family(self) -> "FingerWithReceptors":
        """Representative of the fingers that differ only in the moduli."""
        first = node_tissues(self.config.tissue)[0]
        return self._replace(config=self.config.model_copy(update={"tissue": first}))


def worth_interpolating(fingers: Sequence[FingerWithReceptors]) -> list[bool]:
    """Return whether to interpolate each finger: if its family has enough members, whatever the cache holds."""
    members: dict[FingerWithReceptors, set[tuple[float, float]]] = defaultdict(set)
    for one in fingers:
        if in_range(one.config.tissue):
            members[one.family].add((one.config.tissue.e_dermis, one.config.tissue.e_fat))
    chosen = {family for family, moduli in members.items() if len(moduli) >= PAYS_FROM}
    return [in_range(one.config.tissue) and one.family in chosen for one in fingers]


def missing_nodes(fingers: Iterable[FingerWithReceptors], slopes: Iterable[tuple[int, ...]]) -> list[Node]:
    """Return the full builds that are not on disk, for indentors that slope along some axes."""
    families = dict.fromkeys(one.family for one in fingers)
    every = (node for one in families for axes in slopes for node in _nodes(one, axes))
    return [node for node in every if not node.kept]


def _nodes(family: FingerWithReceptors, slopes: tuple[int, ...]) -> list[Node]:
    """Return a family's nodes; none where the finger cannot be built, which pressing it reports."""
    try:
        return nodes_for(family.config, family.places, slopes)
    except (SurfaceError, ReceptorError):
        return []
