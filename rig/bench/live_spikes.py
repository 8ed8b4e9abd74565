"""Spikes of a population from the poses of an indentor, as these become known.

The measure at each receptor follows the indentor's way past first contact by a table for each place, of presses that
somebody else makes while the indentor comes to rest above it. Time stands still for the afferents while they are
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
from sim.nerve.skin import LEVELS

Array = NDArray[np.float64]

SAMPLE_S = 5 * MOST_STEP_S
"""Time between poses (s)."""
PATIENCE_S = 60.0
"""Longest wait for a table in contact (s); after it, the place has no spikes."""
_KNOWN = 256
_DECIMALS = 4
_LONGEST = 21  # poses at once: within them the indentor hardly moves on


class IndentorPlace(NamedTuple):
    """A place of the indentor: across the finger, and along it from the receptor plane (mm)."""

    x_mm: float
    along_mm: float


class PressWanted(NamedTuple):
    """A press for the table of a place, to a depth (mm)."""

    place: IndentorPlace
    doi_mm: float


class PressMade(NamedTuple):
    """First contact above the apex and the way past it at a depth (mm), and the measure of each afferent there.

    touch_mm is -inf beside the finger; problem says why there is no press.
    """

    wanted: PressWanted
    touch_mm: float = -np.inf
    way_mm: float = 0.0
    values: Array = np.empty(0)
    problem: str = ""


class _Table:
    """Measures of all afferents against the way past first contact; none without presses."""

    def __init__(self, presses: list[PressMade], problem: str = "") -> None:
        self.problem = problem
        self.touch_mm = presses[0].touch_mm if presses else -np.inf
        if presses:
            ways = np.concatenate([[0.0], [one.way_mm for one in presses]])
            values = np.stack([one.values for one in presses])
            self._value = PchipInterpolator(ways, np.concatenate([np.zeros((1, values.shape[1])), values]))
            self._farthest_mm = float(ways[-1])

    def values(self, above_mm: Array) -> Array:
        """Return the measures, (n_afferents, n_samples), at heights above the apex."""
        return np.asarray(self._value(np.clip(self.touch_mm - above_mm, 0.0, self._farthest_mm)).T)


class LiveSpikes:
    """Spikes of a population from the poses of an indentor.

    Parameters
    ----------
    afferents : AfferentPopulation
        The afferents.
    deepest_mm : float
        Depth of the deepest press of a table (mm).
    ask : callable
        Called with the next press that is wanted; `take` gets the answer. There is one at a time.
    complain : callable, optional
        Called with one line about a place without spikes.
    """

    def __init__(
        self,
        afferents: AfferentPopulation,
        deepest_mm: float,
        ask: Callable[[PressWanted], object],
        complain: Callable[[str], object] = print,
    ) -> None:
        self._ask, self._complain = ask, complain
        self._depths_mm = [float(mm) for mm in deepest_mm * np.linspace(0.0, 1.0, LEVELS + 1)[1:]]
        self._count = len(afferents)
        self._groups = [
            (np.array(mine), stream_of(afferents.models[name], [afferents[k] for k in mine]))
            for name, mine in afferents.groups.items()
        ]
        self._origin_s: float | None = None
        self._done = -1  # last sample of the signal
        self._poses: list[tuple[float, float, float, float]] = []  # time, x, height, along; the first is done
        self._tables: OrderedDict[IndentorPlace, _Table] = OrderedDict()
        self._asked: PressWanted | None = None
        self._made: list[PressMade] = []

    def known(self, t_s: float, x_mm: float, above_mm: float, along_mm: float) -> None:
        """Take the next pose of the indentor: its time (s, any clock), place and height above the apex (mm)."""
        if self._origin_s is None:
            self._origin_s = t_s
        self._poses.append((t_s, x_mm, above_mm, along_mm))

    def take(self, made: PressMade) -> None:
        """Take a press, and ask for the next one of the table."""
        wanted, self._asked = self._asked, None
        if wanted is None or made.wanted != wanted:
            return
        place = wanted.place
        if made.problem or made.touch_mm == -np.inf:
            self._finish(place, made.problem)
            return
        self._made.append(made)
        if len(self._made) == len(self._depths_mm):
            self._finish(place)
        elif self._resting() == place:
            self._want(PressWanted(place, self._depths_mm[len(self._made)]))

    def advance(self) -> tuple[NDArray[np.intp], Array]:
        """Return the afferents and times (s, clock of the poses) of the spikes that are now known."""
        who, times = [np.empty(0, dtype=np.intp)], [np.empty(0)]
        while len(self._poses) > 1 or self._done < 0 < len(self._poses):
            block = self._block(self._poses[:_LONGEST])
            if block is None:
                break
            for mine, stream in self._groups:
                found, found_s = stream.advance(block[mine])
                who.append(mine[found])
                times.append(found_s)
            del self._poses[: min(_LONGEST, len(self._poses)) - 1]
            self._done += block.shape[1]
        return np.concatenate(who), (self._origin_s or 0.0) + np.concatenate(times)

    def _block(self, poses: list[tuple[float, float, float, float]]) -> Array | None:
        """Return the signal up to the last pose; None while a table is missing."""
        t, _, above, _ = np.array(poses).T
        assert self._origin_s is not None
        newest = round((t[-1] - self._origin_s) / MOST_STEP_S)
        grid = self._origin_s + MOST_STEP_S * np.arange(self._done + 1, newest + 1)
        signal = np.zeros((self._count, len(grid)))
        place = self._resting(poses)
        if place is None:
            return signal
        table = self._tables.get(place)
        if table is None and self._asked is None:
            self._made = []
            self._want(PressWanted(place, self._depths_mm[0]))
        if above.min() > 0:  # nothing of the finger is above its apex
            return signal
        if table is None:
            if self._poses[-1][0] - t[0] < PATIENCE_S:
                return None
            self._made = []
            table = self._finish(place, f"the finger was not pressed within {PATIENCE_S:g} s")
        if table.problem:
            self._complain(f"no spikes at x = {place.x_mm:g} mm: {table.problem}")
            table.problem = ""
        if table.touch_mm > above.min():
            signal[:] = table.values(np.interp(grid, t, above))
        return signal

    def _resting(self, poses: list[tuple[float, float, float, float]] | None = None) -> IndentorPlace | None:
        """Return the place of the indentor; None while it moves across the finger or along it."""
        poses = poses or self._poses[-2:]
        first, last = poses[0], poses[-1]
        places = {IndentorPlace(round(one[1], _DECIMALS), round(one[3], _DECIMALS)) for one in (first, last)}
        return places.pop() if len(places) == 1 else None

    def _want(self, wanted: PressWanted) -> None:
        self._asked = wanted
        self._ask(wanted)

    def _finish(self, place: IndentorPlace, problem: str = "") -> _Table:
        """Store the table of a place; presses before one that failed count."""
        table = self._tables[place] = _Table(self._made, "" if self._made else problem)
        self._made = []
        if len(self._tables) > _KNOWN:
            self._tables.popitem(last=False)
        return table
