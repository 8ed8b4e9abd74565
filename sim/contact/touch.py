"""Where a profile first touches the undeformed, continuous skin: the zero of DOI."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from sim.contact.indentors import Profile

Array = NDArray[np.float64]

_GRID_MM = 0.004


def first_touch(profile: Profile, x_mm: float, ridge: CubicSpline) -> tuple[float, float]:
    """Height of the profile's lowest point at first touch and the x of the point touched; mm.

    `ridge` is the highest skin over all z as a function of x.
    """
    low, high = ridge.x[0], ridge.x[-1]
    x = np.linspace(low, high, int((high - low) / _GRID_MM) + 1)
    best = int(np.argmax(ridge(x) - profile.evaluate(x - x_mm)[0]))
    bounds = (x[max(best - 1, 0)], x[min(best + 1, len(x) - 1)])

    def gap(at: float) -> float:
        return float(profile.evaluate(np.array([at - x_mm]))[0][0] - ridge(at))

    found = minimize_scalar(gap, bounds=bounds, method="bounded", options={"xatol": 1e-12})
    return (-float(found.fun), float(found.x)) if found.fun < gap(x[best]) else (-gap(x[best]), float(x[best]))
