"""Order of presses against history: blocks of one shape, and within them counterbalanced depths.

In a block, each depth (or force) follows each as often as if they were independent, within one press: the numbers of
transitions are rounded without a change of their sums, and the order is an Eulerian circuit through them. Each press
cannot follow each other one, as a block would need the square of their number. Positions are assigned at random, so
that they depend least on the press before.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.design.confusion import DesignName, OrderedDesign
from rig.design.press_times import PressTimes
from rig.design.presses import PossiblePress

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_TRIED = 300


def ordered(name: DesignName, blocks: Sequence[Ints], times: PressTimes, minutes: float) -> OrderedDesign:
    """Return presses in blocks, each of one shape, with the time of each (s)."""
    at_s, now_s = [], times.first_s
    for number, block in enumerate(blocks):
        now_s += times.change_s if number else 0.0
        for k in block:
            at_s.append(now_s)
            now_s += float(times.press_s[k])
    return OrderedDesign(name, np.concatenate([np.zeros(0, dtype=np.int64), *blocks]), np.array(at_s), minutes)


def blocks_of(repeats: Ints, presses: Sequence[PossiblePress], shapes: Sequence[str], seed: int) -> list[Ints]:
    """Return the presses of a design in blocks, in counterbalanced orders."""
    chance = np.random.default_rng(seed)
    found = []
    for shape in shapes:
        mine = [k for k, press in enumerate(presses) if press.shape == shape]
        block = np.repeat(mine, repeats[mine])
        if len(block):
            found.append(_counterbalanced(block, presses, chance))
    return found


def history(block: Ints, presses: Sequence[PossiblePress]) -> float:
    """Return the largest |correlation| of a press's depth or position with those of the press before."""
    about = np.array([[presses[k].target, presses[k].x_mm] for k in block])
    if len(block) < 4:
        return 0.0
    found = [0.0]
    for one in about[1:].T:
        for before in about[:-1].T:
            if np.ptp(one) > 0 and np.ptp(before) > 0:
                found.append(abs(float(np.corrcoef(one, before)[0, 1])))
    return max(found)


def imbalance(block: Ints, presses: Sequence[PossiblePress]) -> float:
    """Return the largest difference of how often a depth follows another from independence.

    Orders of `blocks_of` have at most 1.
    """
    targets, level = np.unique([presses[k].target for k in block], return_inverse=True)
    made = np.bincount(level, minlength=len(targets))
    follows = np.zeros((len(targets), len(targets)))
    np.add.at(follows, (level[:-1], level[1:]), 1)
    return float(np.abs(follows - np.outer(made, made) / len(block)).max())


def _counterbalanced(block: Ints, presses: Sequence[PossiblePress], chance: np.random.Generator) -> Ints:
    """Return the best of several counterbalanced orders: the one that depends least on the press before."""
    targets, level = np.unique([presses[k].target for k in block], return_inverse=True)
    of_level = [block[level == one] for one in range(len(targets))]
    follows = _transitions(np.bincount(level), chance)
    tried = []
    for _ in range(_TRIED):
        levels = _circuit(follows, chance)
        order = np.empty_like(block)
        for one, mine in enumerate(of_level):
            order[levels == one] = chance.permutation(mine)
        tried.append(order)
    return min(tried, key=lambda one: (round(history(one, presses), 6), _alike(one)))


def _transitions(made: Ints, chance: np.random.Generator) -> Ints:
    """Return how often each level follows each in a circle of presses: independence, rounded up or down.

    Rows and columns sum to the presses of each level. Such a rounding exists always (a transportation problem with
    integer sums has integer vertices); one that leaves all levels in one circle is found by other random costs.
    """
    from scipy.optimize import linprog  # slow to import, and a help does not need it

    n = len(made)
    ideal = np.outer(made, made) / made.sum()
    low = np.floor(ideal + 1e-9)
    bounds = np.stack([low, np.maximum(np.ceil(ideal - 1e-9), low)], axis=-1).reshape(-1, 2)
    rows, columns = np.kron(np.eye(n), np.ones(n)), np.kron(np.ones(n), np.eye(n))
    while True:
        cost = chance.random((n, n)) + n * np.eye(n)  # circles of one level are the last resort
        found = linprog(cost.ravel(), A_eq=np.concatenate([rows, columns]), b_eq=np.tile(made, 2), bounds=bounds)
        follows = found.x.round().astype(np.int64).reshape(n, n)
        reached = np.linalg.matrix_power(follows + np.eye(n, dtype=np.int64) > 0, n)
        if reached.all():
            return np.asarray(follows)


def _circuit(follows: Ints, chance: np.random.Generator) -> Ints:
    """Return the levels along a random Eulerian circuit, cut at a transition that was rounded up (Hierholzer)."""
    made = follows.sum(axis=1)
    left = [chance.permutation(np.repeat(np.arange(len(made)), row)).tolist() for row in follows]
    stack, found = [int(chance.integers(len(made)))], []
    while stack:
        if left[stack[-1]]:
            stack.append(left[stack[-1]].pop())
        else:
            found.append(stack.pop())
    circle = np.array(found[:0:-1])
    above = (follows - np.outer(made, made) / made.sum())[circle, np.roll(circle, -1)]
    cut = int(chance.choice(np.flatnonzero(above >= above.max() - 1e-9)))
    return np.roll(circle, -cut - 1)


def _alike(block: Ints) -> int:
    """Return how often a press follows itself."""
    return int((block[1:] == block[:-1]).sum())


def carry_over(series: Sequence[tuple[float, float]], hold_s: float, gap_s: float) -> float:
    """Return the share of a press's force by which relaxation still lowers the next one.

    Each Prony term (share, τ) relaxes by 1 − exp(−hold / τ) during a hold, and recovers by exp(−gap / τ) until the
    next one.
    """
    return float(sum(share * -np.expm1(-hold_s / tau) * np.exp(-gap_s / tau) for share, tau in series))
