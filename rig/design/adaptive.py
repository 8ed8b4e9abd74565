"""Adaptive choice of the next press: the most information per second, given the counts so far.

The rule keeps no state. The same counts, in the same order, give the same posterior and the same choice, so that a
resumed run continues as if it had not been interrupted.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.design.counts import TEN_MINUTES_S, CountModel
from rig.design.fibers import draw_fibers, log_rates, relative_rates
from rig.design.information import CountBins, count_bins
from rig.design.posterior import LEVEL, CandidatePosterior
from rig.design.press_times import PressTimes
from rig.design.presses import PossiblePress
from rig.design.response_table import ResponseTable

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NOTHING_BITS = 0.01
"""Information of the best press (bits) below which nothing more can be learned: a hundred such presses would make one
bit, and the estimate is no more accurate."""

CONFIRMED = 2
"""Counts in a row after which one candidate must have 95 %, so that no single count ends a session."""

DRAWS = 8192
PARTICLES, MOST_PARTICLES = 8192, 2048
"""Fibers by which the information is estimated: in all, and for each candidate that is still probable."""

_PROBABLE = 2e-3

ChoiceReason = Literal["first", "same_shape", "new_shape"]
EndReason = Literal["one_candidate", "nothing_to_learn", "no_time"]


class PressChoice(NamedTuple):
    """Next press: number, reason, expected information (bits), and time with a change of shape (s)."""

    press: int
    reason: ChoiceReason
    information_bits: float
    seconds: float


class End(NamedTuple):
    """End of the presses, and why."""

    reason: EndReason


class AdaptiveState(NamedTuple):
    """Progress of a session.

    Presses made, in order and with or without a count; time since the session began (s); the mounted shape; and the
    last counts, without a gap, after which one candidate had `LEVEL` of the probability.
    """

    made: tuple[int, ...]
    elapsed_s: float
    shape: str | None
    sure: int = 0


class SpikeCount(NamedTuple):
    """A press by its number, and its count of spikes; None if no count arrived."""

    press: int
    spikes: float | None


@dataclass(frozen=True, eq=False)
class AdaptiveRule:
    """Choice among the presses that may be made; the number of a press is its place in `presses`.

    `prior` is the state before the first count, and `minutes` the length of the session, with homing, rests and
    changes of shape. Start with `replayed`, then alternate `chosen` and `updated`.
    """

    candidates: tuple[str, ...]
    presses: tuple[PossiblePress, ...]
    times: PressTimes
    minutes: float
    prior: CandidatePosterior
    bins: CountBins
    particles: int
    seed: int

    @classmethod
    def of(
        cls,
        table: ResponseTable,
        candidates: Sequence[str],
        model: CountModel,
        times: PressTimes,
        minutes: float,
        *,
        seed: int = 1,
        draws: int = DRAWS,
        particles: int = PARTICLES,
    ) -> "AdaptiveRule":
        """Return the rule for the presses of a table, all of which may be made.

        `draws` fibers are drawn for each candidate; `particles`, shared among the candidates, estimate the
        information.
        """
        known = draw_fibers(draws, table, model.unknowns, seed + 23)
        log_rate = np.stack([log_rates(relative_rates(table, one, known)) for one in candidates])
        prior = CandidatePosterior.before(model, known, log_rate, minutes)
        return cls(tuple(candidates), table.presses, times, minutes, prior, count_bins(model), particles, seed)

    def replayed(
        self, counted: Iterable[SpikeCount], shape: str | None = None
    ) -> tuple[CandidatePosterior, AdaptiveState]:
        """Return posterior and state after these counts, in the order in which they were taken.

        `shape` is the mounted one, if no press was made.
        """
        posterior, state = self.prior, AdaptiveState((), self.times.first_s, shape)
        for one in counted:
            posterior, state = self.updated(posterior, state, one)
        return posterior, state

    def updated(
        self, posterior: CandidatePosterior, state: AdaptiveState, counted: SpikeCount
    ) -> tuple[CandidatePosterior, AdaptiveState]:
        """Return posterior and state after one more press."""
        shape = self.presses[counted.press].shape
        at_s = state.elapsed_s + self._change_s(state, shape)
        sure = state.sure
        if counted.spikes is not None:
            tau = (at_s - 30 * self.minutes) / TEN_MINUTES_S
            posterior = posterior.updated(counted.press, np.array([float(counted.spikes)]), tau)
            sure = sure + 1 if posterior.probabilities[0].max() >= LEVEL else 0
        ends_s = at_s + float(self.times.press_s[counted.press])
        return posterior, AdaptiveState((*state.made, counted.press), ends_s, shape, sure)

    def chosen(self, posterior: CandidatePosterior, state: AdaptiveState) -> PressChoice | End:
        """Return the next press, or why there is none."""
        probability = posterior.probabilities[0]
        if state.sure >= CONFIRMED:
            return End("one_candidate")
        change_s = np.array([self._change_s(state, press.shape) for press in self.presses])
        press_s = self.times.press_s
        left_s = 60 * self.minutes - state.elapsed_s
        fits = change_s + press_s <= left_s
        if not fits.any():
            return End("no_time")
        chance = np.random.default_rng([self.seed, len(state.made)])
        probable = int((probability > _PROBABLE).sum())
        particles = min(self.particles // max(probable, 1), MOST_PARTICLES)
        bits = posterior.information_bits(particles, chance, self.bins)
        bits = np.where(fits, bits, -np.inf)
        if bits.max() < NOTHING_BITS:
            return End("one_candidate" if probability.max() >= LEVEL else "nothing_to_learn")
        # A press right after itself would start from the deepest trace of its own history.
        again = np.arange(len(bits)) == (state.made[-1] if state.made else -1)
        if (fits & ~again).any():
            bits = np.where(again, -np.inf, bits)
        # A change of shape is shared by the presses that still fit after it, and have something left to tell.
        unknown_bits = -float((probability * np.log2(np.maximum(probability, 1e-12))).sum())
        after = np.minimum((left_s - change_s) / press_s, unknown_bits / np.maximum(bits, NOTHING_BITS))
        after = np.maximum(np.floor(after), 1.0)
        best = int(np.argmax(bits / (press_s + change_s / after)))
        shape = self.presses[best].shape
        reason: ChoiceReason = "first" if not state.made else "same_shape" if shape == state.shape else "new_shape"
        return PressChoice(best, reason, float(bits[best]), float(change_s[best] + press_s[best]))

    def _change_s(self, state: AdaptiveState, shape: str) -> float:
        return self.times.change_s if state.shape not in (None, shape) else 0.0
