"""Spikes of afferents of one class whose signal comes in blocks: the same as if it came at once."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.nerve.filters import FilterMemory
from sim.nerve.integrator import Membranes
from sim.nerve.models import AfferentModel
from sim.nerve.skin import Signal

Array = NDArray[np.float64]

_DRAWN = 1000  # steps for which noise is drawn at once


class SpikeStream:
    """Spikes of afferents of one class, from one block of their signal to the next.

    Filters and membranes keep their states, and each afferent draws its noise in the order of time, so that spikes do
    not depend on how the signal is divided. `step_s` must be short enough for the class.
    """

    def __init__(
        self, model: AfferentModel, step_s: float, sensitivity: ArrayLike, seeds: Sequence[int | Sequence[int]]
    ) -> None:
        self._model, self._step_s = model, step_s
        self._sensitivity = np.atleast_1d(np.asarray(sensitivity, dtype=float))
        count = len(self._sensitivity)
        self._membranes = Membranes(model.membrane, count, model.sites, step_s)
        self._memory = FilterMemory()
        self._last: Array | None = None
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._noise = np.zeros((count, 2 * _DRAWN, model.sites), dtype=np.float32)
        self._drawn = np.zeros(count, dtype=int)
        for row in range(count):  # not all run out of noise at the same time
            self._draw(row, _DRAWN + row * _DRAWN // count)

    def advance(self, value: Array) -> tuple[NDArray[np.intp], Array]:
        """Return a block's spikes: afferents, and times (s) from the very first sample, both (n_spikes,).

        The block is (n_afferents, n_samples) or (n_afferents, n_organs, n_samples); times ascend for each afferent.
        """
        self._memory.begin_block()
        current = self._model.current(Signal(self._step_s, value), self._sensitivity, self._memory)
        if self._last is not None:
            current = np.concatenate([self._last, current], axis=1)
        self._last = current[:, -1:].copy()
        current = np.ascontiguousarray(current)
        samples = max(_DRAWN // self._membranes.parts, 1)
        found = [
            self._fired(current[:, first : first + samples + 1]) for first in range(0, current.shape[1] - 1, samples)
        ]
        if len(found) == 1:
            return found[0]
        who = np.concatenate([np.empty(0, dtype=np.intp), *(who for who, _ in found)])
        return who, np.concatenate([np.empty(0), *(times_s for _, times_s in found)])

    def _fired(self, current: Array) -> tuple[NDArray[np.intp], Array]:
        needed = self._membranes.step + self._membranes.parts * (current.shape[1] - 1)
        for row in np.flatnonzero(self._drawn < needed):
            self._draw(int(row), _DRAWN)
        return self._membranes.advance(current, self._noise)

    def _draw(self, row: int, steps: int) -> None:
        new = self._generators[row].standard_normal((steps, self._noise.shape[2]), dtype=np.float32)
        begin, kept = self._drawn[row] % self._noise.shape[1], self._noise.shape[1]
        first = min(steps, kept - begin)
        self._noise[row, begin : begin + first] = new[:first]
        self._noise[row, : steps - first] = new[first:]
        self._drawn[row] += steps
