"""Filters of receptor signals on an even time grid, exact for signals that are linear between samples."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


def low_pass(signal: Array, frequency_hz: float, step_s: float, order: int = 1) -> Array:
    """Return a signal through `order` first-order low-pass filters in series.

    Parameters
    ----------
    signal : ndarray of shape (…, n_samples)
        The signal; it is 0 before the first sample.
    frequency_hz : float
        Corner frequency of each filter (Hz).
    step_s : float
        Time between samples (s).
    order : int, optional
        Number of filters. Default: 1.

    Returns
    -------
    ndarray of shape (…, n_samples)
        The filtered signal.
    """
    rate = 2 * np.pi * frequency_hz
    for _ in range(order):
        signal = _lagged(signal, rate, step_s)
    return signal


def fading(signal: Array, tau_s: float, step_s: float) -> Array:
    """Return ∫ exp(−(t − s)/τ) dm(s) of a signal that is 0 before its first sample.

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
    if np.isinf(tau_s):
        return signal
    decay = np.exp(-step_s / tau_s)
    gain = -np.expm1(-step_s / tau_s) * tau_s / step_s
    change = np.diff(signal, axis=-1, prepend=0.0)
    change[..., 0] /= gain  # what is there at the first sample came at once
    return np.asarray(lfilter([gain], [1.0, -decay], change, axis=-1))


def _lagged(signal: Array, rate: float, step_s: float) -> Array:
    """Return dy/dt = rate (m − y), exact for m linear between samples: y = m − ∫ exp(−rate (t − s)) dm(s)."""
    return np.asarray(signal - fading(signal, 1 / rate, step_s))
