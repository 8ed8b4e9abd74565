"""Search for the contacts that explain readings best, by moving ends and changing kinds, splits and joins."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from sim.coding.evidence import explained

# --- contact ---
#
# The prior of a contact: inside, pressure has a level and varies slowly about it. At a sharp end, a corner's, it may
# rise far above it; the outermost samples are covered in part. Sizes are relative to a typical pressure.

Array = NDArray[np.float64]

LEVELS = (0.3, 0.7, 1.6)
ENDS = (0.2, 2.0)
SHARP, ALIKE = 0.5, 0.4
"""Probability of a sharp end. All numbers here were chosen on other scenes and seeds than those reported
(docs/validation/coding.md)."""

_LEVEL_SD = 0.5  # relative to the level
_SLOW = 0.2  # sd of the slow variation over the level, and its length (Matérn 5/2)
_LENGTH_SAMPLES = 4.0
_COVERED = 0.5  # covered part of an outermost sample, and its sd
_COVERED_SD = 0.3
_FREE = 0.02  # independent sd of each sample, so that covariances stay invertible


class ContactPrior(NamedTuple):
    """Prior mean of a contact / typical pressure, and sds of the two samples at each end / that mean."""

    level: float
    first_end: float
    last_end: float

    @property
    def sharp(self) -> bool:
        """Whether an end is sharp."""
        return max(ENDS) in self[1:]


KINDS = tuple(ContactPrior(level, *ends) for level in LEVELS for ends in product(ENDS, repeat=2))


def _log_prior(kind: ContactPrior) -> float:
    first, last = (SHARP if end == max(ENDS) else 1 - SHARP for end in kind[1:])
    alike = ALIKE if kind.first_end == kind.last_end else 0.0
    return float(np.log(first * (alike + (1 - ALIKE) * last) / len(LEVELS)))


_LOG_PRIOR = [_log_prior(kind) for kind in KINDS]


class ContactInterval(NamedTuple):
    """Samples first … stop − 1 of a contact, and the index of its prior in KINDS."""

    first: int
    stop: int
    kind: int

    @property
    def samples(self) -> slice:
        """Slice of its samples."""
        return slice(self.first, self.stop)

    @property
    def log_prior(self) -> float:
        """Log probability of its kind."""
        return _LOG_PRIOR[self.kind]

    @property
    def mean(self) -> Array:
        """(k,) prior mean pressures of its k samples / typical pressure."""
        return _prior_of(self.stop - self.first, self.kind)[0]

    @property
    def root(self) -> Array:
        """(k, k) lower Cholesky factor of their prior covariance."""
        return _prior_of(self.stop - self.first, self.kind)[1]

    @property
    def covariance(self) -> Array:
        """(k, k) prior covariance of these pressures."""
        return np.asarray(self.root @ self.root.T)


@cache
def _prior_of(samples: int, kind: int) -> tuple[Array, Array]:
    """Return prior mean and root of a contact with a number of samples."""
    level, first_end, last_end = KINDS[kind]
    number = np.arange(samples)
    outermost = (number == 0) | (number == samples - 1)
    alone = _FREE**2 + _COVERED_SD**2 * outermost + first_end**2 * (number <= 1)
    alone = alone + last_end**2 * (number >= samples - 2)
    mean = np.where(outermost, _COVERED, 1.0)
    apart = np.abs(np.subtract.outer(number, number)) * (np.sqrt(5) / _LENGTH_SAMPLES)
    alike = _LEVEL_SD**2 + _SLOW**2 * (1 + apart + apart**2 / 3) * np.exp(-apart)
    return level * mean, level * cholesky(np.outer(mean, mean) * alike + np.diag(alone), lower=True)


@cache
def table_of_contacts(most: int) -> tuple[Array, Array, Array]:
    """Return prior means (kinds, most, most), roots (kinds, most, most, most) and log probabilities (kinds,).

    They cover contacts of 1 … most samples of every kind.
    """
    mean, root = np.zeros((len(KINDS), most, most)), np.zeros((len(KINDS), most, most, most))
    for kind, k in product(range(len(KINDS)), range(most)):
        mean[kind, k, : k + 1], root[kind, k, : k + 1, : k + 1] = _prior_of(k + 1, kind)
    return mean, root, np.array(_LOG_PRIOR)


# --- likelihood ---
#
# Readings linearized about nearby pressures give normal priors and posteriors.

Model = tuple[ContactInterval, ...]
"""Adjacent contacts, ascending, with at least one free sample between them."""


class _Together(NamedTuple):
    """Models on the k samples of the largest: p = mean + root · u a priori, with u of variance 1."""

    at: NDArray[np.intp]  # (b, k) samples; padded by the number of samples
    mean: Array  # (b, k)
    root: Array  # (b, k, k)
    precision: Array  # (b, k, k) precision of the readings
    towards: Array  # (b, k) gradient of the readings' log likelihood, from the mean


class PressurePosterior(NamedTuple):
    """Posteriors of b models, each on its own samples, padded to the k of the largest."""

    at: NDArray[np.intp]  # (b, k) samples; n for padding
    mean: Array  # (b, k)
    covariance: Array  # (b, k, k)

    def over(self, samples: int) -> tuple[Array, Array]:
        """Return (b, samples) means and variances, 0 outside a model's contacts."""
        found = np.zeros((2, len(self.at), samples + 1))
        row = np.arange(len(self.at))[:, None]
        found[0, row, self.at] = self.mean
        found[1, row, self.at] = np.diagonal(self.covariance, axis1=1, axis2=2)
        return found[0, :, :samples], found[1, :, :samples]


