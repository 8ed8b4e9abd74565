"""Order of presses against history: blocks of one shape, and within them the least dependence on the press before."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.design.confusion import OrderedDesign
from rig.design.press_times import PressTimes
from rig.design.presses import PossiblePress

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_TRIED = 300


def ordered(name: str, blocks: Sequence[Ints], times: PressTimes, minutes: float) -> OrderedDesign:
    """Return presses in blocks, each of one shape, with the time of each (s)."""
    at_s, now_s = [], times.first_s
    for number, block in enumerate(blocks):
        now_s += times.change_s if number else 0.0
        for k in block:
            at_s.append(now_s)
            now_s += float(times.press_s[k])
    return OrderedDesign(name, np.concatenate([np.zeros(0, dtype=np.int64), *blocks]), np.array(at_s), minutes)


def blocks_of(repeats: Ints, presses: Sequence[PossiblePress], shapes: Sequence[str], seed: int) -> list[Ints]:
    """Return the presses of a design in blocks, in an order whose history says least about the next press."""
    chance = np.random.default_rng(seed)
    found = []
    for shape in shapes:
        mine = [k for k, press in enumerate(presses) if press.shape == shape]
        block = np.repeat(mine, repeats[mine])
        if len(block):
            found.append(_least_dependent(block, presses, chance))
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


def _least_dependent(block: Ints, presses: Sequence[PossiblePress], chance: np.random.Generator) -> Ints:
    tried = [chance.permutation(block) for _ in range(_TRIED)]
    return min(tried, key=lambda one: (round(history(one, presses), 6), _alike(one)))


def _alike(block: Ints) -> int:
    """Return how often a press follows itself."""
    return int((block[1:] == block[:-1]).sum())


def carry_over(series: Sequence[tuple[float, float]], hold_s: float, gap_s: float) -> float:
    """Return the share of a press's force by which relaxation still lowers the next one.

    Each Prony term (share, τ) relaxes by 1 − exp(−hold / τ) during a hold, and recovers by exp(−gap / τ) until the
    next one.
    """
    return float(sum(share * -np.expm1(-hold_s / tau) * np.exp(-gap_s / tau) for share, tau in series))
