"""Expected information of one more press about which candidate is right, given what is known so far.

For every data set, each candidate has a posterior, from which particles (fiber and gain) are drawn. The counts that a
press would give are put into bins; the mutual information of candidate and bin is then a sum, and needs no draws of
counts. A candidate's distribution of bins is a mean over particles, whose scatter would pass for a difference between
candidates; its expectation is subtracted.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import nbinom, poisson

from rig.design.counts import CountModel, CountSums
from rig.design.fibers import FiberDraws

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_LEVELS_PER_ROOT = 6  # levels of the mean, evenly spaced in its root, in which Poisson counts scatter by a half
_BINS_PER_ROOT = 2.5
_LEAST = 2e-3  # probability below which a candidate is ignored


class CountBins(NamedTuple):
    """Probability (levels, bins) of each bin of counts at each level of the mean, for every dispersion; and with its
    squares beside it.
    """

    chance: Floats
    per_dispersion: int
    with_squares: Floats


def count_bins(model: CountModel) -> CountBins:
    """Return the bins for the largest mean that the unknowns allow."""
    unknowns = model.unknowns
    most = 2.0 * unknowns.rate_per_s[1] * model.window_s + 4.0
    levels = np.arange(int(_LEVELS_PER_ROOT * np.sqrt(most)) + 2) / _LEVELS_PER_ROOT
    mean = np.maximum(levels, 1e-3) ** 2
    edges = np.unique(np.floor((np.arange(1, int(_BINS_PER_ROOT * np.sqrt(1.5 * most)) + 1) / _BINS_PER_ROOT) ** 2))
    tables = []
    for phi in unknowns.dispersions:
        # Regular discharge scatters less than Poisson's; planning with Poisson's is cautious.
        spread = max(float(phi), 1.0)
        if spread > 1 + 1e-6:
            below = nbinom.cdf(edges, (mean / (spread - 1))[:, None], 1 / spread)
        else:
            below = poisson.cdf(edges, mean[:, None])
        ends = np.concatenate([np.zeros((len(mean), 1)), below, np.ones((len(mean), 1))], axis=1)
        tables.append(np.maximum(np.diff(ends, axis=1), 0.0))
    chance = np.concatenate(tables).astype(np.float32)
    return CountBins(chance, len(levels), np.concatenate([chance, chance**2], axis=1))


def probabilities(log_likelihood: Floats) -> Array:
    """Return (s, candidates) probabilities from log-likelihoods (candidates, s, draws), all equally likely before."""
    evidence = log_evidence(log_likelihood)
    return np.asarray(np.exp(evidence - logsumexp(evidence, axis=1, keepdims=True)))


def log_evidence(log_likelihood: Floats) -> Array:
    """Return (s, candidates) ln of the mean likelihood over the draws, up to what all candidates share."""
    top = log_likelihood.max(axis=2)
    mean = np.exp(log_likelihood - top[:, :, None]).mean(axis=2)
    return np.asarray((top + np.log(mean)).T, dtype=float)


def information_bits(
    model: CountModel,
    bins: CountBins,
    sums: CountSums,
    log_rate: Floats,
    draws: FiberDraws,
    log_likelihood: Floats,
    particles: int,
    chance: np.random.Generator,
    chosen: NDArray[np.int64] | None = None,
) -> Array:
    """Return (presses,) the expected information (bits) of one more press, averaged over the s data sets of `sums`.

    `log_rate` has shape (candidates, draws, presses), `log_likelihood` (candidates, s, draws). `particles` is the
    number for each candidate and data set. Presses that are not `chosen` have no information; default: all are.
    """
    weight = probabilities(log_likelihood)
    every = np.arange(log_rate.shape[2]) if chosen is None else chosen
    sets, presses = weight.shape[0], len(every)
    dispersion = model.unknowns.dispersions[draws.level]
    timeless = _without_time(sums)
    total = np.zeros(presses)
    for s in range(sets):
        live = np.flatnonzero(weight[s] > _LEAST)
        if len(live) < 2:
            continue
        p = weight[s, live] / weight[s, live].sum()
        mean = np.empty((len(live), presses, bins.chance.shape[1]), dtype=np.float32)
        scatter = np.empty_like(mean)
        for row, c in enumerate(live):
            fiber = _resampled(log_likelihood[c, s], particles, chance)
            mine = log_rate[c][fiber]
            exposure = model.exposure_s(mine, np.zeros(particles), timeless)
            shape, rate = model.gain_posterior(sums, exposure, dispersion[fiber])
            gain = chance.standard_gamma(shape[s]) / rate
            scale = _LEVELS_PER_ROOT * np.sqrt(model.window_s * gain)
            # Rounded up or down at random, so that the mean over particles interpolates between levels.
            level = (np.exp(0.5 * mine[:, every]) * scale[:, None] + chance.random((particles, 1))).astype(np.int64)
            level = np.minimum(level, bins.per_dispersion - 1) + bins.per_dispersion * draws.level[fiber][:, None]
            mean[row], scatter[row] = _mean_and_scatter(level, bins)
        total += _mutual(p, mean, scatter / np.float32(particles))
    bits_of_press = np.zeros(log_rate.shape[2])
    bits_of_press[every] = total / sets
    return bits_of_press


def _without_time(sums: CountSums) -> CountSums:
    """Return the sums with all presses at one time: the choice of presses ignores drift."""
    return sums._replace(late=sums.late.sum(axis=1, keepdims=True), tau=np.zeros(1))


def _resampled(log_likelihood: Floats, particles: int, chance: np.random.Generator) -> NDArray[np.int64]:
    """Return draws by systematic resampling."""
    weight = np.cumsum(np.exp(log_likelihood - log_likelihood.max()), dtype=float)
    at = (np.arange(particles) + chance.random()) / particles * weight[-1]
    return np.minimum(np.searchsorted(weight, at), len(weight) - 1)


def _mean_and_scatter(level: NDArray[np.int64], bins: CountBins) -> tuple[Floats, Floats]:
    """Return (presses, bins) mean over particles (r, presses) of the bins' probabilities, and their variance."""
    levels, presses = len(bins.chance), level.shape[1]
    flat = (level + levels * np.arange(presses)).ravel()
    share = np.bincount(flat, minlength=levels * presses).reshape(presses, levels) / len(level)
    both = share.astype(np.float32) @ bins.with_squares
    mean, square = np.split(both, 2, axis=1)
    return mean, np.maximum(square - mean**2, 0.0)


def _mutual(p: Array, mean: Floats, scatter: Floats) -> Array:
    """Return (presses,) the mutual information (bits) of candidates with probabilities p (c,) and bins (c, j, b)."""
    together = np.tensordot(p.astype(np.float32), mean, 1)
    safe = np.maximum(together, 1e-12)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_each = np.where(mean > 1e-12, mean * np.log2(mean / safe), 0.0).sum(axis=2)
    # Second order of the scatter: half of variances over probabilities, of each candidate and of the mixture.
    bias = (scatter / np.maximum(mean, 1e-4)).sum(axis=2) / (2 * np.log(2))
    of_mixture = (np.tensordot((p**2).astype(np.float32), scatter, 1) / np.maximum(together, 1e-4)).sum(axis=1) / (
        2 * np.log(2)
    )
    return np.asarray(p @ (of_each - bias) + of_mixture)
