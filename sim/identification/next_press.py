"""Choice of the press that reduces the uncertainty of the goal forces most."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.identification.posterior import PRESS_ERROR, READING_ERROR, SHAPE_ERROR, Learned
from sim.identification.predicted_forces import PredictedForces, PressTrajectory, RampAndHold, nominal_trajectory
from sim.identification.uncertainty_bands import Width, band

Array = NDArray[np.float64]

_RAMP_SHARES = (0.25, 0.5, 0.75, 1.0)
_COMPARED = 400  # draws that suffice to compare presses
_NOISE_GWT = 0.02
_FOUND = 0.995  # share of the likely fingers whose skin a touch must find


@dataclass(frozen=True)
class PressAt:
    """Press of a shape at a position (mm) to a depth past first touch (mm)."""

    indentor: str
    x_mm: float
    doi_mm: float

    def trajectory(self, pace: RampAndHold) -> PressTrajectory:
        """Return the expected trajectory of the press."""
        return nominal_trajectory(self.indentor, self.x_mm, self.doi_mm, pace, _RAMP_SHARES)


def held_gwt(predicted: PredictedForces, draws: Array, press: PressAt, pace: RampAndHold) -> Array:
    """Return the (n,) mean forces of the hold (gwt)."""
    return np.asarray(predicted.forces_gwt(draws, press.trajectory(pace))[:, -pace.readings :].mean(axis=1))


def highest_gwt(predicted: PredictedForces, draws: Array, press: PressAt, pace: RampAndHold, share: float) -> float:
    """Return the quantile `share` of the highest force during the press (gwt)."""
    return _highest(predicted.forces_gwt(draws, press.trajectory(pace)), share)


def _highest(forces_gwt: Array, share: float) -> float:
    """Return the quantile of the highest of (n, r) forces (gwt)."""
    return float(np.quantile(forces_gwt.max(axis=1), share)) * (1 + 2 * PRESS_ERROR)


class SkinSearch(NamedTuple):
    """Range of the search for the skin about its expected height (mm), and the touch force (gwt)."""

    mm: float
    touch_gwt: float


class PressSelector:
    """Goals of an identification, and the choice of presses that determine them."""

    def __init__(
        self,
        predicted: PredictedForces,
        goals: Sequence[PressAt],
        pace: RampAndHold,
        search: SkinSearch | None = None,
    ) -> None:
        """Prepare the choice. search: None if the skin is found at any height."""
        self.predicted, self.goals, self.pace, self.search = predicted, tuple(goals), pace, search

    def goal_widths(self, learned: Learned, model_error: float) -> list[Width]:
        """Return the predicted force of each goal with its band."""
        return [band(held_gwt(self.predicted, learned.draws, g, self.pace), model_error) for g in self.goals]

    def choose(self, learned: Learned, most_gwt: float, menu: Sequence[PressAt], share: float = 0.975) -> PressAt:
        """Return the press of a menu that leaves the least variance in the goal forces, at most most_gwt.

        If all presses exceed most_gwt, return the lightest. Presses whose touch may not find the skin are used only
        if there are no others.
        """
        menu = self._surest(menu, learned.draws)
        draws = learned.draws[:: max(len(learned.draws) // _COMPARED, 1)]
        goals = np.log([held_gwt(self.predicted, draws, g, self.pace) for g in self.goals]).T
        highest, remaining = [], []
        for press in menu:
            forces = self.predicted.forces_gwt(draws, press.trajectory(self.pace))
            highest.append(_highest(forces, share))
            remaining.append(_remaining_variance(np.log(forces), goals, _variance(forces)))
        allowed = np.array(highest) <= most_gwt
        if not allowed.any():
            return menu[int(np.argmin(highest))]
        return menu[int(np.argmin(np.where(allowed, remaining, np.inf)))]

    def _surest(self, menu: Sequence[PressAt], draws: Array) -> list[PressAt]:
        """Return the presses whose touch finds the skin of nearly all likely fingers, or of most."""
        if self.search is None:
            return list(menu)
        places = {(press.indentor, press.x_mm) for press in menu}
        found = {place: self._found(*place, self.search, draws) for place in places}
        least = min(_FOUND, max(found.values()))
        return [press for press in menu if found[press.indentor, press.x_mm] >= least]

    def _found(self, indentor: str, x_mm: float, search: SkinSearch, draws: Array) -> float:
        """Return the share of fingers that a touch finds within the search, after relaxation."""
        expected_mm = float(self.predicted.table(indentor).touches_mm(np.array([x_mm]))[0])
        once, lowest_mm = np.zeros(1), np.array([expected_mm - search.mm])
        elastic = self.predicted.elastic_gwt(draws, PressTrajectory(indentor, x_mm, once, lowest_mm, once))[:, 0]
        found = self.predicted.lasting(draws) * elastic >= search.touch_gwt
        not_above = self.predicted.touches_mm(draws, indentor, x_mm) <= expected_mm + search.mm
        return float(np.mean(found & not_above))


def _variance(forces: Array) -> Array:
    """Return the (r, r) covariance of the logarithms of readings."""
    own = READING_ERROR**2 + np.square(_NOISE_GWT / np.maximum(np.median(forces, axis=0), _NOISE_GWT))
    return np.asarray(np.diag(own) + PRESS_ERROR**2 + SHAPE_ERROR**2)


def _remaining_variance(readings: Array, goals: Array, noise: Array) -> float:
    """Return the mean variance of (n, g) goals after (n, r) noisy readings, for normal distributions."""
    readings, goals = readings - readings.mean(axis=0), goals - goals.mean(axis=0)
    cross = readings.T @ goals / len(readings)
    explained = cross * np.linalg.solve(readings.T @ readings / len(readings) + noise, cross)
    return float((goals**2).mean() - explained.sum() / goals.shape[1])
