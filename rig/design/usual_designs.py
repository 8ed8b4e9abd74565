"""Designs in common use, for comparison: positions of one shape, a grid of depths, random presses."""

from collections.abc import Sequence
from itertools import cycle
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.design.confusion import OrderedDesign
from rig.design.order import ordered
from rig.design.press_times import PressTimes
from rig.design.presses import PossiblePress

Ints = NDArray[np.int64]

SOURCE: Final = "21 positions of one shape"
DEPTHS: Final = "a grid of depths"
RANDOM: Final = "random presses"

_USUAL = {"doi_mm": 0.73, "force_gwt": 8.0}  # step 1 at 8 gwt, the source's recordings
_POSITIONS = 5


def usual_designs(
    presses: Sequence[PossiblePress], times: PressTimes, minutes: float, seed: int
) -> list[OrderedDesign]:
    """Return the three designs, each as long as the session allows."""
    shapes = list(dict.fromkeys(press.shape for press in presses))
    shape = next((one for one in shapes if one.startswith("step")), shapes[0])
    mine = np.array([k for k, press in enumerate(presses) if press.shape == shape])
    usual = _USUAL[presses[0].kind]
    target = min((presses[k].target for k in mine), key=lambda one: abs(one - usual))
    across = np.array([k for k in mine if presses[k].target == target])
    x = np.array(sorted({presses[k].x_mm for k in mine}))
    some = set(x[np.unique(np.linspace(0.2, 0.8, _POSITIONS) * (len(x) - 1)).round().astype(int)].tolist())
    grid = np.array([k for k in mine if presses[k].x_mm in some])
    chance = np.random.default_rng(seed + 5)
    return [
        ordered(SOURCE, [_repeated(across, times, minutes, 1)], times, minutes),
        ordered(DEPTHS, [_repeated(grid, times, minutes, 1)], times, minutes),
        ordered(RANDOM, _random(presses, shapes, times, minutes, chance), times, minutes),
    ]


def everything(presses: Sequence[PossiblePress], times: PressTimes, minutes: float) -> OrderedDesign:
    """Return all presses there are, as often as the session allows."""
    shapes = list(dict.fromkeys(press.shape for press in presses))
    room_s = 60 * minutes - times.session_s((), len(shapes))
    cost = times.press_s
    order = np.random.default_rng(0).permutation(len(presses))
    whole = int(room_s // cost.sum())
    left, rest = room_s - whole * float(cost.sum()), []
    for k in order:
        if cost[k] <= left:
            left -= float(cost[k])
            rest.append(k)
    repeats = np.full(len(presses), whole, dtype=np.int64)
    repeats[rest] += 1
    mine = [np.array([k for k, press in enumerate(presses) if press.shape == shape]) for shape in shapes]
    return ordered("all presses", [np.repeat(some, repeats[some]) for some in mine], times, minutes)


def _repeated(some: Ints, times: PressTimes, minutes: float, shapes: int) -> Ints:
    """Return presses in a cycle until the time is over."""
    left = 60 * minutes - times.session_s((), shapes)
    made: list[int] = []
    for k in cycle(some.tolist()):
        left -= float(times.press_s[k])
        if left < 0:
            return np.array(made, dtype=np.int64)
        made.append(k)
    return np.array(made, dtype=np.int64)


def _random(
    presses: Sequence[PossiblePress],
    shapes: Sequence[str],
    times: PressTimes,
    minutes: float,
    chance: np.random.Generator,
) -> list[Ints]:
    room_s = 60 * minutes - times.session_s((), len(shapes))
    if room_s <= 0:
        shapes, room_s = shapes[:1], 60 * minutes - times.session_s((), 1)
    found = []
    for shape in shapes:
        mine = np.array([k for k, press in enumerate(presses) if press.shape == shape])
        left, made = room_s / len(shapes), []
        while True:
            k = int(chance.choice(mine))
            left -= float(times.press_s[k])
            if left < 0:
                break
            made.append(k)
        found.append(np.array(made, dtype=np.int64))
    return found
