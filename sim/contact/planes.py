"""The convex problem of one pass: contact planes frozen at one displacement."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from sim.contact.lcp import LcpSolution, solve_lcp
from sim.contact.patch import Patch
from sim.contact.points import ContactPoints, Pose

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Region:
    """The part of a patch that takes part: points that may be touched, and how they move one another."""

    def __init__(self, patch: Patch, points: ContactPoints) -> None:
        self.points, self.places = points, points.on(patch)
        axes = range(len(patch.axes))
        upper = {(a, b): self.places.compliance(patch.block(a, b)) for a in axes for b in axes if a <= b}
        # mm/N, (k, k) for each pair of axes: displacement along the first, force along the second
        self.compliance = [[upper[a, b] if a <= b else upper[b, a].T for b in axes] for a in axes]

    def part(self, moved: int, pushed: int, points: Ints, by: Ints) -> Array:
        """(r, c) displacements of some points along an axis, mm, per newton at others along another axis."""
        if moved > pushed:
            return self.part(pushed, moved, by, points).T
        return among(self.compliance[moved][pushed], points, by)

    def moved_to(self, u: Array) -> tuple[Array, Array]:
        """Where the points are, (m − 1, k) along the axes of slope and (k,) heights, displaced by (m, k); mm."""
        return self.places.tangential_mm + u[:-1], self.places.y + u[-1]

    def moved_by(self, force: Array) -> Array:
        """(m, k) displacements in mm of the points under (m, k) forces at them."""
        return np.stack([summed(block @ f for block, f in zip(row, force, strict=True)) for row in self.compliance])


class FrozenPlanes:
    """The convex problem whose contact planes are tangent to the indentor at one displacement of the points."""

    def __init__(self, pose: Pose, region: Region, u: Array, pressed: bool) -> None:
        self.region, self.u = region, u
        at = u if pressed else np.concatenate([u[:-1], np.zeros_like(u[-1:])])
        planes = (pose.plane if pressed else pose.gap)(*region.moved_to(at))
        self.slope, self.curvature = planes.slope, planes.curvature
        self.normal = forces_along(self.slope, np.ones(len(region.points)))
        self.gap_mm = planes.height_mm - (self.normal * at).sum(axis=0)

    def solve(self, held: Bools) -> LcpSolution | None:
        """Multipliers λ ≥ 0 with gap + Wλ ≥ 0 complementary to them."""
        entered = (self.gap_mm < 0) & (np.arange(len(held)) < len(self.region.points.nodes))
        return solve_lcp(self.gap_mm, self._compliance(), held if held.any() else entered)

    def _compliance(self) -> Array:
        """(k, k) motion of the points along their normals (∇h, −1) per unit multiplier."""
        c, vertical = self.region.compliance, len(self.slope)
        tilted = (self.slope != 0).any(axis=0)
        sloped = np.flatnonzero(tilted) if 2 * tilted.sum() < len(tilted) else slice(None)
        half = np.zeros((len(self.gap_mm), len(self.gap_mm)))
        for a, slope in enumerate(self.slope):
            sideways = 0.5 * c[a][a][sloped] * slope
            for b in range(a + 1, vertical):
                sideways += c[a][b][sloped] * self.slope[b]
            sideways -= c[a][vertical][sloped]
            half[sloped] += slope[sloped, None] * sideways
        return np.asarray(c[vertical][vertical] + half + half.T)

    def displacement(self, solution: LcpSolution) -> Array:
        """(m, k) displacements of the points in mm."""
        return self.region.moved_by(self.normal * solution.multipliers)

    def energy(self, solution: LcpSolution, u: Array) -> float:
        """Elastic energy of the displacements u that the multipliers cause."""
        return 0.5 * float((self.normal * solution.multipliers * u).sum())


def among(matrix: Array, rows: Ints, columns: Ints) -> Array:
    """(r, c) part of a matrix."""
    return matrix[rows].take(columns, axis=1)


def summed(terms: Iterable[Array]) -> Array:
    """Their sum, made in the first one's place."""
    first, *others = terms
    for other in others:
        first += other
    return first


def forces_along(slope: Array, multipliers: Array) -> Array:
    """(m, k) forces on the skin along (∇h, −1), the vertical last."""
    return np.concatenate([slope * multipliers, -multipliers[None]])
