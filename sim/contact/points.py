"""Where contact is enforced: at nodes, and at points of the segments between them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import SHARP_RADIUS_MM, Indentor, Surface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

PARTS = 4
"""Parts into which the points between nodes divide a segment."""

_INNER = PARTS - 1
_BENT_MM = 1e-7  # an indentor that leaves a segment's chord by less is straight there
_ROUND_OFF = 1e-11
_REACH_MM = 0.3  # below the indentor's lowest point, where a step down does not reach


@dataclass(frozen=True)
class Pose:
    """Where an indentor is: its reference point, the height of its lowest point and the length that scales errors."""

    indentor: Indentor
    at_mm: tuple[float, ...]  # along the indentor's axes
    height_mm: float
    scale_mm: float  # D = max(DOI, 1 µm)

    def gap(self, tangential_mm: Array, y_mm: Array) -> Surface:
        """Vertical gap (mm), slope and curvature of the indentor over points at (m, k) and y."""
        surface = self.indentor.evaluate(tangential_mm - np.array(self.at_mm)[:, None])
        return surface._replace(height_mm=self.height_mm + surface.height_mm - y_mm)

    def plane(self, tangential_mm: Array, y_mm: Array) -> Surface:
        """As `gap`, to the tangent plane of the indentor closest to each point."""
        offset = tangential_mm - np.array(self.at_mm)[:, None]
        surface = self.indentor.tangent(offset, y_mm - self.height_mm)
        return surface._replace(height_mm=self.height_mm + surface.height_mm - y_mm)


class Skin(Protocol):
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

    @cached_property
    def segments(self) -> Ints:
        """(e,) the segments of the points between nodes."""
        return self.between // _INNER

    @cached_property
    def along(self) -> Array:
        """(e,) their places, from the segment's first node (0) to its second (1)."""
        return (self.between % _INNER + 1) / PARTS

    def chosen(self, mask: Bools) -> "ContactPoints":
        """Some of the points."""
        return ContactPoints(self.nodes[mask[: len(self.nodes)]], self.between[mask[len(self.nodes) :]])

    def among(self, other: "ContactPoints") -> Bools:
        """(k,) whether each point is one of the other's."""
        pairs = ((self.nodes, other.nodes), (self.between, other.between))
        return np.concatenate([_marked(others, mine)[mine] for mine, others in pairs])

    def joined(self, other: "ContactPoints") -> "ContactPoints":
        """These and the other's points."""
        pairs = ((self.nodes, other.nodes), (self.between, other.between))
        return ContactPoints(*[np.flatnonzero(_marked(a, b) | _marked(b, a)) for a, b in pairs])

    def on(self, skin: Skin) -> "Places":
        """The same points, ready to take values from the nodes of a skin."""
        first, second = skin.segments[self.segments].T
        return Places(skin, self.nodes, first, second, self.along)


@dataclass(frozen=True)
class Places:
    """Points of a skin: some of its nodes, then places between two of them."""

    skin: Skin
    alone: Ints  # (k − e,)
    first: Ints  # (e,)
    second: Ints  # (e,)
    along: Array  # (e,) from the first to the second

    @cached_property
    def tangential_mm(self) -> Array:
        """(m, k) undeformed positions along the axes of slope."""
        return self.interpolate(self.skin.tangential_mm)

    @cached_property
    def y(self) -> Array:
        """(k,) undeformed heights in mm."""
        return self.interpolate(self.skin.y)

    @cached_property
    def carriers(self) -> tuple[Ints, Array]:
        """(2, k) nodes around each point and their shares in it; a node stands by itself."""
        nodes = np.stack([np.concatenate([self.alone, self.first]), np.concatenate([self.alone, self.second])])
        share = np.concatenate([np.zeros(len(self.alone)), self.along])
        return nodes, np.stack([1 - share, share])

    def interpolate(self, nodal: Array) -> Array:
        """(…, k) values at the points from (…, n) values at the nodes."""
        at_nodes = nodal.take(self.alone, axis=-1)
        if not len(self.along):
            return at_nodes
        first, second = (nodal.take(ends, axis=-1) for ends in (self.first, self.second))
        between = (1 - self.along) * first + self.along * second
        return np.concatenate([at_nodes, between], axis=-1)

    def to_nodes(self, force: Array) -> Array:
        """(m, n) forces on the nodes that (m, k) forces at the points amount to."""
        nodes, share = self.carriers
        parts = (force[:, None] * share).reshape(len(force), -1)
        return np.stack([np.bincount(nodes.ravel(), weights=f, minlength=len(self.skin.y)) for f in parts])


