"""Leaky integrator that turns current into spikes: τ dV/dt = −V + I + noise, a spike at V = 1; leaky sums.

V is stepped by the exact exponential, at most `MOST_STEP_S` at a time; the current is linear between its samples and
constant within a step. The noise is white: its increments grow with the root of the step, so that rates do not depend
on it. It is shot noise of the current: its variance grows with the current up to the rheobase, so that an afferent
without a current is silent. A class may have an outward current after a spike; each spike begins it anew.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]

MOST_STEP_S = 1e-4
"""Longest step of V (s): with longer ones a spike's time and the share of missed crossings depend on the step."""

AFTER_PEAK_S, AFTER_ENDS_S, _AFTER_OFFSET_S = 0.008, 0.0379, 0.001
"""Peak and end of the outward current after a spike, and what is added to times before their logarithm (s).

A raised cosine in the logarithm of time, the slow post-spike current of Saal et al. (2017, PNAS 114:E5693).
"""


def after_current(since_s: Array) -> Array:
    """Return the outward current at times after a spike (s), relative to its peak."""
    most = math.log((AFTER_ENDS_S + _AFTER_OFFSET_S) / (AFTER_PEAK_S + _AFTER_OFFSET_S))
    logarithm = np.log((np.maximum(since_s, 0.0) + _AFTER_OFFSET_S) / (AFTER_PEAK_S + _AFTER_OFFSET_S))
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.clip(logarithm / most, -1.0, 1.0)))


@dataclass(frozen=True)
class Membrane:
    """Leaky integrator of one class, with its time constant τ; within `refractory_s` nothing is integrated.

    `noise` is the standard deviation of V without a threshold, in units of the threshold, from a current of 1 on. V
    after a spike is `reset`; below 0 it makes the class refractory for some time constants. `after` is the peak of
    the outward current then (`after_current`), in units of the rheobase.
    """

    tau_s: float
    refractory_s: float
    noise: float
    reset: float = 0.0
    after: float = 0.0


def parts_of(step_s: float) -> int:
    """Return the number of steps of V between two samples."""
    return max(1, int(np.ceil(step_s / MOST_STEP_S - 1e-9)))


def spikes(current: Array, step_s: float, membrane: Membrane, sites: int, generator: np.random.Generator) -> Array:
    """Return the ascending spike times (s) of one afferent from its current (n_samples,), in units of the rheobase.

    Each of the sites has its own noise. The first at its threshold makes the spike and resets all.
    """
    steps = parts_of(step_s) * max(0, len(current) - 1)
    membranes = Membranes(membrane, 1, sites, step_s)
    noise = generator.standard_normal((1, steps, sites), dtype=np.float32)
    return membranes.advance(np.ascontiguousarray(current)[None], noise)[1]


class Membranes:
    """Membranes of afferents of one class, advanced from one block of their currents to the next."""

    def __init__(self, membrane: Membrane, afferents: int, sites: int, step_s: float) -> None:
        self.parts = parts_of(step_s)
        self._membrane, self._short_s = membrane, step_s / self.parts
        self._decay = float(np.exp(-self._short_s / membrane.tau_s))
        self._kick = membrane.noise * float(np.sqrt(1 - self._decay**2))
        self._v = np.zeros((afferents, sites))
        self._silent_until_s = np.full(afferents, -1.0)
        since_s = self._short_s * np.arange(math.ceil(AFTER_ENDS_S / self._short_s) + 1, dtype=float)
        self._after = membrane.after * after_current(since_s) if membrane.after else np.empty(0)
        self.step = 0
        """Number of steps so far."""

    def advance(self, current: Array, noise: NDArray[np.float32]) -> tuple[NDArray[np.intp], Array]:
        """Return the spikes of the next block: afferents, ascending, and times (s), both (n_spikes,).

        Times are from the first sample of the first block. The current (n_afferents, n_samples), in units of the
        rheobase, begins at the last sample of the block before. Standard normal `noise` (n_afferents, n_kept,
        n_sites) of a step lies at its number modulo n_kept.
        """
        steps = self.parts * max(0, current.shape[1] - 1)
        who, found = np.empty(steps * len(current), dtype=np.intp), np.empty(steps * len(current))
        count = _fired(
            current,
            self.parts,
            self.step,
            self._decay,
            self._kick,
            noise,
            self._short_s,
            self._membrane.refractory_s,
            self._membrane.reset,
            self._after,
            self._v,
            self._silent_until_s,
            who,
            found,
        )
        self.step += steps
        return who[:count].copy(), found[:count].copy()


@compiled
def leaked(
    signal: Array,
    last: Array,
    decay: complex,
    gain: complex,
    state: NDArray[Any],
    found: NDArray[Any],
) -> None:
    """Write a leaky sum of the signal's changes, beginning with the last sample before and the sum there.

    `last` gets the last sample, `state` the last sum. They and the rows of `found` have the same length.
    """
    for row in range(signal.shape[0]):
        before, total = last[row], state[row]
        for k in range(signal.shape[1]):
            total = gain * (signal[row, k] - before) + decay * total
            before = signal[row, k]
            found[row, k] = total
        last[row], state[row] = before, total


@compiled
def _fired(
    current: Array,
    parts: int,
    first_step: int,
    decay: float,
    kick: float,
    noise: NDArray[np.float32],
    short_s: float,
    refractory_s: float,
    reset: float,
    after: Array,
    v: Array,
    silent_until_s: Array,
    who: NDArray[np.intp],
    found: Array,
) -> int:
    """Write afferents and spike times; return their number."""
    kept, sites = noise.shape[1:]
    count = 0
    for row in range(current.shape[0]):
        for k in range(parts * (current.shape[1] - 1)):
            step = first_step + k
            now_s = step * short_s
            part = min(1.0, step + 1 - silent_until_s[row] / short_s)  # of the step, after the refractory time
            if part <= 0.0:
                continue
            sample = k // parts
            share = (k - sample * parts + 0.5) / parts
            flow = current[row, sample] + share * (current[row, sample + 1] - current[row, sample])
            jolt = kick * math.sqrt(part * min(max(flow, 0.0), 1.0))
            since = (now_s + (1.0 - 0.5 * part) * short_s - silent_until_s[row] + refractory_s) / short_s
            if since < len(after) - 1:
                begun = int(since)
                flow -= after[begun] + (since - begun) * (after[begun + 1] - after[begun])
            left = decay if part == 1.0 else decay**part
            first = 2.0
            for site in range(sites):
                before = v[row, site]
                v[row, site] = flow + (before - flow) * left + jolt * noise[row, step % kept, site]
                if v[row, site] >= 1.0:
                    first = min(first, (1.0 - before) / (v[row, site] - before))
            if first < 2.0:
                found[count] = now_s + (1.0 - part + first * part) * short_s
                silent_until_s[row] = found[count] + refractory_s
                who[count] = row
                count += 1
                v[row, :] = reset
    return count
