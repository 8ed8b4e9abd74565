"""From a configuration to the stiffness matrix of its mesh, and that condensed onto the skin that may be touched."""

import logging
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig, Tissue
from sim.contact.patch import X, Y
from sim.fem import pardiso
from sim.fem.assembly import assemble_upper
from sim.fem.dissection import DissectionFactor
from sim.fem.elements import stiffness
from sim.fem.pardiso import PardisoFactor
from sim.finger.mesh import FingerMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Factor = PardisoFactor | DissectionFactor

LONG = 50_000
"""Unknowns from which on condensing them takes seconds; the default finger has twice as many."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FiniteElements:
    """The uncondensed problem: mesh, upper triangle of the free stiffness, and its unknowns."""

    mesh: FingerMesh
    upper: sp.csr_array  # (n_free, n_free) N/mm per MPa of E(epidermis)
    free: Ints  # (n_free,) degree of freedom 3·node + component
    kept: Ints  # ascending positions in `free` of the patch's displacements along its axes

    @property
    def places(self) -> Ints:
        """(n_free, 3) where each unknown is on the grid of nodes."""
        return np.column_stack(np.unravel_index(self.free // 3, self.mesh.grid))


def young_ratios(tissue: Tissue) -> Array:
    """E / E(epidermis) of epidermis, dermis, fat and bone."""
    return np.array([1.0, tissue.e_dermis, tissue.e_fat, tissue.e_bone])


def meshed_for(config: FingertipConfig, slopes: tuple[int, ...]) -> FingertipConfig:
    """The mesh for indentors that slope along some axes: longer elements are for shapes prismatic along the finger.

    Under round shapes and the line the spacing is even, unless given; round shapes have a patch of their own.
    """
    if slopes == (X,):
        return config
    mesh = config.mesh
    other: dict[str, float] = {}
    if mesh.axial_spacing_mm is None:
        other["axial_spacing_mm"] = mesh.spacing_mm
    if len(slopes) > 1 and mesh.round_patch_mm:  # 0: widened for a scene, `sim/models/patches.py`
        other |= {"patch_x_mm": mesh.round_patch_mm, "patch_z_mm": mesh.round_patch_mm}
    return config.model_copy(update={"mesh": mesh.model_copy(update=other)})


def assembled(config: FingertipConfig, mesh: FingerMesh) -> sp.csr_array:
    """(3 n_nodes, 3 n_nodes) upper triangle of the stiffness for E(epidermis) = 1 MPa."""
    young = young_ratios(config.tissue)[mesh.layer]
    matrices = stiffness(mesh.nodes, mesh.hexes, young, config.tissue.poisson, config.mesh.element)
    return assemble_upper(matrices, mesh.hexes, len(mesh.nodes))


def discretise(config: FingertipConfig, mesh: FingerMesh, axes: tuple[int, ...] = (X, Y)) -> FiniteElements:
    """Assemble the stiffness of the free degrees of freedom for E(epidermis) = 1 MPa, to keep the patch's `axes`."""
    upper = assembled(config, mesh)
    free = np.flatnonzero(np.repeat(~mesh.fixed, 3))
    patch = np.sort((3 * mesh.patch_nodes + np.array(axes)[:, None]).ravel())
    return FiniteElements(mesh, upper[free][:, free], free, np.searchsorted(free, patch))


def factorise(problem: FiniteElements, solver: str = "auto") -> Factor:
    """Condense onto the patch: by MKL PARDISO where it is installed ("pardiso"), else by LAPACK ("dissection")."""
    return condense(problem.upper, problem.kept, problem.places, solver)


def condense(upper: sp.csr_array, kept: Ints, places: Ints, solver: str = "auto") -> Factor:
    """The same for any symmetric matrix whose unknowns have places (n, d); it says so where that takes long."""
    unknowns = upper.shape[0]
    level = logging.INFO if unknowns >= LONG else logging.DEBUG
    _log.log(level, "building a model: a stiffness of %d unknowns is factorised …", unknowns)
    if solver == "pardiso" or (solver == "auto" and pardiso.available()):
        return PardisoFactor(upper, kept)
    return DissectionFactor(upper, kept, places)
