"""A rigid, frictionless indentor on the nodes of a skin, as the energy of a stiff penalty on its clearance."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Indentor
from sim.contact.patch import Y
from studies.finite_strain.solver.clearance import Clearance
from studies.finite_strain.solver.clearance import clearance as from_indentor

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PENALTY_MPA_PER_MM = 1e4
"""Of E(epidermis) = 1 MPa: the highest pressures, near 1 MPa, go 0.1 µm deep."""


@dataclass(frozen=True)
class Skin:
    """Nodes that may be touched: their places (n, 3) mm, unknowns (n, 3), −1 where held, and areas (n,) mm²."""

    position_mm: Array
    unknown: Ints
    area_mm2: Array


@dataclass(frozen=True)
class Rigid:
    """An indentor with its reference point at a place along its axes, its lowest point at a height."""

    indentor: Indentor
    at_mm: tuple[float, ...]
    height_mm: float


class Touching(NamedTuple):
    """What bears: nodes of the skin, the pressure times area on each in N, the normal (n, 3) and h″ (n, m, m)."""

    nodes: Ints
    load_n: Array
    normal: Array
    curvature: Array


def clearance(skin: Skin, rigid: Rigid, a: Array) -> Clearance:
    """Of every node of the skin at the unknowns."""
    moved = skin.position_mm + np.where(skin.unknown >= 0, a[skin.unknown], 0.0)
    offset = moved[:, list(rigid.indentor.axes)].T - np.array(rigid.at_mm)[:, None]
    return from_indentor(rigid.indentor, offset, moved[:, Y] - rigid.height_mm)


def energy(skin: Skin, rigid: Rigid, a: Array) -> float:
    """N·mm of the penalty."""
    inside = np.minimum(clearance(skin, rigid, a).mm, 0.0)
    return 0.5 * PENALTY_MPA_PER_MM * float((skin.area_mm2 * inside**2).sum())


def touching(skin: Skin, rigid: Rigid, a: Array) -> Touching:
    """Nodes inside, and the load of each along minus the clearance's gradient."""
    found = clearance(skin, rigid, a)
    nodes = np.flatnonzero(found.mm < 0)
    load = -PENALTY_MPA_PER_MM * skin.area_mm2[nodes] * found.mm[nodes]
    return Touching(nodes, load, found.gradient[nodes], found.hessian[nodes])
