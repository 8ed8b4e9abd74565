"""What relaxing tissue leaves of the elastic force of a press, on the way and in the last hold.

The depth grows evenly up to each hold, and f(t) = ∫ G(t − s) dF(s), with F ∝ d^1.5 as the engine takes it to be.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.engine.pressing.touch_fit import CONTACT_EXPONENT
from rig.protocol.planned import Pace
from sim.models.relaxation import Moves

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
    each_s, quick_s = pace.ramp_s(doi_mm) / pace.ramps, doi_mm / pace.speed_mm_s
    since_s = pace.hold_s * (np.arange(_STEPS) + 0.5) / _STEPS
    return Left(_felt(series, pace.ramps, each_s, pace.hold_s, since_s), _felt(series, 1, quick_s, 0.0, np.zeros(1)))


def _felt(series: tuple[tuple[float, float], ...], ramps: int, ramp_s: float, hold_s: float, since_s: Array) -> float:
    """Mean force so long after the last of some ramps, holds between them, over the elastic one at the target."""
    ramp, part_of_one = np.arange(ramps)[:, None], np.arange(1, _STEPS + 1) / _STEPS
    ended_s = (ramp * (ramp_s + hold_s) + ramp_s * part_of_one).ravel()
    elastic = ((ramp + part_of_one).ravel() / ramps) ** CONTACT_EXPONENT
    moves, asked_s = Moves(ended_s, np.full(len(ended_s), ramp_s / _STEPS)), ended_s[-1] + since_s
    last = np.full(len(asked_s), len(ended_s) - 1)
    relaxing = sum(part * moves.fading(tau_s, asked_s, last) @ elastic for part, tau_s in series)
    return float(np.mean((1 - sum(part for part, _ in series)) * elastic[-1] + relaxing))