@dataclass(frozen=True)
class Survey:
    """The whole skin, displaced, against an indentor in a pose: once looked at, it holds for other heights too."""

    pose: Pose
    skin: Skin
    u: Array  # (m, n) mm
    surface: Surface  # over the nodes
    segments: Ints  # (s,) those that may be touched between their nodes
    gap_mm: Array  # (s, _INNER) at the points between
    below_chord: Bools  # (s, _INNER) whether the indentor is below the segment's chord there

    @classmethod
    def of(cls, pose: Pose, skin: Skin, u: Array, *, between: bool) -> "Survey":
        """What there is to see; segments are looked at up to 0.3 mm below the indentor's lowest point."""
        tangential, y = skin.tangential_mm + u[:-1], skin.y + u[-1]
        surface = pose.gap(tangential, y)
        if not between:
            nothing = np.zeros((0, _INNER))
            return cls(pose, skin, u, surface, np.zeros(0, np.int64), nothing, nothing > 0)
        high = (pose.height_mm - y) < _REACH_MM
        segments = np.flatnonzero(high[skin.segments].any(axis=1))
        return cls(pose, skin, u, surface, segments, *_between(pose, tangential, y, surface, skin.segments[segments]))

    def near(self, pose: Pose, gap_mm: float) -> ContactPoints:
        """Nodes closer than a gap to the indentor at another height, and points between nodes where it bends."""
        lower_mm = self.pose.height_mm - pose.height_mm
        if len(self.segments) and lower_mm + gap_mm > _REACH_MM:
            return Survey.of(pose, self.skin, self.u, between=True).near(pose, gap_mm)
        bent = self.below_chord.any(axis=1, keepdims=True)
        nodes = np.flatnonzero(self.surface.height_mm - lower_mm < gap_mm)
        return ContactPoints(nodes, self._points(bent & (self.gap_mm - lower_mm < gap_mm)))

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


def displaced_gap(pose: Pose, places: Places, u: Array) -> Surface:
    """Gap, slope and curvature at places of a skin whose nodes are displaced by u, (m, n) mm."""
    moved = places.interpolate(u)
    return pose.gap(places.tangential_mm + moved[:-1], places.y + moved[-1])


def norm(slope: Array) -> Array:
    """Length of (∇h, −1)."""
    return np.sqrt(1 + (slope**2).sum(axis=0))


def _marked(numbers: Ints, others: Ints) -> Bools:
    """Which of all numbers up to the largest of both, each ascending, are among the first."""
    marked = np.zeros(1 + max([-1, *numbers[-1:], *others[-1:]]), dtype=bool)
    marked[numbers] = True
    return marked


def _between(pose: Pose, tangential_mm: Array, y_mm: Array, nodes: Surface, segments: Ints) -> tuple[Array, Bools]:
    """(s, _INNER) gaps at the points between (s, 2) nodes, and whether the indentor is below its chord there."""
    along = np.arange(1, PARTS) / PARTS
    s, y = tangential_mm[:, segments], y_mm[segments]
    at_s, at_y = (v[..., :1] + np.diff(v) * along for v in (s, y))
    surface = pose.gap(at_s.reshape(len(s), -1), at_y.ravel())
    gap = surface.height_mm.reshape(at_y.shape)
    chord = nodes.height_mm[segments] @ np.stack([1 - along, along])
    bent = np.asarray(chord - gap > _BENT_MM)
    if pose.indentor.corners_only:
        bent &= _turns(pose, s)[:, None]
    return gap, bent


def _turns(pose: Pose, s: Array) -> Bools:
    """(n_segments,) whether the indentor turns within less than 0.5 mm over segments (m, n_segments, 2)."""
    share = np.arange(PARTS + 1) / PARTS
    at = (s[..., :1] + np.diff(s) * share).reshape(len(s), -1)
    slope = pose.indentor.evaluate(at - np.array(pose.at_mm)[:, None]).slope
    normal = (np.concatenate([slope, -np.ones_like(slope[:1])]) / norm(slope)).reshape(-1, s.shape[1], len(share))
    turn = np.linalg.norm(np.diff(normal), axis=0).sum(axis=1)
    return np.asarray(turn * SHARP_RADIUS_MM > np.hypot.reduce(np.diff(s)[..., 0], axis=0))
