"""A fixed piece of dense linear algebra: times of different machines and days are told in units of it.

It is what condensing and pressing a finger consist of, and depends on nothing of this project: a Cholesky
factorisation and the triangular solves with it, by LAPACK on one thread, about 0.3 s on two cores at 2.6 GHz.
"""

import time

import numpy as np
from scipy.linalg import lapack
from threadpoolctl import threadpool_limits

ORDER, RIGHT_SIDES, SEED = 2048, 768, 16
_ROUNDS = 3


def reference_s() -> float:
    """Processor seconds of the reference computation on this machine, the least of a few rounds."""
    rng = np.random.default_rng(SEED)
    rows = rng.standard_normal((ORDER, ORDER))
    matrix = np.asfortranarray(rows @ rows.T + ORDER * np.eye(ORDER))
    right = np.asfortranarray(rng.standard_normal((ORDER, RIGHT_SIDES)))
    times = []
    with threadpool_limits(1):
        for _ in range(_ROUNDS):
            began = time.process_time()
            factor, _info = lapack.dpotrf(matrix, lower=1, clean=0)
            forth, _info = lapack.dtrtrs(factor, right, lower=1)
            back, info = lapack.dtrtrs(factor, forth, lower=1, trans=1)
            times.append(time.process_time() - began)
    off = float(np.abs(matrix @ back - right).max())
    if info or not off < 1e-9:
        raise ArithmeticError(f"the reference computation is off by {off:.1e}")
    return min(times)
