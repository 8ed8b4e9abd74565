"""The block diagram of Raju (1998, Fig. 6-6): pressure, SED, noise, receptor, rate."""

import warnings
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import ForwardOperator

Array = NDArray[np.float64]

NoisePlace = Literal["receptor", "output"]
SED_UNIT, RATE_UNIT = "pseudo-unit", "impulses/s"
"""Units of readings: of SED without a receptor, of its rates with one."""
NOISE_PLACES: tuple[NoisePlace, ...] = get_args(NoisePlace)
"""Where noise is added: before the receptor, on SED (Fig. 6-6), or on its output, the rate (§6.8)."""


@dataclass(frozen=True)
class Receptor:
    """R = k (S − S₀), silent below the threshold: that of all receptors, or (m,) of each."""

    gain: float = 1.0
    threshold: float | Array = 0.0

    def rate(self, sed: Array) -> Array:
        """(m,) rates of (m,) SEDs, censored at zero."""
        return np.maximum(0.0, self.gain * (sed - self.threshold))


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of a signal-to-noise ratio in decibels, from a seed."""

    snr_db: float
    at: NoisePlace = "receptor"
    seed: int = 0


@dataclass(frozen=True)
class Encoded:
    """What receptors say of a pressure. Without a receptor the rate is the noisy SED itself, not censored."""

    sed: Array  # (m,) without noise, pseudo-units
    rate: Array  # (m,)
    noise_sd: float  # in the unit of where the noise is added; 0 without
    share_of_peak: float  # noise_sd over the highest value there

    @property
    def samples(self) -> int:
        """M, over which the signal's variance in the SNR is taken."""
        return len(self.sed)


def noise_sd(signal: Array, snr_db: float) -> float:
    """SNR = 10 log₁₀(variance of the signal over all its samples / variance of the noise)."""
    return float(np.sqrt(signal.var() / 10 ** (snr_db / 10)))


def encode(
    operator: ForwardOperator, pressure: Array, receptor: Receptor | None = None, noise: Noise | None = None
) -> Encoded:
    """What receptors say of (n,) pressures; the same bits from the same seed."""
    sed = operator.sed(pressure)
    before = noise is None or noise.at == "receptor"
    signal = sed if before or receptor is None else receptor.rate(sed)
    sd = 0.0 if noise is None else noise_sd(signal, noise.snr_db)
    noisy = signal if noise is None else signal + sd * np.random.default_rng(noise.seed).normal(size=len(signal))
    peak = float(np.abs(signal).max())
    return Encoded(sed, _said(noisy, receptor, before=before), sd, sd / peak if peak else 0.0)


def _said(noisy: Array, receptor: Receptor | None, *, before: bool) -> Array:
    if receptor is None:
        return noisy
    return receptor.rate(noisy) if before else np.maximum(0.0, noisy)


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """The names of `sim.coding.readings` answer here for one release."""
        if name not in ("FEWEST_AT_REST", "LOWEST_SD", "QUIET_SD", "Readings", "sd_at_rest"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        warnings.warn(f"{__name__}.{name} is sim.coding.readings.{name} now", DeprecationWarning, stacklevel=2)
        return getattr(import_module("sim.coding.readings"), name)
