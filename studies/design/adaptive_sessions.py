"""Simulated sessions in which the adaptive rule chooses press by press, on fibers that are not among its draws."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from rig.design.adaptive import AdaptiveRule, PressChoice, SpikeCount
from rig.design.confusion import LEFT_OVER
from rig.design.counts import TEN_MINUTES_S, CountModel, draw_counts
from rig.design.fibers import draw_fibers, relative_rates
from rig.design.posterior import in_set
from rig.design.press_times import PressTimes
from rig.design.response_table import ResponseTable

Array = NDArray[np.float64]


class Session(NamedTuple):
    """A session: number of the true candidate, probabilities at its end, presses, why it ended, and minutes."""

    truth: int
    probability: Array
    presses: int
    ended: str
    minutes: float

    @property
    def kept(self) -> bool:
        """Whether the truth is in the set."""
        return bool(in_set(self.probability[None])[0, self.truth])

    @property
    def failed(self) -> bool:
        """Whether the truth is not in the set, or too many candidates are."""
        return not self.kept or int(in_set(self.probability[None])[0].sum()) > LEFT_OVER

    @property
    def right(self) -> bool:
        """Whether the truth is the most probable candidate."""
        return int(self.probability.argmax()) == self.truth


def simulated(
    table: ResponseTable,
    times: PressTimes,
    model: CountModel,
    candidates: Sequence[str],
    minutes: float,
    sets: int,
    seed: int,
    numbers: Sequence[int],
) -> list[Session]:
    """Return some of so many sessions, in which each candidate is true in turn."""
    with threadpool_limits(1):
        rule = AdaptiveRule.of(table, candidates, model, times, minutes)
        fibers = draw_fibers(sets, table, model.unknowns, seed, evenly=False)
        truth = np.arange(sets) % len(candidates)
        rates = np.stack([relative_rates(table, name, fibers) for name in candidates])[truth, np.arange(sets)]
        gain = model.draw_gains(sets, np.random.default_rng([seed, 1]))
        mean = model.window_s * gain[:, None] * rates
        dispersion = model.unknowns.dispersions[fibers.level]
        return [
            _session(rule, int(truth[s]), mean[s], float(fibers.drift[s]), float(dispersion[s]), [seed, 2, int(s)])
            for s in numbers
        ]


def _session(
    rule: AdaptiveRule, truth: int, mean: Array, drift: float, dispersion: float, seed: list[int]
) -> Session:
    chance = np.random.default_rng(seed)
    posterior, state = rule.replayed([])
    while isinstance(choice := rule.chosen(posterior, state), PressChoice):
        at_s = state.elapsed_s + choice.seconds - float(rule.times.press_s[choice.press])
        tau = (at_s - 30 * rule.minutes) / TEN_MINUTES_S
        count = draw_counts(mean[[choice.press]] * np.exp(drift * tau), dispersion, chance)[0]
        posterior, state = rule.updated(posterior, state, SpikeCount(choice.press, float(count)))
    return Session(truth, posterior.probabilities[0], len(state.made), choice.reason, state.elapsed_s / 60)
