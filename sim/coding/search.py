"""What a decoder answers, and how far that is from the truth."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import Operator
from sim.errors import SimError

Array = NDArray[np.float64]


class DecodingError(SimError, ValueError):
    """Readings that cannot be decoded; the message says what was expected."""

    default_code = "bad_readings"


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
        raise DecodingError(
            "{readings} readings: expected {receptors}, one for each receptor",
            code="not_one_each",
            readings=reading.size,
            receptors=receptors,
        )
    if fewest is None and receptors < unknowns:
        raise DecodingError(
            "{readings} readings of {pressures} pressures: expected at least as many",
            code="fewer_than_pressures",
            readings=receptors,
            pressures=unknowns,
        )
    if fewest is not None and receptors < fewest:
        raise DecodingError(
            "{readings} readings of {pressures} pressures: expected {fewest} or more",
            code="too_few",
            readings=receptors,
            pressures=unknowns,
            fewest=fewest,
        )
    bad = np.flatnonzero(~np.isfinite(reading))
    if len(bad):
        raise DecodingError(
            "reading {number} is {value:g}: expected a number",
            code="not_a_number",
            number=int(bad[0]) + 1,
            value=float(reading[bad[0]]),
        )
    return reading
