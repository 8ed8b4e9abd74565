"""Which contacts explain readings best: a climb from the runs of a first guess, by ends, kinds, splits and joins."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.profiles.contact import ENDS, KINDS, Contact, Kind
from sim.coding.profiles.seen import Model, Seen

Array = NDArray[np.float64]

MOST_CONTACTS = 3

_ANY = KINDS.index(Kind(0.7, 0.15, 0.15))  # the kind that a contact begins as
_SHARP = {k for k, kind in enumerate(KINDS) if max(ENDS) in kind[1:]}
_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the highest pressure: what lies above is a contact
_NEW_WIDTHS = (2, 6)  # samples
_MOVES = (-2, -1, 0, 1, 2)  # samples
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
        found: dict[Sort, Model] = {}
        for model in self.best(len(self.known)):
            found.setdefault(sort_of(model), model)
        highest = max(self.known.values())
        return {sort: model for sort, model in found.items() if self.known[model] > highest - within}


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
        around = list(neighbours(model, seen.matrix.shape[1], alike=sort is not None))
        if sort is not None:
            around = [other for other in around if sort_of(other) == sort]
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


def neighbours(model: Model, samples: int, *, alike: bool = False) -> Iterator[Model]:
    """Models that differ in one contact: its ends or its kind; unless alike, also in how many there are."""
    for k, contact in enumerate(model):
        before, after = model[:k], model[k + 1 :]
        for other in (*_shifted(contact), *_of_other_kinds(contact)):
            if _fits(before, other, after, samples):
                yield (*before, other, *after)
        if not alike:
            yield from _with_fewer(before, contact, after)
            if len(model) < MOST_CONTACTS:
                yield from ((*before, *halves, *after) for halves in _split(contact))
    if not alike and len(model) < MOST_CONTACTS:
        yield from _with_another(model, samples)


def _with_fewer(before: Model, contact: Contact, after: Model) -> Iterator[Model]:
    """Without it, and joined with the next."""
    if before or after:
        yield before + after
    if after:
        yield (*before, Contact(contact.first, after[0].stop, contact.kind), *after[1:])


def _with_another(model: Model, samples: int) -> Iterator[Model]:
    for k in range(len(model) + 1):
        before, after = model[:k], model[k:]
        for width in _NEW_WIDTHS:
            for first in range(0, samples - width + 1, 2):
                new = Contact(first, first + width, _ANY)
                if _fits(before, new, after, samples):
                    yield (*before, new, *after)


def _shifted(contact: Contact) -> Iterator[Contact]:
    first, stop, kind = contact
    for at_first in _MOVES:
        for at_stop in _MOVES:
            if first + at_first < stop + at_stop:
                yield Contact(first + at_first, stop + at_stop, kind)


def _of_other_kinds(contact: Contact) -> list[Contact]:
    return [contact._replace(kind=kind) for kind in range(len(KINDS))]


def _fits(before: Model, contact: Contact, after: Model, samples: int) -> bool:
    low = before[-1].stop + 1 if before else 0
    high = after[0].first - 1 if after else samples
    return low <= contact.first and contact.stop <= high


def _split(contact: Contact) -> Iterator[tuple[Contact, Contact]]:
    """In two, with gaps of any width between, in steps of two samples."""
    first, stop, kind = contact
    for gap in range(first + 1, stop - 1, 2):
        for after in range(gap + 1, stop, 2):
            yield Contact(first, gap, kind), Contact(after, stop, kind)
