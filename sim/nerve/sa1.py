"""SA-I afferents (Merkel cells): the current follows a measure, with four memories that fade.

I(t) = max(0, s Σᵢ kᵢ ∫ exp(−(t − u)/τᵢ) dm(u) − θ), m = (SED / SED₀)^p

Each spike site has its own noise; the first at the threshold of the membrane resets all. Form and time constants:
Gerling et al. (2018, PLoS Comput Biol), for mouse skin; several sites: Lesniak et al. (2014, eLife). The weights k, the
exponent p, the threshold θ and the noise are free; `docs/nerve.md` names the published responses that they were
fitted to.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.nerve.filters import fading
from sim.nerve.integrator import Membrane
from sim.nerve.skin import Signal

Array = NDArray[np.float64]

DEPTH_MM = 0.75
"""Depth of Merkel cells below the skin (mm), at the tips of the intermediate ridges."""
CONDUCTION_M_S = (59.0, 7.0)
"""Mean and standard deviation of conduction velocity (m/s)."""


@dataclass(frozen=True)
class SA1:
    """Parameters of the class; every afferent has its own sensitivity s.

    Attributes
    ----------
    weights : tuple of float
        k of the rapid, slow, ultra-slow and lasting memory, per unit of the measure.
    tau_s : tuple of float
        Their time constants τ (s).
    power, reference_sed : float
        p, and SED₀ in pseudo-units.
    threshold : float
        θ, in units of the rheobase.
    sites : int
        Number of spike sites.
    membrane : Membrane
        Time constant, refractory time and noise of a site.
    """

    weights: tuple[float, ...] = (0.6, 0.8, 0.7, 1.0)
    tau_s: tuple[float, ...] = (0.008, 0.2, 1.832, np.inf)
    power: float = 1.0
    reference_sed: float = 1.0
    threshold: float = 1.0
    sites: int = 4
    membrane: Membrane = Membrane(tau_s=0.03, refractory_s=0.001, noise=0.3)

    name = "SA1"
    depth_mm = DEPTH_MM

    def measure(self, measures: dict[str, Array]) -> Array:
        """Return m at receptors from the 18 measures."""
        return np.asarray((np.maximum(measures["sed"], 0.0) / self.reference_sed) ** self.power)

    def current(self, signal: Signal, sensitivity: Array) -> Array:
        """Return the current of each afferent, shape (n_afferents, n_samples)."""
        terms = zip(self.weights, self.tau_s, strict=True)
        total = sum(k * fading(signal.value, tau_s, signal.step_s) for k, tau_s in terms)
        return np.maximum(0.0, sensitivity[:, None] * total - self.threshold)
