"""How far nodes are from a rigid indentor: the gap above them, and from a bar, whose walls are steep, the distance.

Measured vertically, a gap beside a bar's wall is some thousand times the distance, and its penalty a million times as
stiff as below the face: Newton's method finds no rest for a node that slides round the edge.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import ALONG, Indentor, Prismatic
from sim.contact.patch import X, Y
from sim.contact.profiles import Bar

Array = NDArray[np.float64]


class Clearance(NamedTuple):
    """Of n nodes: mm from the indentor, negative inside; its gradient (n, 3) and Hessian (n, 3, 3)."""

    mm: Array
    gradient: Array
    hessian: Array


def clearance(indentor: Indentor, offset: Array, above: Array) -> Clearance:
    """At (m, n) mm from its reference point along its axes, and (n,) mm above its lowest point."""
    bar = _bar(indentor)
    return _above(indentor, offset, above) if bar is None else _from_bar(bar, offset[0], above)


def along(indentor: Indentor, s: Array, above: Array) -> tuple[Array, Array]:
    """(n,) mm along an indentor that lies along the finger, round a bar's edge the arc's; its gradient (2, n)."""
    bar = _bar(indentor)
    if bar is None:
        return s, np.stack([np.ones(len(s)), np.zeros(len(s))])
    at = _Beside.of(bar, s, above)
    angle, up = np.arctan2(at.out, at.down), np.where(at.out > 0, np.maximum(-at.below, 0.0), 0.0)
    turned = np.where(at.out > 0, bar.edge_radius_mm * angle + up, 0.0)
    slower = np.where((at.out > 0) & (at.below > 0), bar.edge_radius_mm / at.far, 1.0)
    face = np.minimum(np.abs(s), 0.5 * bar.width_mm - bar.edge_radius_mm)
    return at.side * (face + turned), slower * np.stack([-at.gradient[:, Y], at.gradient[:, X]])


def _bar(indentor: Indentor) -> Bar | None:
    if isinstance(indentor, Prismatic) and indentor.axes == ALONG and isinstance(indentor.profile, Bar):
        return indentor.profile
    return None


def _above(indentor: Indentor, offset: Array, above: Array) -> Clearance:
    found, axes, n = indentor.evaluate(offset), list(indentor.axes), len(above)
    gradient, hessian = np.zeros((n, 3)), np.zeros((n, 3, 3))
    gradient[:, axes] = found.slope.T
    gradient[:, Y] = -1.0
    hessian[np.ix_(range(n), axes, axes)] = np.moveaxis(found.curvature, -1, 0)
    return Clearance(found.height_mm - above, gradient, hessian)


def _from_bar(bar: Bar, s: Array, above: Array) -> Clearance:
    at, hessian = _Beside.of(bar, s, above), np.zeros((len(s), 3, 3))
    tangent = np.stack([-at.gradient[:, Y], at.gradient[:, X]], axis=1)
    bent = np.where((at.out > 0) & (at.below > 0), 1 / at.far, 0.0)
    hessian[:, :2, :2] = bent[:, None, None] * tangent[:, :, None] * tangent[:, None]
    return Clearance(at.far - bar.edge_radius_mm, at.gradient, hessian)


class _Beside(NamedTuple):
    """Of n nodes: where they are from the centre of the nearer edge, and how far from it, or from its level."""

    side: Array
    out: Array
    below: Array
    down: Array
    far: Array
    gradient: Array  # (n, 3)

    @classmethod
    def of(cls, bar: Bar, s: Array, above: Array) -> "_Beside":
        """Whatever is within the face's width is claimed by the face, never by a wall."""
        r, side = bar.edge_radius_mm, np.where(s < 0, -1.0, 1.0)
        out, below = np.maximum(np.abs(s) - (0.5 * bar.width_mm - r), 0.0), r - above
        down = np.where(out > 0, np.maximum(below, 0.0), below)
        far = np.where(out > 0, np.hypot(out, down), below)
        gradient, past = np.zeros((len(s), 3)), out > 0
        gradient[past, X] = (side * out)[past] / far[past]
        gradient[:, Y] = -1.0
        gradient[past, Y] = -down[past] / far[past]
        return cls(side, out, below, down, far, gradient)
