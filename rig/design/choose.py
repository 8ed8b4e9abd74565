"""Choice of presses: greedy by information per second over simulated data, then exchange.

Every step asks what one more press would tell, averaged over data sets in which each candidate is true in turn.
Presses come in blocks, one for each shape, since a change of indentor takes long; the shapes are chosen by coarse
designs of every few of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.design.counts import CountModel, CountSums, draw_counts
from rig.design.exceptions import DesignError
from rig.design.fibers import FiberDraws, draw_fibers, log_rates, relative_rates
from rig.design.information import CountBins, count_bins, information_bits, probabilities
from rig.design.press_times import PressTimes
from rig.design.response_table import ResponseTable

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Ints = NDArray[np.int64]

MOST_REPEATS = 16
"""Maximum number of times that a design makes one press."""

_MOST_SHAPES = 3  # of which every combination is tried
_TRIED_OUT = 5  # presses that a round of exchange tries to do without


class Effort(NamedTuple):
    """Size of the computation: fibers per candidate, data sets by which designs are compared, those by which presses
    are chosen, particles, steps of a design and of a coarse one, rounds of exchange.
    """

    draws: int = 2048
    compared: int = 144
    sets: int = 36
    particles: int = 40
    steps: int = 16
    coarse_sets: int = 18
    coarse_steps: int = 5
    exchanges: int = 4


QUICK = Effort(draws=1024, compared=72, sets=18, particles=24, steps=6, coarse_sets=12, coarse_steps=2, exchanges=0)
"""Effort of `--quick`."""


class AddedPresses(NamedTuple):
    """Presses added at once, by number, and the information of the design with them (bits)."""

    presses: tuple[int, ...]
    bits: float


@dataclass(frozen=True, eq=False)
class ChosenPresses:
    """A design: repeats of every press, its shapes in order of their blocks, and how it grew."""

    repeats: Ints
    shapes: tuple[str, ...]
    steps: tuple[AddedPresses, ...]
    bits: float
    added_bits: Array  # (presses,) what one more of each would add (bits)
    exchanged: int = 0


@dataclass(frozen=True, eq=False)
class _Data:
    """Simulated data: sums of counts, of y ln y − y, and numbers of nonzero counts after each number of repeats.

    Arrays (s, presses, repeats + 1); `truth` (s,) numbers of candidates.
    """

    truth: Ints
    counts: Array
    scatter: Array
    fired: Array

    def sums(self, repeats: Ints, sets: int | None = None) -> CountSums:
        """Return the sums of the counts of a design."""
        press = np.arange(len(repeats))
        by_press, scatter, fired = (one[:sets, press, repeats] for one in (self.counts, self.scatter, self.fired))
        late = repeats[:, None].astype(float)
        return CountSums(by_press, scatter.sum(axis=1), fired.sum(axis=1), np.zeros(len(by_press)), late, np.zeros(1))


class PressChooser:
    """Choice among the presses of a table."""

    def __init__(
        self,
        table: ResponseTable,
        candidates: Sequence[str],
        model: CountModel,
        times: PressTimes,
        effort: Effort,
        seed: int,
    ) -> None:
        self.table, self.candidates, self.model, self.times, self.effort = table, candidates, model, times, effort
        self._chance = np.random.default_rng(seed)
        self.draws: FiberDraws = draw_fibers(effort.draws, table, model.unknowns, seed)
        self.log_rate: Floats = np.stack([log_rates(relative_rates(table, c, self.draws)) for c in candidates])
        self._bins: CountBins = count_bins(model)
        self._data = self._simulated(seed + 1)
        self._of_shape = np.array([press.shape for press in table.presses])

    def _simulated(self, seed: int) -> _Data:
        """Return data of fibers that are not among the draws."""
        sets = -(-self.effort.compared // len(self.candidates)) * len(self.candidates)
        truth = np.arange(sets) % len(self.candidates)
        fibers = draw_fibers(sets, self.table, self.model.unknowns, seed, evenly=False)
        rates = np.stack([relative_rates(self.table, c, fibers) for c in self.candidates])[truth, np.arange(sets)]
        gain = self.model.draw_gains(sets, self._chance)
        mean = np.repeat((self.model.window_s * gain[:, None] * rates)[..., None], MOST_REPEATS, axis=2)
        dispersion = self.model.unknowns.dispersions[fibers.level][:, None, None]
        counts = draw_counts(mean, dispersion, self._chance)
        with np.errstate(divide="ignore", invalid="ignore"):
            scatter = np.where(counts > 0, counts * np.log(counts) - counts, 0.0)
        return _Data(truth, *(_cumulated(one) for one in (counts, scatter, (counts > 0).astype(float))))

    def chosen(self, minutes: float, shapes: Sequence[str], progress: Callable[[int, int], None]) -> ChosenPresses:
        """Return the design for a session of `minutes` with the given shapes."""
        grown = self._greedy(shapes, minutes, self.effort.steps, self.effort.sets, progress)
        return self._exchanged(grown, minutes, progress)

    def coarse(
        self, minutes: float, combinations_of_shapes: Sequence[tuple[str, ...]], progress: Callable[[int, int], None]
    ) -> ChosenPresses:
        """Return the coarse design with the most information, over combinations of shapes.

        Raises DesignError if there is no time for one press.
        """
        shortest_s = float(self.times.press_s.min())
        fitting = [some for some in combinations_of_shapes if self._room_s(some, minutes) >= shortest_s]
        if not fitting:
            raise DesignError(
                f"{minutes:g} minutes are too short: one press, with homing and zeroing, takes "
                f"{self.times.first_s + shortest_s:.0f} s",
                "too_few_minutes",
            )
        found = []
        for n, some in enumerate(fitting):
            progress(n, len(fitting))
            found.append(self._greedy(some, minutes, self.effort.coarse_steps, self.effort.coarse_sets, _unseen))
        return max(found, key=lambda one: one.bits)

    def bits(self, repeats: Ints, sets: int | None = None) -> float:
        """Return the information of a design (bits), by nested Monte Carlo over common draws."""
        return self._bits_of(self._likelihood(self._data.sums(repeats, sets)), sets)

    def _room_s(self, shapes: Sequence[str], minutes: float) -> float:
        return 60 * minutes - self.times.session_s((), len(shapes))

    def _likelihood(self, sums: CountSums) -> Floats:
        return np.stack([self.model.log_likelihood(sums, one, self.draws) for one in self.log_rate])

    def _bits_of(self, likelihood: Floats, sets: int | None = None) -> float:
        truth = self._data.truth[:sets]
        right = probabilities(likelihood)[np.arange(len(truth)), truth]
        return float(np.log2(np.maximum(right, 1e-6)).mean() + np.log2(len(self.candidates)))

    def _greedy(
        self,
        shapes: Sequence[str],
        minutes: float,
        steps: int,
        sets: int,
        progress: Callable[[int, int], None],
    ) -> ChosenPresses:
        mine = np.flatnonzero(np.isin(self._of_shape, list(shapes)))
        cost, room = self.times.press_s, self._room_s(shapes, minutes)
        batch = max(1, round(room / float(cost[mine].mean()) / steps))
        repeats = np.zeros(len(cost), dtype=np.int64)
        grown: list[AddedPresses] = []
        likelihood = self._likelihood(self._data.sums(repeats, sets))
        bits = 0.0
        while True:
            sums = self._data.sums(repeats, sets)
            added_bits = information_bits(
                self.model, self._bins, sums, self.log_rate, self.draws, likelihood, self._particles(sets),
                self._chance, mine,
            )  # fmt: skip
            added = self._best(added_bits / cost, mine, repeats, room, batch)
            if not added:
                break
            for k in added:
                repeats[k] += 1
                room -= cost[k]
            likelihood = self._likelihood(self._data.sums(repeats, sets))
            bits = self._bits_of(likelihood, sets)
            grown.append(AddedPresses(tuple(added), bits))
            progress(len(grown), steps)
        used = tuple(shape for shape in shapes if repeats[self._of_shape == shape].any())
        return ChosenPresses(repeats, used, tuple(grown), self.bits(repeats), added_bits)

    def _particles(self, sets: int) -> int:
        return self.effort.particles if sets >= self.effort.sets else self.effort.particles // 2

    def _best(self, worth: Array, mine: Ints, repeats: Ints, room: float, batch: int) -> list[int]:
        """Return the best presses at different places, as many as a batch and the time allow."""
        added: list[int] = []
        places: set[tuple[str, float]] = set()
        for k in mine[np.argsort(-worth[mine], kind="stable")]:
            press = self.table.presses[k]
            place = press.shape, press.x_mm
            if place in places or repeats[k] >= MOST_REPEATS or self.times.press_s[k] > room:
                continue
            places.add(place)
            added.append(int(k))
            room -= self.times.press_s[k]
            if len(added) == batch:
                break
        return added

    def _exchanged(
        self, chosen: ChosenPresses, minutes: float, progress: Callable[[int, int], None]
    ) -> ChosenPresses:
        """Replace presses of little information by others, as long as the information grows on the same data."""
        repeats, bits, exchanged, added_bits = chosen.repeats.copy(), chosen.bits, 0, chosen.added_bits
        mine = np.flatnonzero(np.isin(self._of_shape, list(chosen.shapes)))
        for n in range(self.effort.exchanges):
            progress(n, self.effort.exchanges)
            # Presses that would tell least if made once more are most likely to be missed least.
            made = np.flatnonzero(repeats)
            least = made[np.argsort(added_bits[made] / self.times.press_s[made])[:_TRIED_OUT]]
            without = np.array([self.bits(_with(repeats, k, -1)) for k in least])
            out = int(least[np.argmax(without)])
            base = _with(repeats, out, -1)
            sums = self._data.sums(base, self.effort.sets)
            added_bits = information_bits(
                self.model, self._bins, sums, self.log_rate, self.draws, self._likelihood(sums),
                self.effort.particles, self._chance, mine,
            )  # fmt: skip
            room = self._room_s(chosen.shapes, minutes) - float(self.times.press_s @ base)
            into = self._best(added_bits / self.times.press_s, mine, base, room, 3)
            tried = {k: self.bits(_with(base, k, 1)) for k in into}
            best = max(tried, key=tried.__getitem__, default=out)
            if not tried or tried[best] <= bits or best == out:
                break
            repeats, bits, exchanged = _with(base, best, 1), tried[best], exchanged + 1
        return ChosenPresses(repeats, chosen.shapes, chosen.steps, bits, added_bits, exchanged)


def _unseen(done: int, total: int) -> None:
    """Show no progress."""


def _with(repeats: Ints, press: int, more: int) -> Ints:
    changed = repeats.copy()
    changed[press] += more
    return changed


def _cumulated(values: Array) -> Array:
    """Return (s, presses, repeats + 1) sums over the first repeats."""
    return np.concatenate([np.zeros((*values.shape[:2], 1)), np.cumsum(values, axis=2)], axis=2)


def some_of(shapes: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the combinations of up to three shapes."""
    return [some for n in range(1, min(len(shapes), _MOST_SHAPES) + 1) for some in combinations(shapes, n)]
