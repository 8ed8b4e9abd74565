"""Two more decoders that the source names: a table of simulated responses, and a global optimiser."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import dual_annealing

from sim.coding.decoded import Decoded, checked_readings, misfit
from sim.coding.operators import Operator
from sim.coding.univariate import Range

Array = NDArray[np.float64]

_ROUNDS = 100


def table_search(operator: Operator, reading: Array, within: Range, entries: int, seed: int = 0) -> Decoded:
    """The nearest in SED of so many random pressures; the same from the same seed."""
    checked_readings(operator, reading)
    drawn = np.random.default_rng(seed).uniform(*within, (entries, operator.parts.shape[2]))
    responses = np.einsum("cmn,kn->ckm", operator.parts, drawn)
    nearest = drawn[np.argmin((((responses**2).sum(axis=0) - reading) ** 2).sum(axis=1))]
    return Decoded(nearest, misfit(operator, nearest, reading), converged=True)


def global_search(operator: Operator, reading: Array, within: Range, seed: int = 0) -> Decoded:
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
