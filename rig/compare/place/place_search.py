"""The least of a deviance over places, and the region about it that is not unlikely.

Deviances have narrow, slanting valleys, narrower than a grid of the whole range: the best nodes of one are followed
down by grids that shrink about the best place, and the region is looked for along rays from the least, in coordinates
in which it would be round if the deviance were a parabola.
"""

from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rig.compare.place.place_grid import nodes

Array = NDArray[np.float64]
Deviance = Callable[[Array], Array]
"""(n,) of places (n, 3): x, depth and offset in mm."""

_AROUND = np.linspace(-1.0, 1.0, 5)
_STARTS, _ROUNDS, _SHRUNK, _FINE_MM = 4, 60, 0.4, 1e-3
_FIRST_STEP_MM = 2e-3
_DIRECTIONS = 64
_RADII = np.concatenate([np.linspace(0.1, 2.0, 20), np.geomspace(2.2, 20.0, 10)])


def least(deviance: Deviance, low: Array, high: Array, steps: Array) -> Array:
    """(3,) the place in a box with the least deviance, from the best nodes of a grid with steps (3,) on."""
    axes = [nodes((a, b), step) for a, b, step in zip(low, high, steps, strict=True)]
    grid = np.array(list(product(*axes)))
    total = deviance(grid)
    ended = [
        follow(deviance, start, low, high, steps) for start in _apart(grid[np.argsort(total, kind="stable")], steps)
    ]
    return ended[int(np.argmin(deviance(np.array(ended))))]


def _apart(ordered: Array, steps: Array) -> list[Array]:
    """The first few places that are no neighbours of one that was taken."""
    taken: list[Array] = []
    for place in ordered:
        if all((np.abs(place - other) > 1.5 * steps).any() for other in taken):
            taken.append(place)
        if len(taken) == _STARTS:
            break
    return taken


def follow(deviance: Deviance, start: Array, low: Array, high: Array, steps: Array) -> Array:
    """(3,) downhill from a place: the grid about it moves along while its edge is better, and shrinks where not."""
    free = low < high
    around = np.array(list(product(*(_AROUND if one else [0.0] for one in free))))
    at, step, middle = start, steps.copy(), len(around) // 2
    for _ in range(_ROUNDS):
        tried = np.clip(at + around * step, low, high)
        total = deviance(tried)
        best = int(np.argmin(total))
        if not total[best] < total[middle]:
            best = middle  # level ground leads nowhere
        if not (np.abs(around[best]) == 1).any():
            step = _SHRUNK * step
        at = tried[best]
        if (step[free] < _FINE_MM).all():
            break
    return at


def region(deviance: Deviance, best: Array, low: Array, high: Array, limit: float) -> tuple[Array, Array]:
    """(3,) lowest and highest x, depth and offset at which the deviance, from the least on, is within a limit.

    Rays that meet an end of the box go on along it.
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
    """(free, free) columns that lead from the least to the limit, were the deviance a parabola."""
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
    """How far along an axis the deviance rises by so much, on either side; a quarter of the range at most."""
    widest = 0.25 * (high - low)[axis]
    steps = _FIRST_STEP_MM * 1.5 ** np.arange(20)
    steps = np.append(steps[steps < widest], widest)
    places = np.repeat(best[None], 2 * len(steps), axis=0)
    places[:, axis] += np.concatenate([steps, -steps])
    there = deviance(np.clip(places, low, high)).reshape(2, -1).max(axis=0)
    enough = np.flatnonzero(there - deviance(best[None]) >= rise)
    return float(steps[enough[0]] if len(enough) else widest)


def _rays(columns: Array, free: int) -> Array:
    """(n, free) vectors of the round region: spread evenly, and those that lead farthest along each axis."""
    if free == 1:
        return np.array([columns[0], -columns[0]])
    even = _circle() if free == 2 else _sphere()
    farthest = columns / np.linalg.norm(columns, axis=1, keepdims=True)
    return np.asarray(np.concatenate([even, farthest, -farthest]) @ columns.T)


def _circle() -> Array:
    turn = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _sphere() -> Array:
    """A spiral from pole to pole."""
    number = np.arange(_DIRECTIONS) + 0.5
    height, turn = 1 - 2 * number / _DIRECTIONS, np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - height**2)
    return np.asarray(np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1))
