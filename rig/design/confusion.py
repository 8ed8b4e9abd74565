"""Expected confusion of candidates after a design, by simulation of whole experiments.

Fibers of the experiments lie between the draws, drift with the order of the presses, and never fire below their
threshold. Each candidate's evidence is a mean over draws, which are refined where too few of them count.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rig.design.counts import TEN_MINUTES_S, CountModel, CountSums, draw_counts, no_counts, with_counts
from rig.design.fibers import FiberDraws, draw_fibers, log_rates, relative_rates
from rig.design.posterior import in_set
from rig.design.refined import FEW, Refined, best_draws, refined_evidence
from rig.design.response_table import ResponseTable

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Ints = NDArray[np.int64]

LEFT_OVER = 2
"""Most candidates in the set of an experiment that succeeds."""

_THREADS = 2

# A candidate is refined if its log evidence may come this near to the best one's; fewer draws may miss more of it.
_NEAR, _MISSED = 3.0, 12.0

SEPARATED = 0.8
"""Share of right choices between two candidates from which they count as separated."""


DesignName = Literal["designed", "21 positions of one shape", "a grid of depths", "random presses", "all presses"]


class OrderedDesign(NamedTuple):
    """A design as it is carried out: numbers of presses in order, their times (s), and the session's minutes."""

    name: DesignName
    order: Ints
    time_s: Array
    minutes: float


