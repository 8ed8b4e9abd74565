"""Points between nodes: positions on strips, candidates for contact, and their nodes.

A strip is a straight line at a share of the way from one segment to the next one; a segment is its own neighbor.
"""

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@compiled
def spread(
    tangential: Array, y: Array, strips: Ints, across: Array, lowest_mm: float, parts: int
) -> tuple[Ints, Array, Array]:
    """Return (s,) strips with a node above a height, and positions (m, s · inner) and heights of inner points."""
    m, inner, level = len(tangential), parts - 1, y.reshape(1, -1)
    high, s = np.empty(strips.shape[1], np.int64), 0
    for i in range(strips.shape[1]):
        for end in range(4):
            if y[strips[end, i]] > lowest_mm:
                high[s] = i
                s += 1
                break
    at, at_y = np.empty((m, s * inner)), np.empty(s * inner)
    for i in range(s):
        t = across[high[i]]
        for j in range(inner):
            along = (j + 1.0) / parts
            at_y[i * inner + j] = bilinear(level, 0, strips, high[i], along, t)
            for a in range(m):
                at[a, i * inner + j] = bilinear(tangential, a, strips, high[i], along, t)
    return high[:s], at, at_y


@compiled
def bilinear(nodal: Array, row: int, nodes: Ints, p: int, along: float, across: float) -> float:
    """Interpolate a row of nodal values between the four nodes of column p; two of them if `across` is 0."""
    found = nodal[row, nodes[0, p]]
    found += along * (nodal[row, nodes[1, p]] - found)
    if across > 0.0:
        far = nodal[row, nodes[2, p]]
        found += across * (far + along * (nodal[row, nodes[3, p]] - far) - found)
    return found


@compiled
def below_chord(height: Array, strips: Ints, across: Array, which: Ints, gap: Array, bent_mm: float) -> Bools:
    """Return (s, inner) whether a gap is smaller, by more than `bent_mm`, than interpolated between the nodes."""
    inner, heights = gap.shape[1], height.reshape(1, -1)
    found = np.empty(gap.shape, np.bool_)
    for i in range(len(which)):
        for j in range(inner):
            along = (j + 1.0) / (inner + 1.0)
            found[i, j] = bilinear(heights, 0, strips, which[i], along, across[which[i]]) - gap[i, j] > bent_mm
    return found


@compiled
def closer(
    height: Array, gap: Array, below: Bools, which: Ints, lower_mm: float, than_mm: float
) -> tuple[Ints, Ints]:
    """Return numbers of nodes within a gap of the lowered indentor, and of points on strips that bend anywhere."""
    nodes, n = np.empty(len(height), np.int64), 0
    for i in range(len(height)):
        if height[i] - lower_mm < than_mm:
            nodes[n] = i
            n += 1
    inner, k = gap.shape[1], 0
    points = np.empty(gap.size, np.int64)
    for i in range(len(which)):
        if below[i].any():
            for j in range(inner):
                if gap[i, j] - lower_mm < than_mm:
                    points[k] = inner * which[i] + j
                    k += 1
    return nodes[:n], points[:k]


@compiled
def carried(nodes: Ints, between: Ints, strips: Ints, across: Array, parts: int) -> tuple[Ints, Array]:
    """Return the nodes (4, k) around nodes and points (inner · strip + place), and shares (2, k) between them."""
    n, inner = len(nodes), parts - 1
    carriers, share = np.empty((4, n + len(between)), np.int64), np.zeros((2, n + len(between)))
    for p in range(n):
        carriers[:, p] = nodes[p]
    for p in range(len(between)):
        strip = between[p] // inner
        carriers[:, n + p] = strips[:, strip]
        share[0, n + p], share[1, n + p] = (between[p] % inner + 1.0) / parts, across[strip]
    return carriers, share


@compiled
def interpolated(nodal: Array, carriers: Ints, share: Array) -> Array:
    """Interpolate (r, n) nodal values to (r, k) values at points."""
    found = np.empty((len(nodal), share.shape[1]))
    for r in range(len(nodal)):
        for p in range(share.shape[1]):
            found[r, p] = bilinear(nodal, r, carriers, p, share[0, p], share[1, p])
    return found


@compiled
def shared_out(force: Array, carriers: Ints, share: Array, n: int) -> Array:
    """Distribute (m, k) forces at points to (m, n) forces at nodes."""
    found = np.zeros((len(force), n))
    for a in range(len(force)):
        for p in range(share.shape[1]):
            for end in range(4):
                found[a, carriers[end, p]] += force[a, p] * weight(share[0, p], share[1, p], end)
    return found


@compiled
def weight(along: float, across: float, end: int) -> float:
    """Return the weight of one of the four nodes around a point."""
    return (along if end % 2 else 1.0 - along) * (across if end > 1 else 1.0 - across)


@compiled
def which_of(numbers: Ints, others: Ints) -> Bools:
    """Return a mask of the numbers that are among others; both ascend."""
    found, j = np.zeros(len(numbers), np.bool_), 0
    for i in range(len(numbers)):
        while j < len(others) and others[j] < numbers[i]:
            j += 1
        found[i] = j < len(others) and others[j] == numbers[i]
    return found


@compiled
def merged(numbers: Ints, others: Ints) -> Ints:
    """Return the ascending union of both."""
    found = np.empty(len(numbers) + len(others), np.int64)
    i = j = k = 0
    while i < len(numbers) or j < len(others):
        if j == len(others) or (i < len(numbers) and numbers[i] <= others[j]):
            j += j < len(others) and numbers[i] == others[j]
            found[k] = numbers[i]
            i += 1
        else:
            found[k] = others[j]
            j += 1
        k += 1
    return found[:k]
