"""Fit of a receptor's location to its recording, with profile-likelihood limits.

Every measure has its own k and ε₀ at every location. The frame is that of all comparisons, x_indentor = position +
x_receptor, plus an offset on request; all locations are compared over the same positions.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from rig.compare.candidate_measures import lack_of_fit
from rig.compare.comparison import Overlay, compare
from rig.compare.exceptions import ComparisonError
from rig.compare.fit import Flags, compared
from rig.compare.likelihood import Form, MaximumLikelihoodFits, Observed, maximum_likelihood, observed
from rig.compare.make_verdict import afferents
from rig.compare.place_grid import (
    PlaceRange,
    PlaceRow,
    Range,
    ReceptorLocation,
    finger_with_grid,
    nodes,
    place_range,
    spline_weights,
)
from rig.compare.recordings.recording import Recording
from rig.compare.stimuli import pressed, stimuli
from rig.compare.verdict import LEVEL
from rig.data import Run
from rig.plan.config import load_config
from sim.config import FingertipConfig
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip

# Minimum of a deviance over locations, and the confidence region around it.
#
# Deviances have slanting valleys, narrower than a grid of the whole range. So the best nodes of one are followed down
# by grids that shrink around the best location, and the region is found along rays from the minimum, in coordinates
# in which it would be round if the deviance were a parabola.

Array = NDArray[np.float64]
Deviance = Callable[[Array], Array]
"""(n,) values at locations (n, 3): x, depth and offset (mm)."""

_AROUND = np.linspace(-1.0, 1.0, 5)
_STARTS, _ROUNDS, _SHRUNK, _FINE_MM = 4, 60, 0.4, 1e-3
_FIRST_STEP_MM = 2e-3
_DIRECTIONS = 64
_RADII = np.concatenate([np.linspace(0.1, 2.0, 20), np.geomspace(2.2, 20.0, 10)])


def least(deviance: Deviance, low: Array, high: Array, steps: Array) -> Array:
    """Return the (3,) location in a box with the smallest deviance, starting from a grid with steps (3,)."""
    axes = [nodes((a, b), step) for a, b, step in zip(low, high, steps, strict=True)]
    grid = np.array(list(product(*axes)))
    total = deviance(grid)
    ended = [
        follow(deviance, start, low, high, steps) for start in _apart(grid[np.argsort(total, kind="stable")], steps)
    ]
    return ended[int(np.argmin(deviance(np.array(ended))))]


def _apart(ordered: Array, steps: Array) -> list[Array]:
    """Return the first few locations that are not neighbors of an earlier one."""
    taken: list[Array] = []
    for place in ordered:
        if all((np.abs(place - other) > 1.5 * steps).any() for other in taken):
            taken.append(place)
        if len(taken) == _STARTS:
            break
    return taken


def follow(deviance: Deviance, start: Array, low: Array, high: Array, steps: Array) -> Array:
    """Return the (3,) local minimum near a location: the grid moves while its edge is better, and else shrinks."""
    free = low < high
    around = np.array(list(product(*(_AROUND if one else [0.0] for one in free))))
    at, step, middle = start, steps.copy(), len(around) // 2
    for _ in range(_ROUNDS):
        tried = np.clip(at + around * step, low, high)
        total = deviance(tried)
        best = int(np.argmin(total))
        if not total[best] < total[middle]:
            best = middle  # on a plateau, stay
        if not (np.abs(around[best]) == 1).any():
            step = _SHRUNK * step
        at = tried[best]
        if (step[free] < _FINE_MM).all():
            break
    return at


def region(deviance: Deviance, best: Array, low: Array, high: Array, limit: float) -> tuple[Array, Array]:
    """Return (3,) lowest and highest x, depth and offset of the region around the minimum within a limit.

    Rays that reach an end of the box continue along it.
    """
    free = np.flatnonzero(low < high)
    rays = _rays(_round(deviance, best, low, high, limit), len(free))
    places = np.broadcast_to(best, (len(rays), len(_RADII), 3)).copy()
    places[..., free] += _RADII[:, None] * rays[:, None, :]
    places = np.clip(places, low, high)
    above = deviance(places.reshape(-1, 3)).reshape(places.shape[:2]) - limit
    here = float(deviance(best[None])[0]) - limit
    inside = [best]
    for along, excess in zip(places, above, strict=True):
        out = np.flatnonzero(excess > 0)
        last = int(out[0]) if len(out) else len(along)
        inside += list(along[:last])
        if len(out):
            before, was = (along[last - 1], excess[last - 1]) if last else (best, here)
            inside.append(before + (along[last] - before) * was / (was - excess[last]))
    return np.min(inside, axis=0), np.max(inside, axis=0)


def _round(deviance: Deviance, best: Array, low: Array, high: Array, limit: float) -> Array:
    """Return (free, free) columns from the minimum to the limit, as if the deviance were a parabola."""
    free = np.flatnonzero(low < high)
    room = limit - float(deviance(best[None])[0])
    steps = np.array([_until(deviance, best, axis, low, high, 0.5 * room) for axis in free])
    centre = best.copy()
    centre[free] = np.clip(best[free], low[free] + steps, high[free] - steps)
    stencil = np.array(list(product((-1, 0, 1), repeat=len(free))), dtype=float)
    places = np.repeat(centre[None], len(stencil), axis=0)
    places[:, free] += stencil * steps
    value = deviance(places)
    pairs = [(a, b) for a in range(len(free)) for b in range(a, len(free))]
    terms = np.stack([np.ones(len(stencil)), *stencil.T, *(stencil[:, a] * stencil[:, b] for a, b in pairs)], axis=1)
    found = np.linalg.lstsq(terms, value, rcond=None)[0][1 + len(free) :]
    curved = np.zeros((len(free), len(free)))
    for (a, b), one in zip(pairs, found, strict=True):
        curved[a, b] += 0.5 * one
        curved[b, a] += 0.5 * one
    bend, axes = np.linalg.eigh(curved)
    widest = float(np.max((high - low)[free] / steps))
    return steps[:, None] * axes * np.sqrt(room / np.maximum(bend, room / widest**2))


def _until(deviance: Deviance, best: Array, axis: np.int64, low: Array, high: Array, rise: float) -> float:
    """Return how far along an axis the deviance rises by `rise` on either side; at most a quarter of the range."""
    widest = 0.25 * (high - low)[axis]
    steps = _FIRST_STEP_MM * 1.5 ** np.arange(20)
    steps = np.append(steps[steps < widest], widest)
    places = np.repeat(best[None], 2 * len(steps), axis=0)
    places[:, axis] += np.concatenate([steps, -steps])
    there = deviance(np.clip(places, low, high)).reshape(2, -1).max(axis=0)
    enough = np.flatnonzero(there - deviance(best[None]) >= rise)
    return float(steps[enough[0]] if len(enough) else widest)


def _rays(columns: Array, free: int) -> Array:
    """Return (n, free) rays of the round region: evenly spread, plus those that lead farthest along each axis."""
    if free == 1:
        return np.array([columns[0], -columns[0]])
    even = _circle() if free == 2 else _sphere()
    farthest = columns / np.linalg.norm(columns, axis=1, keepdims=True)
    return np.asarray(np.concatenate([even, farthest, -farthest]) @ columns.T)


def _circle() -> Array:
    turn = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _sphere() -> Array:
    """Return directions on a spiral from pole to pole."""
    number = np.arange(_DIRECTIONS) + 0.5
    height, turn = 1 - 2 * number / _DIRECTIONS, np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - height**2)
    return np.asarray(np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1))


_STEPS_MM = np.array([0.05, 0.15, 0.05])
"""Spacing of the first grid in x, depth and offset (mm); profiles change within 0.1 mm."""

_BLOCK = 400  # locations fitted at once


class _Data(NamedTuple):
    """Recording at the positions that all receptors in play cover, for every offset."""

    overlays: Sequence[Overlay]
    observed: Observed
    used: Flags
    in_play: Flags  # (nx,)
    where: PlaceRange  # x of those in play
    nodes: tuple[Array, Array]

    def nodes_at(self, measure: int, offset_mm: Array) -> Array:
        """Return a measure (offsets, p, nd, nx) at the nodes in play."""
        each = [_at(p, measure, offset_mm) for p in self.overlays]
        values = np.concatenate(each, axis=1)[:, self.used]
        return values.reshape(*values.shape[:2], len(self.nodes[1]), -1)[..., self.in_play]

    def eps(self, measure: int, place: Array) -> Array:
        """Return a measure (n, p) at locations (n, 3)."""
        offset, which = np.unique(place[:, 2], return_inverse=True)
        of_x, of_depth = (spline_weights(nodes, place[:, n]) for n, nodes in enumerate(self.nodes))
        return np.einsum("npji,ni,nj->np", self.nodes_at(measure, offset)[which], of_x, of_depth, optimize=True)


def _at(overlay: Overlay, measure: int, offset_mm: Array) -> Array:
    """Return a measure (offsets, p, receptors)."""
    one = replace(overlay.stimulus, measures=overlay.stimulus.measures[measure : measure + 1])
    position = overlay.recording.position_mm + offset_mm[:, None]
    return one.at(position.ravel())[0].reshape(*position.shape, -1)


def receptor_location(
    overlays: Sequence[Overlay], where: PlaceRange, form: Form, measures: Sequence[str] = MEASURES
) -> ReceptorLocation | None:
    """Return the receptor location of one afferent, from stimuli with receptors at every node.

    None if too few positions are covered, or the afferent hardly fired. Raises ComparisonError if too few are covered
    with the offset.
    """
    data = _data(overlays, where)
    if data is None or data.observed.silent:
        return None
    rows = [_row(data, MEASURES.index(name), form) for name in measures]
    return ReceptorLocation(
        stimuli=tuple(overlay.stimulus.title for overlay in overlays),
        recordings=tuple(overlay.recording.name for overlay in overlays),
        positions=len(data.observed.rate),
        recorded=len(data.used),
        requested=where,
        where=data.where,
        rows=tuple(sorted(rows, key=lambda row: row.deviance)),
    )


def _data(overlays: Sequence[Overlay], where: PlaceRange) -> _Data | None:
    n_depths = len(where.depth_nodes)
    ends = [
        np.concatenate([p.stimulus.at(p.recording.position_mm + offset)[:1] for p in overlays], axis=1)
        for offset in where.offset_mm
    ]
    at_ends = ends[0] + ends[1]  # NaN if either end of the offset is not covered
    at_ends = at_ends.reshape(1, at_ends.shape[1], n_depths, -1)[:, :, 0]
    which = compared(at_ends)
    if which is None and where.offset_mm[0] < where.offset_mm[1]:
        raise ComparisonError(
            f"--offset-mm {where.offset_mm[0]:g},{where.offset_mm[1]:g}: the run covers too few recorded "
            "positions moved by these offsets; narrow the offset, or press a wider range",
            "offset_not_covered",
        )
    if which is None:
        return None
    in_play, used = which
    x = where.x_nodes[in_play]
    return _Data(
        overlays,
        observed([overlay.recording for overlay in overlays], used),
        used,
        in_play,
        where._replace(x_mm=(float(x[0]), float(x[-1]))),
        (x, where.depth_nodes),
    )


def _row(data: _Data, measure: int, form: Form) -> PlaceRow:
    low, high = (np.array(ends) for ends in zip(*data.where, strict=True))

    def fitted(place: Array) -> MaximumLikelihoodFits:
        return maximum_likelihood(data.eps(measure, place), data.observed, form)

    def deviance(places: Array) -> Array:
        blocks = [places[n : n + _BLOCK] for n in range(0, len(places), _BLOCK)]
        return np.concatenate([fitted(block).total for block in blocks])

    best = least(deviance, low, high, _STEPS_MM)
    found = fitted(best[None])
    more, ratio, p_fit = _not_unlikely(data, found, form)
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
        deviance=float(found.total[0] / data.observed.noise.dispersion),
        lack_of_fit=ratio,
        p_fit=p_fit,
        at_bounds=_at_bounds(intervals, list(data.where)),
    )


def _not_unlikely(data: _Data, found: MaximumLikelihoodFits, form: Form) -> tuple[float, float, float]:
    """Return the allowed rise of the deviance (for k and ε₀), and F and p of the fit at that location."""
    free = form.parameters + data.where.free
    ratio, p = lack_of_fit(data.observed, found.mean, found.deviance, free)
    noise = data.observed.noise
    freedom = min(noise.freedom * data.observed.evenness, _KNOWN)
    more = noise.dispersion * max(float(ratio[0]), 1.0) * fdtri(1, freedom, 1 - LEVEL)
    return float(more), float(ratio[0]), float(p[0])


_KNOWN = 1e9


def _at_bounds(crossed: Sequence[Range], ranges: Sequence[Range]) -> tuple[str, ...]:
    """Return the range ends inside an interval, beyond which nothing was searched."""
    names = zip(("x", "depth", "offset"), crossed, ranges, strict=True)
    return tuple(
        f"{name} {end}"
        for name, found, requested in names
        if requested[0] < requested[1]
        for end, a, b in (("low", found[0], requested[0]), ("high", found[1], requested[1]))
        if abs(a - b) < _SAME_MM
    )


_SAME_MM = 1e-9


class RequestedRanges(NamedTuple):
    """Requested ranges (mm); None means default depths and no offset."""

    x_mm: Range
    depth_mm: Range | None = None
    offset_mm: Range | None = None


def common_range(runs: Sequence[Run], sought: RequestedRanges) -> PlaceRange:
    """Return the range of the fit; raise ComparisonError unless it lies in one layer of every run's finger."""
    configs = [_finger(run) for run in runs]
    where = place_range(*sought, configs[0])
    for config in configs[1:]:
        place_range(where.x_mm, where.depth_mm, sought.offset_mm, config)
    return where


