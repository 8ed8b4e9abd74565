"""Power law SED = A / r^m, by least squares of SED or of its logarithm."""

from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]

FitKind = Literal["linear", "logarithmic"]
FIT_KINDS: tuple[FitKind, ...] = get_args(FitKind)
"""Fit: `linear` minimizes squared differences of SED, which weights near receptors; `logarithmic` fits a line to the
logarithms."""


class PowerLaw(NamedTuple):
    """Power law A / r^m, its correlation with the data, and the share of variance that it explains."""

    a: float  # at r = 1 mm, in the unit of the data
    m: float
    r: float
    r2: float

    def at(self, distance_mm: Array) -> Array:
        """Return (n,) values of the law."""
        return np.asarray(self.a / distance_mm**self.m)


def fitted(distance_mm: Array, values: Array, kind: FitKind) -> PowerLaw:
    """Fit the law to (n,) positive values at (n,) distances."""
    logs = np.log(distance_mm), np.log(values)
    slope, intercept = np.polyfit(*logs, 1)
    if kind == "logarithmic":
        return _judged(intercept, -slope, logs[1], intercept + slope * logs[0])
    size = values.max()
    found = least_squares(
        lambda v: np.exp(v[0] - v[1] * logs[0]) / size - values / size, [intercept, -slope], xtol=1e-12, ftol=1e-12
    )
    log_a, m = found.x.tolist()
    return _judged(log_a, m, values, np.exp(log_a - m * logs[0]))


def _judged(log_a: float, m: float, values: Array, law: Array) -> PowerLaw:
    left = ((values - law) ** 2).sum() / ((values - values.mean()) ** 2).sum()
    return PowerLaw(float(np.exp(log_a)), float(m), float(np.corrcoef(values, law)[0, 1]), float(1 - left))
