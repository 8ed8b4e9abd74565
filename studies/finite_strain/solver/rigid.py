"""A rigid, frictionless indentor on the nodes of a skin, as the energy of a stiff penalty on the vertical gap."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Indentor
from sim.contact.patch import Y

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


def gap(skin: Skin, rigid: Rigid, a: Array) -> tuple[Array, Array, Array]:
    """(n,) vertical gaps in mm, negative inside, slopes (m, n) and curvatures (m, m, n)."""
    moved = skin.position_mm + np.where(skin.unknown >= 0, a[skin.unknown], 0.0)
    axes = list(rigid.indentor.axes)
    found = rigid.indentor.evaluate(moved[:, axes].T - np.array(rigid.at_mm)[:, None])
    return rigid.height_mm + found.height_mm - moved[:, Y], found.slope, found.curvature


def energy(skin: Skin, rigid: Rigid, a: Array) -> float:
    """N·mm of the penalty."""
    inside = np.minimum(gap(skin, rigid, a)[0], 0.0)
    return 0.5 * PENALTY_MPA_PER_MM * float((skin.area_mm2 * inside**2).sum())


def touching(skin: Skin, rigid: Rigid, a: Array) -> Touching:
    """Nodes inside, the load of each along −(slope, −1): its push on the node is (h′, −1) times that."""
    height, slope, curvature = gap(skin, rigid, a)
    nodes = np.flatnonzero(height < 0)
    normal = np.zeros((len(nodes), 3))
    normal[:, list(rigid.indentor.axes)] = slope[:, nodes].T
    normal[:, Y] = -1.0
    bent = np.zeros((len(nodes), 3, 3))
    for i, row in enumerate(rigid.indentor.axes):
        for k, column in enumerate(rigid.indentor.axes):
            bent[:, row, column] = curvature[i, k, nodes]
    return Touching(nodes, -PENALTY_MPA_PER_MM * skin.area_mm2[nodes] * height[nodes], normal, bent)
