"""Which contacts explain readings best: a climb from the runs of a first guess, by ends, kinds, splits and joins."""

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
# One contact: which samples it covers, and what is known of the pressure there beforehand.
#
# Inside, pressure has a level and varies slowly about it. At a blunt end it does little else, at a sharp one, a
# corner's, it may stand out by far; the outermost samples are covered in part. Sizes are over a typical pressure.

Array = NDArray[np.float64]

LEVELS = (0.3, 0.7, 1.6)
ENDS = (0.2, 2.0)
SHARP, ALIKE = 0.5, 0.4
"""Levels; sds of blunt and of sharp ends; the probabilities of a sharp one, and that the last end is told to be as
the first. Chosen on other scenes and seeds than those reported (docs/validation/coding.md), as all below."""

_LEVEL_SD = 0.5  # over the level
_SLOW = 0.2  # sd of the slow variation over the level, and its length (Matérn 5/2)
_LENGTH_SAMPLES = 4.0
_COVERED = 0.5  # of an outermost sample, and its sd
_COVERED_SD = 0.3
_FREE = 0.02  # sd of each sample by itself: covariances keep an inverse


class ContactPrior(NamedTuple):
    """Prior mean over the typical pressure; over that mean the sds of two samples at the first end, at the last."""

    level: float
    first_end: float
    last_end: float

    @property
    def sharp(self) -> bool:
        """At some end."""
        return max(ENDS) in self[1:]


KINDS = tuple(ContactPrior(level, *ends) for level in LEVELS for ends in product(ENDS, repeat=2))


def _log_prior(kind: ContactPrior) -> float:
    first, last = (SHARP if end == max(ENDS) else 1 - SHARP for end in kind[1:])
    alike = ALIKE if kind.first_end == kind.last_end else 0.0
    return float(np.log(first * (alike + (1 - ALIKE) * last) / len(LEVELS)))


_LOG_PRIOR = [_log_prior(kind) for kind in KINDS]


class ContactInterval(NamedTuple):
    """Samples first … stop − 1, and a place in KINDS."""

    first: int
    stop: int
    kind: int

    @property
    def samples(self) -> slice:
        """Those it covers."""
        return slice(self.first, self.stop)

    @property
    def log_prior(self) -> float:
        """Log probability of its kind."""
        return _LOG_PRIOR[self.kind]

    @property
    def mean(self) -> Array:
        """(k,) pressures of its k samples beforehand, over the typical pressure."""
        return _beforehand(self.stop - self.first, self.kind)[0]

    @property
    def root(self) -> Array:
        """(k, k) lower triangular; times its transpose the covariance of those pressures."""
        return _beforehand(self.stop - self.first, self.kind)[1]

    @property
    def covariance(self) -> Array:
        """(k, k) of those pressures."""
        return np.asarray(self.root @ self.root.T)


@cache
def _beforehand(samples: int, kind: int) -> tuple[Array, Array]:
    """Mean and root of a contact of so many samples."""
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
    """Means (kinds, most, most) and roots (kinds, most, most, most) of contacts of 1 … most samples of every kind.

    And the (kinds,) log probabilities.
    """
    mean, root = np.zeros((len(KINDS), most, most)), np.zeros((len(KINDS), most, most, most))
    for kind, k in product(range(len(KINDS)), range(most)):
        mean[kind, k, : k + 1], root[kind, k, : k + 1, : k + 1] = _beforehand(k + 1, kind)
    return mean, root, np.array(_LOG_PRIOR)


# --- seen ---
#
# Readings as seen from pressures nearby: linear, so that all of a few contacts is normal, prior and posterior.

Model = tuple[ContactInterval, ...]
"""Contacts side by side, ascending, with at least one free sample between them."""


class _Together(NamedTuple):
    """Models on the k samples that the largest presses: p = mean + root · u beforehand, u of variance 1."""

    at: NDArray[np.intp]  # (b, k) samples; one beyond the last where a model has none left
    mean: Array  # (b, k)
    root: Array  # (b, k, k)
    precision: Array  # (b, k, k) by which readings see them
    towards: Array  # (b, k) gradient of the readings' log likelihood, from the mean


class PressurePosterior(NamedTuple):
    """Of b models, each on its own samples; the rest of the k that the largest presses are nothing, for sure."""

    at: NDArray[np.intp]  # (b, k) samples; n, beyond the last, for nothing
    mean: Array  # (b, k)
    covariance: Array  # (b, k, k)

    def over(self, samples: int) -> tuple[Array, Array]:
        """(b, samples) means and variances, 0 outside a model's contacts."""
        found = np.zeros((2, len(self.at), samples + 1))
        row = np.arange(len(self.at))[:, None]
        found[0, row, self.at] = self.mean
        found[1, row, self.at] = np.diagonal(self.covariance, axis1=1, axis2=2)
        return found[0, :, :samples], found[1, :, :samples]