@dataclass(frozen=True, eq=False)
class Confusion:
    """Outcome of simulated experiments: `truth` (s,), and the log evidence (s, candidates).

    Of the presses, `different` ones differ.
    """

    name: DesignName
    minutes: float
    presses: int
    different: int
    candidates: tuple[str, ...]
    truth: Ints
    log_evidence: Array
    effective: Array  # (s,) effective number of draws of the true candidate

    @property
    def probability(self) -> Array:
        """Probabilities (s, candidates)."""
        return np.asarray(np.exp(self.log_evidence - logsumexp(self.log_evidence, axis=1, keepdims=True)))

    @property
    def matrix(self) -> Array:
        """Share (true, chosen) of experiments in which a candidate is the most probable one."""
        chosen = self.log_evidence.argmax(axis=1)
        found = np.zeros((len(self.candidates), len(self.candidates)))
        np.add.at(found, (self.truth, chosen), 1.0)
        return found / np.maximum(found.sum(axis=1, keepdims=True), 1.0)

    @property
    def error(self) -> Array:
        """Monte Carlo standard error of the matrix, of (count + 1) / (n + 2)."""
        n = np.bincount(self.truth, minlength=len(self.candidates))[:, None]
        share = (self.matrix * n + 1) / (n + 2)
        return np.asarray(np.sqrt(share * (1 - share) / np.maximum(n, 1)))

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Whether the truth is in the set (s,)."""
        return np.asarray(in_set(self.probability)[np.arange(len(self.truth)), self.truth])

    @property
    def left(self) -> Ints:
        """Number of candidates in the set (s,)."""
        return np.asarray(in_set(self.probability).sum(axis=1))

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether the truth is not in the set, or more than `LEFT_OVER` candidates are (s,)."""
        return np.asarray(~self.kept | (self.left > LEFT_OVER))

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether the truth is the most probable candidate (s,)."""
        return np.asarray(self.log_evidence.argmax(axis=1) == self.truth)

    @property
    def bits(self) -> float:
        """Information about the candidate (bits)."""
        right = self.probability[np.arange(len(self.truth)), self.truth]
        return float(np.log2(np.maximum(right, 1e-9)).mean() + np.log2(len(self.candidates)))

    def separation(self) -> Array:
        """Return (candidates, candidates) shares of right choices between two, when one of them is true."""
        n = len(self.candidates)
        found = np.ones((n, n))
        for a in range(n):
            mine = self.log_evidence[self.truth == a]
            for b in range(n):
                if a != b and len(mine):
                    difference = mine[:, a] - mine[:, b]
                    found[a, b] = (difference > 0).mean() + 0.5 * (difference == 0).mean()
        return (found + found.T) / 2

    def not_separated(self) -> list[tuple[str, str, float]]:
        """Return the pairs that are not separated, and the share of right choices, worst first."""
        share, names = self.separation(), self.candidates
        pairs = [
            (names[a], names[b], float(share[a, b]))
            for a in range(len(names))
            for b in range(a + 1, len(names))
            if share[a, b] < SEPARATED
        ]
        return sorted(pairs, key=lambda pair: pair[2])


def share_and_error(flags: NDArray[np.bool_]) -> tuple[float, float]:
    """Return a share and its Monte Carlo standard error, that of (count + 1) / (n + 2)."""
    n = len(flags)
    near = (float(flags.sum()) + 1) / (n + 2)
    return float(flags.mean()), float(np.sqrt(near * (1 - near) / n))


def expected_confusion(
    table: ResponseTable,
    candidates: Sequence[str],
    model: CountModel,
    designs: Sequence[OrderedDesign],
    each: int,
    draws: int,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
    few: float = FEW,
) -> list[Confusion]:
    """Return the confusion of every design, over the same fibers: `each` for every candidate.

    Where fewer than `few` draws count effectively, they are refined.
    """
    sets = each * len(candidates)
    truth = np.repeat(np.arange(len(candidates)), each)
    fibers = draw_fibers(sets, table, model.unknowns, seed + 17, evenly=False)
    rates = np.stack([relative_rates(table, c, fibers) for c in candidates])[truth, np.arange(sets)]
    chance = np.random.default_rng(seed + 18)
    gain = model.draw_gains(sets, chance)
    dispersion = model.unknowns.dispersions[fibers.level]
    mean = model.window_s * gain[:, None] * rates
    sums = [_experiments(mean, fibers.drift, dispersion, design, chance) for design in designs]
    known = draw_fibers(draws, table, model.unknowns, seed + 19)
    evidence = np.empty((len(designs), sets, len(candidates)))
    effective = np.empty_like(evidence)
    best: list[dict[tuple[int, int], _Best]] = []
    total = len(candidates) + len(designs)

    def of_candidate(c: int) -> tuple[Array, Array, dict[tuple[int, int], _Best]]:
        log_rate = log_rates(relative_rates(table, candidates[c], known))
        return _evidence(model, sums, log_rate, known, few)

    def refined(at: tuple[int, int, int]) -> Refined:
        d, s, c = at
        start = best[c][d, s]
        return refined_evidence(
            table, candidates[c], model, sums[d].one(s), known.z[start.draws], start.log_likelihood,
            np.random.default_rng([seed, *at]),
        )  # fmt: skip

    with ThreadPoolExecutor(_THREADS) as pool:  # the products of matrices hold no lock
        for c, (found, counted, start) in enumerate(pool.map(of_candidate, range(len(candidates)))):
            progress(c, total)
            evidence[:, :, c], effective[:, :, c] = found, counted
            best.append(start)
        for d in range(len(designs)):
            progress(len(candidates) + d, total)
            behind = evidence[d].max(axis=1, keepdims=True) - evidence[d]
            near = np.argwhere((effective[d] < few) & (behind < _NEAR + _MISSED / effective[d])).tolist()
            for (s, c), one in zip(near, pool.map(refined, [(d, s, c) for s, c in near]), strict=True):
                evidence[d, s, c], effective[d, s, c] = one
    return [
        Confusion(
            design.name,
            design.minutes,
            len(design.order),
            len(np.unique(design.order)),
            tuple(candidates),
            truth,
            evidence[d],
            effective[d, np.arange(sets), truth],
        )
        for d, design in enumerate(designs)
    ]


class _Best(NamedTuple):
    """Numbers of the likeliest draws, and their log-likelihood."""

    draws: Ints
    log_likelihood: Floats


def _evidence(
    model: CountModel, sums: Sequence[CountSums], log_rate: Floats, known: FiberDraws, few: float
) -> tuple[Array, Array, dict[tuple[int, int], _Best]]:
    """Return (designs, s) log evidence of a candidate and effective draws, and the best ones where these are few."""
    evidence = np.empty((len(sums), len(sums[0].scatter)))
    effective = np.empty_like(evidence)
    best: dict[tuple[int, int], _Best] = {}
    for d, one in enumerate(sums):
        likelihood = model.log_likelihood(one, log_rate, known)
        top = likelihood.max(axis=1)
        share = np.exp(likelihood - top[:, None])
        evidence[d] = top + np.log(share.mean(axis=1))
        effective[d] = share.sum(axis=1) ** 2 / (share**2).sum(axis=1)
        for s in np.flatnonzero(effective[d] < few).tolist():
            draws = best_draws(likelihood[s])
            best[d, s] = _Best(draws, likelihood[s, draws])
    return evidence, effective, best


def _experiments(
    mean: Array, drift: Array, dispersion: Array, design: OrderedDesign, chance: np.random.Generator
) -> CountSums:
    """Return the counts of a design on every fiber, with means (s, presses) in the middle of the session."""
    sums = no_counts(len(mean), mean.shape[1], design.minutes)
    for press, at_s in zip(design.order, design.time_s, strict=True):
        tau = (at_s - 30 * design.minutes) / TEN_MINUTES_S
        sums = with_counts(
            sums, int(press), draw_counts(mean[:, press] * np.exp(drift * tau), dispersion, chance), float(tau)
        )
    return sums
