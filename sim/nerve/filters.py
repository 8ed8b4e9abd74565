"""Filters of receptor signals on an even time grid, exact for signals that are linear between samples."""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim.nerve.integrator import leaked

Array = NDArray[np.float64]

_POLES = (1.0, 0.5 + 0.5j * np.sqrt(3))
"""Minus the real pole and one of the pair of poles of a Butterworth filter of third order with corner 1 rad/s."""
_RESIDUES = (1.0, -0.5 + 0.5j / np.sqrt(3))
"""Residues of the filter at these poles; that of the other complex pole is conjugate, and all three add up to 0."""


class FilterMemory:
    """State of filters between blocks of a signal: the last sample, and the filter states.

    A model calls its filters in the same order for every block.
    """

    def __init__(self) -> None:
        self._states: list[tuple[Array, NDArray[Any]]] = []
        self._next = 0

    def begin_block(self) -> None:
        """Begin with the first filter again."""
        self._next = 0

    def state(self) -> tuple[Array, NDArray[Any]] | None:
        """Return the last sample and the state of the next filter; None in the first block."""
        return self._states[self._next] if self._next < len(self._states) else None

    def keep(self, sample: Array, state: NDArray[Any]) -> None:
        """Store the last sample and the state of this filter."""
        self._states[self._next : self._next + 1] = [(sample, state)]
        self._next += 1


def fading(signal: Array, tau_s: float, step_s: float, memory: FilterMemory | None = None) -> Array:
    """Return ∫ exp(−(t − u)/τ) dm(u) of a signal m (…, n_samples) that is 0 before its first sample.

    An infinite τ returns the signal. The samples follow those that `memory` has filtered.
    """
    return signal if np.isinf(tau_s) else np.asarray(_fading(signal, 1 / tau_s, step_s, memory))


def adapted(drive: Array, share: float, tau_s: float, step_s: float, memory: FilterMemory | None = None) -> Array:
    """Return the excess max(0, I − θ) of a drive over a slow threshold: τ dθ/dt = share·I − θ.

    The drive I (…, n_samples) is at least 0, and 0 before the first sample. The samples follow those of `memory`.
    """
    return np.maximum(0.0, drive - share * (drive - fading(drive, tau_s, step_s, memory)))


def strongest(drive: Array) -> Array:
    """Return the drive of each afferent (n_afferents, n_samples): the largest of its end organs at every instant.

    The branch that fires first resets the others, so that one end organ paces the axon (Horch, Whitehorn and Burgess
    1974, J Neurophysiol; Lesniak et al. 2014, eLife). `drive` is (n_afferents, n_organs, n_samples), or without
    organs.
    """
    return drive if drive.ndim == 2 else np.asarray(drive.max(axis=1))


def derivative_low_pass(
    signal: Array, frequency_hz: float, step_s: float, derivative: Literal[1, 2], memory: FilterMemory | None = None
) -> Array:
    """Return dm/dt or d²m/dt² (1/s, 1/s²) through a Butterworth low-pass of third order, 0.707 at `frequency_hz`.

    It is a sum over poles of memories that fade. At a pole −λ with residue r the low-pass of dm/dt is r times the
    memory, that of d²m/dt² is −λ r times it. The rest adds up to 0, since the residues do. The signal m (…,
    n_samples) is 0 before its first sample, which follows those of `memory`.
    """
    corner = 2 * np.pi * frequency_hz
    total = np.zeros(signal.shape)
    for pole, residue, times in zip(_POLES, _RESIDUES, (1, 2), strict=True):
        weight = times * corner * residue * (1 if derivative == 1 else -corner * pole)
        total += (weight * _fading(signal, corner * pole, step_s, memory)).real
    return total


def _fading(signal: Array, rate: complex, step_s: float, memory: FilterMemory | None) -> NDArray[Any]:
    """Return ∫ exp(−rate (t − u)) dm(u), exact for m that is linear between samples."""
    decay = np.exp(-step_s * rate)
    gain = -np.expm1(-step_s * rate) / (rate * step_s)
    rows = np.ascontiguousarray(signal).reshape(-1, signal.shape[-1])
    known = None if memory is None else memory.state()
    found = np.empty(rows.shape, dtype=np.result_type(decay, float))
    begin = 0
    if known is None:  # what is there at the very first sample came at once
        known, begin = (rows[:, 0].copy(), rows[:, 0].astype(found.dtype)), 1
        found[:, 0] = rows[:, 0]
    leaked(rows[:, begin:], known[0], decay, gain, known[1], found[:, begin:])
    if memory is not None:
        memory.keep(*known)
    return found.reshape(signal.shape)
