"""What an answer keeps of the model that gave it: nodes, areas and receptors; no matrix."""

import zlib
from dataclasses import dataclass, fields
from functools import cached_property
from pickle import dumps, loads
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.contact.patch import PatchNodes, Z
from sim.measures.measures import MEASURES, measures_in_layers
from sim.measures.receptors import ReceptorSet

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ModelOutline:
    """The patch without its compliance, and where the receptors are; one for all answers of a model."""

    patch: PatchNodes
    patch_in_skin: Ints  # (n_patch,) numbers of the patch's nodes among those of the skin
    receptor_row: int
    receptors: ReceptorSet
    receptor_e: Array  # (n_receptors,) E / E(epidermis)
    nodes: int  # of the model's mesh
    kind: str
    poisson: float
    widened_mm: tuple[float, float] | None = None  # half-widths of a patch that was made for a scene

    @cached_property
    def plane(self) -> slice:
        """The patch nodes that lie in the receptor plane."""
        columns = self.patch.shape[1]
        return slice(self.receptor_row * columns, (self.receptor_row + 1) * columns)

    @property
    def plane_mm(self) -> float:
        """z of the receptor plane."""
        return float(self.patch.position_mm[self.plane][0, Z])

    @cached_property
    def across(self) -> Ints:
        """The patch nodes that lie in the receptor plane, by ascending x."""
        nodes = np.arange(len(self.patch))[self.plane]
        return nodes[np.argsort(self.patch.x[nodes])]

    @cached_property
    def along(self) -> slice:
        """The patch nodes along the pad's centre line."""
        return slice(int(np.argmin(np.abs(self.patch.x[self.plane]))), None, self.patch.shape[1])

    def measures(self, strain: Array) -> dict[str, Array]:
        """The 18 measures (n_receptors,) of (n_receptors, 6) strains; stresses in pseudo-units."""
        return measures_in_layers(strain, self.receptor_e, self.poisson)

    def receptors_as_json(self, measures: dict[str, Array]) -> dict[str, list[float]]:
        """What `rig indent --json` prints under `receptors`."""
        x_mm, _, z_mm = self.receptors.position_mm.T
        places = {"x_mm": x_mm, "depth_mm": self.receptors.depths_mm, "z_mm": z_mm}
        return {name: values.tolist() for name, values in {**places, **measures}.items()}

    def receptor_columns(self, measures: dict[str, Array]) -> dict[str, Array]:
        """Columns x_mm, depth_mm and the 18 measures, one row a receptor."""
        x_mm = self.receptors.position_mm[:, 0]
        columns = {"x_mm": x_mm.copy(), "depth_mm": self.receptors.depths_mm.copy()}
        return columns | {name: measures[name] for name in MEASURES}

    @cached_property
    def _packed(self) -> bytes:
        """The fields, deflated: heights along the finger repeat."""
        patch = PatchNodes(self.patch.position_mm, self.patch.area_mm2, self.patch.shape, self.patch.axes)
        kept = {field.name: getattr(self, field.name) for field in fields(self)} | {"patch": patch}
        return zlib.compress(dumps(kept, protocol=5), level=1)

    def __getstate__(self) -> dict[str, bytes]:
        return {"packed": self._packed}

    def __setstate__(self, state: dict[str, bytes]) -> None:
        unpacked: dict[str, Any] = loads(zlib.decompress(state["packed"]))
        self.__dict__.update(unpacked)
