"""Prediction of what was left out: a stimulus in turn, or blocks of positions where there is one stimulus only."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.answers.candidates import Candidates
from rig.compare.answers.goodness import blocks
from rig.compare.answers.observed import Observed

Array = NDArray[np.float64]

BLOCKS = 5


class Predicted(NamedTuple):
    """Deviances (N, p) where each position was not fitted, and (p,) those of the mean of what was fitted."""

    deviance: Array
    of_mean: Array

    def share(self, at: NDArray[np.bool_] | slice = slice(None)) -> Array:
        """(N,) of the deviance of the mean that is predicted, at some positions; 0: no better than the mean."""
        of_mean = self.of_mean[at].sum()
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(1 - self.deviance[:, at].sum(axis=1) / of_mean)


def predicted_left_out(candidates: Candidates, observed: Observed) -> Predicted:
    """Every position is predicted once, from the stimuli or the blocks that it is not of."""
    several = len(np.unique(observed.stimulus)) > 1
    fold = observed.stimulus if several else blocks(observed, BLOCKS)
    mean = np.empty(candidates.eps.shape[1:])
    level = np.empty(len(observed.rate))
    for number in np.unique(fold):
        out = fold == number
        fit = candidates.fitted(observed, ~out)
        mean[:, out] = fit.found.rates(fit.eps[:, out])
        level[out] = np.average(observed.rate[~out], weights=observed.base[~out])
    return Predicted(observed.deviance(mean), observed.deviance(level))
