"""The full builds between which fingers of other moduli are interpolated: made once, each a file of its own."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.models.cache import Arrays, cached_arrays, content_key, path_of
from sim.models.condensed import CondensedModel, from_arrays, to_arrays
from sim.models.discretised import young_ratios
from sim.models.inside.columns import Columns
from sim.models.moduli.packed import Singles, packed, summed, unpacked
from sim.models.moduli.weights import node_tissues, node_weights
from sim.models.sources import OnDisk
from sim.models.whole_finger import build_finger

INTERPOLATED = "interpolated finger"
"""The kind of model that answers say they are from."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Node:
    """A finger that is built in full. Compliance and columns have files of their own: a stop loses one build."""

    source: OnDisk
    slopes: tuple[int, ...]

    @cached_property
    def key(self) -> str:
        """Of its compliance."""
        return content_key(["node", self.source.made_of((self.slopes, None))])

    @property
    def kept(self) -> bool:
        """Whether nothing of it has to be made."""
        return all(path.exists() for path in self.files)

    @property
    def files(self) -> tuple[Path, Path]:
        """Where both are kept."""
        return path_of(self.key, "node"), self.source.columns_path((self.slopes, None))

    def compliance(self) -> tuple[Arrays, bool]:
        """Packed, with what no modulus changes; read or built, and whether it was read."""
        return cached_arrays(self.key, self._build, "node")

    def columns(self) -> Columns:
        """Those of the finger's receptors; read or solved for."""
        return self.source.columns((self.slopes, None), self.source.receptors)

    def _build(self) -> Arrays:
        source = self.source
        built = build_finger(source.config, source.surface, source.receptors, self.slopes, source.solver)
        source.columns((self.slopes, None), source.receptors, lambda: built.columns)
        return {**to_arrays(built), "compliance": packed(built.patch.compliance)}


def nodes_of(source: OnDisk, slopes: tuple[int, ...]) -> list[Node]:
    """Those of a source's finger and of all that differ from it in the moduli of dermis and fat."""
    config = source.config
    tissues = node_tissues(config.tissue)
    return [Node(replace(source, config=config.model_copy(update={"tissue": t})), slopes) for t in tissues]


@dataclass(frozen=True)
class NodeBuilds:
    """Compliances and columns of the nodes, in their order, and what all of them share."""

    compliance: Singles  # (16, k) packed
    columns: Singles  # (16, 6 n_receptors, n_z, n_phi, 3)
    layer: NDArray[np.int64]  # (n_receptors,) in which each receptor lies
    shared: Arrays

    @classmethod
    def of(cls, nodes: Sequence[Node]) -> tuple["NodeBuilds", bool]:
        """Read or built, and whether all were read."""
        compliance, columns, shared, read = [], [], Arrays(), True
        for n, node in enumerate(nodes, 1):
            if not node.kept:
                _log.info("full build %d of %d, to interpolate between, made once …", n, len(nodes))
            shared, was_read = node.compliance()
            compliance.append(shared.pop("compliance"))
            columns.append(node.columns())
            read = read and was_read
        stiff = young_ratios(nodes[0].source.config.tissue)
        layer = np.argmin(np.abs(columns[0].young_ratio[:, None] - stiff), axis=1)
        per_force = np.stack([one.per_skin_force for one in columns], dtype=np.float32, casting="same_kind")
        return cls(np.stack(compliance), per_force, layer, shared), read

    def model(self, source: OnDisk) -> CondensedModel:
        """The source's finger."""
        weights = node_weights(source.config.tissue)
        unknowns = len(self.shared["axes"]) * len(self.shared["position_mm"])
        compliance = unpacked(summed(weights, self.compliance), unknowns)
        young = young_ratios(source.config.tissue)[self.layer]
        columns = Columns(source.receptors, young, summed(weights, self.columns).astype(float))
        model = from_arrays({**self.shared, "compliance": compliance}, source.surface, columns)
        return replace(model, kind=INTERPOLATED)
