"""Where contact is enforced: at nodes, and at points of the segments between them."""

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
"""Number of parts into which the points between nodes divide a segment."""

_INNER = PARTS - 1
_BENT_MM = 1e-7  # an indentor that leaves a segment's chord by less is straight there
_ROUND_OFF = 1e-11
_REACH_MM = 0.3  # below the indentor's lowest point, where a step down does not reach


@dataclass(frozen=True)
class ContactPose:
    """Where an indentor is: its reference point, the height of its lowest point and the length that scales errors."""

    indentor: Indentor
    at_mm: tuple[float, ...]  # along the indentor's axes
    height_mm: float
    scale_mm: float  # D = max(DOI, 1 µm)

    def gap(self, tangential_mm: Array, y_mm: Array) -> Surface:
        """Vertical gap (mm), slope and curvature of the indentor over points at (m, k) and y."""
        height, slope, curvature = self.indentor.evaluate(tangential_mm - self._place)
        return Surface(self.height_mm + height - y_mm, slope, curvature)

    def plane(self, tangential_mm: Array, y_mm: Array) -> Surface:
        """As `gap`, to the tangent plane of the indentor closest to each point."""
        height, slope, curvature = self.indentor.tangent(tangential_mm - self._place, y_mm - self.height_mm)
        return Surface(self.height_mm + height - y_mm, slope, curvature)

    @cached_property
    def _place(self) -> Array:
        return np.array(self.at_mm)[:, None]


class SkinNodes(Protocol):
    """Nodes of the skin and the segments between them."""

    @property
    def tangential_mm(self) -> Array:
        """(m, n) undeformed positions along the axes of slope."""

    @property
    def y(self) -> Array:
        """(n,) undeformed heights in mm."""

    @property
    def segments(self) -> Ints:
        """(n_segments, 2) nodes joined along the axes of slope."""


@dataclass(frozen=True)
class ContactPoints:
    """Nodes, then points between nodes by number: _INNER · segment + place along it."""

    nodes: Ints  # (k − e,) ascending
    between: Ints  # (e,) ascending

    @classmethod
    def none(cls) -> "ContactPoints":
        """No point at all."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.nodes) + len(self.between)

    def chosen(self, mask: Bools) -> "ContactPoints":
        """Some of the points."""
        return ContactPoints(self.nodes[mask[: len(self.nodes)]], self.between[mask[len(self.nodes) :]])

    def among(self, other: "ContactPoints") -> Bools:
        """(k,) whether each point is one of the other's."""
        pairs = ((self.nodes, other.nodes), (self.between, other.between))
        return np.concatenate([points_between_nodes.which_of(mine, others) for mine, others in pairs])

    def joined(self, other: "ContactPoints") -> "ContactPoints":
        """These and the other's points."""
        pairs = ((self.nodes, other.nodes), (self.between, other.between))
        return ContactPoints(*[points_between_nodes.merged(mine, others) for mine, others in pairs])

    def on(self, skin: SkinNodes) -> "SkinPoints":
        """The same points, ready to take values from the nodes of a skin."""
        return SkinPoints(skin, *points_between_nodes.carried(self.nodes, self.between, skin.segments, PARTS))


@dataclass(frozen=True)
class SkinPoints:
    """Points of a skin: some of its nodes, then places between two of them."""

    skin: SkinNodes
    around: Ints  # (2, k) the nodes around each point; a node stands by itself
    share: Array  # (k,) of the second

    @cached_property
    def tangential_mm(self) -> Array:
        """(m, k) undeformed positions along the axes of slope."""
        return self.interpolate(self.skin.tangential_mm)

    @cached_property
    def y(self) -> Array:
        """(k,) undeformed heights in mm."""
        return self.interpolate(self.skin.y[None])[0]

    @property
    def carriers(self) -> tuple[Ints, Array]:
        """(2, k) nodes around each point and their shares in it."""
        return self.around, np.stack([1 - self.share, self.share])

    def interpolate(self, nodal: Array) -> Array:
        """(r, k) values at the points from (r, n) values at the nodes, (k,) from (n,)."""
        rows = np.ascontiguousarray(nodal).reshape(-1, nodal.shape[-1])
        return points_between_nodes.interpolated(rows, self.around, self.share).reshape(*nodal.shape[:-1], -1)

    def to_nodes(self, force: Array) -> Array:
        """(m, n) forces on the nodes that (m, k) forces at the points amount to."""
        return points_between_nodes.shared_out(force, self.around, self.share, len(self.skin.y))


