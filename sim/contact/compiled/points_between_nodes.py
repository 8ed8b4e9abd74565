"""Points between nodes: positions on segments, candidates for contact, and their nodes."""

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@compiled
def spread(tangential: Array, y: Array, segments: Ints, lowest_mm: float, parts: int) -> tuple[Ints, Array, Array]:
    """Return (s,) segments with an end above a height, and positions (m, s · inner) and heights of inner points."""
    m, inner = len(tangential), parts - 1
    high, s = np.empty(len(segments), np.int64), 0
    for i in range(len(segments)):
        if y[segments[i, 0]] > lowest_mm or y[segments[i, 1]] > lowest_mm:
            high[s] = i
            s += 1
    at, at_y = np.empty((m, s * inner)), np.empty(s * inner)
    for i in range(s):
        first, second = segments[high[i]]
        for j in range(inner):
            along = (j + 1.0) / parts
            at_y[i * inner + j] = y[first] + (y[second] - y[first]) * along
            for a in range(m):
                at[a, i * inner + j] = tangential[a, first] + (tangential[a, second] - tangential[a, first]) * along
    return high[:s], at, at_y


@compiled
def below_chord(height: Array, segments: Ints, which: Ints, gap: Array, bent_mm: float) -> Bools:
    """Return (s, inner) whether a gap is smaller, by more than `bent_mm`, than on the chord between the nodes."""
    inner = gap.shape[1]
    found = np.empty(gap.shape, np.bool_)
    for i in range(len(which)):
        first, second = segments[which[i]]
        for j in range(inner):
            along = (j + 1.0) / (inner + 1.0)
            found[i, j] = height[first] * (1.0 - along) + height[second] * along - gap[i, j] > bent_mm
    return found


@compiled
def closer(
    height: Array, gap: Array, below: Bools, which: Ints, lower_mm: float, than_mm: float
) -> tuple[Ints, Ints]:
    """Return numbers of nodes within a gap of the lowered indentor, and of points on segments that bend anywhere."""
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
def carried(nodes: Ints, between: Ints, segments: Ints, parts: int) -> tuple[Ints, Array]:
    """Return the nodes (2, k) around nodes and then points (inner · segment + place), and weights of the second."""
    n, inner = len(nodes), parts - 1
    carriers, share = np.empty((2, n + len(between)), np.int64), np.zeros(n + len(between))
    for p in range(n):
        carriers[0, p] = carriers[1, p] = nodes[p]
    for p in range(len(between)):
        carriers[0, n + p], carriers[1, n + p] = segments[between[p] // inner]
        share[n + p] = (between[p] % inner + 1.0) / parts
    return carriers, share


@compiled
def interpolated(nodal: Array, carriers: Ints, share: Array) -> Array:
    """Interpolate (r, n) nodal values to (r, k) values at points."""
    found = np.empty((len(nodal), len(share)))
    for r in range(len(nodal)):
        for p in range(len(share)):
            near, far = nodal[r, carriers[0, p]], nodal[r, carriers[1, p]]
            found[r, p] = near + share[p] * (far - near)
    return found


@compiled
def shared_out(force: Array, carriers: Ints, share: Array, n: int) -> Array:
    """Distribute (m, k) forces at points to (m, n) forces at nodes."""
    found = np.zeros((len(force), n))
    for a in range(len(force)):
        for p in range(len(share)):
            found[a, carriers[0, p]] += force[a, p] * (1.0 - share[p])
            found[a, carriers[1, p]] += force[a, p] * share[p]
    return found


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
