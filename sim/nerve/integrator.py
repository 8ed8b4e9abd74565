"""Leaky integrator that turns current into spikes: τ dV/dt = −V + I + noise, a spike at V = 1.

V is stepped by the exact exponential, at most `MOST_STEP_S` at a time; the current is linear between its samples and
constant within a step. The noise is white: its increments grow with the root of the step, so that rates do not depend
on it. It is shot noise of the current: its variance grows with the current up to the rheobase, so that an afferent
without a current is silent.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.compiling import compiled

Array = NDArray[np.float64]

MOST_STEP_S = 1e-4
"""Longest step of V (s): with longer ones a spike's time and the share of missed crossings depend on the step."""


@dataclass(frozen=True)
class Membrane:
    """Leaky integrator of one class.

    Attributes
    ----------
    tau_s : float
        Time constant τ (s).
    refractory_s : float
        Time after a spike in which nothing is integrated (s).
    noise : float
        Standard deviation of V without a threshold, in units of the threshold, from a current of 1 on.
    reset : float
        V after a spike; below 0 it makes the class refractory for some time constants. Default: 0.
    """

    tau_s: float
    refractory_s: float
    noise: float
    reset: float = 0.0


def spikes(current: Array, step_s: float, membrane: Membrane, sites: int, generator: np.random.Generator) -> Array:
    """Return the spike times of one afferent.

    Parameters
    ----------
    current : ndarray of shape (n_samples,)
        Current, in units of the rheobase.
    step_s : float
        Time between samples (s).
    membrane : Membrane
        Time constant, refractory time and noise.
    sites : int
        Number of spike sites, each with its own noise. The first at its threshold makes the spike and resets all.
    generator : numpy.random.Generator
        The afferent's own.

    Returns
    -------
    ndarray of shape (n_spikes,)
        Times from the first sample (s), ascending.
    """
    parts = max(1, int(np.ceil(step_s / MOST_STEP_S - 1e-9)))
    short_s = step_s / parts
    decay = float(np.exp(-short_s / membrane.tau_s))
    kick = membrane.noise * float(np.sqrt(1 - decay**2))
    steps = parts * max(0, len(current) - 1)
    noise = generator.standard_normal((steps, sites), dtype=np.float32)
    found = np.empty(steps)
    count = _fired(
        np.ascontiguousarray(current),
        parts,
        decay,
        kick,
        noise,
        short_s,
        membrane.refractory_s,
        membrane.reset,
        found,
    )
    return found[:count].copy()


@compiled
def _fired(
    current: Array,
    parts: int,
    decay: float,
    kick: float,
    noise: NDArray[np.float32],
    short_s: float,
    refractory_s: float,
    reset: float,
    found: Array,
) -> int:
    """Write spike times; return their number."""
    steps, sites = noise.shape
    v = np.zeros(sites)
    silent_until_s = -1.0
    count = 0
    for k in range(steps):
        now_s = k * short_s
        part = min(1.0, k + 1 - silent_until_s / short_s)  # of the step, after the refractory time
        if part <= 0.0:
            continue
        sample = k // parts
        share = (k - sample * parts + 0.5) / parts
        flow = current[sample] + share * (current[sample + 1] - current[sample])
        jolt = kick * math.sqrt(part * min(max(flow, 0.0), 1.0))
        kept = decay if part == 1.0 else decay**part
        first = 2.0
        for site in range(sites):
            before = v[site]
            v[site] = flow + (before - flow) * kept + jolt * noise[k, site]
            if v[site] >= 1.0:
                first = min(first, (1.0 - before) / (v[site] - before))
        if first < 2.0:
            found[count] = now_s + (1.0 - part + first * part) * short_s
            silent_until_s = found[count] + refractory_s
            count += 1
            v[:] = reset
    return count
