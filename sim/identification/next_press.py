"""Which press tells most of the forces that are wanted, and how wide these are known."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.identification.posterior import PRESS_ERROR, READING_ERROR, SHAPE_ERROR, Learned
from sim.identification.predicted_forces import Foreseen, PressTrajectory, RampAndHold, nominal_way
from sim.identification.uncertainty_bands import Width, band

Array = NDArray[np.float64]

_RAMP_SHARES = (0.25, 0.5, 0.75, 1.0)
_LOOKED_AT = 400  # draws that are enough to compare presses by
_NOISE_GWT = 0.02
_FOUND = 0.995  # of the likely fingers


@dataclass(frozen=True)
class PressAt:
    """A shape at a place, to a depth past first touch."""

    indentor: str
    x_mm: float
    doi_mm: float

    def way(self, pace: RampAndHold) -> PressTrajectory:
        """As the bench is expected to press it."""
        return nominal_way(self.indentor, self.x_mm, self.doi_mm, pace, _RAMP_SHARES)


def held_gwt(foreseen: Foreseen, draws: Array, press: PressAt, pace: RampAndHold) -> Array:
    """(n,) mean force of the hold."""
    return np.asarray(foreseen.forces_gwt(draws, press.way(pace))[:, -pace.readings :].mean(axis=1))


def highest_gwt(foreseen: Foreseen, draws: Array, press: PressAt, pace: RampAndHold, share: float) -> float:
    """The force that no more than so many of the fingers would pass on the way."""
    return _highest(foreseen.forces_gwt(draws, press.way(pace)), share)


def _highest(forces_gwt: Array, share: float) -> float:
    """Of (n, r) forces on the way."""
    return float(np.quantile(forces_gwt.max(axis=1), share)) * (1 + 2 * PRESS_ERROR)


class SkinSearch(NamedTuple):
    """How far from where it is expected the skin is looked for, and what force tells that it is there."""

    mm: float
    felt_gwt: float


class Chooser:
    """The presses that are wanted, and which one tells most of them."""

    def __init__(
        self, foreseen: Foreseen, goals: Sequence[PressAt], pace: RampAndHold, search: SkinSearch | None = None
    ) -> None:
        """search: None where the skin is found wherever it lies."""
        self.foreseen, self.goals, self.pace, self.search = foreseen, tuple(goals), pace, search

    def goal_widths(self, learned: Learned, model_error: float) -> list[Width]:
        """How the force of each press that is wanted is known."""
        return [band(held_gwt(self.foreseen, learned.draws, g, self.pace), model_error) for g in self.goals]

    def choose(self, learned: Learned, most_gwt: float, menu: Sequence[PressAt], share: float = 0.975) -> PressAt:
        """The press of a menu that leaves least variance in the wanted forces, none of them above most_gwt.

        Where even the gentlest may be, that one. Where the skin may not be found, nothing is pressed while there are
        others.
        """
        menu = self._surest(menu, learned.draws)
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

    def _surest(self, menu: Sequence[PressAt], draws: Array) -> list[PressAt]:
        """The presses whose touch nearly all fingers let be felt, or as many of them as let any."""
        if self.search is None:
            return list(menu)
        places = {(press.indentor, press.x_mm) for press in menu}
        found = {place: self._found(*place, self.search, draws) for place in places}
        least = min(_FOUND, max(found.values()))
        return [press for press in menu if found[press.indentor, press.x_mm] >= least]

    def _found(self, indentor: str, x_mm: float, search: SkinSearch, draws: Array) -> float:
        """The share of fingers that are felt within the search, relaxed as they may be."""
        expected_mm = float(self.foreseen.table(indentor).touches_mm(np.array([x_mm]))[0])
        once, lowest_mm = np.zeros(1), np.array([expected_mm - search.mm])
        elastic = self.foreseen.elastic_gwt(draws, PressTrajectory(indentor, x_mm, once, lowest_mm, once))[:, 0]
        felt = self.foreseen.lasting(draws) * elastic >= search.felt_gwt
        not_above = self.foreseen.touches_mm(draws, indentor, x_mm) <= expected_mm + search.mm
        return float(np.mean(felt & not_above))


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
