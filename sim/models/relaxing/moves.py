"""What relaxation leaves of a force whose elastic course is known: moves, each even, with rests between them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Moves:
    """From no force to one elastic force after another, each reached evenly: when (p,) and in how long (p,), s."""

    ended_s: Array
    took_s: Array

    def fading(self, tau_s: float, asked_s: Array, last: NDArray[np.intp]) -> Array:
        """(r, p) what a term of relaxation has left of the elastic forces at (r,) instants: ∫ exp(−(t−s)/τ) dF.

        Exact. Moves after the last (r,) that counts then are still to come.
        """
        took_s = np.where(self.took_s > 0, self.took_s, 1.0)
        still = np.where(self.took_s > 0, -np.expm1(-took_s / tau_s) * tau_s / took_s, 1.0)
        there = np.arange(len(self.ended_s)) <= last[:, None]
        since_s = np.where(there, asked_s[:, None] - self.ended_s, 0.0)
        left = np.where(there, np.exp(-since_s / tau_s) * still, 0.0)
        return np.asarray(left - np.concatenate([left[:, 1:], np.zeros((len(left), 1))], axis=1))
