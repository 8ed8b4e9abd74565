"""Which contacts explain readings best: a climb from the runs of a first guess, by ends, kinds, splits and joins."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.profiles.contact import ENDS, KINDS, Contact, Kind
from sim.coding.profiles.seen import Model, Seen

Array = NDArray[np.float64]

MOST_CONTACTS = 3

_ANY = KINDS.index(Kind(0.7, ENDS[0], ENDS[0]))  # the kind that a contact begins as
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


def climbed(seen: Seen, starts: list[Model], begin: int = 1, sort: Sort | None = None) -> Climb:
    """From so many of the best starts to their tops, through models of one sort where that is told."""
    known: dict[Model, float] = {}
    _meet(seen, known, [model for model in starts if sort is None or sort_of(model) == sort])
    begun = sorted(known, key=known.__getitem__, reverse=True)[:begin]
    tops = [_to_the_top(seen, known, start, sort) for start in begun]
    return Climb(known, all(tops))


def _to_the_top(seen: Seen, known: dict[Model, float], model: Model, sort: Sort | None) -> bool:
    for _ in range(_MOST_STEPS):
        around = list(neighbours(model, len(seen.towards), sort))
        _meet(seen, known, around)
        best = max(around, key=known.__getitem__)
        if known[best] <= known[model]:
            return True
        model = best
    return False


def _meet(seen: Seen, known: dict[Model, float], models: list[Model]) -> None:
    new = [model for model in dict.fromkeys(models) if model not in known]
    if new:
        known.update(zip(new, seen.log_evidence(new).tolist(), strict=True))


def runs(pressure: Array) -> list[Model]:
    """Models of what lies above some shares of the highest pressure, and of all samples."""
    found: list[Model] = [(Contact(0, len(pressure), _ANY),)]
    for share in _SHARES:
        above = np.concatenate([[False], pressure > share * pressure.max(), [False]])
        first, stop = np.flatnonzero(np.diff(above.astype(int))).reshape(-1, 2).T
        model = tuple(Contact(a, b, _ANY) for a, b in zip(first.tolist(), stop.tolist(), strict=True))
        if 0 < len(model) <= MOST_CONTACTS:
            found.append(model)
    return found


def alone(samples: int) -> list[Model]:
    """Models of one contact, its ends at every other sample."""
    ends = range(0, samples + 1, 2)
    return [(Contact(first, stop, _ANY),) for first in ends for stop in ends if first < stop]


def neighbours(model: Model, samples: int, sort: Sort | None = None) -> Iterator[Model]:
    """Models that differ in one contact: its ends, or its kind; unless of one sort, also in how many there are."""
    for k, contact in enumerate(model):
        before, after = model[:k], model[k + 1 :]
        low, high = _room(before, after, samples)
        for other in _shifted(contact, low, high):
            yield (*before, other, *after)
        for kind in _kinds_beside(before + after, sort):
            yield (*before, Contact(contact.first, contact.stop, kind), *after)
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


def _with_fewer(before: Model, contact: Contact, after: Model) -> Iterator[Model]:
    """Without it, and joined with the next."""
    if before or after:
        yield before + after
    if after:
        yield (*before, Contact(contact.first, after[0].stop, contact.kind), *after[1:])


def _with_another(model: Model, samples: int) -> Iterator[Model]:
    for k in range(len(model) + 1):
        before, after = model[:k], model[k:]
        low, high = _room(before, after, samples)
        for width in _NEW_WIDTHS:
            for first in range(low + low % 2, high - width + 1, 2):
                yield (*before, Contact(first, first + width, _ANY), *after)


def _shifted(contact: Contact, low: int, high: int) -> Iterator[Contact]:
    for first in range(max(low, contact.first - _FARTHEST), contact.first + _FARTHEST + 1):
        for stop in range(max(first + 1, contact.stop - _FARTHEST), min(high, contact.stop + _FARTHEST) + 1):
            yield Contact(first, stop, contact.kind)


def _room(before: Model, after: Model, samples: int) -> tuple[int, int]:
    """First and stop between others, a sample being free on each side."""
    return before[-1].stop + 1 if before else 0, after[0].first - 1 if after else samples


def _split(contact: Contact) -> Iterator[tuple[Contact, Contact]]:
    """In two, with gaps of any width between, in steps of two samples."""
    first, stop, kind = contact
    for gap in range(first + 1, stop - 1, 2):
        for after in range(gap + 1, stop, 2):
            yield Contact(first, gap, kind), Contact(after, stop, kind)
