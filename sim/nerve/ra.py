"""RA afferents (Meissner corpuscles, FA-I): the current follows the rate of strain, both ways.

x = low-pass(dm/dt), I = s (a₊ [x]₊ + a₋ [−x]₊) less a slow threshold, then c·I / (c + I), m = √SED / √SED₀

An afferent has several end organs; the one with the largest a₊ [x]₊ + a₋ [−x]₊ paces it. Number: the 12 to 17 zones
of maximal sensitivity in a human field (Johansson 1978, J Physiol 281:101; from memory). They lie within 3 to 5 mm of
a monkey's skin (Johnson 2001, Curr Opin Neurobiol 11:455; from memory), the diameter of a human field too (13 mm²,
Johansson and Vallbo 1980; from memory).

The square root of SED is linear in the strain, so that its rate has no term in position: the class is silent in a
hold. The low-pass is a Butterworth filter of third order. Its corner, c and the whole membrane are medians of the
nine RA afferents of Saal et al. (2017, PNAS 114:E5693), in units of this integrator: V is −7.3 when their fast
current after a spike ends, and their slow one peaks at 1.74. Slow threshold: Leung et al. (2005, J Neurophysiol).
SED₀ and a₋ are fitted; `docs/validation/nerve.md` names the published responses that they were fitted to.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.nerve.filters import FilterMemory, adapted, derivative_low_pass, strongest
from sim.nerve.integrator import Membrane
from sim.nerve.skin import Signal

Array = NDArray[np.float64]

MEMBRANE = Membrane(tau_s=0.0046, refractory_s=0.0034, noise=0.15, reset=-7.3, after=1.74)


@dataclass(frozen=True)
class RA:
    """Parameters of the class; every afferent has its own sensitivity s.

    `reference_sed` is SED₀, in pseudo-units: √SED that rises by √SED₀ in a second makes a current of 1 at s = 1.
    `corner_hz` is the corner of the low-pass; `falling` is a₋, with a₊ = 1; `most` is c, the current that is never
    exceeded, in units of the rheobase; the slow threshold is after a long time `slow_share` of the current.
    """

    reference_sed: float = 10600.0
    corner_hz: float = 117.0
    falling: float = 0.3
    most: float = 3400.0
    slow_share: float = 0.3
    slow_tau_s: float = 15.0
    sites: int = 1
    membrane: Membrane = MEMBRANE
    name: str = "RA"
    depth_mm: float = 0.6
    organs: int = 14
    field_mm: float = 4.0

    def measure(self, measures: dict[str, Array]) -> Array:
        return np.sqrt(np.maximum(measures["sed"], 0.0) / self.reference_sed)

    def current(self, signal: Signal, sensitivity: Array, memory: FilterMemory | None = None) -> Array:
        rate = derivative_low_pass(signal.value, self.corner_hz, signal.step_s, 1, memory)
        x = strongest(np.where(rate > 0, rate, -self.falling * rate))
        x = np.asarray(sensitivity)[:, None] * x
        drive = adapted(x, self.slow_share, self.slow_tau_s, signal.step_s, memory)
        return self.most * drive / (self.most + drive)
