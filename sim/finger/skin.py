"""Areas of the skin that belong to its nodes."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SLOPES = np.array([[-1.5, 2.0, -0.5], [-0.5, 0.0, 0.5], [0.5, -2.0, 1.5]])  # of a parabola through −1, 0, 1
_SIMPSON = np.array([1.0, 4.0, 1.0]) / 3


def tributary_areas(skin: Array, order: int) -> Array:
    """(n_z, n_phi) areas in mm² of (n_z, n_phi, 3) nodes closed along φ: what a unit pressure puts on each.

    Of order 1 a quarter of each adjacent bilinear quadrilateral; of order 2 by Simpson's rule on faces of nine nodes.
    """
    return _of_quadrilaterals(skin) if order == 1 else _of_nine_nodes(skin)


def _of_quadrilaterals(skin: Array) -> Array:
    turned = np.roll(skin, -1, axis=1)
    d1, d2 = turned[1:] - skin[:-1], turned[:-1] - skin[1:]
    quads = 0.125 * np.linalg.norm(np.cross(d1, d2), axis=-1)
    quads = quads + np.roll(quads, 1, axis=1)
    area = np.zeros(skin.shape[:2])
    area[:-1] += quads
    area[1:] += quads
    return area


def _of_nine_nodes(skin: Array) -> Array:
    n_z, n_phi, _ = skin.shape
    number = np.arange(n_z * n_phi).reshape(n_z, n_phi)
    across, around = np.arange(0, n_z - 1, 2), np.arange(0, n_phi, 2)
    k, j = (across[:, None] + np.arange(3)).ravel(), (around[:, None] + np.arange(3)).ravel() % n_phi
    faces = number[np.ix_(k, j)].reshape(len(across), 3, len(around), 3).swapaxes(1, 2)
    p = skin.reshape(-1, 3)[faces]
    along_z, along_phi = np.einsum("ab,kjbpi->kjapi", _SLOPES, p), np.einsum("ab,kjpbi->kjpai", _SLOPES, p)
    area = np.linalg.norm(np.cross(along_z, along_phi), axis=-1) * _SIMPSON[:, None] * _SIMPSON
    return np.asarray(np.bincount(faces.ravel(), area.ravel()).reshape(n_z, n_phi), float)
