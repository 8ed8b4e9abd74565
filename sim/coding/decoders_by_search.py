"""Decoders that search: pressure by pressure, on a grid, in a table, by annealing."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import dual_annealing

from sim.coding.decoding import Decoded, checked_readings, misfit
from sim.coding.operators import ForwardOperator

Array = NDArray[np.float64]

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
