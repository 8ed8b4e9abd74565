"""Classes of afferents by name, and spikes of any class."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from sim.errors import ArgumentError
from sim.nerve.filters import FilterMemory
from sim.nerve.integrator import Membrane, spikes
from sim.nerve.pc import PC
from sim.nerve.ra import RA
from sim.nerve.sa1 import SA1
from sim.nerve.skin import Signal

Array = NDArray[np.float64]

MOST_SAMPLES = 100_000_000
"""Largest number of samples of all afferents together; their currents take 0.8 GB."""


_MOST_STEP_S = 2.5e-4
"""Longest step of a signal (s); between samples that are farther apart a spline is read. PC follows its curvature."""


class AfferentModel(Protocol):
    """A class of afferents: from the measures at a receptor to the current at its spike sites.

    End organs lie in a disc of diameter `field_mm`, `depth_mm` below the skin.
    """

    @property
    def name(self) -> str: ...

    @property
    def depth_mm(self) -> float: ...

    @property
    def membrane(self) -> Membrane: ...

    @property
    def sites(self) -> int: ...

    @property
    def organs(self) -> int: ...

    @property
    def field_mm(self) -> float: ...

    def measure(self, measures: dict[str, Array]) -> Array:
        """Return the signal at receptors, shape (n_receptors,), from the measures there."""
        ...

    def current(self, signal: Signal, sensitivity: Array, memory: FilterMemory | None = None) -> Array:
        """Return the current of each afferent in units of the rheobase, shape (n_afferents, n_samples).

        The signal has a row for each afferent, or one for all: samples, or end organs with samples each. With a
        memory it continues earlier blocks, and filters take what they need from there.
        """
        ...


BUILT_IN: dict[str, AfferentModel] = {model.name: model for model in (SA1(), RA(), PC())}
"""The classes of this package by their names."""


def spikes_of(
    model: AfferentModel, signal: Signal, sensitivity: ArrayLike, seeds: Sequence[int | Sequence[int]]
) -> list[Array]:
    """Return the ascending spike times (s, from the signal's first sample) of afferents of one class.

    The signal has a row for each afferent, or one for all. The same seed gives the same spikes. Raises ArgumentError
    if the numbers of afferents differ, a sensitivity is not positive, or the signal is not finite or too long.
    """
    gains = np.atleast_1d(np.asarray(sensitivity, dtype=float))
    rows, samples = signal.value.shape[0], signal.value.shape[-1]
    if len(seeds) != len(gains) or rows not in (1, len(gains)):
        raise ArgumentError(
            f"{len(gains)} sensitivities, {len(seeds)} seeds and {rows} signals: there must be one of each for "
            "every afferent",
            "afferents_differ",
        )
    if not (np.isfinite(gains).all() and (gains > 0).all()):
        raise ArgumentError("the sensitivity of an afferent must be more than 0", "bad_sensitivity")
    if not np.isfinite(signal.value).all():
        raise ArgumentError("the signal at a receptor must be finite", "bad_signal")
    samples *= max(1, int(np.ceil(signal.step_s / _MOST_STEP_S - 1e-9)))
    together = max(len(gains), signal.value[..., 0].size) * samples
    if together > MOST_SAMPLES:
        raise ArgumentError(
            f"{together} samples of all afferents together; must be at most {MOST_SAMPLES}: take a longer step or "
            "fewer afferents at once",
            "too_many_samples",
        )
    signal = _finer(signal)
    currents = model.current(signal, gains)
    return [
        spikes(current, signal.step_s, model.membrane, model.sites, np.random.default_rng(seed))
        for current, seed in zip(currents, seeds, strict=True)
    ]


def _finer(signal: Signal) -> Signal:
    """Return a signal whose step is short enough for every class."""
    parts = int(np.ceil(signal.step_s / _MOST_STEP_S - 1e-9))
    samples = signal.value.shape[-1]
    if parts == 1 or samples < 2:
        return signal
    between = np.arange(parts * (samples - 1) + 1) / parts
    return Signal(signal.step_s / parts, CubicSpline(np.arange(samples), signal.value, axis=-1)(between))
