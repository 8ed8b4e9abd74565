"""Decoders that search (pressure by pressure, grid, table, annealing); what all decoders return, errors, metrics."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import dual_annealing

from sim.coding.operators import ForwardOperator
from sim.errors import SimError

Array = NDArray[np.float64]


class CodingError(SimError, ValueError):
    """What cannot be encoded or decoded.

    An argument that the sentence names is a field whose value is its own name: a program that has other names for its
    arguments puts these in.
    """

    default_code = "not_coded"


class DecodingError(CodingError):
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


def misfit(operator: ForwardOperator, pressure: Array, reading: Array) -> float:
    """Σ (SED of the pressures − reading)²."""
    return float(((operator.sed(pressure) - reading) ** 2).sum())


def checked_readings(operator: ForwardOperator, reading: Array, fewest: int | None = None) -> Array:
    """(m,) readings, one for each receptor. Raises DecodingError for too few, too many, or no numbers.

    Too few is fewer than pressures, unless told.
    """
    receptors, unknowns = operator.parts.shape[1:]
    if reading.shape != (receptors,):
        raise DecodingError(
            "{readings} readings: must be {receptors}, one for each receptor",
            code="not_one_each",
            readings=reading.size,
            receptors=receptors,
        )
    if fewest is None and receptors < unknowns:
        raise DecodingError(
            "{readings} readings of {pressures} pressures: at least as many readings as pressures are required",
            code="fewer_than_pressures",
            readings=receptors,
            pressures=unknowns,
        )
    if fewest is not None and receptors < fewest:
        raise DecodingError(
            "{readings} readings of {pressures} pressures: at least {fewest} readings are required",
            code="too_few",
            readings=receptors,
            pressures=unknowns,
            fewest=fewest,
        )
    bad = np.flatnonzero(~np.isfinite(reading))
    if len(bad):
        raise DecodingError(
            "reading {number} is {value:g}: must be a number",
            code="not_a_number",
            number=int(bad[0]) + 1,
            value=float(reading[bad[0]]),
        )
    return reading


# --- univariate ---
#
# The source's decoder: one pressure after another is set to what fits the readings best (Raju 1998, §6.7).
#
# Along one coordinate SED is a quadratic and the squared error a quartic: its lowest point is found exactly
# (`converged_search`), or among the values of a grid, as the source does (`grid_search`).

STAGNANT = 1e-9
"""Share of the range: a sweep over all pressures that moves none by more has converged."""

MOST_SWEEPS = 20_000
"""Maximum number of sweeps over two pressures; for more pressures as many moves."""


class PressureRange(NamedTuple):
    """Values that a pressure may take."""

    low: float
    high: float


def converged_search(operator: ForwardOperator, reading: Array, start: Array, within: PressureRange) -> Decoded:
    """Exact minima along each coordinate in turn, to stagnation."""

    def lowest(quartic: Array, now: float) -> float:
        turns = np.roots(np.polyder(quartic))
        steps = turns.real[np.abs(turns.imag) <= 1e-6 * (1 + np.abs(turns.real))]
        values = np.array([now, *np.clip(now + steps, *within), *within])
        return float(values[np.argmin(np.polyval(quartic, values - now))])

    return _search(operator, reading, start, lowest, STAGNANT * (within.high - within.low))


def grid_search(
    operator: ForwardOperator, reading: Array, start: Array, within: PressureRange, step: float
) -> Decoded:
    """The best of equally spaced values along each coordinate in turn, until none moves: it may stick in a valley."""
    values = np.linspace(within.low, within.high, round((within.high - within.low) / step) + 1)

    def lowest(quartic: Array, now: float) -> float:
        return float(values[np.argmin(np.polyval(quartic, values - now))])

    return _search(operator, reading, start, lowest, 0.0)


def quartic_along(operator: ForwardOperator, reading: Array, pressure: Array, k: int) -> Array:
    """(5,) coefficients, highest power first, of the squared error as pressure k moves by t."""
    column, linear = operator.parts[:, :, k], operator.parts @ pressure
    left = (linear**2).sum(axis=0) - reading
    slope, bend = 2 * (linear * column).sum(axis=0), (column**2).sum(axis=0)
    return np.array([bend @ bend, 2 * slope @ bend, slope @ slope + 2 * left @ bend, 2 * left @ slope, left @ left])


def error_surface(operator: ForwardOperator, reading: Array, first: Array, second: Array) -> Array:
    """(k, l) squared errors of two pressures at (k,) values of the first and (l,) of the second."""
    both = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1)
    sed = (np.einsum("cmn,kln->cklm", operator.parts, both) ** 2).sum(axis=0)
    return np.asarray(((sed - reading) ** 2).sum(axis=-1))


def _search(
    operator: ForwardOperator, reading: Array, start: Array, lowest: Callable[[Array, float], float], stagnant: float
) -> Decoded:
    checked_readings(operator, reading)
    pressure, path, still = start.astype(float).copy(), [start.astype(float)], False
    for _ in range(max(1, 2 * MOST_SWEEPS // len(pressure))):
        before = pressure.copy()
        for k in range(len(pressure)):
            pressure[k] = lowest(quartic_along(operator, reading, pressure, k), float(pressure[k]))
            path.append(pressure.copy())
        still = bool(np.abs(pressure - before).max() <= stagnant)
        if still:
            break
    return Decoded(pressure, misfit(operator, pressure, reading), still, np.array(path))


# --- other searches ---
#
# Two more decoders that the source names: a table of simulated responses, and a global optimiser.

_ROUNDS = 100


def table_search(
    operator: ForwardOperator, reading: Array, within: PressureRange, entries: int, seed: int = 0
) -> Decoded:
    """The nearest in SED of so many random pressures; the same from the same seed."""
    checked_readings(operator, reading)
    drawn = np.random.default_rng(seed).uniform(*within, (entries, operator.parts.shape[2]))
    responses = np.einsum("cmn,kn->ckm", operator.parts, drawn)
    nearest = drawn[np.argmin((((responses**2).sum(axis=0) - reading) ** 2).sum(axis=1))]
    return Decoded(nearest, misfit(operator, nearest, reading), converged=True)


def global_search(operator: ForwardOperator, reading: Array, within: PressureRange, seed: int = 0) -> Decoded:
    """Scipy's dual annealing, each local search with the adjoint gradient; the same from the same seed."""
    checked_readings(operator, reading)
    scale = float(reading @ reading) or 1.0

    def cost(pressure: Array) -> float:
        return misfit(operator, pressure, reading) / scale

    def gradient(pressure: Array) -> Array:
        return operator.pulled_back(pressure, 2 * (operator.sed(pressure) - reading)) / scale

    bounds = [tuple(within)] * operator.parts.shape[2]
    local = {"method": "L-BFGS-B", "jac": gradient, "bounds": bounds}
    found = dual_annealing(cost, bounds, maxiter=_ROUNDS, rng=np.random.default_rng(seed), minimizer_kwargs=local)
    pressure = np.asarray(found.x, dtype=np.float64)
    return Decoded(pressure, misfit(operator, pressure, reading), bool(found.success))
