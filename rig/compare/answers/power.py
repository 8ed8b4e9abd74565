"""What the fit test can see, so that "not rejected" is not taken for "right"."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.compare.answers.candidates import Candidates
from rig.compare.answers.goodness import rejected
from rig.compare.answers.observed import Observed

Array = NDArray[np.float64]


def imitated(measures: Candidates, observed: Observed, truth: Array) -> tuple[int, float]:
    """The candidate that imitates expected rates (p,) best, and how probably even its fit would be rejected.

    The candidates are fitted to these rates without noise; what is left is the non-centrality of the F test.
    """
    noise, even = observed.noise, observed.evenness
    told = replace(observed, rate=truth)
    fit = measures.fitted(told)
    variance = noise.dispersion * told.variance(fit.found.mean)
    shrunk = variance / (variance + measures.discrepancy(fit))
    misfit = (fit.found.deviance / noise.dispersion * shrunk).sum(axis=1)
    best = int(np.argmin(misfit))
    freedom = max(float(told.share(truth).sum()) - measures.parameters, 1.0)
    chance = rejected(np.array(even * misfit[best]), even * freedom, even * noise.freedom)
    return best, float(chance)
