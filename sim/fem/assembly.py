"""Sparse assembly of element matrices, 3×3 block by 3×3 block."""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def assemble_upper(stiffness: Array, elements: Ints, n_nodes: int) -> sp.csr_array:
    """Upper triangle of the (3 n_nodes, 3 n_nodes) stiffness from (n, 3k, 3k) matrices of (n, k) elements."""
    k = elements.shape[1]
    a, b = np.triu_indices(k)
    rows, cols = elements[:, a], elements[:, b]
    blocks = stiffness.reshape(-1, k, 3, k, 3).swapaxes(2, 3)[:, a, b]
    below = rows > cols
    blocks[below] = blocks[below].swapaxes(-1, -2)
    folded = (rows == cols) & (a != b)  # both triangles of a wedge's coinciding nodes fall on one block
    blocks[folded] += blocks[folded].swapaxes(-1, -2)
    key = np.where(below, cols * n_nodes + rows, rows * n_nodes + cols).ravel()
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.concatenate([[True], np.diff(key[order]) > 0]))
    gather = sp.csr_array(
        (np.ones(len(order)), order, np.append(starts, len(order))), shape=(len(starts), len(order))
    )
    summed = (gather @ blocks.reshape(-1, 9)).reshape(-1, 3, 3)
    unique = key[order][starts]
    indptr = np.searchsorted(unique // n_nodes, np.arange(n_nodes + 1))
    shape = (3 * n_nodes, 3 * n_nodes)
    return sp.triu(sp.bsr_array((summed, unique % n_nodes, indptr), shape=shape), format="csr")


def symmetric(upper: sp.csr_array) -> sp.csr_array:
    """The whole matrix of an upper triangle."""
    return sp.csr_array(upper + sp.triu(upper, k=1).T)
