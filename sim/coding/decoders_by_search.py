"""Decoders that search: pressure by pressure, on a grid, in a table, by annealing."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import dual_annealing

from sim.coding.decoder_results import Decoded, checked_readings, misfit
from sim.coding.operators import ForwardOperator

Array = NDArray[np.float64]

# --- univariate ---
#
# The source's decoder sets one pressure after another to its best fit (Raju 1998, §6.7). Along one coordinate SED is
# a quadratic and the squared error a quartic, whose minimum is exact (`converged_search`), or chosen from a grid as
# in the source (`grid_search`).

STAGNANT = 1e-9
"""Convergence threshold, relative to the range: the largest change of a pressure in a sweep."""

MOST_SWEEPS = 20_000
"""Maximum number of sweeps over two pressures; for more pressures the same number of moves."""


class PressureRange(NamedTuple):
    """Allowed range of a pressure."""

    low: float
    high: float


def converged_search(operator: ForwardOperator, reading: Array, start: Array, within: PressureRange) -> Decoded:
    """Search exact minima along each coordinate in turn, to stagnation."""

    def lowest(quartic: Array, current: float) -> float:
        turns = np.roots(np.polyder(quartic))
        steps = turns.real[np.abs(turns.imag) <= 1e-6 * (1 + np.abs(turns.real))]
        values = np.array([current, *np.clip(current + steps, *within), *within])
        return float(values[np.argmin(np.polyval(quartic, values - current))])

    return _search(operator, reading, start, lowest, STAGNANT * (within.high - within.low))


def grid_search(
    operator: ForwardOperator, reading: Array, start: Array, within: PressureRange, step: float
) -> Decoded:
    """Search the best of equally spaced values along each coordinate in turn; it may get stuck in a valley."""
    values = np.linspace(within.low, within.high, round((within.high - within.low) / step) + 1)

    def lowest(quartic: Array, current: float) -> float:
        return float(values[np.argmin(np.polyval(quartic, values - current))])

    return _search(operator, reading, start, lowest, 0.0)


def quartic_along(operator: ForwardOperator, reading: Array, pressure: Array, k: int) -> Array:
    """Return (5,) coefficients, highest power first, of the squared error as pressure k changes by t."""
    column, linear = operator.parts[:, :, k], operator.parts @ pressure
    left = (linear**2).sum(axis=0) - reading
    slope, bend = 2 * (linear * column).sum(axis=0), (column**2).sum(axis=0)
    return np.array([bend @ bend, 2 * slope @ bend, slope @ slope + 2 * left @ bend, 2 * left @ slope, left @ left])


def error_surface(operator: ForwardOperator, reading: Array, first: Array, second: Array) -> Array:
    """Return (k, l) squared errors of two pressures at (k,) values of the first and (l,) of the second."""
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
# The source names two more decoders: a table of simulated responses, and a global optimizer.

_ROUNDS = 100


def table_search(
    operator: ForwardOperator, reading: Array, within: PressureRange, entries: int, seed: int = 0
) -> Decoded:
    """Return the random pressures with the nearest SED; reproducible by seed."""
    checked_readings(operator, reading)
    samples = np.random.default_rng(seed).uniform(*within, (entries, operator.parts.shape[2]))
    responses = np.einsum("cmn,kn->ckm", operator.parts, samples)
    nearest = samples[np.argmin((((responses**2).sum(axis=0) - reading) ** 2).sum(axis=1))]
    return Decoded(nearest, misfit(operator, nearest, reading), converged=True)


def global_search(operator: ForwardOperator, reading: Array, within: PressureRange, seed: int = 0) -> Decoded:
    """Search by scipy's dual annealing with adjoint gradients; reproducible by seed."""
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
