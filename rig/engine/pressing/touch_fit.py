"""Contact found from force readings near the threshold."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from rig.engine.records import Touch

CONTACT_EXPONENT = 1.5  # F ∝ d^1.5, a sphere pressed on an elastic solid (Hertz)

_TRIED = 200  # contact heights looked at, before the best is refined


def fit_contact(readings: Sequence[tuple[float, float]], threshold_gwt: float, resolution_gwt: float) -> Touch:
    """Contact height from (height mm, force gwt) readings that descend to the threshold.

    The least-squares fit of F = a · (contact − height)^1.5, none above contact, to all readings: one that noise has
    lifted is outvoted by its neighbours. It is the last height where fewer than two readings show more than half a
    step of the sensor, resolution_gwt.
    """
    height, force = np.array(readings).T
    shown = force > 0.5 * resolution_gwt
    contact = float(height[-1]) if shown.sum() < 2 else _least_squares(height, force)
    return Touch(threshold_gwt, float(height[-1]), float(force[-1]), contact, int(shown.sum()))


def _least_squares(height_mm: NDArray[np.float64], force_gwt: NDArray[np.float64]) -> float:
    """Contact height, mm, within the descent; for each one tried the stiffness a that fits it best is known."""

    def misfit(contact_mm: float) -> float:
        shape = np.maximum(contact_mm - height_mm, 0.0) ** CONTACT_EXPONENT
        stiffness = shape @ force_gwt / (shape @ shape)
        return float(((force_gwt - stiffness * shape) ** 2).sum())

    tried, step = np.linspace(height_mm[-1], height_mm[0], _TRIED, retstep=True)
    best = tried[1 + int(np.argmin([misfit(contact) for contact in tried[1:]]))]
    lowest = max(best - step, 0.5 * (height_mm[-1] + tried[1]))
    found = minimize_scalar(misfit, bounds=(lowest, min(best + step, height_mm[0])), options={"xatol": 1e-10})
    return float(found.x)
