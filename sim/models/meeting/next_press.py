"""Which press tells most of the forces that are wanted, and how wide these are known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from sim.models.meeting.foreseen import Foreseen
from sim.models.meeting.given import Pace, Way, nominal_way
from sim.models.meeting.learned import PRESS_ERROR, READING_ERROR, SHAPE_ERROR, Learned

Array = NDArray[np.float64]

COVERAGE = 0.9
_RAMP_SHARES = (0.25, 0.5, 0.75, 1.0)
_LOOKED_AT = 400  # draws that are enough to compare presses by
_NOISE_GWT = 0.02


@dataclass(frozen=True)
class PressAt:
    """A shape at a place, to a depth past first touch."""

    indentor: str
    x_mm: float
    doi_mm: float

    def way(self, pace: Pace) -> Way:
        """As the bench is expected to press it."""
        return nominal_way(self.indentor, self.x_mm, self.doi_mm, pace, _RAMP_SHARES)


@dataclass(frozen=True)
class Width:
    """A force that is known to a band: gwt."""

    middle: float
    low: float
    high: float

    @property
    def half(self) -> float:
        """Half of the band over the middle."""
        return (self.high - self.low) / (2 * self.middle)


def held_gwt(foreseen: Foreseen, draws: Array, press: PressAt, pace: Pace) -> Array:
    """(n,) mean force of the hold."""
    return np.asarray(foreseen.forces_gwt(draws, press.way(pace))[:, -pace.readings :].mean(axis=1))


def band(forces_gwt: Array, model_error: float, coverage: float = COVERAGE) -> Width:
    """Of (n,) equally likely forces, widened by the model's own error: normal in the logarithm."""
    ln = np.log(forces_gwt)
    half = float(norm.ppf(0.5 + coverage / 2)) * np.hypot(ln.std(), model_error)
    middle = float(ln.mean())
    return Width(*(float(np.exp(middle + sign * half)) for sign in (0, -1, 1)))


def highest_gwt(foreseen: Foreseen, draws: Array, press: PressAt, pace: Pace, share: float) -> float:
    """The force that no more than so many of the fingers would pass on the way."""
    return _highest(foreseen.forces_gwt(draws, press.way(pace)), share)


def _highest(forces_gwt: Array, share: float) -> float:
    """Of (n, r) forces on the way."""
    return float(np.quantile(forces_gwt.max(axis=1), share)) * (1 + 2 * PRESS_ERROR)


class Chooser:
    """The presses that are wanted, and which one tells most of them."""

    def __init__(self, foreseen: Foreseen, goals: Sequence[PressAt], pace: Pace) -> None:
        self.foreseen, self.goals, self.pace = foreseen, tuple(goals), pace

    def goal_widths(self, learned: Learned, model_error: float) -> list[Width]:
        """How the force of each press that is wanted is known."""
        return [band(held_gwt(self.foreseen, learned.draws, g, self.pace), model_error) for g in self.goals]

    def choose(self, learned: Learned, most_gwt: float, menu: Sequence[PressAt], share: float = 0.975) -> PressAt:
        """The press of a menu that leaves least variance in the wanted forces, none of them above most_gwt.

        Where even the gentlest may be, that one.
        """
        draws = learned.draws[:: max(len(learned.draws) // _LOOKED_AT, 1)]
        wanted = np.log([held_gwt(self.foreseen, draws, g, self.pace) for g in self.goals]).T
        highest, left = [], []
        for press in menu:
            forces = self.foreseen.forces_gwt(draws, press.way(self.pace))
            highest.append(_highest(forces, share))
            left.append(_left(np.log(forces), wanted, _variance(forces)))
        allowed = np.array(highest) <= most_gwt
        if not allowed.any():
            return menu[int(np.argmin(highest))]
        return menu[int(np.argmin(np.where(allowed, left, np.inf)))]


def _variance(forces: Array) -> Array:
    """(r, r) of the logarithms of readings about the truth."""
    own = READING_ERROR**2 + np.square(_NOISE_GWT / np.maximum(np.median(forces, axis=0), _NOISE_GWT))
    return np.asarray(np.diag(own) + PRESS_ERROR**2 + SHAPE_ERROR**2)


def _left(seen: Array, wanted: Array, noise: Array) -> float:
    """Mean variance of wanted ones once (n, r) are seen with so much noise, were all normal."""
    seen, wanted = seen - seen.mean(axis=0), wanted - wanted.mean(axis=0)
    cross = seen.T @ wanted / len(seen)
    explained = cross * np.linalg.solve(seen.T @ seen / len(seen) + noise, cross)
    return float((wanted**2).mean() - explained.sum() / wanted.shape[1])
