"""Input of a decoder: one reading for each receptor, its noise, and which readings are only upper bounds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from sim.coding.decoder_results import DecodingError
from sim.coding.encoding import Receptor

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LOWEST_SD = 6.0
"""Number of sd below 0 beyond which an SED reading cannot be noise."""

QUIET_SD = 3.0
"""Number of sd below which a noisy rate only bounds the true one."""

FEWEST_AT_REST = 3
"""Fewest readings of an unloaded receptor for an estimate of its noise."""

_DEAF = 1e-6  # least weight of a silent reading / that of another


@dataclass(frozen=True)
class Readings:
    """Noisy SED in pseudo-units; for a silent receptor, noisy SED was at most its threshold."""

    sed: Array  # (m,) the threshold for silent receptors
    sd: float
    silent: Flags  # (m,)

    @classmethod
    def of_sed(cls, sed: Array, sd: float) -> "Readings":
        """Make readings of noisy SED. Raises DecodingError for values too far below 0 to be noise."""
        low = np.flatnonzero(sed < -LOWEST_SD * _positive(sd))
        if len(low):
            raise DecodingError(
                f"reading {int(low[0]) + 1} is {float(sed[low[0]]):g}; SED must be above −{LOWEST_SD:g} sd of its "
                f"noise, which is {sd:g}",
                "below_noise",
            )
        return cls(sed, sd, np.zeros(len(sed), np.bool_))

    @classmethod
    def of_rates(cls, rate: Array, receptor: Receptor, sd: float) -> "Readings":
        """Make readings of rates with noise before the receptors, sd in SED. Raises DecodingError below zero."""
        if (rate < 0).any():
            raise DecodingError(f"rate {float(rate.min()):g}: must not be negative", "negative_rate")
        return cls(rate / receptor.gain + receptor.threshold, _positive(sd), rate == 0)

    @classmethod
    def of_noisy_rates(cls, rate: Array, receptor: Receptor, sd: float) -> "Readings":
        """Make readings of rates with noise on the rates, sd in their unit. Raises DecodingError below zero.

        Rates up to `QUIET_SD` sd are censored together: below the threshold every SED gives the same.
        """
        quiet = QUIET_SD * _positive(sd)
        rates, silent = cls.of_rates(rate, receptor, sd / receptor.gain), rate <= quiet
        return cls(np.where(silent, quiet / receptor.gain + receptor.threshold, rates.sed), rates.sd, silent)

    def cost(self, sed: Array) -> tuple[Array, Array, Array]:
        """Return (m,) negative log likelihoods of true SEDs, with first and second derivatives.

        Gaussian; for silent receptors the censored −log Φ(−z) with z = (SED − threshold) / sd.
        """
        z = (sed - self.sed) / self.sd
        log_below = log_ndtr(-z)
        mills = np.exp(-0.5 * z * z - log_below) / np.sqrt(2 * np.pi)
        cost = np.where(self.silent, -log_below, 0.5 * z * z)
        first = np.where(self.silent, mills, z)
        second = np.where(self.silent, mills * (mills - z), 1.0)
        return cost, first / self.sd, second / self.sd**2

    def derivatives(self, sed: Array) -> tuple[Array, Array]:
        """Return the derivatives of `cost`; the second, the weight of a reading, is never 0."""
        _, first, second = self.cost(sed)
        return first, np.maximum(second, _DEAF / self.sd**2)


def sd_at_rest(unloaded: Array) -> float:
    """Estimate the noise sd from readings of unloaded receptors. Raises DecodingError for too few, or no noise."""
    if len(unloaded) < FEWEST_AT_REST or not np.isfinite(unloaded).all():
        raise DecodingError(
            f"{len(unloaded)} readings at rest: at least {FEWEST_AT_REST} finite numbers are required",
            "too_few_at_rest",
        )
    return _positive(float(np.std(unloaded, ddof=1)))


def _positive(sd: float) -> float:
    if not (np.isfinite(sd) and sd > 0):
        raise DecodingError(f"noise sd {sd:g}: must be a positive number", "noise_not_positive")
    return sd
