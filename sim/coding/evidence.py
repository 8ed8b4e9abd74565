"""Evidence of many contact models, by compiled loops (docs/decisions/0019-compiled-loops.md)."""

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@compiled
def explained(models: Whole, count: Whole, mean: Array, root: Array, precision: Array, towards: Array) -> Array:
    """Return (b,) log evidence of models relative to no pressure.

    `models` (b, c, 3) are first, stop and kind of up to c contacts, `count` (b,) their number; `mean` (kinds, n, n)
    and `root` (kinds, n, n, n) are the priors of contacts of 1 … n samples. Pressures are mean + root · u, with u of
    prior variance 1. With the readings' gradient by u as one more row of u's precision, the Cholesky factor ends in
    the whitened gradient. Innermost loops run along rows and skip zeros of the root between contacts.
    """
    n = len(towards)
    found = np.zeros(len(models))
    at, begins, middle, gradient = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n), np.empty(n)
    by_u, seen, square = np.empty((n, n)), np.empty((n, n)), np.empty((n + 1, n + 1))
    for b in range(len(models)):
        k = 0
        by_u[:] = 0.0
        for c in range(count[b]):
            begin, stop, kind = models[b, c]
            samples = stop - begin
            for i in range(samples):
                begins[k + i] = k
                at[k + i], middle[k + i] = begin + i, mean[kind, samples - 1, i]
                by_u[k + i, k : k + i + 1] = root[kind, samples - 1, i, : i + 1]
            k += samples
        for i in range(k):
            gradient[i] = towards[at[i]]
            for j in range(k):
                gradient[i] -= precision[at[i], at[j]] * middle[j]
            found[b] += 0.5 * (towards[at[i]] + gradient[i]) * middle[i]
        for i in range(k):
            seen[i, :k], square[i, :k] = 0.0, 0.0
            square[i, i] = 1.0
            for q in range(k):
                for j in range(begins[q], q + 1):
                    seen[i, j] += precision[at[i], at[q]] * by_u[q, j]
        square[k, :k] = 0.0
        for q in range(k):
            for i in range(begins[q], q + 1):
                for j in range(i + 1):
                    square[i, j] += by_u[q, i] * seen[q, j]
                square[k, i] += by_u[q, i] * gradient[q]
        for j in range(k):
            for q in range(j):
                square[j, j] -= square[j, q] ** 2
            square[j, j] = np.sqrt(square[j, j])
            found[b] -= np.log(square[j, j])
            for i in range(j + 1, k + 1):
                for q in range(j):
                    square[i, j] -= square[i, q] * square[j, q]
                square[i, j] /= square[j, j]
            found[b] += 0.5 * square[k, j] ** 2
    return found
