"""What is no finger of the prior: presses that none of its fingers answers like."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from sim.models.meeting.foreseen import Foreseen
from sim.models.meeting.given import Given
from sim.models.meeting.learned import Learned
from sim.models.meeting.prior import TISSUE
from sim.models.meeting.width import Width

Array = NDArray[np.float64]

CHANCE_OF_ALL, CHANCE_OF_ONE, CHANCE_OF_LAYERS, MOST_SURPRISE = 0.01, 0.001, 0.01, 4.5
"""How often a finger of the prior would be so far off all readings, off those of its worst press, and its moduli so
far from what is usual; and by how many sd a press may surprise."""

_COMPARED, _RARE, _MOST_PRESSES = 300, 0.025, 0.6  # fingers; share of them; share of the presses
_DEEP, _ENOUGH = 0.3, 3  # of the deepest, and readings: there the touch's own error counts little
_JUMP_MM = 0.03
_STEP_MM, _LEAST = 1e-3, 1e-12


@dataclass(frozen=True)
class Surprise:
    """The highest force of a press as it was foreseen before it, and as it came."""

    foreseen: Width
    sd: float  # of its logarithm
    measured_gwt: float

    @property
    def sds(self) -> float:
        """How far off."""
        return float(np.log(max(self.measured_gwt, 1e-3) / self.foreseen.middle) / self.sd)


def no_finger(
    foreseen: Foreseen, presses: Sequence[Given], learned: Learned, surprises: Sequence[Surprise]
) -> str | None:
    """Why this is no finger of the prior, in one sentence; None where it may be one."""
    if not presses:
        return None
    total_off = chi2.sf(learned.total, int(learned.readings.sum())) < CHANCE_OF_ALL
    one_off = bool((chi2.sf(learned.misfit, learned.readings) < CHANCE_OF_ONE).any())
    surprising = max((abs(one.sds) for one in surprises), default=0.0) > MOST_SURPRISE
    if not (total_off or one_off or surprising):
        return _NO_LAYERS if _layers_off(learned) else None
    return f"no finger of the prior answers like this: {_how(foreseen, presses, learned)}"


_NO_LAYERS = "no finger of the prior is likely to answer like this: its layers would be at the end of their ranges"


def _layers_off(learned: Learned) -> bool:
    """Whether only unlikely moduli of dermis and fat come near: what lies there may be layered otherwise."""
    off = learned.prior.off(learned.likeliest)[[learned.prior.index(name) for name in TISSUE]]
    return bool(chi2.sf(float(off @ off), len(TISSUE)) < CHANCE_OF_LAYERS)


def _how(foreseen: Foreseen, presses: Sequence[Given], learned: Learned) -> str:
    """By how force grows with depth under each press, and by where each found the skin."""
    any_of_them = learned.prior.draws(_COMPARED, np.random.default_rng(0))
    ranks = [rank for press in presses if (rank := _rank(foreseen, press, any_of_them)) is not None]
    if ranks and np.mean(np.array(ranks) > 1 - _RARE) > _MOST_PRESSES:
        return "force grows more steeply with depth: something stiff under the skin, as bone under the indentor"
    if ranks and np.mean(np.array(ranks) < _RARE) > _MOST_PRESSES:
        return "force grows less steeply with depth: something even, as a ball of rubber"
    shift_mm = np.array([_shift_mm(foreseen, press, learned.likeliest) for press in presses])
    jump_mm = np.diff(shift_mm)
    if len(jump_mm) and np.abs(jump_mm).max() > _JUMP_MM:
        k = int(np.argmax(np.abs(jump_mm)))
        return f"at press {k + 2} it lay {1e3 * jump_mm[k]:+.0f} µm from where it was before: does the mount slip?"
    return "shapes and places do not agree on one finger"


def _rank(foreseen: Foreseen, press: Given, draws: Array) -> float | None:
    """The share of fingers under which force grows less steeply with depth; None where too little was pressed."""
    way = press.by_depth
    deep = way.height_mm[way.lowest] < _DEEP * way.height_mm.min()
    moving = deep & (way.asked_s <= way.t_s[-1]) & (press.force_gwt > 0)
    if moving.sum() < _ENOUGH:
        return None
    ln_d = np.log(-way.height_mm[way.lowest][moving])
    ln_d = ln_d - ln_d.mean()
    foreseen_ln = np.log(foreseen.forces_gwt(draws, way)[:, moving])
    return float(np.mean(foreseen_ln @ ln_d < np.log(press.force_gwt[moving]) @ ln_d))


def _shift_mm(foreseen: Foreseen, press: Given, draw: Array) -> float:
    """How much higher than under this finger the skin would have to lie, by least squares."""
    higher = draw.copy()
    higher[foreseen.prior.index("height_mm")] += _STEP_MM
    here, there = foreseen.forces_gwt(np.stack([draw, higher]), press.way)
    slope = (there - here) / _STEP_MM
    return float(slope @ (press.force_gwt - here) / max(float(slope @ slope), _LEAST))
