"""Filters of receptor signals on an even time grid, exact for signals that are linear between samples."""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

_POLES = (1.0, 0.5 + 0.5j * np.sqrt(3))
"""Minus the real pole and one of the pair of poles of a Butterworth filter of third order with corner 1 rad/s."""
_RESIDUES = (1.0, -0.5 + 0.5j / np.sqrt(3))
"""Residues of the filter at these poles; that of the other complex pole is conjugate, and all three add up to 0."""


def fading(signal: Array, tau_s: float, step_s: float) -> Array:
    """Return ∫ exp(−(t − u)/τ) dm(u) of a signal that is 0 before its first sample.

    Parameters
    ----------
    signal : ndarray of shape (…, n_samples)
        The signal m.
    tau_s : float
        Time constant τ (s); infinite returns the signal.
    step_s : float
        Time between samples (s).

    Returns
    -------
    ndarray of shape (…, n_samples)
        Memory of the signal's changes, which fades.
    """
    return signal if np.isinf(tau_s) else np.asarray(_fading(signal, 1 / tau_s, step_s))


def adapted(drive: Array, share: float, tau_s: float, step_s: float) -> Array:
    """Return what of a drive exceeds a slow threshold, which approaches a share of the drive: τ dθ/dt = share·I − θ.

    Parameters
    ----------
    drive : ndarray of shape (…, n_samples)
        The drive I, at least 0; it is 0 before the first sample.
    share : float
        The threshold after a long time, relative to the drive, 0 to 1.
    tau_s : float
        Time constant τ (s).
    step_s : float
        Time between samples (s).

    Returns
    -------
    ndarray of shape (…, n_samples)
        max(0, I − θ).
    """
    return np.maximum(0.0, drive - share * (drive - fading(drive, tau_s, step_s)))


def derivative_low_pass(signal: Array, frequency_hz: float, step_s: float, derivative: Literal[1, 2]) -> Array:
    """Return dm/dt or d²m/dt² through a Butterworth low-pass of third order: a sum over poles of memories that fade.

    At a pole −λ with residue r the low-pass of dm/dt is r times the memory, that of d²m/dt² is −λ r times it. The
    rest adds up to 0, since the residues do.

    Parameters
    ----------
    signal : ndarray of shape (…, n_samples)
        The signal m; it is 0 before the first sample.
    frequency_hz : float
        Corner frequency, at which the filter passes 0.707 (Hz).
    step_s : float
        Time between samples (s).
    derivative : {1, 2}
        Which derivative.

    Returns
    -------
    ndarray of shape (…, n_samples)
        The filtered derivative (1/s or 1/s²).
    """
    corner = 2 * np.pi * frequency_hz
    total = np.zeros(signal.shape)
    for pole, residue, times in zip(_POLES, _RESIDUES, (1, 2), strict=True):
        weight = times * corner * residue * (1 if derivative == 1 else -corner * pole)
        total += (weight * _fading(signal, corner * pole, step_s)).real
    return total


def _fading(signal: Array, rate: complex, step_s: float) -> NDArray[Any]:
    """Return ∫ exp(−rate (t − u)) dm(u), exact for m that is linear between samples."""
    decay = np.exp(-step_s * rate)
    gain = -np.expm1(-step_s * rate) / (rate * step_s)
    made = lfilter([gain], [1.0, -decay], np.diff(signal, axis=-1), axis=-1)
    # What is there at the first sample came at once.
    first = signal[..., :1] * np.exp(-rate * step_s * np.arange(signal.shape[-1]))
    return np.asarray(first + np.concatenate([np.zeros_like(made[..., :1]), made], axis=-1))