@dataclass(frozen=True)
class PressureLikelihood:
    """Log likelihood −½ pᵀ `precision` p + `towards` · p + `nothing` of (n,) pressures p over typical."""

    precision: Array  # (n, n)
    towards: Array  # (n,)
    typical: float
    nothing: float  # of no pressure

    def log_evidence(self, models: Sequence[Model]) -> Array:
        """(b,) log probabilities of the readings and the model, but for what is the same of all readings."""
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
        """Of the pressures over typical."""
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
    """From (m, n) slopes, (m,) values that slope · pressure should have, and the (m, m) covariance of their noise."""
    lower = cholesky(covariance, lower=True)
    white = solve_triangular(lower, np.column_stack([typical * slope, value]), lower=True)
    seen, said = white[:, :-1], white[:, -1]
    nothing = -0.5 * said @ said - np.log(np.diag(lower)).sum()
    return PressureLikelihood(seen.T @ seen, seen.T @ said, typical, float(nothing))


MOST_CONTACTS = 3

_ANY = KINDS.index(ContactPrior(0.7, ENDS[0], ENDS[0]))  # the kind that a contact begins as
_SHARP = tuple(k for k, kind in enumerate(KINDS) if kind.sharp)
_BLUNT = tuple(k for k in range(len(KINDS)) if k not in _SHARP)
_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the highest pressure: what lies above is a contact
_NEW_WIDTHS = (2, 6)  # samples
_FARTHEST = 2  # samples that an end moves at once
_MOST_STEPS = 20


class Sort(NamedTuple):
    """Kinds of answers that no small step joins."""

    contacts: int
    sharp: bool  # at some end


class Climb(NamedTuple):
    """Log evidence of every model met on the way up, and whether each top was reached."""

    known: dict[Model, float]
    at_top: bool

    def best(self, count: int) -> list[Model]:
        """The likeliest, first the best."""
        return sorted(self.known, key=self.known.__getitem__, reverse=True)[:count]

    def best_of_sorts(self, within: float) -> dict[Sort, Model]:
        """The likeliest of each sort, none so far below the best."""
        highest = max(self.known.values())
        likely = [model for model, log in self.known.items() if log > highest - within]
        found: dict[Sort, Model] = {}
        for model in sorted(likely, key=self.known.__getitem__, reverse=True):
            found.setdefault(sort_of(model), model)
        return found


def sort_of(model: Model) -> Sort:
    """Its number of contacts, and whether some end is sharp."""
    return Sort(len(model), any(contact.kind in _SHARP for contact in model))


def climbed(seen: PressureLikelihood, starts: list[Model], begin: int = 1, sort: Sort | None = None) -> Climb:
    """From so many of the best starts to their tops, through models of one sort where that is told."""
    known: dict[Model, float] = {}
    _meet(seen, known, [model for model in starts if sort is None or sort_of(model) == sort])
    begun = sorted(known, key=known.__getitem__, reverse=True)[:begin]
    tops = [_to_the_top(seen, known, start, sort) for start in begun]
    return Climb(known, all(tops))


def _to_the_top(seen: PressureLikelihood, known: dict[Model, float], model: Model, sort: Sort | None) -> bool:
    for _ in range(_MOST_STEPS):
        around = list(neighbours(model, len(seen.towards), sort))
        _meet(seen, known, around)
        best = max(around, key=known.__getitem__)
        if known[best] <= known[model]:
            return True
        model = best
    return False


def _meet(seen: PressureLikelihood, known: dict[Model, float], models: list[Model]) -> None:
    new = [model for model in dict.fromkeys(models) if model not in known]
    if new:
        known.update(zip(new, seen.log_evidence(new).tolist(), strict=True))


def runs(pressure: Array) -> list[Model]:
    """Models of what lies above some shares of the highest pressure, and of all samples."""
    found: list[Model] = [(ContactInterval(0, len(pressure), _ANY),)]
    for share in _SHARES:
        above = np.concatenate([[False], pressure > share * pressure.max(), [False]])
        first, stop = np.flatnonzero(np.diff(above.astype(int))).reshape(-1, 2).T
        model = tuple(ContactInterval(a, b, _ANY) for a, b in zip(first.tolist(), stop.tolist(), strict=True))
        if 0 < len(model) <= MOST_CONTACTS:
            found.append(model)
    return found


def alone(samples: int) -> list[Model]:
    """Models of one contact, its ends at every other sample."""
    ends = range(0, samples + 1, 2)
    return [(ContactInterval(first, stop, _ANY),) for first in ends for stop in ends if first < stop]


def neighbours(model: Model, samples: int, sort: Sort | None = None) -> Iterator[Model]:
    """Models that differ in one contact: its ends, or its kind; unless of one sort, also in how many there are."""
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
    """That a contact may be of."""
    if sort is None or (sort.sharp and sort_of(others).sharp):
        return range(len(KINDS))
    return _SHARP if sort.sharp else _BLUNT


def _with_fewer(before: Model, contact: ContactInterval, after: Model) -> Iterator[Model]:
    """Without it, and joined with the next."""
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
    """First and stop between others, a sample being free on each side."""
    return before[-1].stop + 1 if before else 0, after[0].first - 1 if after else samples


def _split(contact: ContactInterval) -> Iterator[tuple[ContactInterval, ContactInterval]]:
    """In two, with gaps of any width between, in steps of two samples."""
    first, stop, kind = contact
    for gap in range(first + 1, stop - 1, 2):
        for after in range(gap + 1, stop, 2):
            yield ContactInterval(first, gap, kind), ContactInterval(after, stop, kind)
