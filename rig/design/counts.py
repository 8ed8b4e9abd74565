"""Counts of spikes: how they scatter, and their log-likelihood with the gain integrated out.

A count y in a window w has the mean μ = k w g and the variance φ μ. Its quasi-log-likelihood is
(y ln μ − μ − y ln y + y) / φ − ½ ln φ, which is Poisson's at φ = 1 (Nelder & Pregibon, Biometrika 74, 221, 1987).
With a gamma distribution of k, ∫ k^(Y/φ) e^(−kG/φ) p(k) dk is a gamma function: no draws are spent on the gain. What
the counts contribute are sums, so that a press adds to them and many data sets need one product of matrices.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, xlogy

from rig.design.fibers import FiberDraws, Unknowns

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

TEN_MINUTES_S = 600.0
_TAU_BINS = 16


class CountSums(NamedTuple):
    """Sums over the counts of data sets (s,), which presses add to.

    `by_press` (s, presses), Σ y; `scatter` Σ (y ln y − y); `fired` presses with a spike; `drifted` Σ y τ, with τ the
    time from the middle in units of ten minutes. `repeats` (presses,) and `late` (presses, bins) describe the presses
    made: how often, and at which of the times `tau` (bins,).
    """

    by_press: Array
    scatter: Array
    fired: Array
    drifted: Array
    late: Array
    tau: Array

    @property
    def repeats(self) -> Array:
        """Number of times that each press was made (presses,)."""
        return np.asarray(self.late.sum(axis=1))

    def one(self, s: int) -> "CountSums":
        """Return the sums of one data set."""
        return self._replace(
            by_press=self.by_press[[s]],
            scatter=self.scatter[[s]],
            fired=self.fired[[s]],
            drifted=self.drifted[[s]],
        )


def no_counts(sets: int, presses: int, minutes: float = 0.0) -> CountSums:
    """Return the sums before the first press of a session of `minutes`."""
    half = minutes * 60 / TEN_MINUTES_S / 2
    tau = half * (2 * (np.arange(_TAU_BINS) + 0.5) / _TAU_BINS - 1) if minutes else np.zeros(1)
    none = np.zeros(sets)
    return CountSums(np.zeros((sets, presses)), none, none, none, np.zeros((presses, len(tau))), tau)


def with_counts(sums: CountSums, press: int, counts: Array, tau: float = 0.0) -> CountSums:
    """Return the sums after one more press, with counts (s,) at a time tau."""
    by_press, late = sums.by_press.copy(), sums.late.copy()
    by_press[:, press] += counts
    late[press, int(np.argmin(np.abs(sums.tau - tau)))] += 1
    return CountSums(
        by_press,
        sums.scatter + xlogy(counts, counts) - counts,
        sums.fired + (counts > 0),
        sums.drifted + tau * counts,
        late,
        sums.tau,
    )


@dataclass(frozen=True)
class CountModel:
    """Window (s) in which spikes are counted, and the unknowns of a fiber."""

    window_s: float
    unknowns: Unknowns

    @property
    def _gain(self) -> tuple[float, float]:
        """Shape, and rate in s, of the gamma distribution of k."""
        shape = self.unknowns.gain_shape
        return shape, shape / self.unknowns.gain_mean_per_s

    def draw_gains(self, n: int, chance: np.random.Generator) -> Array:
        """Return n gains (1/s)."""
        shape, rate = self._gain
        return chance.gamma(shape, 1 / rate, n)

    def exposure_s(self, log_rate: Floats, drift: Array, sums: CountSums) -> Array:
        """Return (draws,) the sum of windows times relative rates."""
        seen = np.flatnonzero(sums.repeats)
        rate = np.exp(log_rate[:, seen])
        if len(sums.tau) == 1:
            return np.asarray(self.window_s * (rate @ sums.late[seen, 0].astype(np.float32)), dtype=float)
        by_time = rate @ sums.late[seen].astype(np.float32)
        drifting = np.exp(drift[:, None] * sums.tau)
        return np.asarray(self.window_s * (by_time * drifting).sum(axis=1), dtype=float)

    def log_likelihood(self, sums: CountSums, log_rate: Floats, draws: FiberDraws) -> Floats:
        """Return (s, draws) log-likelihoods of the data sets, with the gain integrated out."""
        shape, rate = self._gain
        seen = np.flatnonzero(sums.repeats)
        total = sums.by_press.sum(axis=1)
        drift = draws.drift if len(sums.tau) > 1 else np.zeros(len(draws))
        exposure = self.exposure_s(log_rate, drift, sums)
        dispersion = self.unknowns.dispersions[draws.level]
        own = sums.by_press[:, seen].astype(np.float32) @ log_rate[:, seen].T
        own += np.outer(sums.drifted, drift).astype(np.float32)
        own /= dispersion.astype(np.float32)
        known = np.empty((len(total), len(self.unknowns.dispersions)))
        for level, phi in enumerate(self.unknowns.dispersions):
            known[:, level] = (
                gammaln(shape + total / phi) - sums.scatter / phi - 0.5 * sums.fired * np.log(phi)
                + total * np.log(self.window_s) / phi
            )  # fmt: skip
        ending = np.log1p(exposure / dispersion / rate).astype(np.float32)
        power = (shape + total[:, None] / self.unknowns.dispersions - 0.0).astype(np.float32)
        constant = (known - (total[:, None] / self.unknowns.dispersions) * np.log(rate)).astype(np.float32)
        if len(self.unknowns.dispersions) == 1:
            own += constant - power * ending
        else:
            own += constant[:, draws.level] - power[:, draws.level] * ending
        return own - np.float32(gammaln(shape))

    def gain_posterior(self, sums: CountSums, exposure: Array, dispersion: Array) -> tuple[Array, Array]:
        """Return shape (s, draws) and rate (draws,) of the gamma distribution of k after the counts."""
        shape, rate = self._gain
        total = sums.by_press.sum(axis=1)
        return shape + total[:, None] / dispersion, rate + exposure / dispersion


def draw_counts(mean: Array, dispersion: Array | float, chance: np.random.Generator) -> Array:
    """Return counts with these means, and variances of dispersion × mean.

    Negative binomial above 1; at 1 and below Poisson and, for regular discharge, rounded normal.
    """
    phi = np.broadcast_to(np.asarray(dispersion, dtype=float), mean.shape)
    wide = phi > 1 + 1e-9
    scale = np.where(wide, phi - 1, 1.0)
    mixed = np.where(wide, chance.standard_gamma(np.maximum(mean, 1e-12) / scale) * scale, mean)
    counts = chance.poisson(mixed).astype(float)
    regular = phi < 1 - 1e-9
    if regular.any():
        normal = mean + np.sqrt(phi * mean) * chance.standard_normal(mean.shape)
        # A window with few spikes is no more regular than chance allows: the count is one of the two whole numbers.
        low = np.floor(np.maximum(normal, 0.0))
        counts = np.where(regular, low + (chance.random(mean.shape) < np.maximum(normal, 0.0) - low), counts)
    return counts