@dataclass(frozen=True)
class Survey:
    """The whole skin, displaced, against an indentor in a pose: once looked at, it holds for other heights too."""

    pose: ContactPose
    skin: SkinNodes
    u: Array  # (m, n) mm
    surface: Surface  # over the nodes
    segments: Ints  # (s,) those that may be touched between their nodes
    gap_mm: Array  # (s, _INNER) at the points between
    below_chord: Bools  # (s, _INNER) whether the indentor is below the segment's chord there

    @classmethod
    def of(cls, pose: ContactPose, skin: SkinNodes, u: Array, *, between: bool) -> "Survey":
        """What there is to see; segments are looked at up to 0.3 mm below the indentor's lowest point."""
        tangential, y = skin.tangential_mm + u[:-1], skin.y + u[-1]
        surface = pose.gap(tangential, y)
        if not between:
            nothing = np.zeros((0, _INNER))
            return cls(pose, skin, u, surface, np.zeros(0, np.int64), nothing, nothing > 0)
        segments, at, at_y = points_between_nodes.spread(
            tangential, y, skin.segments, pose.height_mm - _REACH_MM, PARTS
        )
        gap = pose.gap(at, at_y).height_mm.reshape(-1, _INNER)
        below = points_between_nodes.below_chord(surface.height_mm, skin.segments, segments, gap, _BENT_MM)
        if pose.indentor.corners_only:
            below &= _turns(pose, tangential[:, skin.segments[segments]])[:, None]
        return cls(pose, skin, u, surface, segments, gap, below)

    def near(self, pose: ContactPose, gap_mm: float) -> ContactPoints:
        """Nodes closer than a gap to the indentor at another height, and points between nodes where it bends."""
        lower_mm = self.pose.height_mm - pose.height_mm
        if len(self.segments) and lower_mm + gap_mm > _REACH_MM:
            return Survey.of(pose, self.skin, self.u, between=True).near(pose, gap_mm)
        height, gap = self.surface.height_mm, self.gap_mm
        return ContactPoints(
            *points_between_nodes.closer(height, gap, self.below_chord, self.segments, lower_mm, gap_mm)
        )

    @cached_property
    def penetrated(self) -> tuple[ContactPoints, Array]:
        """Points that lie within the indentor by more than round-off, and (k,) by how much, along its normal; mm."""
        tiny, height = _ROUND_OFF * self.pose.scale_mm, self.surface.height_mm
        deep = np.flatnonzero(height < -tiny)
        depth = -height[deep] / norm(self.surface.slope[:, deep])
        inside = ContactPoints(np.zeros(0, np.int64), self._points(self.below_chord & (self.gap_mm < -tiny)))
        if not len(inside):
            return ContactPoints(deep, inside.between), depth
        there = displaced_gap(self.pose, inside.on(self.skin), self.u)
        return ContactPoints(deep, inside.between), np.concatenate([depth, -there.height_mm / norm(there.slope)])

    def _points(self, mask: Bools) -> Ints:
        """Numbers of points between nodes, by (s, _INNER)."""
        row, place = np.nonzero(mask)
        return np.asarray(_INNER * self.segments[row] + place)


def displaced_gap(pose: ContactPose, places: SkinPoints, u: Array) -> Surface:
    """Gap, slope and curvature at places of a skin whose nodes are displaced by u, (m, n) mm."""
    moved = places.interpolate(u)
    return pose.gap(places.tangential_mm + moved[:-1], places.y + moved[-1])


def norm(slope: Array) -> Array:
    """Length of (∇h, −1)."""
    return np.sqrt(1 + (slope**2).sum(axis=0))


def _turns(pose: ContactPose, s: Array) -> Bools:
    """(n_segments,) whether the indentor turns within less than 0.5 mm over segments (m, n_segments, 2)."""
    share = np.arange(PARTS + 1) / PARTS
    at = (s[..., :1] + np.diff(s) * share).reshape(len(s), -1)
    slope = pose.indentor.evaluate(at - np.array(pose.at_mm)[:, None]).slope
    normal = (np.concatenate([slope, -np.ones_like(slope[:1])]) / norm(slope)).reshape(-1, s.shape[1], len(share))
    turn = np.linalg.norm(np.diff(normal), axis=0).sum(axis=1)
    return np.asarray(turn * SHARP_RADIUS_MM > np.hypot.reduce(np.diff(s)[..., 0], axis=0))
