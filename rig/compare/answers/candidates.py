"""The candidates of an answer on one finger or on a design of plausible ones, and their likeliest fits."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.answers.goodness import lack_of_fit
from rig.compare.answers.likeliest import Form, Likeliest, likeliest
from rig.compare.answers.observed import Observed
from rig.compare.fingers.finger_fit import fit_with_finger, free_of, weights

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DISCREPANCY = 0.5
"""How far a right measure may be off on a finger that no finger of the ranges quite is, over the spread of these."""

OF_THE_MESH = 0.02
"""And how far on another mesh, over the largest rate (docs/comparison.md)."""


class Fitted(NamedTuple):
    """Each candidate's fit, its ε (N, p) on its best finger, and that finger's place (N, free)."""

    found: Likeliest
    eps: Array
    place: Array


@dataclass(frozen=True, eq=False)
class Candidates:
    """ε (fingers, N, p) of measures and controls on one finger, or on the design of plausible ones."""

    eps: Array
    form: Form

    @property
    def free(self) -> int:
        """Parameters of the finger that are fitted, too."""
        return free_of(self.eps)

    @property
    def parameters(self) -> int:
        """Of a candidate's fit."""
        return self.form.parameters + self.free

    def only(self, chosen: Flags | NDArray[np.int64]) -> "Candidates":
        """Some of them."""
        return replace(self, eps=self.eps[:, chosen])

    def fitted(self, observed: Observed, at: Flags | None = None) -> Fitted:
        """To what was observed, or to some of it; ε is at every position all the same."""
        at = np.ones(len(observed.rate), dtype=bool) if at is None else at
        some = observed.at(at)
        if not self.free:
            return Fitted(
                likeliest(self.eps[0][:, at], some, self.form), self.eps[0], np.zeros((self.eps.shape[1], 0))
            )
        weight = 1 / some.variance(some.smooth)
        place = fit_with_finger(self.eps[:, :, at], some.rate, weight, silent=self.form.silent_at_rest).place
        eps = np.einsum("nf,fnp->np", weights(place), self.eps)
        return Fitted(likeliest(eps[:, at], some, self.form), eps, place)

    def discrepancy(self, fit: Fitted) -> Array:
        """(N, p) variance of rates that another finger and mesh may make, where fingers are stated; else none.

        A share of what the fingers of the design differ by, once k and ε₀ have followed, and one of the largest rate.
        """
        if not self.free:
            return np.zeros_like(fit.found.mean)
        own = fit.eps - fit.eps.mean(axis=1, keepdims=True)
        all_ = self.eps - self.eps.mean(axis=2, keepdims=True)
        slope = (all_ * own).sum(axis=2) / np.maximum((own * own).sum(axis=1), np.finfo(float).tiny)
        spread = ((all_ - slope[..., None] * own) ** 2).mean(axis=0)
        fires = fit.found.mean > 0
        of_finger = DISCREPANCY**2 * np.nan_to_num(fit.found.k)[:, None] ** 2 * spread
        of_mesh = (OF_THE_MESH * fit.found.mean.max(axis=1, keepdims=True)) ** 2
        return np.where(fires, of_finger + of_mesh, 0.0)

    def tested(self, observed: Observed, fit: Fitted) -> tuple[Array, Array]:
        """F and p (N,) of each candidate's own fit."""
        found = fit.found
        return lack_of_fit(observed, found.mean, found.deviance, self.parameters, self.discrepancy(fit))
