"""Spikes of a population from the poses of an indentor, as these become known.

The measure at each end organ follows from the depth past first contact by a table for each place. Another process
makes its presses while the indentor comes to rest above the place. Time stands still for the afferents while they are
pressed at a place whose table is not complete: their spikes are late, not wrong.
"""

from collections import OrderedDict
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from rig.plan.nerve import stream_of
from sim.nerve.integrator import MOST_STEP_S
from sim.nerve.population import AfferentPopulation

Array = NDArray[np.float64]

SAMPLE_S = 5 * MOST_STEP_S
"""Time between poses (s)."""
PATIENCE_S = 60.0
"""Longest wait for a table in contact (s); after it, the place has no spikes."""
GAP_S = 2.0
"""Time without a pose after which the bench was suspended: it is left out."""
_KNOWN = 256
_DECIMALS = 4
_LONGEST = 21  # poses at once: within them the indentor hardly moves on


class IndentorPlace(NamedTuple):
    """A place of the indentor: across the finger, and along it from the receptor plane (mm)."""

    x_mm: float
    along_mm: float


class PlaceTable(NamedTuple):
    """Presses at a place: first contact above the apex, the way past it (mm), and the measure at each end organ.

    Without presses nothing is known of the place: touch_mm is -inf beside the finger, problem says why it failed.
    """

    place: IndentorPlace
    touch_mm: float = -np.inf
    ways_mm: tuple[float, ...] = ()
    values: Array = np.empty((0, 0))  # (n_presses, n_organs of all afferents)
    problem: str = ""


class _Table:
    """Measures at all end organs against the way past first contact; none without presses."""

    def __init__(self, made: PlaceTable) -> None:
        self.problem, self.touch_mm = made.problem, -np.inf
        if made.ways_mm:
            self.touch_mm, self._farthest_mm = made.touch_mm, made.ways_mm[-1]
            values = np.concatenate([np.zeros((1, made.values.shape[1])), made.values])
            self._value = PchipInterpolator([0.0, *made.ways_mm], values)

    def values(self, above_mm: Array) -> Array:
        """Return the measures, (n_organs of all afferents, n_samples), at heights above the apex."""
        return np.asarray(self._value(np.clip(self.touch_mm - above_mm, 0.0, self._farthest_mm)).T)


class LiveSpikes:
    """Spikes of a population from the poses of an indentor.

    Parameters
    ----------
    afferents : AfferentPopulation
        The afferents.
    ask : callable
        Called with a place whose table is wanted; `take` gets the answer. There is one at a time.
    complain : callable, optional
        Called with one line about a place without spikes.
    """

    def __init__(
        self,
        afferents: AfferentPopulation,
        ask: Callable[[IndentorPlace], object],
        complain: Callable[[str], object] = print,
    ) -> None:
        self._ask, self._complain = ask, complain
        self._count = sum(map(len, afferents.organs))
        self._groups = [
            (
                np.array(mine),
                afferents.organs_of(mine),
                stream_of(afferents.models[name], [afferents[k] for k in mine]),
            )
            for name, mine in afferents.groups.items()
        ]
        self._origin_s: float | None = None
        self._lost_s = 0.0  # while the bench was suspended
        self._done = -1  # last sample of the signal
        self._poses: list[tuple[float, float, float, float]] = []  # time, x, height, along; the first is done
        self._tables: OrderedDict[IndentorPlace, _Table] = OrderedDict()
        self._asked: IndentorPlace | None = None

    def known(self, t_s: float, x_mm: float, above_mm: float, along_mm: float) -> None:
        """Take the next pose of the indentor: its time (s, any clock), place and height above the apex (mm)."""
        if self._origin_s is None:
            self._origin_s = t_s
        if self._poses and (gap_s := t_s - self._lost_s - self._poses[-1][0]) > GAP_S:
            self._lost_s += gap_s - SAMPLE_S
        self._poses.append((t_s - self._lost_s, x_mm, above_mm, along_mm))

    def take(self, made: PlaceTable) -> None:
        """Take a table."""
        if made.place == self._asked:
            self._asked = None
        self._store(made)

    def advance(self) -> tuple[NDArray[np.intp], Array]:
        """Return the afferents and times (s, clock of the poses) of the spikes that the known poses determine."""
        who, times = [np.empty(0, dtype=np.intp)], [np.empty(0)]
        while len(self._poses) > 1 or self._done < 0 < len(self._poses):
            block = self._block(self._poses[:_LONGEST])
            if block is None:
                break
            for mine, organs, stream in self._groups:
                found, found_s = stream.advance(block[organs])
                who.append(mine[found])
                times.append(found_s)
            del self._poses[: min(_LONGEST, len(self._poses)) - 1]
            self._done += block.shape[1]
        return np.concatenate(who), (self._origin_s or 0.0) + self._lost_s + np.concatenate(times)

    def _block(self, poses: list[tuple[float, float, float, float]]) -> Array | None:
        """Return the signal up to the last pose; None while a table is missing."""
        t, _, above, _ = np.array(poses).T
        assert self._origin_s is not None
        newest = round((t[-1] - self._origin_s) / MOST_STEP_S)
        grid = self._origin_s + MOST_STEP_S * np.arange(self._done + 1, newest + 1)
        signal = np.zeros((self._count, len(grid)))
        place = _resting(poses)
        if place is None:
            return signal
        table = self._tables.get(place)
        if table is None and self._asked is None:
            self._asked = place
            self._ask(place)
        if above.min() > 0:  # nothing of the finger is above its apex
            return signal
        if table is None:
            if self._poses[-1][0] - t[0] < PATIENCE_S:
                return None
            table = self._store(PlaceTable(place, problem=f"the finger was not pressed within {PATIENCE_S:g} s"))
        if table.problem:
            self._complain(f"no spikes at x = {place.x_mm:g} mm: {table.problem}")
            table.problem = ""
        if table.touch_mm > above.min():
            signal[:] = table.values(np.interp(grid, t, above))
        return signal

    def _store(self, made: PlaceTable) -> _Table:
        table = self._tables[made.place] = _Table(made)
        if len(self._tables) > _KNOWN:
            self._tables.popitem(last=False)
        return table


def _resting(poses: list[tuple[float, float, float, float]]) -> IndentorPlace | None:
    """Return the place of the indentor; None while it moves across the finger or along it."""
    first, last = (IndentorPlace(round(one[1], _DECIMALS), round(one[3], _DECIMALS)) for one in (poses[0], poses[-1]))
    return first if first == last else None
