"""The likeliest place of the receptor for each measure, with profile-likelihood limits.

Every measure has its own k and ε₀ at every place. The frame is that of all comparisons, x_indentor = position +
x_receptor, with the offset added where one is asked for; all places are judged over the same positions.
"""

from collections.abc import Sequence
from dataclasses import replace
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
from rig.compare.place.place_search import least, region
from rig.compare.place.whereabouts import PlaceRow, Whereabouts
from rig.compare.statistics import Flags, compared
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]

_STEPS_MM = np.array([0.05, 0.15, 0.05])
"""Of the first grid in x, depth and offset: profiles change within a tenth of a millimetre."""

_BLOCK = 400  # places that are fitted at once


class _Seen(NamedTuple):
    """What was recorded at the positions that all receptors in play cover, whatever the offset."""

    overlays: Sequence[Overlay]
    observed: Observed
    used: Flags
    in_play: Flags  # (nx,)
    where: PlaceRange  # x of those in play
    nodes: tuple[Array, Array]

    def nodes_at(self, measure: int, offset_mm: Array) -> Array:
        """(offsets, p, nd, nx) of a measure at the nodes in play."""
        each = [_at(p, measure, offset_mm) for p in self.overlays]
        values = np.concatenate(each, axis=1)[:, self.used]
        return values.reshape(*values.shape[:2], len(self.nodes[1]), -1)[..., self.in_play]

    def eps(self, measure: int, place: Array) -> Array:
        """(n, p) of a measure at places (n, 3)."""
        offset, which = np.unique(place[:, 2], return_inverse=True)
        of_x, of_depth = (spline_weights(nodes, place[:, n]) for n, nodes in enumerate(self.nodes))
        return np.einsum("npji,ni,nj->np", self.nodes_at(measure, offset)[which], of_x, of_depth, optimize=True)


def _at(overlay: Overlay, measure: int, offset_mm: Array) -> Array:
    """(offsets, p, receptors)."""
    one = replace(overlay.stimulus, measures=overlay.stimulus.measures[measure : measure + 1])
    position = overlay.recording.position_mm + offset_mm[:, None]
    return one.at(position.ravel())[0].reshape(*position.shape, -1)


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
    low, high = (np.array(ends) for ends in zip(*seen.where, strict=True))

    def fitted(place: Array) -> Likeliest:
        return likeliest(seen.eps(measure, place), seen.observed, form)

    def deviance(places: Array) -> Array:
        blocks = [places[n : n + _BLOCK] for n in range(0, len(places), _BLOCK)]
        return np.concatenate([fitted(block).total for block in blocks])

    best = least(deviance, low, high, _STEPS_MM)
    found = fitted(best[None])
    more, ratio, p_fit = _not_unlikely(seen, found, form)
    ends = region(deviance, best, low, high, float(found.total[0]) + more)
    intervals = [(float(a), float(b)) for a, b in zip(*ends, strict=True)]
    return PlaceRow(
        MEASURES[measure],
        x_mm=float(best[0]),
        depth_mm=float(best[1]),
        offset_mm=float(best[2]),
        x_interval=intervals[0],
        depth_interval=intervals[1],
        offset_interval=intervals[2],
        k=float(found.k[0]),
        eps0=float(found.eps0[0]),
        deviance=float(found.total[0] / seen.observed.noise.dispersion),
        lack_of_fit=ratio,
        p_fit=p_fit,
        at_bounds=_at_bounds(intervals, list(seen.where)),
    )


def _not_unlikely(seen: _Seen, found: Likeliest, form: Form) -> tuple[float, float, float]:
    """By how much the deviance may be above the least (as of k and ε₀), and F and p of that place's own fit."""
    free = form.parameters + seen.where.free
    ratio, p = lack_of_fit(seen.observed, found.mean, found.deviance, free)
    noise = seen.observed.noise
    freedom = min(noise.freedom * seen.observed.evenness, _KNOWN)
    more = noise.dispersion * max(float(ratio[0]), 1.0) * fdtri(1, freedom, 1 - LEVEL)
    return float(more), float(ratio[0]), float(p[0])


_KNOWN = 1e9


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
