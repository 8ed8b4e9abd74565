"""Gauss–Seidel sweeps over points under friction: slow, but they come closer from any start."""

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]


@compiled
def swept(
    compliance: Array,
    gap: Array,
    slip: Array,
    normal: Array,
    tangent: Array,
    friction: float,
    force: Array,
    sweeps: int,
) -> None:
    """Overwrite forces (k, m) by those after some sweeps, with normals and tangents held.

    `gap` (k,) and `slip` (k, m) are those without force; both move with the displacement, (k, m, k, m) per force.
    """
    k, m = force.shape
    motion, load, rest, trial = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    for _ in range(sweeps):
        for i in range(k):
            for a in range(m):
                motion[a] = 0.0
                row = compliance[i, a]
                for j in range(k):
                    for b in range(m):
                        motion[a] += row[j, b] * force[j, b]
            # the normal force closes the gap, then the tangential force stops the slip, within the cone
            stiff = 0.0
            apart = gap[i]
            bearing = 0.0
            for a in range(m):
                apart += normal[i, a] * motion[a]
                bearing += normal[i, a] * force[i, a]
                for b in range(m):
                    stiff += normal[i, a] * compliance[i, a, i, b] * normal[i, b]
            after = max(0.0, bearing - apart / stiff)
            for a in range(m):
                load[a] = (after - bearing) * normal[i, a]
                rest[a] = force[i, a] - bearing * normal[i, a]
            size, softest = 0.0, 0.0
            for t in range(m - 1):
                along = 0.0
                for a in range(m):
                    for b in range(m):
                        along += tangent[i, t, a] * compliance[i, a, i, b] * tangent[i, t, b]
                softest = max(softest, along)
            for t in range(m - 1):
                moved, now = 0.0, 0.0
                for a in range(m):
                    by_load = 0.0
                    for b in range(m):
                        by_load += compliance[i, a, i, b] * load[b]
                    moved += tangent[i, t, a] * (slip[i, a] + motion[a] + by_load)
                    now += tangent[i, t, a] * rest[a]
                trial[t] = now - moved / softest
                size += trial[t] * trial[t]
            size = np.sqrt(size)
            share = 1.0
            if size > friction * after:
                share = friction * after / size
            for a in range(m):
                force[i, a] = after * normal[i, a]
                for t in range(m - 1):
                    force[i, a] += share * trial[t] * tangent[i, t, a]
