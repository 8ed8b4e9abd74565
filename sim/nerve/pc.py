"""PC afferents (Pacinian corpuscles, FA-II): the current follows the second derivative of strain.

x = low-pass(d²m/dt²), I = s [x]₊ less a slow threshold, then c·I / (c + I), m = √SED / √SED₀

Corner of the low-pass, a Butterworth filter of third order, time constant of the membrane and refractory time: within
those of Saal et al. (2017, PNAS 114:E5693); slow threshold: Leung et al. (2005, J Neurophysiol). SED₀ is fitted;
`docs/validation/nerve.md` names the published response that it was fitted to. A ramp's end fires
the class as its beginning does. The finger is quasi-static: waves, which carry vibration to corpuscles far from the
probe, are missing, so the class is good under the probe only.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.nerve.filters import FilterMemory, adapted, derivative_low_pass, strongest
from sim.nerve.integrator import Membrane
from sim.nerve.skin import Signal

Array = NDArray[np.float64]

MEMBRANE = Membrane(tau_s=0.0012, refractory_s=0.0015, noise=0.15)


@dataclass(frozen=True)
class PC:
    """Parameters of the class; every afferent has its own sensitivity s.

    `reference_sed` is SED₀, in pseudo-units: √SED whose rate rises by √SED₀ per second in a second makes a current of
    1 at s = 1. `corner_hz` is the corner of the low-pass; `most` is c, the current that is never exceeded, in units
    of the rheobase; the slow threshold is after a long time `slow_share` of the current.
    """

    reference_sed: float = 1.82e7
    corner_hz: float = 320.0
    most: float = 2.0
    slow_share: float = 0.3
    slow_tau_s: float = 30.0
    sites: int = 1
    membrane: Membrane = MEMBRANE
    name: str = "PC"
    depth_mm: float = 1.8
    organs: int = 1
    field_mm: float = 0.0

    def measure(self, measures: dict[str, Array]) -> Array:
        return np.sqrt(np.maximum(measures["sed"], 0.0) / self.reference_sed)

    def current(self, signal: Signal, sensitivity: Array, memory: FilterMemory | None = None) -> Array:
        rate = derivative_low_pass(signal.value, self.corner_hz, signal.step_s, 2, memory)
        x = np.asarray(sensitivity)[:, None] * strongest(rate)
        drive = adapted(np.maximum(0.0, x), self.slow_share, self.slow_tau_s, signal.step_s, memory)
        return self.most * drive / (self.most + drive)
