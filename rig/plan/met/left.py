"""What relaxing tissue leaves of the elastic force of a press, on the way and in the last hold.

The depth grows evenly up to each hold, and f(t) = ∫ G(t − s) dF(s), with F ∝ d^1.5 as the engine takes it to be.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.engine.pressing.touch_fit import CONTACT_EXPONENT
from rig.protocol.planned import Pace
from sim.models.relaxing.prony import Prony, PronyTerm

Array = NDArray[np.float64]

_STEPS = 32  # of a ramp, and of a hold


class Left(NamedTuple):
    """Shares of the elastic force at the target."""

    held: float  # mean of the last hold
    highest: float  # on a ramp that nothing interrupts


def left_of(series: tuple[tuple[float, float], ...], pace: Pace, doi_mm: float) -> Left:
    """Of tissue with a Prony series of (share, time constant in s); all of it where there is none."""
    if not series:
        return Left(1.0, 1.0)
    prony = Prony([PronyTerm(*term) for term in series])
    each_s = pace.ramp_s(doi_mm) / pace.ramps
    ends = np.linspace(0.0, 1.0, pace.ramps + 1)
    t_s, share, now_s = [0.0], [0.0], 0.0
    for before, after in pairwise(ends):
        t_s += list(np.linspace(now_s, now_s + each_s, _STEPS + 1)[1:])
        share += list(np.linspace(before, after, _STEPS + 1)[1:])
        now_s += each_s + pace.hold_s
        t_s.append(now_s)
        share.append(after)
    asked_s = np.linspace(now_s - pace.hold_s, now_s, _STEPS)
    held = _felt(prony, np.array(t_s), np.array(share), asked_s).mean()
    quick_s = doi_mm / pace.speed_mm_s
    ramp = np.linspace(0.0, 1.0, _STEPS + 1)
    return Left(float(held), float(_felt(prony, quick_s * ramp, ramp, np.array([quick_s]))[0]))


def _felt(prony: Prony, t_s: Array, share: Array, asked_s: Array) -> Array:
    """Force at instants over the elastic one at the target, of a depth that goes in straight lines."""
    steps = np.diff(share**CONTACT_EXPONENT)
    middle_s = 0.5 * (t_s[1:] + t_s[:-1])
    since_s = np.maximum(asked_s[:, None] - middle_s, 0.0)
    return np.asarray(prony.relaxed(since_s) @ steps)
