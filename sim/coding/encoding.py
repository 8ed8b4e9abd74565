"""Block diagram of Raju (1998, Fig. 6-6): pressure, SED, noise, receptor, rate."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import ForwardOperator
from sim.errors import ArgumentError, refuse_unless_numbers

Array = NDArray[np.float64]

NoisePlace = Literal["receptor", "output"]
ReadingUnit = Literal["pseudo-unit", "impulses/s"]
SED_UNIT: ReadingUnit = "pseudo-unit"
RATE_UNIT: ReadingUnit = "impulses/s"
"""Units of readings: of SED without a receptor, of its rates with one."""
NOISE_PLACES: tuple[NoisePlace, ...] = get_args(NoisePlace)
"""Location of the noise: before the receptor, on SED (Fig. 6-6), or on its output, the rate (§6.8)."""


@dataclass(frozen=True)
class Receptor:
    """Receptor R = k (S − S₀), silent below the threshold: one for all, or (m,) thresholds."""

    gain: float = 1.0
    threshold: float | Array = 0.0

    def rate(self, sed: Array) -> Array:
        """Return (m,) rates of (m,) SEDs, censored at zero."""
        return np.maximum(0.0, self.gain * (sed - self.threshold))


@dataclass(frozen=True)
class Noise:
    """Gaussian noise with a signal-to-noise ratio in decibels and a seed."""

    snr_db: float
    at: NoisePlace = "receptor"
    seed: int = 0

    def __post_init__(self) -> None:
        refuse_unless_numbers(snr_db=self.snr_db, seed=self.seed)
        if not (math.isfinite(self.snr_db) and int(self.seed) == self.seed >= 0):
            raise ArgumentError(
                f"snr_db = {self.snr_db} and seed = {self.seed}: must be finite, and a whole number from 0",
                "bad_noise",
            )


@dataclass(frozen=True)
class Encoded:
    """Receptor responses to a pressure. Without a receptor the rate is the noisy SED itself, not censored."""

    sed: Array  # (m,) without noise, pseudo-units
    rate: Array  # (m,)
    noise_sd: float  # in the unit of the signal with noise; 0 without noise
    share_of_peak: float  # noise_sd / highest value of that signal

    @property
    def samples(self) -> int:
        """Number M of samples over which the signal's variance in the SNR is computed."""
        return len(self.sed)


def noise_sd(signal: Array, snr_db: float) -> float:
    """Return the noise sd of SNR = 10 log₁₀(variance of the signal over all samples / variance of the noise)."""
    return float(np.sqrt(signal.var() / 10 ** (snr_db / 10)))


def encode(
    operator: ForwardOperator, pressure: Array, receptor: Receptor | None = None, noise: Noise | None = None
) -> Encoded:
    """Return receptor responses to (n,) pressures; the same bits for the same seed."""
    sed = operator.sed(pressure)
    before = noise is None or noise.at == "receptor"
    signal = sed if before or receptor is None else receptor.rate(sed)
    sd = 0.0 if noise is None else noise_sd(signal, noise.snr_db)
    noisy = signal if noise is None else signal + sd * np.random.default_rng(noise.seed).normal(size=len(signal))
    peak = float(np.abs(signal).max())
    return Encoded(sed, _output(noisy, receptor, before=before), sd, sd / peak if peak else 0.0)


def _output(noisy: Array, receptor: Receptor | None, *, before: bool) -> Array:
    if receptor is None:
        return noisy
    return receptor.rate(noisy) if before else np.maximum(0.0, noisy)