@dataclass(frozen=True)
class PressureLikelihood:
    """Log likelihood −½ pᵀ `precision` p + `towards` · p + `nothing` of (n,) pressures p / typical pressure."""

    precision: Array  # (n, n)
    towards: Array  # (n,)
    typical: float
    nothing: float  # log likelihood without pressure

    def log_evidence(self, models: Sequence[Model]) -> Array:
        """Return (b,) joint log probabilities of readings and model, up to a constant."""
        count = np.array([len(model) for model in models])
        at = np.zeros((len(models), count.max(), 3), np.int64)
        for row, model in enumerate(models):
            at[row, : len(model)] = model
        n = len(self.towards)
        mean, root, log_kind = table_of_contacts(n)
        log_prior = log_kind - np.log(n * (n + 1) / 2)
        there = np.arange(at.shape[1]) < count[:, None]
        beyond = explained(at, count, mean, root, self.precision, self.towards)
        return np.asarray(self.nothing + (log_prior[at[:, :, 2]] * there).sum(axis=1) + beyond)

    def posterior(self, models: Sequence[Model]) -> PressurePosterior:
        """Return the posterior of the pressures / typical pressure."""
        one = self._together(models)
        inside = np.eye(one.mean.shape[1]) + one.root.swapaxes(1, 2) @ one.precision @ one.root
        spread = one.root @ np.linalg.solve(inside, one.root.swapaxes(1, 2))
        return PressurePosterior(one.at, one.mean + (spread @ one.towards[..., None])[..., 0], spread)

    def _together(self, models: Sequence[Model]) -> _Together:
        n, k = len(self.towards), max(map(_pressed, models))
        at = np.full((len(models), k), n)
        mean, root = np.zeros((len(models), k)), np.zeros((len(models), k, k))
        for row, model in enumerate(models):
            begin = 0
            for contact in model:
                end = begin + contact.stop - contact.first
                at[row, begin:end] = range(contact.first, contact.stop)
                mean[row, begin:end], root[row, begin:end, begin:end] = contact.mean, contact.root
                begin = end
        precision = np.pad(self.precision, (0, 1))[at[:, :, None], at[:, None]]
        towards = np.append(self.towards, 0.0)[at] - (precision @ mean[..., None])[..., 0]
        return _Together(at, mean, root, precision, towards)


def _pressed(model: Model) -> int:
    return sum(contact.stop - contact.first for contact in model)


def linearised(slope: Array, value: Array, covariance: Array, typical: float) -> PressureLikelihood:
    """Return the likelihood of (m, n) slopes and (m,) values of slope · pressure, with noise covariance (m, m)."""
    lower = cholesky(covariance, lower=True)
    white = solve_triangular(lower, np.column_stack([typical * slope, value]), lower=True)
    slopes, target = white[:, :-1], white[:, -1]
    nothing = -0.5 * target @ target - np.log(np.diag(lower)).sum()
    return PressureLikelihood(slopes.T @ slopes, slopes.T @ target, typical, float(nothing))


MOST_CONTACTS = 3

_ANY = KINDS.index(ContactPrior(0.7, ENDS[0], ENDS[0]))  # initial kind of a contact
_SHARP = tuple(k for k, kind in enumerate(KINDS) if kind.sharp)
_BLUNT = tuple(k for k in range(len(KINDS)) if k not in _SHARP)
_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4)  # thresholds for contacts, relative to the highest pressure
_NEW_WIDTHS = (2, 6)  # samples
_FARTHEST = 2  # largest step of an end, in samples
_MOST_STEPS = 20


class Sort(NamedTuple):
    """Class of models that small steps do not leave."""

    contacts: int
    sharp: bool  # whether an end is sharp


class Climb(NamedTuple):
    """Log evidence of every evaluated model, and whether each maximum was reached."""

    known: dict[Model, float]
    at_top: bool

    def best(self, count: int) -> list[Model]:
        """Return the most probable models, best first."""
        return sorted(self.known, key=self.known.__getitem__, reverse=True)[:count]

    def best_of_sorts(self, within: float) -> dict[Sort, Model]:
        """Return the most probable model of each sort, within a log evidence of the best."""
        highest = max(self.known.values())
        likely = [model for model, log in self.known.items() if log > highest - within]
        found: dict[Sort, Model] = {}
        for model in sorted(likely, key=self.known.__getitem__, reverse=True):
            found.setdefault(sort_of(model), model)
        return found


