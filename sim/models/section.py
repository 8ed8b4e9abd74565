"""The finger's section in the receptor plane, in plane strain.

The mesh is a slab 1 mm thick, all of whose faces move alike and not along z. Forces are per millimeter of a finger
that has this section everywhere and is pressed along its whole length.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from sim.config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.contact.patch import Patch, X, Y
from sim.errors import ModelRangeError
from sim.fem.elements import symmetric
from sim.finger.mesh import FingerMesh, section_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet, strain_operator
from sim.models.condensed import Columns, CondensedModel, assembled, condense, skin_beside, young_ratios

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

AXES = (X, Y)


def prismatic(surface: FingertipSurface, plane_mm: float) -> FingertipSurface:
    """Return the skin of a finger with the same section everywhere."""
    knots = np.array([0.0, 0.0, surface.geometry.length_mm, surface.geometry.length_mm])
    return replace(surface, curves=BSpline(knots, np.tile(surface.parameters(plane_mm), (2, 1)), 1))


def build_section(
    config: FingertipConfig, surface: FingertipSurface, receptors: ReceptorSet, slopes: tuple[int, ...] = ALONG
) -> CondensedModel:
    """Condense the section of a prismatic skin onto its patch: one row of nodes.

    Raises ModelRangeError for indentors that slope along the finger.
    """
    if slopes != ALONG:
        raise ModelRangeError(
            "a section requires a shape prismatic along the finger; use --model finger", "not_prismatic"
        )
    mesh = section_mesh(config, surface)
    unknown = _unknowns(mesh)
    dof = np.flatnonzero(unknown.ravel() >= 0)
    shape = (unknown.size, int(unknown.max()) + 1)
    spread = sp.csr_array((np.ones(len(dof)), (dof, unknown.ravel()[dof])), shape=shape)
    upper = sp.csr_array(sp.triu(spread.T @ symmetric(assembled(config, mesh)) @ spread, format="csr"))
    pressed = unknown[mesh.patch_nodes][:, AXES].T.ravel()
    kept = np.sort(pressed)
    order = np.searchsorted(kept, pressed)
    operator, layers = strain_operator(mesh, receptors.position_mm)
    places = np.empty((upper.shape[0], 2), np.int64)  # around the section and along the radius
    places[unknown.ravel()[dof]] = np.column_stack(np.unravel_index(dof // 3, mesh.grid)[1:])
    factor = condense(upper, kept, places)
    compliance = factor.compliance[order].take(order, axis=1)
    loads = (operator @ spread).toarray()
    strain = (factor.solve(loads) if len(loads) else loads) @ spread.T
    patch = Patch(mesh.nodes[mesh.patch_nodes], mesh.patch_area_mm2, mesh.patch_shape, AXES, compliance=compliance)
    outside, neighbour = skin_beside(mesh, patch, slice(0, 1))
    skin = np.arange(mesh.grid[1]) * mesh.grid[2]
    return CondensedModel(
        surface=surface,
        patch=patch,
        receptor_row=mesh.receptor_row,
        nodes=mesh.grid[1] * mesh.grid[2],
        columns=Columns(
            receptors,
            young_ratios(config.tissue)[layers],
            strain.reshape(-1, len(mesh.nodes), 3)[:, skin].reshape(-1, 1, len(skin), 3),
        ),
        skin_z_mm=np.array([config.receptor_plane_mm]),
        skin_phi=mesh.phi,
        patch_in_skin=np.searchsorted(skin, mesh.patch_nodes),
        outside_mm=outside,
        outside_neighbour=neighbour,
        kind="section",
    )


def _unknowns(mesh: FingerMesh) -> Ints:
    """Return (n_nodes, 3) unknown of each displacement, equal on all faces; −1 where fixed, and along z."""
    free = ~mesh.fixed.reshape(mesh.grid)[0].ravel()
    face = np.full((len(free), 3), -1)
    face[free, :2] = np.arange(2 * free.sum()).reshape(-1, 2)
    return np.tile(face, (mesh.grid[0], 1))
