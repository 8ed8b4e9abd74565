"""A model confidence set (Hansen, Lunde and Nason, Econometrica 79, 453, 2011): which candidates may be the best."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DRAWS = 500
BLOCK = 4
"""Neighbouring positions that are resampled together: what a model leaves is alike there."""

HARDLY = 0.5
"""A difference in deviance (over the noise, all positions together) that is none: twins stay twins."""


def resampled(stimulus: NDArray[np.int64], draws: int = DRAWS) -> Array:
    """(draws, p) how often each position is drawn: circular blocks of neighbours, within each stimulus; one seed."""
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
    """(N,) p of losses (N, p), deviances over the noise: candidates below a level are not in the set of that level.

    The one that loses most clearly to another is taken out, as long as the largest difference of two of those left,
    in its standard deviations, is larger than resampling makes it (their T_R).
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
    """(N,) the order in which candidates go: each time the one with the largest t against another that is left."""
    t = t.copy()
    order = []
    for _ in range(len(t)):
        worst = int(np.argmax(t.max(axis=1)))
        order.append(worst)
        t[worst, :] = -np.inf
        t[:, worst] = -np.inf
    return np.array(order)
