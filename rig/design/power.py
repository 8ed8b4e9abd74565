"""Sample sizes: how many fibers and minutes distinguish the candidates in four of five experiments."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rig.design.confusion import LEFT_OVER, Confusion
from rig.design.posterior import in_set

Array = NDArray[np.float64]

POWER = 0.8
FIBERS = (1, 2, 3, 4, 6, 8, 12)
_DRAWN = 400


class PowerRow(NamedTuple):
    """Success rate with a number of fibers, each recorded for the same time.

    `few` is the share of experiments whose set has the truth and at most one other candidate, `one` of those whose
    set is the truth alone; with Monte Carlo errors. `repeats` is the mean number of times that a press is made.
    """

    minutes: float
    presses: int
    repeats: float
    fibers: int
    few: float
    few_error: float
    one: float
    one_error: float


def power_rows(outcomes: Sequence[Confusion], seed: int) -> list[PowerRow]:
    """Return a row for each duration and number of fibers, which share one candidate and nothing else."""
    return [_row(one, fibers, seed) for one in outcomes for fibers in FIBERS]


def needed(rows: Sequence[PowerRow], minutes: float, *, alone: bool) -> PowerRow | None:
    """Return the row with the fewest fibers that reaches `POWER`; None if none does."""
    mine = [row for row in rows if row.minutes == minutes and (row.one if alone else row.few) >= POWER]
    return min(mine, key=lambda row: row.fibers, default=None)


def _row(outcome: Confusion, fibers: int, seed: int) -> PowerRow:
    chance = np.random.default_rng([seed, fibers])
    names = len(outcome.candidates)
    each = -(-_DRAWN // names)
    together, truth = [], np.repeat(np.arange(names), each)
    for candidate in range(names):
        mine = outcome.log_evidence[outcome.truth == candidate]
        own = mine - logsumexp(mine, axis=1, keepdims=True)
        together.append(own[chance.integers(len(mine), size=(each, fibers))].sum(axis=1))
    evidence = np.concatenate(together)
    probability = np.exp(evidence - logsumexp(evidence, axis=1, keepdims=True))
    inside = in_set(probability)
    kept, left = inside[np.arange(len(truth)), truth], inside.sum(axis=1)
    independent = len(outcome.truth) / fibers  # experiments that share no fiber
    few, one = (float((kept & (left <= most)).mean()) for most in (LEFT_OVER, 1))
    return PowerRow(
        outcome.minutes,
        outcome.presses,
        outcome.presses / outcome.different,
        fibers,
        few,
        _error(few, independent),
        one,
        _error(one, independent),
    )


def _error(share: float, n: float) -> float:
    near = (share * n + 1) / (n + 2)
    return float(np.sqrt(near * (1 - near) / n))
