"""Boxes of hexahedra: meshed, held, solved and condensed by the simulator's own parts.

x is lateral, y up with the top at 0, z along. A plane-strain slab is one element of 1 mm thick, whose two faces move
alike and do not move along z, so that forces are per millimetre.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.contact.patch import Patch, X, Y, Z
from sim.fem.dissection import DissectionFactor
from sim.fem.elements import Element, assemble_upper, stiffness, strain_matrix, symmetric

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

SLAB = np.array([0.0, 1.0])
"""z of a plane-strain slab."""


def graded(fine_to: float, spacing: float, end: float, growth: float = 1.15) -> Array:
    """Ascending coordinates from 0: uniform up to `fine_to`, then steps growing by about `growth`, to `end`."""
    n_fine = round(fine_to / spacing)
    fine = spacing * np.arange(n_fine + 1, dtype=np.float64)
    if end <= fine[-1] * (1 + 1e-12):
        return fine
    reach = (end - fine[-1]) / spacing
    n = int(np.ceil(np.log1p(reach * (growth - 1) / growth) / np.log(growth)))
    steps = growth ** np.arange(1, n + 1)
    return np.concatenate([fine, fine[-1] + (end - fine[-1]) * np.cumsum(steps) / steps.sum()])


def tributary(x: Array) -> Array:
    """Length that belongs to each coordinate: half the spacing to either side."""
    half = 0.5 * np.diff(x)
    return np.append(half, 0.0) + np.append(0.0, half)


@dataclass(frozen=True)
class Box:
    """Tensor grid of hexahedra; x numbered slowest, so that nodes of equal x are a slab."""

    x: Array
    y: Array  # ascending, ends at 0
    z: Array

    @cached_property
    def nodes(self) -> Array:
        """(n, 3) mm."""
        return np.stack(np.meshgrid(self.x, self.y, self.z, indexing="ij"), -1).reshape(-1, 3)

    @cached_property
    def number(self) -> Ints:
        """(n_x, n_y, n_z) node numbers."""
        return np.arange(len(self.nodes)).reshape(len(self.x), len(self.y), len(self.z))

    @cached_property
    def hexes(self) -> Ints:
        """(m, 8) corners."""
        n = self.number
        face = [n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:]]
        return np.stack([f[..., :-1] for f in face] + [f[..., 1:] for f in face], -1).reshape(-1, 8)

    @cached_property
    def centroids(self) -> Array:
        """(m, 3) mm."""
        return np.asarray(self.nodes[self.hexes].mean(axis=1))

    @property
    def plane(self) -> bool:
        """Whether this is a plane-strain slab."""
        return len(self.z) == 2


def on_rigid_base(box: Box) -> Bools:
    """(n, 3) held components: the base wholly, each side in its normal direction.

    The sides x = 0 and z = 0 are thereby planes of symmetry, and w of a slab is 0.
    """
    held = np.zeros((*box.number.shape, 3), dtype=bool)
    held[:, 0] = True
    held[[0, -1], ..., 0] = True
    held[:, :, [0, -1], 2] = True
    return held.reshape(-1, 3)


class BoxBody:
    """A held elastic body, ready to be solved or condensed."""

    def __init__(
        self,
        box: Box,
        young: Array,
        poisson: float,
        element: Element = "bbar",
        *,
        nodes: Array | None = None,
        held: Bools | None = None,
    ) -> None:
        """E of each element in MPa; other places for the box's nodes and other supports than a rigid base, if any."""
        self.nodes, self.hexes = box.nodes if nodes is None else nodes, box.hexes
        free = ~(on_rigid_base(box) if held is None else held)
        self.unknown = _numbered(box, free)
        matrices = stiffness(self.nodes, self.hexes, young, poisson, element)
        dof = np.flatnonzero(self.unknown.ravel() >= 0)
        shape = (self.nodes.size, int(self.unknown.max()) + 1)
        self._spread = sp.csr_array((np.ones(len(dof)), (dof, self.unknown.ravel()[dof])), shape=shape)
        self._places = np.empty((shape[1], 3))
        self._places[self.unknown.ravel()[dof]] = box.nodes[dof // 3]
        whole = symmetric(assemble_upper(matrices, self.hexes, len(self.nodes)))
        self.stiffness = sp.csr_array(self._spread.T @ whole @ self._spread)

    def factor(self, kept: Ints) -> DissectionFactor:
        """Factor condensed onto some unknowns."""
        upper = sp.csr_array(sp.triu(self.stiffness, format="csr"))
        return DissectionFactor(upper, kept, self._places)

    def solve(self, loads: Array) -> Array:
        """(k, n, 3) displacements in mm under (k, n, 3) forces in N."""
        u = self.factor(np.array([0])).solve(loads.reshape(len(loads), -1) @ self._spread)
        return np.asarray((self._spread @ u.T).T.reshape(loads.shape))

    def imbalance(self, u: Array, loads: Array) -> float:
        """‖K u − f‖ / ‖f‖ over the free displacements, both (n, 3)."""
        f = loads.ravel() @ self._spread
        ends = self.unknown.ravel()
        q = np.zeros(self.stiffness.shape[0])
        q[ends[ends >= 0]] = u.ravel()[ends >= 0]
        return float(np.linalg.norm(self.stiffness @ q - f) / np.linalg.norm(f))

    def strain(self, u: Array, elements: Ints) -> Array:
        """(k, 6) engineering strain e11 e22 e33 e12 e23 e13 at the centroids of some elements, u (n, 3)."""
        hexes = self.hexes[elements]
        at_centre = strain_matrix(self.nodes[hexes], np.zeros((len(hexes), 3)))
        return np.einsum("nrk,nk->nr", at_centre, u[hexes].reshape(-1, 24))


def _numbered(box: Box, free: Bools) -> Ints:
    """(n, 3) unknown of each displacement, −1 where it is held."""
    own = free.copy()
    if box.plane:
        own[box.number[..., 1].ravel()] = False
    unknown = np.where(own.ravel(), np.cumsum(own) - 1, -1).reshape(-1, 3)
    if box.plane:
        unknown[box.number[..., 1].ravel()] = unknown[box.number[..., 0].ravel()]
    return unknown


def condense(box: Box, body: BoxBody, reach_mm: float) -> Patch:
    """The top of a box as a patch: one row of a slab, or the quarter x, z ≥ 0, up to `reach_mm` from the axis."""
    n_x = int(np.searchsorted(box.x, reach_mm * (1 + 1e-9), side="right"))
    n_z = 1 if box.plane else int(np.searchsorted(box.z, reach_mm * (1 + 1e-9), side="right"))
    across = np.ones(1) if box.plane else tributary(box.z)
    nodes = box.number[:n_x, -1, :n_z].T.ravel()
    area = np.outer(across[:n_z], tributary(box.x)[:n_x]).ravel()
    axes = (X, Y) if box.plane else (X, Z, Y)
    unknown = body.unknown[nodes][:, axes].T.ravel()
    moves = np.flatnonzero(unknown >= 0)
    kept = np.sort(unknown[moves])
    at = np.searchsorted(kept, unknown[moves])
    compliance = np.zeros((len(unknown), len(unknown)))
    compliance[np.ix_(moves, moves)] = body.factor(kept).compliance[np.ix_(at, at)]
    return Patch(box.nodes[nodes], area, (n_z, n_x), axes, compliance=compliance)
