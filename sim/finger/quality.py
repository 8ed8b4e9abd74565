"""How well shaped the elements of a mesh are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

POOR_SCALED_JACOBIAN = 0.1
"""Below this an element is nearly flat at a corner."""

# each corner of a hexahedron in VTK order, and its three neighbours, right-handed
_CORNERS = np.array(
    [
        [0, 1, 3, 4],
        [1, 2, 0, 5],
        [2, 3, 1, 6],
        [3, 0, 2, 7],
        [4, 7, 5, 0],
        [5, 4, 6, 1],
        [6, 5, 7, 2],
        [7, 6, 4, 3],
    ]
)


@dataclass(frozen=True)
class MeshQuality:
    """Two numbers an element, and where the elements are."""

    scaled_jacobian: Array  # (n,) smallest of the corners: 1 a box, 0 flat, negative folded
    aspect_ratio: Array  # (n,) longest edge over shortest edge
    centroid_mm: Array  # (n, 3)


def corner_edges(nodes: Array, hexes: Ints) -> Array:
    """(n, 8, 3, 3) edge vectors in mm from each corner of (n, 8 or 27) hexahedra; rows are edges, right-handed."""
    p = nodes[hexes[:, :8]]
    return np.asarray(p[:, _CORNERS[:, 1:]] - p[:, _CORNERS[:, :1]])


def mesh_quality(nodes: Array, hexes: Ints) -> MeshQuality:
    """Quality of (n, 8) hexahedra in VTK order; of (n, 27) that of their corners.

    Source: Knupp, Ernst, Thompson, Stimpson, Pébay, The Verdict library reference manual, Sandia 2007: hexahedron,
    "scaled Jacobian" (here at the corners only) and "edge ratio".
    """
    edges = corner_edges(nodes, hexes)
    length = np.linalg.norm(edges, axis=-1)
    scaled = np.linalg.det(edges) / length.prod(axis=-1)
    return MeshQuality(
        scaled_jacobian=scaled.min(axis=1),
        aspect_ratio=length.max(axis=(1, 2)) / length.min(axis=(1, 2)),
        centroid_mm=nodes[hexes[:, :8]].mean(axis=1),
    )
