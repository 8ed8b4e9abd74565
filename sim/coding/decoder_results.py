"""Errors, results, metrics and checks that all decoders share."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import ForwardOperator
from sim.errors import SimError

Array = NDArray[np.float64]


class CodingError(SimError, ValueError):
    """Error of input that cannot be encoded or decoded.

    `arguments` are those that the sentence names, so that a program with other names for them can replace each, where
    it first stands in the sentence.
    """

    default_code = "not_coded"

    def __init__(self, sentence: str = "", code: str | None = None, arguments: tuple[str, ...] = ()) -> None:
        super().__init__(sentence, code)
        self.arguments = arguments


class DecodingError(CodingError):
    """Error of readings that cannot be decoded."""

    default_code = "bad_readings"


@dataclass(frozen=True)
class Decoded:
    """Pressures that explain readings; `converged` is false where the search reached its limit."""

    pressure: Array  # (n,) pseudo-units
    misfit: float  # Σ (SED of the pressures − reading)²
    converged: bool
    path: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (moves + 1, n) if recorded


class DecodingErrors(NamedTuple):
    """Three metrics of the difference between decoded and true pressures; state the metric with each number."""

    eq_6_8: float  # Σ (x − x̂)² / Σ x², squared: Raju (1998), Eq. 6.8
    relative_l2: float
    rmse_over_peak: float


def decoding_errors(true: Array, found: Array) -> DecodingErrors:
    """Return the errors of (n,) decoded pressures from true ones, not all zero."""
    missed = ((true - found) ** 2).sum()
    squared = float(missed / (true**2).sum())
    return DecodingErrors(squared, float(np.sqrt(squared)), float(np.sqrt(missed / len(true)) / np.abs(true).max()))


def misfit(operator: ForwardOperator, pressure: Array, reading: Array) -> float:
    """Return Σ (SED of the pressures − reading)²."""
    return float(((operator.sed(pressure) - reading) ** 2).sum())


def checked_readings(operator: ForwardOperator, reading: Array, fewest: int | None = None) -> Array:
    """Return (m,) readings, one for each receptor. Raises DecodingError for too few, too many, or NaN.

    `fewest` defaults to the number of pressures.
    """
    receptors, unknowns = operator.parts.shape[1:]
    if reading.shape != (receptors,):
        raise DecodingError(f"{reading.size} readings: must be {receptors}, one for each receptor", "not_one_each")
    if fewest is None and receptors < unknowns:
        raise DecodingError(
            f"{receptors} readings of {unknowns} pressures: at least as many readings as pressures are required",
            "fewer_than_pressures",
        )
    if fewest is not None and receptors < fewest:
        raise DecodingError(
            f"{receptors} readings of {unknowns} pressures: at least {fewest} readings are required", "too_few"
        )
    bad = np.flatnonzero(~np.isfinite(reading))
    if len(bad):
        raise DecodingError(
            f"reading {int(bad[0]) + 1} is {float(reading[bad[0]]):g}: must be a number", "not_a_number"
        )
    return reading
