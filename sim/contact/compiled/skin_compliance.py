"""Displacements of skin points by forces at other points, by loops over the nodes that carry them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled
from sim.contact.compiled.points_between_nodes import bilinear, weight

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class SkinCompliance(NamedTuple):
    """Skin points between nodes, and the compliance of these nodes."""

    store: Array  # (m, N, m, N) mm/N: motion of nodes along the second pair by forces along the first
    nodes: int  # number of the N rows in use
    carriers: Ints  # (4, k) nodes around each point
    share: Array  # (2, k) shares along and across the strip between them: 0 at a node


@compiled
def gather(compliance: Array, nodes: Ints, before: int, store: Array) -> None:
    """Copy the compliance (m n, m n) between nodes, of which the store (m, N, m, N) has the first `before` ones."""
    m = len(store)
    n = len(compliance) // m
    for a in range(m):
        for i in range(before, len(nodes)):
            row = compliance[a * n + nodes[i]]
            for b in range(m):
                for j in range(len(nodes)):
                    motion = row[b * n + nodes[j]]
                    store[a, i, b, j] = motion
                    if j < before:
                        store[b, j, a, i] = motion


@compiled
def worked(
    skin: SkinCompliance, rows: Ints, row_force: Array, columns: Ints, column_force: Array, width: int
) -> Array:
    """Return (r, c) the work of a force (m, r) at each row point along the motion by one (m, c) at each column point.

    The first row has `width` columns, each following row one more; the rest is zero.
    """
    store, carriers, share = skin.store, skin.carriers, skin.share
    m, count = len(row_force), len(columns)
    found = np.zeros((len(rows), count))
    first, second, third, fourth = carriers[:, columns]
    along, across = share[:, columns]
    faces = across.any()
    mixed = np.empty(skin.nodes)
    for r in range(len(rows)):
        i, k, t = carriers[0, rows[r]], carriers[1, rows[r]], share[0, rows[r]]
        within = share[1, rows[r]] > 0.0
        for a in range(m):
            f = row_force[a, r]
            if f == 0.0:
                continue
            for b in range(m):
                near, far = store[a, i, b], store[a, k, b]
                if within:
                    for n in range(skin.nodes):
                        mixed[n] = _mixed(store, a, b, n, carriers, share, rows[r])
                    near, t = mixed, 0.0
                for c in range(min(width + r, count)):
                    g = f * column_force[b, c]
                    if g == 0.0:
                        continue
                    motion = near[first[c]]
                    if t > 0.0:
                        motion += t * (far[first[c]] - motion)
                    if along[c] > 0.0:
                        end = near[second[c]]
                        if t > 0.0:
                            end += t * (far[second[c]] - end)
                        motion += along[c] * (end - motion)
                    if faces and across[c] > 0.0:
                        beside, end = near[third[c]], near[fourth[c]]
                        if t > 0.0:
                            beside += t * (far[third[c]] - beside)
                            end += t * (far[fourth[c]] - end)
                        motion += across[c] * (beside + along[c] * (end - beside) - motion)
                    found[r, c] += g * motion
    return found


@compiled
def _mixed(store: Array, a: int, b: int, node: int, carriers: Ints, share: Array, p: int) -> float:
    """Return the motion of a node along b by a force along a at a point within a face."""
    t, s = share[:, p]
    near, far = store[a, carriers[0, p], b, node], store[a, carriers[2, p], b, node]
    near += t * (store[a, carriers[1, p], b, node] - near)
    far += t * (store[a, carriers[3, p], b, node] - far)
    return near + s * (far - near)


@compiled
def moved(skin: SkinCompliance, loaded: Ints, force: Array) -> Array:
    """Return (m, k) displacements in mm of all points by forces (m, r) at the loaded ones."""
    store, count, carriers, share = skin
    m, k = len(store), share.shape[1]
    nodal = np.zeros((m, count))
    for p in range(len(loaded)):
        for a in range(m):
            for end in range(4 if share[1, loaded[p]] > 0.0 else 2):
                f = force[a, p] * weight(share[0, loaded[p]], share[1, loaded[p]], end)
                if f == 0.0:
                    continue
                for b in range(m):
                    row = store[a, carriers[end, loaded[p]], b]
                    for n in range(count):
                        nodal[b, n] += f * row[n]
    found = np.empty((m, k))
    for b in range(m):
        for p in range(k):
            found[b, p] = bilinear(nodal, b, carriers, p, share[0, p], share[1, p])
    return found


@compiled
def moved_by_turns(skin: SkinCompliance, turn: Array, multipliers: Array) -> Array:
    """Return (m, k) displacements in mm by the changes (m − 1, k) of the planes' slopes under multipliers (k,)."""
    m, k = len(turn), len(multipliers)
    loaded, force, n = np.empty(k, np.int64), np.zeros((m + 1, k)), 0
    for p in range(k):
        changed = False
        for a in range(m):
            force[a, n] = turn[a, p] * multipliers[p]
            changed |= force[a, n] != 0.0
        if changed:
            loaded[n] = p
            n += 1
    return moved(skin, loaded[:n], force)


@compiled
def displaced(compliance: Array, force: Array) -> Array:
    """Return (m, n) displacements of nodes by forces (m, n), most of them zero; the compliance is (m n, m n)."""
    pushing, found = force.ravel(), np.zeros(force.size)
    for i in range(len(pushing)):
        f = pushing[i]
        if f == 0.0:
            continue
        row = compliance[i]
        for j in range(len(found)):
            found[j] += f * row[j]
    return found.reshape(force.shape)
