"""Points where contact is enforced: nodes, and points of the segments and faces between them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.contact.compiled import points_between_nodes
from sim.contact.indentor import SHARP_RADIUS_MM, Indentor, Surface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

PARTS = 4
"""Number of parts into which the points between nodes divide a segment, and a face each way."""

_INNER = PARTS - 1
_BENT_MM = 1e-7  # an indentor that deviates from a segment's chord by less counts as straight
_ROUND_OFF = 1e-11
_REACH_MM = 0.3  # below the indentor's lowest point; a step down does not reach farther


@dataclass(frozen=True)
class ContactPose:
    """Pose of an indentor: reference point, height of its lowest point, and the length that scales errors."""

    indentor: Indentor
    at_mm: tuple[float, ...]  # reference point along the indentor's axes
    height_mm: float
    scale_mm: float  # D = max(DOI, 1 µm)
    narrow: bool = False  # whether contact between nodes is enforced within faces, too

    def gap(self, tangential_mm: Array, y_mm: Array) -> Surface:
        """Return vertical gap (mm), slope and curvature of the indentor over points at (m, k) and y."""
        height, slope, curvature = self.indentor.evaluate(tangential_mm - self._origin)
        return Surface(self.height_mm + height - y_mm, slope, curvature)

    def plane(self, tangential_mm: Array, y_mm: Array) -> Surface:
        """Return the same for the indentor's tangent plane closest to each point."""
        height, slope, curvature = self.indentor.tangent(tangential_mm - self._origin, y_mm - self.height_mm)
        return Surface(self.height_mm + height - y_mm, slope, curvature)

    @cached_property
    def _origin(self) -> Array:
        return np.array(self.at_mm)[:, None]


class SkinNodes(Protocol):
    """Nodes of the skin, the segments between them, and strips of the faces between these."""

    @property
    def tangential_mm(self) -> Array:
        """(m, n) undeformed positions along the axes of slope."""

    @property
    def y(self) -> Array:
        """(n,) undeformed heights (mm)."""

    @property
    def strips(self) -> Ints:
        """(4, n) nodes of two opposite sides: of each segment twice the same, then of each face, once for a strip."""

    @property
    def across(self) -> Array:
        """(n,) how far from the first side to the second a strip lies: 0 for segments."""


