"""The likeliest place of the receptor for each measure, with profile-likelihood limits.

Every measure has its own k and ε₀ at every place. Places are tried on a grid of the whole range, then on finer ones
over what is likely. The frame is that of all comparisons, x_indentor = position + x_receptor, with the offset added
where one is asked for; all places are judged over the same positions.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from rig.compare.answers.answer import LEVEL
from rig.compare.answers.goodness import lack_of_fit
from rig.compare.answers.likeliest import Form, Likeliest, likeliest
from rig.compare.answers.observed import Observed, observed
from rig.compare.comparison import Overlay
from rig.compare.place.place_grid import PlaceRange, Range, spline_weights
from rig.compare.place.whereabouts import PlaceRow, Whereabouts
from rig.compare.statistics import Flags, compared
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]

_FIRST, _NEXT, _LAST = (21, 9, 9), (13, 13, 9), (17, 17, 13)
"""Nodes of x, depth and offset: over the whole range, over what may be likely, and over what is."""

_ROUNDS = 6
_SMALLER = 0.9  # a box that shrinks less than this is as small as it gets


class _Tried(NamedTuple):
    """Places (n,) along each of x, depth and offset, and what was fitted at all of them, x going slowest."""

    axes: list[Array]
    found: Likeliest

    @property
    def total(self) -> Array:
        """(nx, nd, no) deviances."""
        return self.found.total.reshape([len(axis) for axis in self.axes])

    def profile(self, axis: int) -> Array:
        """The least deviance over the other two."""
        return self.total.min(axis=tuple({0, 1, 2} - {axis}))


class _Seen(NamedTuple):
    """What was recorded at the positions that all receptors in play cover, whatever the offset."""

    overlays: Sequence[Overlay]
    observed: Observed
    used: Flags
    in_play: Flags  # (nx,)
    where: PlaceRange  # x of those in play
    nodes: tuple[Array, Array]

    def eps(self, measure: int, offset_mm: float) -> Array:
        """(p, nd, nx) of a measure at the nodes in play."""
        each = [p.stimulus.at(p.recording.position_mm + offset_mm)[measure] for p in self.overlays]
        values = np.concatenate(each)[self.used]
        return values.reshape(len(values), len(self.nodes[1]), -1)[:, :, self.in_play]


def whereabouts(
    overlays: Sequence[Overlay], where: PlaceRange, form: Form, measures: Sequence[str] = MEASURES
) -> Whereabouts | None:
    """Of one afferent, from recordings over stimuli with receptors at every node; None with too few positions."""
    seen = _seen(overlays, where)
    if seen is None:
        return None
    rows = [_row(seen, MEASURES.index(name), form) for name in measures]
    return Whereabouts(
        stimuli=tuple(overlay.stimulus.title for overlay in overlays),
        recordings=tuple(overlay.recording.name for overlay in overlays),
        positions=len(seen.observed.rate),
        recorded=len(seen.used),
        asked=where,
        where=seen.where,
        rows=tuple(sorted(rows, key=lambda row: row.deviance)),
    )


def _seen(overlays: Sequence[Overlay], where: PlaceRange) -> _Seen | None:
    n_depths = len(where.depth_nodes)
    ends = [
        np.concatenate([p.stimulus.at(p.recording.position_mm + offset)[:1] for p in overlays], axis=1)
        for offset in where.offset_mm
    ]
    at_ends = ends[0] + ends[1]  # NaN where either end of the offset is not covered
    at_ends = at_ends.reshape(1, at_ends.shape[1], n_depths, -1)[:, :, 0]
    which = compared(at_ends)
    if which is None:
        return None
    in_play, used = which
    x = where.x_nodes[in_play]
    return _Seen(
        overlays,
        observed([overlay.recording for overlay in overlays], used),
        used,
        in_play,
        where._replace(x_mm=(float(x[0]), float(x[-1]))),
        (x, where.depth_nodes),
    )


def _row(seen: _Seen, measure: int, form: Form) -> PlaceRow:
    ranges = list(seen.where)
    box = ranges
    for n in range(_ROUNDS):
        tried = _tried(seen, measure, form, box, _NEXT if n else _FIRST)
        before, box = box, _maybe_likely(tried, _limit(seen, tried, form)[0])
        if n and _size(box) > _SMALLER * _size(before):
            break
    tried = _tried(seen, measure, form, box, _LAST)
    limit, ratio, p_fit = _limit(seen, tried, form)
    best = int(np.argmin(tried.found.total))
    at = np.unravel_index(best, tried.total.shape)
    x, depth, offset = (float(axis[n]) for axis, n in zip(tried.axes, at, strict=True))
    crossed = [_interval(axis, tried.profile(n), limit) for n, axis in enumerate(tried.axes)]
    return PlaceRow(
        MEASURES[measure],
        x_mm=x,
        depth_mm=depth,
        offset_mm=offset,
        x_interval=crossed[0],
        depth_interval=crossed[1],
        offset_interval=crossed[2],
        k=float(tried.found.k[best]),
        eps0=float(tried.found.eps0[best]),
        deviance=float(tried.found.total[best] / seen.observed.noise.dispersion),
        lack_of_fit=ratio,
        p_fit=p_fit,
        at_bounds=_at_bounds(crossed, ranges),
    )


def _tried(seen: _Seen, measure: int, form: Form, ranges: Sequence[Range], n: Sequence[int]) -> _Tried:
    axes = [np.linspace(*ends, number if ends[0] < ends[1] else 1) for ends, number in zip(ranges, n, strict=True)]
    of_x, of_depth = (spline_weights(*one) for one in zip(seen.nodes, axes[:2], strict=True))
    eps = [np.einsum("xi,dj,pji->xdp", of_x, of_depth, seen.eps(measure, float(o))) for o in axes[2]]
    pairs = np.stack(eps, axis=2)
    return _Tried(axes, likeliest(pairs.reshape(-1, pairs.shape[-1]), seen.observed, form))


def _limit(seen: _Seen, tried: _Tried, form: Form) -> tuple[float, float, float]:
    """The deviance that is just not unlikely (as of k and ε₀), and F and p of the best place's own fit."""
    best = [int(np.argmin(tried.found.total))]
    free = form.parameters + seen.where.free
    ratio, p = lack_of_fit(seen.observed, tried.found.mean[best], tried.found.deviance[best], free)
    noise = seen.observed.noise
    freedom = min(noise.freedom * seen.observed.evenness, _KNOWN)
    more = noise.dispersion * max(float(ratio[0]), 1.0) * fdtri(1, freedom, 1 - LEVEL)
    return float(tried.found.total[best[0]] + more), float(ratio[0]), float(p[0])