def refuse_uncovered(
    runs: Sequence[Run], recordings: Mapping[str, Recording], where: PlaceRange, *, normalize: bool
) -> None:
    """Refuse an offset with which the runs cover too few positions, before anything is solved."""
    nodes_mm = np.tile(where.x_nodes, len(where.depth_nodes)).tolist()
    on_grid = [one for run in runs for one in pressed(run, nodes_mm)]
    for overlays in afferents(compare(on_grid, recordings, normalize=normalize)):
        _data(overlays, where)


def places(
    runs: Sequence[Run], recordings: Mapping[str, Recording], where: PlaceRange, form: Form, *, normalize: bool
) -> list[ReceptorLocation]:
    """Return one location per afferent, in the order of the verdicts, if enough positions are covered."""
    fingers: dict[str, Fingertip] = {}
    for config in map(_finger, runs):
        name = config.model_dump_json()
        fingers[name] = fingers.get(name) or finger_with_grid(config, where)
    on_grid = [one for run in runs for one in stimuli(run, fingers[_finger(run).model_dump_json()])]
    laid = afferents(compare(on_grid, recordings, normalize=normalize))
    return [found for overlays in laid if (found := receptor_location(overlays, where, form)) is not None]


def _finger(run: Run) -> FingertipConfig:
    return load_config(run.folder.path / "config.toml").finger