def sort_of(model: Model) -> Sort:
    """Return a model's number of contacts and whether an end is sharp."""
    return Sort(len(model), any(contact.kind in _SHARP for contact in model))


def climbed(likelihood: PressureLikelihood, starts: list[Model], begin: int = 1, sort: Sort | None = None) -> Climb:
    """Climb from the best `begin` starts to their maxima, within one sort if requested."""
    known: dict[Model, float] = {}
    _evaluate(likelihood, known, [model for model in starts if sort is None or sort_of(model) == sort])
    begun = sorted(known, key=known.__getitem__, reverse=True)[:begin]
    at_maximum = [_climb(likelihood, known, start, sort) for start in begun]
    return Climb(known, all(at_maximum))


def _climb(likelihood: PressureLikelihood, known: dict[Model, float], model: Model, sort: Sort | None) -> bool:
    for _ in range(_MOST_STEPS):
        around = list(neighbours(model, len(likelihood.towards), sort))
        _evaluate(likelihood, known, around)
        best = max(around, key=known.__getitem__)
        if known[best] <= known[model]:
            return True
        model = best
    return False


def _evaluate(likelihood: PressureLikelihood, known: dict[Model, float], models: list[Model]) -> None:
    new = [model for model in dict.fromkeys(models) if model not in known]
    if new:
        known.update(zip(new, likelihood.log_evidence(new).tolist(), strict=True))


def runs(pressure: Array) -> list[Model]:
    """Return models of the samples above several thresholds, and of all samples."""
    found: list[Model] = [(ContactInterval(0, len(pressure), _ANY),)]
    for share in _SHARES:
        above = np.concatenate([[False], pressure > share * pressure.max(), [False]])
        first, stop = np.flatnonzero(np.diff(above.astype(int))).reshape(-1, 2).T
        model = tuple(ContactInterval(a, b, _ANY) for a, b in zip(first.tolist(), stop.tolist(), strict=True))
        if 0 < len(model) <= MOST_CONTACTS:
            found.append(model)
    return found


def alone(samples: int) -> list[Model]:
    """Return models of one contact with ends at every other sample."""
    ends = range(0, samples + 1, 2)
    return [(ContactInterval(first, stop, _ANY),) for first in ends for stop in ends if first < stop]


def neighbours(model: Model, samples: int, sort: Sort | None = None) -> Iterator[Model]:
    """Return models that differ in one contact: ends or kind, and unless `sort` is fixed, the number of contacts."""
    for k, contact in enumerate(model):
        before, after = model[:k], model[k + 1 :]
        low, high = _room(before, after, samples)
        for other in _shifted(contact, low, high):
            yield (*before, other, *after)
        for kind in _kinds_beside(before + after, sort):
            yield (*before, ContactInterval(contact.first, contact.stop, kind), *after)
        if sort is None:
            yield from _with_fewer(before, contact, after)
            if len(model) < MOST_CONTACTS:
                yield from ((*before, *halves, *after) for halves in _split(contact))
    if sort is None and len(model) < MOST_CONTACTS:
        yield from _with_another(model, samples)


def _kinds_beside(others: Model, sort: Sort | None) -> Sequence[int]:
    """Return the kinds that a contact may have beside others."""
    if sort is None or (sort.sharp and sort_of(others).sharp):
        return range(len(KINDS))
    return _SHARP if sort.sharp else _BLUNT


def _with_fewer(before: Model, contact: ContactInterval, after: Model) -> Iterator[Model]:
    """Return models without the contact, and with it joined to the next."""
    if before or after:
        yield before + after
    if after:
        yield (*before, ContactInterval(contact.first, after[0].stop, contact.kind), *after[1:])


def _with_another(model: Model, samples: int) -> Iterator[Model]:
    for k in range(len(model) + 1):
        before, after = model[:k], model[k:]
        low, high = _room(before, after, samples)
        for width in _NEW_WIDTHS:
            for first in range(low + low % 2, high - width + 1, 2):
                yield (*before, ContactInterval(first, first + width, _ANY), *after)


def _shifted(contact: ContactInterval, low: int, high: int) -> Iterator[ContactInterval]:
    for first in range(max(low, contact.first - _FARTHEST), contact.first + _FARTHEST + 1):
        for stop in range(max(first + 1, contact.stop - _FARTHEST), min(high, contact.stop + _FARTHEST) + 1):
            yield ContactInterval(first, stop, contact.kind)


def _room(before: Model, after: Model, samples: int) -> tuple[int, int]:
    """Return the limits of a contact between others, with one free sample on each side."""
    return before[-1].stop + 1 if before else 0, after[0].first - 1 if after else samples


def _split(contact: ContactInterval) -> Iterator[tuple[ContactInterval, ContactInterval]]:
    """Return two contacts with gaps of any width between, in steps of two samples."""
    first, stop, kind = contact
    for gap in range(first + 1, stop - 1, 2):
        for after in range(gap + 1, stop, 2):
            yield ContactInterval(first, gap, kind), ContactInterval(after, stop, kind)
