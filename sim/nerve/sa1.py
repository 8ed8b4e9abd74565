"""SA-I afferents (Merkel cells): the current follows strain energy density (SED), with four memories that fade.

I(t) = [s Σᵢ kᵢ ∫ exp(−(t − u)/τᵢ) dm(u) − θ]₊ less a slow threshold, m = SED / SED₀

An afferent is a single point at a depth, as in Phillips and Johnson (1981, J Neurophysiol 46:1204; from memory).
Human fields have four to seven zones of maximal sensitivity (Johansson 1978, J Physiol 281:101; from memory), but
five equally sensitive end organs in a disc of 2.5 mm do not give the recorded profile under a bar. The number is
fitted on that. Of more than one, the end organ with the largest sum would pace the afferent.

Each spike site has its own noise; the first at the threshold of the membrane resets all. Form and time constants of
the memories: Gerling et al. (2018, PLoS Comput Biol), for mouse skin; several sites: Lesniak et al. (2014, eLife);
slow threshold: Leung et al. (2005, J Neurophysiol). The weights k, the threshold θ, SED₀ and the noise are fitted;
`docs/validation/nerve.md` names the published responses that they were fitted to.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.nerve.filters import FilterMemory, adapted, fading, strongest
from sim.nerve.integrator import Membrane
from sim.nerve.skin import Signal

Array = NDArray[np.float64]

MEMBRANE = Membrane(tau_s=0.058, refractory_s=0.001, noise=0.5)


@dataclass(frozen=True)
class SA1:
    """Parameters of the class; every afferent has its own sensitivity s.

    `weights` k and `tau_s` τ are of the rapid, slow, ultra-slow and lasting memory. `reference_sed` is SED₀, which
    makes a lasting current of 1 at s = 1, in pseudo-units; `threshold` is θ, in units of the rheobase; the slow
    threshold is after a long time `slow_share` of the current. Merkel cells lie at the tips of the intermediate
    ridges.
    """

    weights: tuple[float, ...] = (3.2, 2.2, 0.25, 1.0)
    tau_s: tuple[float, ...] = (0.008, 0.2, 1.832, np.inf)
    reference_sed: float = 17.6
    threshold: float = 1.9
    slow_share: float = 0.44
    slow_tau_s: float = 6.0
    sites: int = 4
    membrane: Membrane = MEMBRANE
    name: str = "SA1"
    depth_mm: float = 0.75
    organs: int = 1
    field_mm: float = 0.0

    def measure(self, measures: dict[str, Array]) -> Array:
        return np.maximum(measures["sed"], 0.0) / self.reference_sed

    def current(self, signal: Signal, sensitivity: Array, memory: FilterMemory | None = None) -> Array:
        terms = zip(self.weights, self.tau_s, strict=True)
        total = sum(k * fading(signal.value, tau_s, signal.step_s, memory) for k, tau_s in terms)
        drive = np.maximum(0.0, np.asarray(sensitivity)[:, None] * strongest(np.asarray(total)) - self.threshold)
        return adapted(drive, self.slow_share, self.slow_tau_s, signal.step_s, memory)
