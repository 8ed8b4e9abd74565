"""Leaky integrator that turns current into spikes: τ dV/dt = −V + I + noise, a spike at V = 1.

Between samples the current is constant, for which the step is exact. The noise is white: its increments grow with
the root of the step, so that rates do not depend on the step.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]

MOST_STEP_S = 1e-4
"""Longest step (s): with longer ones a spike's time and the share of missed crossings depend on the step."""


@dataclass(frozen=True)
class Membrane:
    """Leaky integrator of one class.

    Attributes
    ----------
    tau_s : float
        Time constant (s).
    refractory_s : float
        Time after a spike in which nothing is integrated (s).
    noise : float
        Standard deviation of V without a threshold, in units of the threshold.
    """

    tau_s: float
    refractory_s: float
    noise: float


def spikes(current: Array, step_s: float, membrane: Membrane, generator: np.random.Generator) -> Array:
    """Return the spike times of one afferent.

    Parameters
    ----------
    current : ndarray of shape (n_sites, n_samples)
        Current into each spike site, in units of the rheobase. The first site at its threshold makes the spike and
        resets all.
    step_s : float
        Time between samples (s), at most `MOST_STEP_S`.
    membrane : Membrane
        Time constant, refractory time and noise.
    generator : numpy.random.Generator
        The afferent's own.

    Returns
    -------
    ndarray of shape (n_spikes,)
        Times from the first sample (s), ascending.
    """
    decay = np.exp(-step_s / membrane.tau_s)
    kick = membrane.noise * np.sqrt(1 - decay**2)
    noise = generator.standard_normal(current.shape[::-1])
    found = np.empty(current.shape[1] + 1)
    count = _fired(np.ascontiguousarray(current.T), decay, kick, noise, step_s, membrane.refractory_s, found)
    return found[:count].copy()


@compiled
def _fired(
    current: Array, decay: float, kick: float, noise: Array, step_s: float, refractory_s: float, found: Array
) -> int:
    """Write spike times; return their number."""
    steps, sites = current.shape
    v = np.zeros(sites)
    silent_until_s = -1.0
    count = 0
    for k in range(steps):
        now_s = k * step_s
        if now_s < silent_until_s:
            continue
        first = 2.0
        for site in range(sites):
            before = v[site]
            v[site] = current[k, site] + (before - current[k, site]) * decay + kick * noise[k, site]
            if v[site] >= 1.0:
                first = min(first, (1.0 - before) / (v[site] - before))
        if first < 2.0:
            found[count] = now_s + first * step_s
            silent_until_s = found[count] + refractory_s
            count += 1
            v[:] = 0.0
    return count
