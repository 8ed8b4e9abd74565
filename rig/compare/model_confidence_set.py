"""Candidates that may be the best: the model confidence set, cross-validation and the power of the test."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.candidate_measures import Candidates, blocks, rejected
from rig.compare.likelihood import Observed

Array = NDArray[np.float64]

DRAWS = 500
BLOCK = 4
"""Length of a block of neighboring positions in the bootstrap; residuals of neighbors are correlated."""

HARDLY = 0.5
"""Difference in deviance (relative to the noise, over all positions) that counts as none, for near-identical
pairs."""


def resampled(stimulus: NDArray[np.int64], draws: int = DRAWS) -> Array:
    """Return (draws, p) counts of each position in circular blocks of neighbors within each stimulus; fixed seed."""
    rng = np.random.default_rng(0)
    count = np.zeros((draws, len(stimulus)))
    for one in np.unique(stimulus):
        mine = np.flatnonzero(stimulus == one)
        n, blocks = len(mine), -(-len(mine) // BLOCK)
        drawn = (rng.integers(n, size=(draws, blocks, 1)) + np.arange(BLOCK)).reshape(draws, -1)[:, :n] % n
        for draw in drawn.T:
            count[np.arange(draws), mine[draw]] += 1
    return count


def set_probabilities(loss: Array, stimulus: NDArray[np.int64]) -> Array:
    """Return p (N,) of losses (N, p), deviances over the noise; the set of a level holds candidates with p above it.

    The candidate that loses most clearly to another is removed, as long as the largest standardized difference
    between two remaining ones exceeds its bootstrap distribution (T_R of Hansen et al.).
    """
    drawn = resampled(stimulus)
    mean = loss.mean(axis=1)
    scatter = ((drawn @ loss.T) / loss.shape[1] - mean).T.astype(np.float32)  # (N, draws)
    square = scatter @ scatter.T / scatter.shape[1]
    own = np.diag(square)
    least = max(1e-9 * float(own.max()), 1e-30)
    sd = np.sqrt(np.maximum(own[:, None] + own - 2 * square, least))
    excess = mean[:, None] - mean
    t = np.sign(excess) * np.maximum(np.abs(excess) - HARDLY / loss.shape[1], 0.0) / sd
    order = _taken_out(t)
    p = np.ones(len(loss))
    largest = np.zeros(scatter.shape[1], dtype=np.float32)
    observed = 0.0
    for place in range(len(order) - 2, -1, -1):
        one, others = order[place], order[place + 1 :]
        moved = np.abs(scatter[one] - scatter[others]) / sd[one, others, None]
        largest = np.maximum(largest, moved.max(axis=0))
        observed = max(observed, float(np.abs(t[one, others]).max()))
        p[one] = (largest >= observed).mean()
    p[order] = np.maximum.accumulate(p[order])
    return p


def _taken_out(t: Array) -> NDArray[np.int64]:
    """Return the order (N,) of removal: each time the candidate with the largest t against another remaining one."""
    t = t.copy()
    order = []
    for _ in range(len(t)):
        worst = int(np.argmax(t.max(axis=1)))
        order.append(worst)
        t[worst, :] = -np.inf
        t[:, worst] = -np.inf
    return np.array(order)


BLOCKS = 5


class Predicted(NamedTuple):
    """Held-out deviances (N, p), and (p,) those of the mean of the fitted positions."""

    deviance: Array
    of_mean: Array

    def share(self, at: NDArray[np.bool_] | slice = slice(None)) -> Array:
        """Return (N,) the predicted share of the deviance of the mean, at some positions; 0 is no improvement."""
        of_mean = self.of_mean[at].sum()
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(1 - self.deviance[:, at].sum(axis=1) / of_mean)


def predicted_left_out(candidates: Candidates, observed: Observed) -> Predicted:
    """Return predictions of every position from the stimuli or blocks that it does not belong to."""
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


def imitated(measures: Candidates, observed: Observed, truth: Array) -> tuple[int, float]:
    """Return the candidate that imitates expected rates (p,) best, and how probably its fit would be rejected.

    The candidates are fitted to these rates without noise; the residual is the non-centrality of the F test.
    """
    noise, even = observed.noise, observed.evenness
    noiseless = replace(observed, rate=truth)
    fit = measures.fitted(noiseless)
    variance = noise.dispersion * noiseless.variance(fit.found.mean)
    shrunk = variance / (variance + measures.discrepancy(fit))
    misfit = (fit.found.deviance / noise.dispersion * shrunk).sum(axis=1)
    best = int(np.argmin(misfit))
    freedom = max(float(noiseless.share(truth).sum()) - measures.parameters, 1.0)
    chance = rejected(np.array(even * misfit[best]), even * freedom, even * noise.freedom)
    return best, float(chance)
