"""The condensed skin: nodes that an indentor may touch, and their compliance."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Patch:
    """Skin nodes on a (rows along z, columns along φ) grid with their lateral and vertical compliance.

    Forces and pressures are per unit of E(epidermis) = 1 MPa: N and MPa for a finger that stiff.
    """

    position_mm: Array  # (n, 3) undeformed
    area_mm2: Array  # (n,) tributary, undeformed
    compliance: Array  # (2n, 2n) mm/N, all x displacements first, then all y
    shape: tuple[int, int]

    def __len__(self) -> int:
        return len(self.position_mm)

    @property
    def x(self) -> Array:
        """(n,) undeformed lateral positions in mm."""
        return self.position_mm[:, 0]

    @property
    def y(self) -> Array:
        """(n,) undeformed heights in mm."""
        return self.position_mm[:, 1]

    @cached_property
    def rim(self) -> NDArray[np.bool_]:
        """(n,) nodes of the outermost rows and columns."""
        rim = np.ones(self.shape, dtype=bool)
        rim[1:-1, 1:-1] = False
        return rim.ravel()

    def displacement(self, force: Array, nodes: NDArray[np.int64]) -> Array:
        """(2n,) displacements in mm of all nodes under (2, k) forces at k nodes."""
        n = len(self)
        rows = np.concatenate([nodes, nodes + n])
        return np.asarray(force.ravel() @ self.compliance[rows])
