"""Planes under an indentor, and the equilibrium residual, point by point."""

import math

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@compiled
def planes(height: Array, slope: Array, curvature: Array, at: Array) -> tuple[Array, Array, Bools]:
    """Return normals (m, k), undisplaced gaps (k,) and a mask of curved parts of the planes under (m, k) points."""
    m, k = at.shape
    normal, gap, curved = np.empty((m, k)), np.empty(k), np.zeros(k, dtype=np.bool_)
    for p in range(k):
        moved = -at[m - 1, p]
        normal[m - 1, p] = -1.0
        for a in range(m - 1):
            normal[a, p] = slope[a, p]
            moved += slope[a, p] * at[a, p]
            for b in range(m - 1):
                curved[p] |= curvature[a, b, p] != 0.0
        gap[p] = height[p] - moved
    return normal, gap, curved


@compiled
def missed(mismatch: Array, height: Array, slope: Array, multipliers: Array, scale_mm: float) -> tuple[float, float]:
    """Return the largest ratio of mismatch of u (m, n), penetration, complementarity and tension, and Σ depths in mm.

    Heights, slopes (m − 1, k) and multipliers belong to the points. NaN counts as infinite.
    """
    along, peak, worst, depth = np.empty(len(height)), 0.0, 0.0, 0.0
    for p in range(len(height)):
        square = 1.0
        for a in range(len(slope)):
            square += slope[a, p] ** 2
        along[p] = math.sqrt(square)
        peak = max(peak, multipliers[p] * along[p])
    for p in range(len(height)):
        push, away = multipliers[p] * along[p], height[p] / along[p]
        if peak > 0.0:
            push /= peak
        depth += max(0.0, -away)
        worst = max(worst, abs(min(push, away / scale_mm)), -push)
        if math.isnan(push + away):
            worst = math.inf
    for a in range(len(mismatch)):
        for p in range(mismatch.shape[1]):
            off = abs(mismatch[a, p]) / scale_mm
            worst = math.inf if math.isnan(off) else max(worst, off)
    return worst, depth
