"""Decoding through a receptor whose gain and threshold were fitted: their standard errors, carried into the band."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.coding.encoding import Receptor
from sim.coding.profile_decoder import Profile


@dataclass(frozen=True)
class FittedReceptor:
    """R = k (S − S₀) with standard errors of k and S₀, taken as independent; below k, so that k stays positive."""

    receptor: Receptor
    gain_se: float = 0.0
    threshold_se: float = 0.0


def decode_through(fitted: FittedReceptor, decode: Callable[[Receptor], Profile]) -> Profile:
    """What `decode` makes of rates, with a band that is wider by what the receptor's standard errors do.

    It is asked again with gain and threshold one standard error up and down; half of what the pressures move by is
    added in squares. Converged where all of these are.
    """
    found = decode(fitted.receptor)
    variance, converged = found.sd**2, found.converged
    for name, se in (("gain", fitted.gain_se), ("threshold", fitted.threshold_se)):
        if se > 0:
            middle = getattr(fitted.receptor, name)
            up, down = (decode(replace(fitted.receptor, **{name: middle + sign * se})) for sign in (1, -1))
            variance = variance + ((up.pressure - down.pressure) / 2) ** 2
            converged = converged and up.converged and down.converged
    return replace(found, sd=np.sqrt(variance), converged=converged)
