"""Columns: strain at places inside a model under unit forces on its skin, apart from the skin's own compliance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.measures.receptors import ReceptorSet

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STORED = ("young_ratio", "per_skin_force")
"""Fields of columns that go to disk."""


@dataclass(frozen=True)
class Columns:
    """Strain at receptors, linear in the forces on the skin. E(epidermis) = 1 MPa."""

    receptors: ReceptorSet
    young_ratio: Array  # (n,) E / E(epidermis) there
    per_skin_force: Array  # (6 n, n_z, n_phi, 3) 1/N, forces on all skin nodes

    def per_force(self, nodes: Ints, axes: tuple[int, ...]) -> Array:
        """(6 n, m k) 1/N, forces on k of the skin's nodes along m axes, all along the first, then the next."""
        n, n_z, n_phi, _ = self.per_skin_force.shape
        on_nodes = self.per_skin_force.reshape(n, n_z * n_phi, 3)[:, nodes][:, :, list(axes)]
        return np.ascontiguousarray(on_nodes.swapaxes(1, 2)).reshape(n, len(axes) * len(nodes))

    def as_arrays(self) -> dict[str, NDArray[np.generic]]:
        """What is stored on disk: the receptors are known to whoever asks."""
        return {name: np.ascontiguousarray(getattr(self, name)) for name in STORED}
