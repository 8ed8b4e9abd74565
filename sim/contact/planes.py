"""Convex problem of one pass: contact planes frozen at one displacement."""

import numpy as np
from numpy.typing import NDArray

from sim.contact.compiled import planes_and_residual, skin_compliance
from sim.contact.lcp import LcpSolution, solve_lcp
from sim.contact.patch import Patch
from sim.contact.points import ContactPoints, ContactPose

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_ROOM = 64  # nodes by which the store grows at least


class Gathered:
    """Compliance between the nodes of a patch that took part so far, grown from pose to pose."""

    def __init__(self, patch: Patch) -> None:
        self.patch = patch
        self.store = np.zeros((len(patch.axes), 0) * 2)  # (m, N, m, N) mm/N, with room for more nodes
        self._nodes = np.zeros(0, np.int64)
        self._number = np.full(len(patch), -1)

    def __len__(self) -> int:
        return len(self._nodes)

    def numbers(self, nodes: Ints) -> Ints:
        """Return the rows of nodes in the store, adding new ones; an array of any shape."""
        numbers = self._number[nodes]
        if numbers.size and numbers.min() < 0:
            self._add(np.unique(nodes[numbers < 0]))
            numbers = self._number[nodes]
        return numbers

    def _add(self, new: Ints) -> None:
        before, (m, room) = len(self), self.store.shape[:2]
        self._nodes = np.concatenate([self._nodes, new])
        after = len(self)
        self._number[new] = np.arange(before, after)
        if after > room:
            larger = np.zeros((m, after + max(_ROOM, after // 4)) * 2)
            larger[:, :before, :, :before] = self.store[:, :before, :, :before]
            self.store = larger
        skin_compliance.gather(self.patch.compliance, self._nodes, before, self.store)


class ContactRegion:
    """Points of a patch that may be touched, and their compliance."""

    def __init__(self, gathered: Gathered, points: ContactPoints) -> None:
        self.points, self.places = points, points.on(gathered.patch)
        numbers = gathered.numbers(self.places.around)
        self.skin = skin_compliance.SkinCompliance(gathered.store, len(gathered), numbers, self.places.share)

    def moved_to(self, u: Array) -> tuple[Array, Array]:
        """Return positions (m − 1, k) along the axes of slope and heights (k,), displaced by (m, k); all in mm."""
        return self.places.tangential_mm + u[:-1], self.places.y + u[-1]

    def moved_by(self, force: Array, at: Ints) -> Array:
        """Return (m, k) displacements in mm of the points under (m, r) forces at some of them."""
        return skin_compliance.moved(self.skin, at, force)


class FrozenPlanes:
    """Convex problem whose contact planes are tangent to the indentor at one displacement of the points."""

    def __init__(self, pose: ContactPose, region: ContactRegion, u: Array, pressed: bool) -> None:
        self.region, self.u = region, u
        at = u if pressed else np.concatenate([u[:-1], np.zeros_like(u[-1:])])
        planes = (pose.plane if pressed else pose.gap)(*region.moved_to(at))
        self.slope, self.curvature = planes.slope, planes.curvature
        self.normal, self.gap_mm, self.curved = planes_and_residual.planes(
            planes.height_mm, self.slope, self.curvature, at
        )

    def solve(self, held: Bools) -> LcpSolution | None:
        """Solve for multipliers λ ≥ 0 with gap + Wλ ≥ 0 complementary to them."""
        if not held.any():
            held = (self.gap_mm < 0) & (np.arange(len(held)) < len(self.region.points.nodes))
        return solve_lcp(self.gap_mm, self.region.skin, self.normal, held)

    def energy(self, solution: LcpSolution, u: Array) -> float:
        """Return the elastic energy of the displacements u that the multipliers cause."""
        return 0.5 * float((self.normal * solution.multipliers * u).sum())


def forces_along(slope: Array, multipliers: Array) -> Array:
    """Return (m, k) forces on the skin along (∇h, −1), the vertical last."""
    return np.concatenate([slope * multipliers, -multipliers[None]])
