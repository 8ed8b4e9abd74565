"""What a decoder answers, and how far that is from the truth."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import Operator

Array = NDArray[np.float64]


class DecodingError(ValueError):
    """Readings that cannot be decoded; the message says what was expected."""


@dataclass(frozen=True)
class Decoded:
    """Pressures that explain readings; `converged` is false where the search was cut off."""

    pressure: Array  # (n,) pseudo-units
    misfit: float  # Σ (SED of the pressures − reading)²
    converged: bool
    path: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (moves + 1, n) where it is kept


class DecodingErrors(NamedTuple):
    """Three metrics of one difference; which one a number is, is said beside it."""

    eq_6_8: float  # Σ (x − x̂)² / Σ x², squared: Raju (1998), Eq. 6.8
    relative_l2: float
    rmse_over_peak: float


def decoding_errors(true: Array, found: Array) -> DecodingErrors:
    """Of (n,) true pressures, not all zero, and those that were found."""
    missed = ((true - found) ** 2).sum()
    squared = float(missed / (true**2).sum())
    return DecodingErrors(squared, float(np.sqrt(squared)), float(np.sqrt(missed / len(true)) / np.abs(true).max()))


def misfit(operator: Operator, pressure: Array, reading: Array) -> float:
    """Σ (SED of the pressures − reading)²."""
    return float(((operator.sed(pressure) - reading) ** 2).sum())


def checked_readings(operator: Operator, reading: Array, fewest: int | None = None) -> Array:
    """(m,) readings, one for each receptor. Raises DecodingError for too few, too many, or no numbers.

    Too few is fewer than pressures, unless told.
    """
    receptors, unknowns = operator.parts.shape[1:]
    if reading.shape != (receptors,):
        raise DecodingError(f"{reading.size} readings: expected {receptors}, one for each receptor")
    if fewest is None and receptors < unknowns:
        raise DecodingError(f"{receptors} readings of {unknowns} pressures: expected at least as many")
    if fewest is not None and receptors < fewest:
        raise DecodingError(f"{receptors} readings of {unknowns} pressures: expected {fewest} or more")
    bad = np.flatnonzero(~np.isfinite(reading))
    if len(bad):
        raise DecodingError(f"reading {bad[0] + 1} is {reading[bad[0]]:g}: expected a number")
    return reading
