"""Contact found from force readings near the threshold."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.engine.records import Touch

CONTACT_EXPONENT = 1.5  # F ∝ d^1.5, a sphere pressed on an elastic solid (Hertz)

_TRIED = 201  # contact heights looked at together
_FINER = 4  # times that those about the best are looked at, each a hundred times closer


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

    def misfits(contact_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        shape = np.maximum(contact_mm[:, None] - height_mm, 0.0) ** CONTACT_EXPONENT
        stiffness = shape @ force_gwt / np.einsum("ij,ij->i", shape, shape)
        return ((force_gwt - stiffness[:, None] * shape) ** 2).sum(1)

    lowest, highest = height_mm[-1], height_mm[0]
    tried, step = np.linspace(lowest, highest, _TRIED, retstep=True)
    tried = tried[1:]  # at the last height itself nothing is below contact
    lowest += 0.5 * step
    for _ in range(_FINER):
        best = tried[int(np.argmin(misfits(tried)))]
        tried, step = np.linspace(max(best - step, lowest), min(best + step, highest), _TRIED, retstep=True)
    return float(tried[int(np.argmin(misfits(tried)))])