_KNOWN = 1e9


def _maybe_likely(tried: _Tried, limit: float) -> list[Range]:
    """The smallest box with all that may be likely, and a node more on each side.

    Between two nodes the deviance may be lower than at both, by an eighth of how much it changes to the next ones if
    it is a parabola; twice that is allowed for along each axis, since a valley need not lie along one.
    """
    lower = tried.total - sum(0.25 * _change(tried.total, n) for n in range(3))
    box = []
    for n, axis in enumerate(tried.axes):
        inside = np.flatnonzero(lower.min(axis=tuple({0, 1, 2} - {n})) <= limit)
        low, high = max(int(inside[0]) - 1, 0), min(int(inside[-1]) + 1, len(axis) - 1)
        box.append((float(axis[low]), float(axis[high])))
    return box


def _change(total: Array, axis: int) -> Array:
    """To whichever neighbour along an axis it is larger; none along an axis of one node."""
    steps = np.abs(np.diff(total, axis=axis))
    none = np.zeros_like(total.take([0], axis))
    return np.maximum(np.concatenate([steps, none], axis), np.concatenate([none, steps], axis))


def _size(box: Sequence[Range]) -> float:
    return float(np.prod([high - low for low, high in box if low < high]))


def _interval(axis: Array, profile: Array, limit: float) -> Range:
    """Where a profile crosses its limit first and last, linearly between; the end of the axis where it does not."""
    inside = np.flatnonzero(profile <= limit)
    first, last = int(inside[0]), int(inside[-1])
    low, high = float(axis[first]), float(axis[last])
    if first > 0:
        low = float(np.interp(-limit, -profile[first - 1 : first + 1], axis[first - 1 : first + 1]))
    if last < len(axis) - 1:
        high = float(np.interp(limit, profile[last : last + 2], axis[last : last + 2]))
    return low, high


def _at_bounds(crossed: Sequence[Range], ranges: Sequence[Range]) -> tuple[str, ...]:
    """The ends of ranges that hold an interval: what lies beyond was not tried."""
    names = zip(("x", "depth", "offset"), crossed, ranges, strict=True)
    return tuple(
        f"{name} {end}"
        for name, found, asked in names
        if asked[0] < asked[1]
        for end, a, b in (("low", found[0], asked[0]), ("high", found[1], asked[1]))
        if abs(a - b) < _SAME_MM
    )


_SAME_MM = 1e-9
