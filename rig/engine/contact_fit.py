"""Fit of the contact height to the readings of a descent."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.engine.limits import CONTACT_EXPONENT
from rig.records import ContactFit

_TRIED = 201  # contact heights tried at once
_FINER = 4  # refinements about the best one, each a hundred times finer


def fit_contact(readings: Sequence[tuple[float, float]], threshold_gwt: float, resolution_gwt: float) -> ContactFit:
    """Fit the contact height to (height mm, force gwt) readings that descend to the threshold.

    Least-squares fit of F = a · (contact − height)^1.5, zero above contact, to all readings, so that a single noisy
    reading has little weight. If fewer than two readings exceed half a step of the sensor (resolution_gwt), the last
    height is returned.
    """
    height, force = np.array(readings).T
    shown = force > 0.5 * resolution_gwt
    contact = float(height[-1]) if shown.sum() < 2 else _least_squares(height, force)
    return ContactFit(threshold_gwt, float(height[-1]), float(force[-1]), contact, int(shown.sum()))


def _least_squares(height_mm: NDArray[np.float64], force_gwt: NDArray[np.float64]) -> float:
    """Return the contact height (mm) within the descent; the best stiffness follows from each candidate."""

    def misfits(contact_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        shape = np.maximum(contact_mm[:, None] - height_mm, 0.0) ** CONTACT_EXPONENT
        stiffness = shape @ force_gwt / np.einsum("ij,ij->i", shape, shape)
        return ((force_gwt - stiffness[:, None] * shape) ** 2).sum(1)

    lowest, highest = height_mm[-1], height_mm[0]
    tried, step = np.linspace(lowest, highest, _TRIED, retstep=True)
    tried = tried[1:]  # At the last height nothing is below contact.
    lowest += 0.5 * step
    for _ in range(_FINER):
        best = tried[int(np.argmin(misfits(tried)))]
        tried, step = np.linspace(max(best - step, lowest), min(best + step, highest), _TRIED, retstep=True)
    return float(tried[int(np.argmin(misfits(tried)))])