@dataclass(frozen=True)
class ContactPoints:
    """Nodes, then points between nodes numbered _INNER · strip + index along it."""

    nodes: Ints  # (k − e,) ascending
    between: Ints  # (e,) ascending

    @classmethod
    def none(cls) -> "ContactPoints":
        """Return an empty set."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.nodes) + len(self.between)

    def chosen(self, mask: Bools) -> "ContactPoints":
        """Return the points that a mask selects."""
        return ContactPoints(self.nodes[mask[: len(self.nodes)]], self.between[mask[len(self.nodes) :]])

    def among(self, other: "ContactPoints") -> Bools:
        """Return (k,) whether each point belongs to the other set."""
        pairs = ((self.nodes, other.nodes), (self.between, other.between))
        return np.concatenate([points_between_nodes.which_of(mine, others) for mine, others in pairs])

    def joined(self, other: "ContactPoints") -> "ContactPoints":
        """Return the union with the other set."""
        pairs = ((self.nodes, other.nodes), (self.between, other.between))
        return ContactPoints(*[points_between_nodes.merged(mine, others) for mine, others in pairs])

    def on(self, skin: SkinNodes) -> "SkinPoints":
        """Return the points bound to a skin, so that they interpolate its nodal values."""
        return SkinPoints(
            skin, *points_between_nodes.carried(self.nodes, self.between, skin.strips, skin.across, PARTS)
        )


@dataclass(frozen=True)
class SkinPoints:
    """Points of a skin: some of its nodes, then points between two or four of them."""

    skin: SkinNodes
    around: Ints  # (4, k) nodes around each point; at a node, all are that node
    share: Array  # (2, k) shares from the first to the second of them, and from these two to the other two

    @cached_property
    def tangential_mm(self) -> Array:
        """(m, k) undeformed positions along the axes of slope."""
        return self.interpolate(self.skin.tangential_mm)

    @cached_property
    def y(self) -> Array:
        """(k,) undeformed heights (mm)."""
        return self.interpolate(self.skin.y[None])[0]

    @property
    def carriers(self) -> tuple[Ints, Array]:
        """(4, k) nodes around each point and their weights."""
        s, t = self.share
        return self.around, np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])

    def interpolate(self, nodal: Array) -> Array:
        """Interpolate (r, n) nodal values to (r, k) values at the points, or (n,) to (k,)."""
        rows = np.ascontiguousarray(nodal).reshape(-1, nodal.shape[-1])
        return points_between_nodes.interpolated(rows, self.around, self.share).reshape(*nodal.shape[:-1], -1)

    def to_nodes(self, force: Array) -> Array:
        """Distribute (m, k) forces at the points to (m, n) equivalent forces on the nodes."""
        return points_between_nodes.shared_out(force, self.around, self.share, len(self.skin.y))


@dataclass(frozen=True)
class Survey:
    """Gaps between the whole displaced skin and an indentor in a pose; valid for other heights too."""

    pose: ContactPose
    skin: SkinNodes
    u: Array  # (m, n) mm
    surface: Surface  # over the nodes
    strips: Ints  # (s,) strips that may be touched between their nodes
    gap_mm: Array  # (s, _INNER) at the points between nodes
    below_chord: Bools  # (s, _INNER) whether the indentor is below the skin between the nodes there

    @classmethod
    def of(cls, pose: ContactPose, skin: SkinNodes, u: Array, *, between: bool) -> "Survey":
        """Survey the skin; points between nodes are included down to 0.3 mm below the indentor's lowest point."""
        tangential, y = skin.tangential_mm + u[:-1], skin.y + u[-1]
        surface = pose.gap(tangential, y)
        if not between:
            nothing = np.zeros((0, _INNER))
            return cls(pose, skin, u, surface, np.zeros(0, np.int64), nothing, nothing > 0)
        joined = len(skin.across) if pose.narrow else int(np.searchsorted(skin.across, 0.0, side="right"))
        strips, across = skin.strips[:, :joined], skin.across[:joined]
        which, at, at_y = points_between_nodes.spread(
            tangential, y, strips, across, pose.height_mm - _REACH_MM, PARTS
        )
        gap = pose.gap(at, at_y).height_mm.reshape(-1, _INNER)
        below = points_between_nodes.below_chord(surface.height_mm, strips, across, which, gap, _BENT_MM)
        if pose.indentor.corners_only:
            close = np.flatnonzero((below & (gap < _REACH_MM)).any(axis=1))
            which, gap, below = which[close], gap[close], below[close]
            diagonals = [skin.tangential_mm[:, strips[ends][:, which].T] for ends in ([0, 3], [1, 2])]
            below &= np.any([_turns(pose, diagonal) for diagonal in diagonals], axis=0)[:, None]
        return cls(pose, skin, u, surface, which, gap, below)

    def near(self, pose: ContactPose, gap_mm: float) -> ContactPoints:
        """Return nodes within a gap of the indentor at another height, and points between nodes where it bends."""
        lower_mm = self.pose.height_mm - pose.height_mm
        if len(self.strips) and lower_mm + gap_mm > _REACH_MM:
            return Survey.of(pose, self.skin, self.u, between=True).near(pose, gap_mm)
        height, gap = self.surface.height_mm, self.gap_mm
        return ContactPoints(
            *points_between_nodes.closer(height, gap, self.below_chord, self.strips, lower_mm, gap_mm)
        )

    @cached_property
    def penetrated(self) -> tuple[ContactPoints, Array]:
        """Points deeper within the indentor than round-off, and (k,) their depths along its normal (mm)."""
        tiny, height = _ROUND_OFF * self.pose.scale_mm, self.surface.height_mm
        deep = np.flatnonzero(height < -tiny)
        depth = -height[deep] / norm(self.surface.slope[:, deep])
        inside = ContactPoints(np.zeros(0, np.int64), self._points(self.below_chord & (self.gap_mm < -tiny)))
        if not len(inside):
            return ContactPoints(deep, inside.between), depth
        there = displaced_gap(self.pose, inside.on(self.skin), self.u)
        return ContactPoints(deep, inside.between), np.concatenate([depth, -there.height_mm / norm(there.slope)])

    def _points(self, mask: Bools) -> Ints:
        """Return the numbers of points between nodes selected by a mask (s, _INNER)."""
        row, index = np.nonzero(mask)
        return np.asarray(_INNER * self.strips[row] + index)


def displaced_gap(pose: ContactPose, points: SkinPoints, u: Array) -> Surface:
    """Return gap, slope and curvature at points of a skin whose nodes are displaced by u, (m, n) mm."""
    moved = points.interpolate(u)
    return pose.gap(points.tangential_mm + moved[:-1], points.y + moved[-1])


def norm(slope: Array) -> Array:
    """Return the length of (∇h, −1)."""
    return np.sqrt(1 + (slope**2).sum(axis=0))


def _turns(pose: ContactPose, s: Array) -> Bools:
    """Return (n,) whether the indentor turns within less than 0.5 mm about lines (m, n, 2) of the undeformed skin.

    It is measured a quarter beyond their ends: points slide. Where they slid to does not count, so that no point is
    left out at a depth that takes part at another.
    """
    share = np.arange(-1, PARTS + 2) / PARTS
    at = (s[..., :1] + np.diff(s) * share).reshape(len(s), -1)
    slope = pose.indentor.evaluate(at - np.array(pose.at_mm)[:, None]).slope
    normal = np.concatenate([slope, -np.ones_like(slope[:1])]) / norm(slope)
    normal = normal.reshape(len(normal), s.shape[1], len(share))
    turn = np.linalg.norm(np.diff(normal), axis=0).sum(axis=1)
    return np.asarray(turn * SHARP_RADIUS_MM > np.hypot.reduce(np.diff(s)[..., 0], axis=0))
