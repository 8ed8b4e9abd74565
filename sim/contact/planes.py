"""The convex problem of one pass: contact planes frozen at one displacement."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.contact.lcp import LcpSolution, solve_lcp
from sim.contact.patch import Patch
from sim.contact.points import ContactPoints, Pose

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_ROOM = 64  # nodes by which the store grows at least


class Gathered:
    """How nodes of a patch move one another, put side by side as they first take part, for one pose after another."""

    def __init__(self, patch: Patch) -> None:
        self.patch = patch
        self._nodes = np.zeros(0, np.int64)
        self._number = np.full(len(patch), -1)
        self._compliance = np.zeros((len(patch.axes), 0) * 2)

    def among(self, nodes: Ints) -> Array:
        """(m, N, m, N) mm/N: displacement of a node along an axis by a force at another along another."""
        self._add(nodes[self._number[nodes] < 0])
        if len(nodes) == self._compliance.shape[1] and (nodes == self._nodes).all():
            return self._compliance
        at = self._number[nodes]
        return self._compliance.take(at, axis=1).take(at, axis=3)

    def _add(self, new: Ints) -> None:
        if not len(new):
            return
        before, (m, room) = len(self._nodes), self._compliance.shape[:2]
        self._nodes = np.concatenate([self._nodes, new])
        after = len(self._nodes)
        self._number[new] = np.arange(before, after)
        axes = len(self.patch) * np.arange(m)[:, None]
        rows = self.patch.compliance[(axes + new).reshape(-1, 1), (axes + self._nodes).ravel()]
        rows = rows.reshape(m, len(new), m, after)
        if not before:
            self._compliance = rows
            return
        if after > room:
            larger = np.empty((m, after + max(_ROOM, after // 4)) * 2)
            larger[:, :room, :, :room] = self._compliance
            self._compliance = larger
        self._compliance[:, before:after, :, :after] = rows
        self._compliance[:, :before, :, before:after] = rows[..., :before].transpose(2, 3, 0, 1)


class Region:
    """The part of a patch that takes part: points that may be touched, and how they move one another."""

    def __init__(self, gathered: Gathered, points: ContactPoints) -> None:
        self.points, self.places = points, points.on(gathered.patch)
        carriers, share = self.places.carriers
        taking_part = np.zeros(len(gathered.patch), dtype=bool)
        taking_part[carriers] = True
        nodes = taking_part.nonzero()[0]
        number = np.empty(len(taking_part), np.int64)
        number[nodes] = np.arange(len(nodes))
        self._carriers = number[carriers], share[1]
        self._compliance = gathered.among(nodes)
        self._last: tuple[Array, Ints] | None = None
        m, k = len(self._compliance), len(points)
        self._known, self._sideways = np.zeros(k, dtype=bool), np.empty((m - 1, k, m, k))
        self._shares: Array | None = None  # (k, N) of the nodes in the points
        if len(points.between):
            here = np.arange(len(points))
            self._shares = np.zeros((len(points), len(nodes)))
            self._shares[here, self._carriers[0][0]] = share[0]
            self._shares[here, self._carriers[0][1]] += share[1]

    @cached_property
    def vertical(self) -> Array:
        """(k, k) mm/N, vertical motion of the points by vertical forces at them."""
        return self._at_points(self._at_points(self._compliance[-1, :, -1], 0), 1)

    def sideways(self, points: Ints) -> Array:
        """(m − 1, r, m, k) mm/N, motion of all points along each axis by forces sideways at some of them."""
        everything = len(points) == len(self.points)
        if self._shares is None:
            return self._compliance[:-1] if everything else self._compliance[:-1].take(points, axis=1)
        new = points[~self._known[points]]
        if len(new):
            self._sideways[:, new] = self._at_points(self._at_points(self._compliance[:-1], 1, new), 3)
            self._known[new] = True
        return self._sideways if everything else self._sideways.take(points, axis=1)

    def _at_points(self, nodal: Array, axis: int, points: Ints | None = None) -> Array:
        """Values at all or some of the points, along an axis that has the nodes."""
        nodes, share = self._carriers
        if points is not None and len(points) < nodes.shape[1]:
            nodes, share = nodes[:, points], share[points]
        elif self._shares is None:
            return nodal
        values = nodal.take(nodes[0], axis=axis)
        between = share.nonzero()[0]
        if len(between):
            at = (slice(None),) * axis + (between,)
            other = share[between].reshape(-1, *[1] * (nodal.ndim - 1 - axis))
            values[at] = (1 - other) * values[at] + other * nodal.take(nodes[1, between], axis=axis)
        return values

    def moved_to(self, u: Array) -> tuple[Array, Array]:
        """Where the points are, (m − 1, k) along the axes of slope and (k,) heights, displaced by (m, k); mm."""
        return self.places.tangential_mm + u[:-1], self.places.y + u[-1]

    def moved_by(self, force: Array) -> Array:
        """(m, k) displacements in mm of the points under (m, k) forces at them; few of them sideways, as a rule."""
        at_nodes = force if self._shares is None else force @ self._shares
        m, n = at_nodes.shape
        u = np.zeros(m * n)
        for of, along in zip(at_nodes, self._compliance, strict=True):
            loaded = of.nonzero()[0]
            rows = along.reshape(n, m * n)
            if 2 * len(loaded) < n:
                of, rows = of[loaded], rows[loaded]
            u += of @ rows
        return u.reshape(m, n) if self._shares is None else u.reshape(m, n) @ self._shares.T

    def along_normals(self, turning: Ints, added: Array) -> Array:
        """(k, k) vertical compliance and what turning points add to it, (r, k), in their rows and their columns.

        Made in the place of the last one, whose turning points are put back.
        """
        if self._last is None or 2 * len(turning) > len(self.vertical):
            self._last = self.vertical.copy(), turning[:0]
        w, before = self._last
        w[before] = self.vertical[before]
        w[:, before] = self.vertical[:, before]
        everywhere = turning if len(turning) < len(w) else slice(None)
        w[everywhere] += added
        w[:, everywhere] += added.T
        self._last = w, turning
        return w


class FrozenPlanes:
    """The convex problem whose contact planes are tangent to the indentor at one displacement of the points."""

    def __init__(self, pose: Pose, region: Region, u: Array, pressed: bool) -> None:
        self.region, self.u = region, u
        at = u if pressed else np.concatenate([u[:-1], np.zeros_like(u[-1:])])
        planes = (pose.plane if pressed else pose.gap)(*region.moved_to(at))
        self.slope, self.curvature = planes.slope, planes.curvature
        self.normal = forces_along(self.slope, np.ones(len(region.points)))
        self.gap_mm = planes.height_mm - (self.normal * at).sum(axis=0)
        self.tilted = (self.slope != 0).any(axis=0)
        self.curved = (self.curvature != 0).any(axis=(0, 1))

    @cached_property
    def turning(self) -> Ints:
        """Points whose planes are tilted, or tilt as they slide."""
        return np.flatnonzero(self.tilted | self.curved)

    @cached_property
    def sideways(self) -> Array:
        """(m − 1, r, m, k) mm/N, motion of all points by forces sideways at those `turning`."""
        return self.region.sideways(self.turning)

    def solve(self, held: Bools) -> LcpSolution | None:
        """Multipliers λ ≥ 0 with gap + Wλ ≥ 0 complementary to them."""
        entered = (self.gap_mm < 0) & (np.arange(len(held)) < len(self.region.points.nodes))
        return solve_lcp(self.gap_mm, self._compliance(), held if held.any() else entered)

    def _compliance(self) -> Array:
        """(k, k) motion of the points along their normals (∇h, −1) per unit multiplier."""
        at, vertical = self.turning, len(self.slope)
        half = np.zeros((len(at), len(self.gap_mm)))
        for slope, sideways in zip(self.slope, self.sideways, strict=True):
            along = -sideways[:, vertical]
            for b, other in enumerate(self.slope):
                along += (0.5 * other) * sideways[:, b]
            half += slope[at, None] * along
        return self.region.along_normals(at, half)

    def displacement(self, solution: LcpSolution) -> Array:
        """(m, k) displacements of the points in mm."""
        return self.region.moved_by(self.normal * solution.multipliers)

    def energy(self, solution: LcpSolution, u: Array) -> float:
        """Elastic energy of the displacements u that the multipliers cause."""
        return 0.5 * float((self.normal * solution.multipliers * u).sum())


def among(matrix: Array, rows: Ints, columns: Ints) -> Array:
    """(r, c) part of a matrix."""
    return matrix[rows].take(columns, axis=1)


def forces_along(slope: Array, multipliers: Array) -> Array:
    """(m, k) forces on the skin along (∇h, −1), the vertical last."""
    return np.concatenate([slope * multipliers, -multipliers[None]])
