"""Verdict on several afferents: one measure in common, with a gain and a threshold of each afferent.

The likelihood of an afferent is that of its own verdict (`rig/compare/likelihood.py`), with two changes. Its noise is
integrated out with the freedom of its estimate, and it counts as larger where even the best candidate of the afferent
does not fit. For each measure and receptor it is integrated over log|k| (Laplace) and ε₀ (quadrature), which gives a
mass, a mean and a covariance. Over the afferents, log|k| and ε₀ are normal; their means and standard deviations are
maximum-likelihood estimates. Receptors have equal prior probabilities, and so have measures and controls.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, stdtrit

from rig.compare.intervals import along
from rig.compare.make_verdict import CandidatePool
from rig.compare.verdict import LEVEL, AfferentVerdict, Limits

Array = NDArray[np.float64]
GroupOutcome = Literal["one measure", "several measures", "not beyond controls", "nothing"]

FEWEST = 2
"""Number of afferents from which a group has a verdict."""

_STEPS = np.geomspace(1e-3, 3.0, 40)
_OFFSETS = np.concatenate([-_STEPS[::-1], [0.0], _STEPS])  # of ε₀ from its best value, relative to the range of ε
_HOPELESS = 40.0  # log-likelihood below a measure's best receptor at which another one is ignored
_KNOWN = 1e6  # degrees of freedom from which the noise counts as known
_WIDEST = 1.0  # variance of log|k| above which a Laplace approximation means nothing
_VARIANCES = (
    np.array([[0.01, 0.005], [3.0, 1.0]]) ** 2
)  # least and largest, of log|k| and of thresholds over their size
_FIRST_SD = 0.3
_ROUNDS, _SETTLED = 300, 1e-3


@dataclass(frozen=True, eq=False)
class AfferentLikelihood:
    """Likelihood of one measure for one afferent at each receptor (R,), as a normal one of log|k| and ε₀.

    `log_mass` (R,), `mean` (R, 2), `covariance` (R, 2, 2); ε₀ is in the sign in which the rate rises with it.
    `flat` is the log-likelihood of a constant rate, which a measure without any better line has.
    """

    log_mass: Array
    mean: Array
    covariance: Array
    receptors: int
    flat: float


def surfaces(pool: CandidatePool) -> dict[str, AfferentLikelihood]:
    """Return the likelihood of every measure and control of an afferent."""
    data, eps = pool.observed, pool.candidates.eps[0]
    found = pool.candidates.fitted(data).found
    noise, total = data.noise, found.total
    size = float(data.share(data.smooth).sum())
    misfit = float(total.min()) / noise.dispersion / max(size - 2, 1.0)
    dispersion = noise.dispersion * max(misfit, 1.0)
    known = noise.freedom > _KNOWN

    def log_likelihood(deviance: Array, freedom: float) -> Array:
        """Return the log-likelihood up to a constant, with `freedom` dimensions already integrated out."""
        if known:
            return np.asarray(-deviance / (2 * dispersion))
        spread = noise.freedom * dispersion
        return np.asarray(-(noise.freedom + size - freedom) / 2 * np.log1p(deviance / spread))

    def variance(deviance: Array) -> Array:
        """Return the variance of the noise at a deviance."""
        if known:
            return np.full_like(deviance, dispersion)
        return np.asarray((noise.freedom * dispersion + deviance) / (noise.freedom + size))

    flat = float(log_likelihood(total[-1:], 0.0)[0])  # the last candidate is a constant rate
    at_best = log_likelihood(total, 0.0)
    result = {}
    for name in dict.fromkeys(one.name for one in pool.named[:-1]):
        mine = np.array([n for n, one in enumerate(pool.named) if one.name == name])
        fitted = mine[np.isfinite(found.k[mine])]
        if len(fitted):
            fitted = fitted[at_best[fitted] > at_best[fitted].max() - _HOPELESS]
        sign = np.sign(found.k[fitted])
        rising = sign[:, None] * eps[fitted]
        reach = np.ptp(rising, axis=1, keepdims=True)
        eps0 = (sign * found.eps0[fitted])[:, None] + reach * _OFFSETS
        k, deviance, steep = along(rising, eps0, data, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            of_k = np.where(k > 0, variance(deviance) / (steep * k * k), np.inf)
            log_k = np.where(k > 0, np.log(k), 0.0)
            height = log_likelihood(deviance, 1.0) - 0.5 * np.log(steep * k * k)
        inside = (k > 0) & (reach > 0) & (eps0 > rising.min(axis=1, keepdims=True) - 2 * reach) & (of_k < _WIDEST)
        log_weight = np.where(
            inside, height + np.log(np.maximum(np.gradient(eps0, axis=1), np.finfo(float).tiny)), -np.inf
        )
        log_mass = logsumexp(log_weight, axis=1) if len(fitted) else np.empty(0)
        seen = np.isfinite(log_mass)
        weight = np.exp(log_weight[seen] - log_mass[seen, None])
        values = np.stack([log_k[seen], eps0[seen]])
        mean = (weight * values).sum(axis=2)
        off = values - mean[..., None]
        covariance = np.einsum("iaq,jaq,aq->aij", off, off, weight)
        covariance[:, 0, 0] += (weight * np.where(inside[seen], of_k[seen], 0.0)).sum(axis=1)
        result[name] = AfferentLikelihood(log_mass[seen], mean.T, covariance, len(mine), flat)
    return result


class Population(NamedTuple):
    """Gain and threshold of a measure over the afferents.

    `gain` is the geometric mean of |k| and `gain_factor` the exponential of the standard deviation of log|k|;
    `threshold` and `threshold_sd` are of ε₀, in the sign in which the rate rises. Limits: 95 %.
    """

    gain: float
    gain_limits: Limits
    gain_factor: float
    threshold: float
    threshold_limits: Limits
    threshold_sd: float


@dataclass(frozen=True, eq=False)
class GroupRow:
    """A measure or control as the one in common.

    `worse_by` is its log-likelihood below the best one, `by_afferent` (A,) the same for each afferent. `wins` counts
    the afferents whose maximum-likelihood measure it is, `kept` those in whose set it is.
    """

    name: str
    control: bool
    probability: float
    worse_by: float
    in_set: bool
    wins: int
    kept: int
    population: Population
    by_afferent: Array


@dataclass(frozen=True, eq=False)
class GroupVerdict:
    """Verdict on a group; `rows` best first. `afferents` have a verdict of their own each."""

    afferents: Mapping[str, AfferentVerdict]
    rows: tuple[GroupRow, ...]

    @property
    def set(self) -> list[GroupRow]:
        """Measures and controls that share 95 % of the probability."""
        return [row for row in self.rows if row.in_set]

    @property
    def leader(self) -> GroupRow | None:
        """Only measure in the set; None if the set has several members or a control."""
        return self.rows[0] if len(self.set) == 1 and not self.rows[0].control else None

    @property
    def best(self) -> GroupRow:
        """Most probable measure."""
        return next(row for row in self.rows if not row.control)

    @property
    def unexplained(self) -> int:
        """Number of afferents whose own verdict rejects every measure."""
        return sum(one.outcome == "nothing" for one in self.afferents.values())

    @property
    def outcome(self) -> GroupOutcome:
        """Outcome; "nothing" if at least half of the afferents reject every measure."""
        if 2 * self.unexplained >= len(self.afferents):
            return "nothing"
        if any(row.control for row in self.set):
            return "not beyond controls"
        return "one measure" if len(self.set) == 1 else "several measures"


def group_verdict(afferents: Mapping[str, tuple[CandidatePool, AfferentVerdict]]) -> GroupVerdict | None:
    """Return the verdict on afferents with their candidates, or None below two of them."""
    if len(afferents) < FEWEST:
        return None
    found = ranked([pool for pool, _ in afferents.values()])
    verdicts = {name: verdict for name, (_, verdict) in afferents.items()}
    controls = {one.name for pool, _ in afferents.values() for one in pool.named if one.control}
    rows = [
        GroupRow(
            name=one.name,
            control=one.name in controls,
            probability=one.probability,
            worse_by=float((found[0].fit.by_afferent - one.fit.by_afferent).sum()),
            in_set=one.in_set,
            wins=sum(verdict.closest.name == one.name for verdict in verdicts.values()),
            kept=sum(any(row.name == one.name and row.in_set for row in v.rows) for v in verdicts.values()),
            population=one.fit.population,
            by_afferent=found[0].fit.by_afferent - one.fit.by_afferent,
        )
        for one in found
    ]
    return GroupVerdict(verdicts, tuple(rows))


class Ranked(NamedTuple):
    """A measure or control with its fit as the one in common, its probability, and whether it is in the set."""

    name: str
    fit: "InCommon"
    probability: float
    in_set: bool


def ranked(pools: Sequence[CandidatePool]) -> list[Ranked]:
    """Return the measures and controls that every afferent has, most probable first."""
    each = [surfaces(pool) for pool in pools]
    names = [name for name in each[0] if all(name in one for one in each)]
    fits = in_common([[one[name] for one in each] for name in names])
    total = np.array([fit.by_afferent.sum() for fit in fits])
    probability = np.exp(total - logsumexp(total))
    order = np.argsort(-total, kind="stable")
    before = np.cumsum(probability[order]) - probability[order]
    return [
        Ranked(names[n], fits[n], float(probability[n]), bool(share < 1 - LEVEL))
        for n, share in zip(order, before, strict=True)
    ]


class InCommon(NamedTuple):
    """Fit of a measure as the one in common: its population, and the log-likelihood (A,) of each afferent."""

    population: Population
    by_afferent: Array


def in_common(each: Sequence[Sequence[AfferentLikelihood]]) -> list[InCommon]:
    """Return the maximum-likelihood population of each measure, from its surface for every afferent.

    Afferents for which a measure has no line better than a constant rate count with that constant's likelihood.
    """
    most = max(1, *(len(one.log_mass) for some in each for one in some))
    shape = len(each), len(each[0]), most
    mass, mean, covariance = np.full(shape, -np.inf), np.zeros((*shape, 2)), np.zeros((*shape, 2, 2))
    covariance[:] = np.eye(2)
    for m, some in enumerate(each):
        for a, one in enumerate(some):
            here = m, a, slice(len(one.log_mass))
            mass[here] = one.log_mass - np.log(one.receptors)
            mean[here], covariance[here] = one.mean, one.covariance
    scale = _scale(mass, mean, covariance)  # of thresholds, so that bounds suit every measure
    unit = np.stack([np.ones_like(scale), scale], axis=-1)[:, None, None]
    mean, covariance = mean / unit, covariance / (unit[..., None] * unit[..., None, :])
    surface = _Normal(mass - np.log(scale)[:, None, None], mean, covariance)
    centre, variance = _most_likely(surface)
    terms = surface.terms(centre, variance)
    lined = np.asarray(np.isfinite(mass).any(axis=2))
    total = logsumexp(np.where(lined[..., None], terms, 0.0), axis=2)
    flat = np.array([[one.flat for one in some] for some in each])
    by_afferent = np.where(lined, total, flat)
    share = np.where(lined[..., None], np.exp(terms - total[..., None]), 0.0)
    return [
        InCommon(_population(variance[m], share[m], mean[m], covariance[m], float(scale[m])), by_afferent[m])
        for m in range(len(each))
    ]


def _scale(mass: Array, mean: Array, covariance: Array) -> Array:
    """Return the size (M,) of thresholds: the range of the best ones and the largest standard deviation."""
    best = np.take_along_axis(mean[..., 1], mass.argmax(axis=2)[..., None], axis=2)[..., 0]
    lined = np.isfinite(mass)
    widest = np.sqrt(np.where(lined, covariance[..., 1, 1], 0.0).max(axis=(1, 2)))
    some = np.asarray(lined.any(axis=2))
    low, high = (sign * np.where(some, sign * best, -np.inf).max(axis=1) for sign in (-1, 1))
    scale = widest + np.where(some.any(axis=1), high - low, 0.0)
    return np.where(scale > 0, scale, 1.0)


class _Normal(NamedTuple):
    """Surfaces (M, A, R) of measures, afferents and receptors."""

    log_mass: Array
    mean: Array
    covariance: Array

    def terms(self, centre: Array, variance: Array) -> Array:
        """Return the log-likelihood of each receptor in populations (M, 2) of independent gain and threshold."""
        off = self.mean - centre[:, None, None]
        a, b, c = self._sums(variance)
        determinant = a * c - b * b
        x, y = off[..., 0], off[..., 1]
        square = (c * x * x - 2 * b * x * y + a * y * y) / determinant
        return np.asarray(self.log_mass - 0.5 * (square + np.log(determinant)) - np.log(2 * np.pi))

    def updated(self, centre: Array, variance: Array) -> tuple[Array, Array]:
        """Return the populations after one step of expectation and maximization."""
        terms = self.terms(centre, variance)
        largest = terms.max(axis=2, keepdims=True)
        share = np.exp(terms - np.where(np.isfinite(largest), largest, 0.0))
        share /= np.maximum(share.sum(axis=2, keepdims=True), np.finfo(float).tiny)
        a, b, c = self._sums(variance)
        determinant = a * c - b * b
        inverse = (
            np.stack([np.stack([c, -b], axis=-1), np.stack([-b, a], axis=-1)], axis=-2) / determinant[..., None, None]
        )
        precision = np.einsum("mar,marij->mij", share, inverse)
        pull = np.einsum("mar,marij,marj->mi", share, inverse, self.mean)
        lined = share.sum(axis=(1, 2)) > 0
        moved = np.where(
            lined[:, None],
            np.linalg.solve(np.where(lined[:, None, None], precision, np.eye(2)), pull[..., None])[..., 0],
            centre,
        )
        wide = variance[:, None, None]
        off = wide * np.einsum("marij,marj->mari", inverse, self.mean - moved[:, None, None])
        left = wide * (1 - wide * np.diagonal(inverse, axis1=-2, axis2=-1))
        weight = (share / np.maximum(share.sum(axis=(1, 2), keepdims=True), np.finfo(float).tiny))[..., None]
        spread = (weight * (left + off**2)).sum(axis=(1, 2))
        return moved, np.clip(spread, *_VARIANCES)

    def _sums(self, variance: Array) -> tuple[Array, Array, Array]:
        wide = variance[:, None, None]
        of = self.covariance
        return of[..., 0, 0] + wide[..., 0], of[..., 0, 1], of[..., 1, 1] + wide[..., 1]


def _most_likely(surface: _Normal) -> tuple[Array, Array]:
    """Return maximum-likelihood means and variances (M, 2) of log gain and threshold."""
    best = np.take_along_axis(surface.mean, surface.log_mass.argmax(axis=2)[..., None, None], axis=2)[:, :, 0]
    lined = np.asarray(np.isfinite(surface.log_mass).any(axis=2))
    centre = np.array([np.median(own[here], axis=0) if here.any() else np.zeros(2)
                       for own, here in zip(best, lined, strict=True)])  # fmt: skip
    variance = np.full_like(centre, _FIRST_SD**2)
    for _ in range(_ROUNDS):
        before = variance
        centre, variance = surface.updated(centre, variance)
        if np.abs(np.log(variance / before)).max() < _SETTLED:
            break
    return centre, variance


def _population(variance: Array, share: Array, mean: Array, covariance: Array, scale: float) -> Population:
    """Return the estimates with limits by Knapp and Hartung (Stat. Med. 22, 2693, 2003), which suit few afferents."""
    lined = share.sum(axis=1) > 0
    if not lined.any():
        return Population(np.nan, (np.nan, np.nan), np.nan, np.nan, (np.nan, np.nan), np.nan)
    share, mean, covariance = share[lined], mean[lined], covariance[lined]
    limits = []
    for axis in range(2):
        own = (share * mean[..., axis]).sum(axis=1)
        width = (share * (covariance[..., axis, axis] + (mean[..., axis] - own[:, None]) ** 2)).sum(axis=1)
        weight = 1 / (width + variance[axis])
        centre = float((weight * own).sum() / weight.sum())
        freedom = max(len(own) - 1, 1)
        scatter = float((weight * (own - centre) ** 2).sum() / freedom)
        error = np.sqrt(scatter / weight.sum()) if len(own) > 1 else np.inf
        reach = float(stdtrit(freedom, 1 - LEVEL / 2) * error)
        limits.append((centre, centre - reach, centre + reach))
    (k, k_low, k_high), (at, low, high) = limits
    gain, gain_low, gain_high = np.exp([k, k_low, k_high]).tolist()
    factor, sd = float(np.exp(np.sqrt(variance[0]))), float(np.sqrt(variance[1])) * scale
    return Population(gain, (gain_low, gain_high), factor, at * scale, (low * scale, high * scale), sd)
