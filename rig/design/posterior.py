"""Probabilities of the candidates after each press: the update that a design and an adaptive run share."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rig.design.counts import CountModel, CountSums, no_counts, with_counts
from rig.design.fibers import FiberDraws
from rig.design.information import CountBins, count_bins, information_bits, log_evidence, probabilities

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

LEVEL = 0.95
"""Share of the probability that the set of candidates holds."""


@dataclass(frozen=True, eq=False)
class CandidatePosterior:
    """Posterior over candidates given the counts so far, of one fiber or of many data sets at once.

    Examples
    --------
    `later = now.updated(press, np.array([12.0]))` after a count of 12; `later.probabilities` are those of the
    candidates, and `later.information_bits(...)` is what each possible press would add.
    """

    model: CountModel
    draws: FiberDraws
    log_rate: Floats  # (candidates, draws, presses)
    sums: CountSums

    @classmethod
    def before(
        cls, model: CountModel, draws: FiberDraws, log_rate: Floats, minutes: float = 0.0, sets: int = 1
    ) -> "CandidatePosterior":
        """Return the state before the first press; with a session's minutes, the gain may drift."""
        return cls(model, draws, log_rate, no_counts(sets, log_rate.shape[2], minutes))

    def updated(self, press: int, counts: Array, tau: float = 0.0) -> "CandidatePosterior":
        """Return the state after one more press, by its number, with its count at a time tau (ten minutes)."""
        return replace(self, sums=with_counts(self.sums, press, counts, tau))

    @cached_property
    def log_likelihood(self) -> Floats:
        """Log-likelihood (candidates, s, draws)."""
        return np.stack([self.model.log_likelihood(self.sums, one, self.draws) for one in self.log_rate])

    @property
    def probabilities(self) -> Array:
        """Probabilities (s, candidates)."""
        return probabilities(self.log_likelihood)

    @property
    def log_evidence(self) -> Array:
        """Log evidence (s, candidates)."""
        return log_evidence(self.log_likelihood)

    def information_bits(self, particles: int, chance: np.random.Generator, bins: CountBins | None = None) -> Array:
        """Return the expected information (presses,) of one more press about the candidate (bits)."""
        bins = count_bins(self.model) if bins is None else bins
        likelihood = self.log_likelihood
        return information_bits(self.model, bins, self.sums, self.log_rate, self.draws, likelihood, particles, chance)


def in_set(probability: Array) -> NDArray[np.bool_]:
    """Return (s, candidates) flags of the smallest sets that hold `LEVEL` of the probability."""
    order = np.argsort(-probability, axis=1, kind="stable")
    ranked = np.take_along_axis(probability, order, axis=1)
    before = np.cumsum(ranked, axis=1) - ranked
    inside = np.empty(probability.shape, dtype=bool)
    np.put_along_axis(inside, order, before < LEVEL, axis=1)
    return inside
