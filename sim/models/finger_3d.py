"""The finger in three dimensions: layered, fixed at nail and bone, condensed onto the patch under the indentor."""

import logging
import time

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.patch import Patch, X, Y
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet, strain_operator
from sim.models.adjoint import adjoint_columns
from sim.models.condensed import Columns, CondensedModel, discretise, factorise, meshed_for, skin_beside, young_ratios

Ints = NDArray[np.int64]

_log = logging.getLogger(__name__)


def build_finger(
    config: FingertipConfig,
    surface: FingertipSurface,
    receptors: ReceptorSet,
    slopes: tuple[int, ...] = (X,),
) -> CondensedModel:
    """Mesh, assemble and condense for indentors that slope along some axes; `timing_s` has the time of each step."""
    clock = _Stopwatch()
    mesh = build_mesh(meshed_for(config, slopes), surface)
    clock.lap("mesh")
    operator, layers = strain_operator(mesh, receptors.position_mm)
    clock.lap("recovery")
    axes = (*slopes, Y)
    problem = discretise(config, mesh, axes)
    clock.lap("assembly")
    factor = factorise(problem)
    clock.lap("condensation")
    compliance = factor.compliance
    clock.lap("inverse")
    strain = adjoint_columns(problem, factor, operator)
    clock.lap("receptors")
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[:, :, 0].ravel()
    order = by_axis(axes, len(mesh.patch_nodes))
    patch = Patch(
        position_mm=mesh.nodes[mesh.patch_nodes],
        area_mm2=mesh.patch_area_mm2,
        compliance=compliance[order].take(order, axis=1),
        shape=mesh.patch_shape,
        axes=axes,
    )
    outside, neighbour = skin_beside(mesh, patch)
    clock.lap("ordering")
    return CondensedModel(
        surface=surface,
        patch=patch,
        receptor_row=mesh.receptor_row,
        nodes=len(mesh.nodes),
        columns=Columns(receptors, young_ratios(config.tissue)[layers], strain),
        skin_z_mm=mesh.z_mm,
        skin_phi=mesh.phi,
        patch_in_skin=np.searchsorted(skin, mesh.patch_nodes),
        outside_mm=outside,
        outside_neighbour=neighbour,
        timing_s=clock.laps,
    )


def by_axis(axes: tuple[int, ...], n: int) -> Ints:
    """Return the indices that reorder unknowns from node by node to axis by axis."""
    rank = np.argsort(np.argsort(axes))
    return (len(axes) * np.arange(n) + rank[:, None]).ravel()


class _Stopwatch:
    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = now - self._last
        _log.debug("building a model: %s done", name)
        self._last = now
