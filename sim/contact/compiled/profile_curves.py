"""Heights, slopes and curvatures of profiles: arcs with flanks, the sine of a step, cubics joined at points."""

import math

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]


@compiled
def arc(t: Array, radius: float, side: Array, steepest: float) -> tuple[Array, Array, Array]:
    """Return height, slope and curvature (k,) of a circle's lower part, with a flank where it is steepest.

    t (k,) is the distance from the lowest point in mm; the profile is flat at t < 0.
    """
    height, slope, curvature = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t))
    end = radius * steepest / math.hypot(1.0, steepest)
    for p in range(len(t)):
        if t[p] > end:
            height[p] = radius - math.sqrt(radius * radius - end * end) + steepest * (t[p] - end)
            slope[p] = side[p] * steepest
        elif t[p] >= 0.0 and radius > 0.0:
            cosine = math.sqrt(radius * radius - t[p] * t[p])
            height[p] = radius - cosine
            slope[p] = side[p] * (t[p] / cosine)
            curvature[p] = radius * radius / (cosine * cosine * cosine)
    return height, slope, curvature


@compiled
def lean(height: Array, slope: Array, t: Array, y_mm: Array, radius: float, side: Array, steepest: float) -> None:
    """Replace the flank of `arc` by the circle's tangent that is closest to a point at height y, in place."""
    end = radius * steepest / math.hypot(1.0, steepest)
    for p in range(len(t)):
        if t[p] > end:
            steepness = min(t[p] / max(radius - y_mm[p], 1e-12), steepest)
            height[p] = radius - radius * math.hypot(1.0, steepness) + steepness * t[p]
            slope[p] = side[p] * steepness


@compiled
def flank(s: Array, half: float, k: float) -> tuple[Array, Array, Array]:
    """Return height, slope and curvature of half · (1 − cos ks), level before s = 0 and half a wave later."""
    height, slope, curvature = np.zeros(len(s)), np.zeros(len(s)), np.zeros(len(s))
    for p in range(len(s)):
        if s[p] > math.pi / k:
            height[p] = half * 2.0
        elif s[p] >= 0.0:
            t = min(k * s[p], math.pi)
            height[p] = half * (1.0 - math.cos(t))
            slope[p] = half * k * math.sin(t)
            curvature[p] = half * k * k * math.cos(t)
    return height, slope, curvature


@compiled
def joined(s: Array, knots: Array, powers: Array) -> tuple[Array, Array, Array]:
    """Evaluate polynomials (p, n), highest power first, between n + 1 knots; the outer ones extend beyond them."""
    height, slope, curvature = np.zeros(len(s)), np.zeros(len(s)), np.zeros(len(s))
    last = powers.shape[1] - 1
    for p in range(len(s)):
        i = min(max(np.searchsorted(knots, s[p], side="right") - 1, 0), last)
        t = s[p] - knots[i]
        for power in powers[:, i]:
            curvature[p] = curvature[p] * t + 2.0 * slope[p]
            slope[p] = slope[p] * t + height[p]
            height[p] = height[p] * t + power
    return height, slope, curvature


@compiled
def measured(
    s: Array, knots: Array, powers: Array, first: float, last: float, steepest: float
) -> tuple[Array, Array, Array]:
    """Return height, slope and curvature of a profile `joined` between two ends, with flanks beyond them."""
    height, slope, curvature = joined(np.minimum(np.maximum(s, first), last), knots, powers)
    middle = 0.5 * (first + last)
    for p in range(len(s)):
        beyond = max(s[p] - last, first - s[p])
        if beyond > 0.0:
            height[p] += steepest * beyond
            slope[p] = steepest if s[p] > middle else -steepest
            curvature[p] = 0.0
    return height, slope, curvature


@compiled
def arm(offset: Array) -> tuple[Array, Array]:
    """Return the distances (k,) of points (2, k) from the axis, and the unit vectors (2, k) towards them."""
    s, direction = np.empty(offset.shape[1]), np.empty(offset.shape)
    for p in range(len(s)):
        s[p] = math.hypot(offset[0, p], offset[1, p])
        if s[p] > 0.0:
            direction[0, p], direction[1, p] = offset[0, p] / s[p], offset[1, p] / s[p]
        else:
            direction[0, p], direction[1, p] = 1.0, 0.0
    return s, direction


@compiled
def revolved(s: Array, direction: Array, slope: Array, curvature: Array) -> tuple[Array, Array]:
    """Return slopes (2, k) and second derivatives (2, 2, k) of a profile turned about the vertical."""
    along, bend = np.empty(direction.shape), np.empty((2, 2, len(s)))
    for p in range(len(s)):
        around = slope[p] / s[p] if s[p] > 0.0 else curvature[p]
        for a in range(2):
            along[a, p] = slope[p] * direction[a, p]
            for b in range(2):
                radial = direction[a, p] * direction[b, p]
                bend[a, b, p] = curvature[p] * radial + around * ((1.0 if a == b else 0.0) - radial)
    return along, bend
