"""Numbers that are no measurements: what other numbers are together, as their mean, and 999 for no data."""

import math
import re
from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.recordings.column_units import LENGTH, column_kind
from rig.compare.recordings.table import Row

Array = NDArray[np.float64]


class Statistic(NamedTuple):
    """What several numbers are together, along the first axis.

    `of_repeats`: a repeat that has it at all positions may be none. `of_places`: a row of totals may have it as its
    place. `exact`: it is not rounded to a whole number.
    """

    word: str
    of: Callable[[Array], Array]
    of_places: bool = False
    of_repeats: bool = True
    exact: bool = False


def _sd(values: Array) -> Array:
    return np.asarray(values.std(axis=0, ddof=1))


STATISTICS = (
    Statistic("sum", lambda values: values.sum(axis=0), of_places=True, exact=True),
    Statistic("mean", lambda values: values.mean(axis=0), of_places=True, exact=True),
    Statistic("rounded mean", lambda values: values.mean(axis=0)),
    Statistic("median", lambda values: np.median(values, axis=0), of_places=True),
    Statistic("minimum", lambda values: values.min(axis=0), of_places=True),
    Statistic("maximum", lambda values: values.max(axis=0), of_places=True),
    Statistic("sd", _sd, of_places=True),
    Statistic("sd (of n)", lambda values: values.std(axis=0), of_places=True),
    Statistic("standard error", lambda values: _sd(values) / math.sqrt(len(values)), of_places=True),
    Statistic("variance", lambda values: values.var(axis=0, ddof=1), of_places=True, of_repeats=False),
)
ROUNDED = 1e-3
"""Share by which a mean in a table may be rounded."""
UNLIKELY = 1.5e-3
"""Chance below which an agreement of measurements with a statistic of others is refused."""
SQRT_TAU = 2.5  # of a normal density: the chance of one of its steps is step / (2.5 sd)
_MOST_TOTALS, _MOST_OF_GROUP = 8, 3  # rows that pandas' describe() gives, and a mean, an sd and a number
_SAID, _WHOLE = 0.03, 0.02
_TRIED = 5  # statistics that lie in the range of the values
_ODD, _TAKEN, _ZERO = 0.1, 0.03, 0.2
"""Shares of tables whose last measurement lies beside the order of the others, at the place of one, or at 0."""


class _Rows(NamedTuple):
    """Rows that belong together, by their numbers from 0, and what the others of them are called."""

    at: NDArray[np.intp]
    above: str
    below: str
    most: int


class _Total(NamedTuple):
    """A row that is a statistic of others, and the chance that a measurement is."""

    at: int
    word: str
    chance: float


def refuse_total_rows(
    rows: Sequence[Row], columns: Sequence[str], values: Array, what: str, group: str = "", *, fewest: int = 3
) -> str:
    """Refuse one of the first or last rows that is the sum, mean and the like of the others, or of its group.

    values (n, 1 + k) are the measured ones in n rows, and k coordinates of the place; `what` is a row in words,
    `group` a column whose cells tell groups apart, `fewest` the others that can show it. A row is refused if its
    value is that of the others to rounding, and its place fits neither the order nor the spacing of the others, or is
    their mean and the like, so that chance is excluded. Return a sentence on one that may be so by chance.
    """
    labels = np.array([row.cells.get(group, "") for row in rows])
    every = [_Rows(np.arange(len(rows)), "the rows above", "the rows below", _MOST_TOTALS)]
    for label in dict.fromkeys(labels.tolist()) if len(set(labels.tolist())) > 1 else ():
        others = f"the other rows of {rows[0].columns[group].name} {label}"
        every.append(_Rows(np.flatnonzero(labels == label), others, others, _MOST_OF_GROUP))
    likeliest, said, step = _SAID, "", value_step(values[:, 0])
    for some in every:
        for beside in range(1, min(some.most, len(some.at) - fewest) + 1):
            for block, rest in ((some.at[-beside:], some.at[:-beside]), (some.at[:beside], some.at[beside:])):
                if np.ptp(values[rest, 0]) == 0:
                    continue
                found = _total(rows, columns, values, labels, block, rest, step)
                if found is None or found.chance >= likeliest:
                    continue
                has = f"the {found.word} of {some.below if found.at < rest[0] else some.above}"
                if found.chance < UNLIKELY:
                    raise rows[found.at].wrong(
                        columns[0],
                        "totals",
                        f"a {what}, but this row has {has}; delete it, or, if it is a {what}, move it into the "
                        "middle",
                    )
                if found.word not in _COMMON:
                    continue
                likeliest = found.chance
                said = f"Row {rows[found.at].row} has {has} and is counted as a {what}: delete it if it is none."
    return said


def _total(
    rows: Sequence[Row], columns: Sequence[str], values: Array, labels: NDArray[np.str_], block: NDArray[np.intp],
    rest: NDArray[np.intp], step: float,
) -> _Total | None:  # fmt: skip
    """Return the row of a block that is most surely a statistic of the rest."""
    others, measured = values[rest], values[rest, 0]
    largest, whole = np.abs(others).max(axis=0), (others == np.round(others)).all(axis=0)
    centre, sd = float(measured.mean()), float(measured.std())
    found: _Total | None = None
    for statistic in STATISTICS:
        total = float(statistic.of(measured))
        for at in np.flatnonzero(np.abs(values[block, 0] - total) <= _ROUGHLY + ROUNDED * largest[0]):
            row, value = rows[block[at]], values[block[at]]
            in_whole = np.array([not decimals_of(row, column) for column in columns])
            half = np.array([half_digit(row, column) for column in columns])
            within = np.maximum(np.where(in_whole & whole, 0.0, half), _SAME * np.maximum(largest, np.abs(value)))
            if abs(value[0] - total) > max(within[0], half[0]):
                continue
            beside = np.delete(values[block, 1:], at, axis=0)
            if not _is_taken(others[:, 1:], value[1:]) and _is_within_a_group(values[:, 1:], labels, block[at]):
                continue
            if _is_taken(np.vstack([beside, others[:, 1:]]), value[1:]) and (
                _is_taken(beside, value[1:]) or _begins_a_group(labels[block[at]], labels[rest])
            ):
                continue
            place = _chance_of_place(others[:, 1:], value[1:], within[1:], statistic, block[at] < rest[0], beside)
            density = max(2 * within[0], step) / (SQRT_TAU * sd) / (1 + ((value[0] - centre) / sd) ** 2)
            equal = int(np.count_nonzero(np.abs(measured - value[0]) <= within[0]))
            ties = max(0, equal - (statistic.word in _ONE_OF_THEM)) / len(rest)
            tried = _TRIED * (1 if statistic.word in _COMMON else _RARE) * len(block) ** 2
            chance = max(min(1.0, tried * (density + ties)) * place, _WHOLE * (abs(value[0] - total) > within[0]))
            if place < 1 and (found is None or chance < found.chance):
                found = _Total(int(block[at]), statistic.word, chance)
        if found is not None and found.chance < UNLIKELY:
            return found
    return found


_SAME, _ROUGHLY, _UNEVEN, _OFF_STEP = 1e-6, 0.51, 0.1, 0.02
_COMMON = ("sum", "mean", "median")
_RARE = 5  # fewer tables have rows of these, and there are more of them
_ONE_OF_THEM = ("median", "minimum", "maximum")


def _begins_a_group(label: str, others: NDArray[np.str_]) -> bool:
    """Return whether a row is of a group of its own, and its label is not the mean and the like of the others."""
    if label in others:
        return False
    try:
        number, numbers = float(label), others.astype(float)
    except ValueError:
        return True
    return not any(abs(float(one.of(numbers)) - number) <= ROUNDED * abs(number) for one in STATISTICS)


def _is_within_a_group(places: Array, labels: NDArray[np.str_], at: int) -> bool:
    """Return whether the place of a row is that of a row of another group, and not its first or last."""
    same = (np.abs(places - places[at]) < _SAME).all(axis=1) & (labels != labels[at])
    ends = [np.flatnonzero(labels == label)[[0, -1]] for label in dict.fromkeys(labels[same].tolist())]
    return not np.isin(np.flatnonzero(same), ends).all()


def _is_taken(others: Array, place: Array) -> bool:
    return bool((np.abs(others - place) < _SAME).all(axis=1).any())


def _chance_of_place(
    others: Array, place: Array, within: Array, statistic: Statistic, before: bool, beside: Array
) -> float:
    """Return the chance that the first or last measurement has such a place (k,) beside the others (n, k).

    `beside` (m, k) are those of the other rows of the block.
    """
    varied = np.flatnonzero(np.ptp(others, axis=0) > 0)
    repeated, taken = len(np.unique(others, axis=0)) < len(others), _is_taken(others, place)
    if not len(varied) or (repeated and taken):
        return 1.0
    fits, onward, chance = False, -1.0, _TAKEN if taken else _ODD if repeated else 1.0
    if len(varied) == 1:
        along, at = others[:, varied[0]], float(place[varied[0]])
        fits = not taken and _is_regular([*along, at, *beside[:, varied[0]]])
        sign = -1 if along[-1] < along[0] else 1
        ordered = bool((sign * np.diff(along) >= 0).all())
        onward = sign * (along[0] - at if before else at - along[-1]) if ordered else -1.0
        chance = min(1.0 if fits else chance, _ODD if ordered and onward < 0 else 1.0)
    if chance < 1 and not place[varied].any():
        chance *= _ZERO
    if fits:
        return chance
    centre, sd = others[:, varied].mean(axis=0), others[:, varied].std(axis=0)
    widths = 2 * np.maximum(within[varied], 0.5 * np.array([value_step(others[:, one]) for one in varied]))
    steps = np.minimum(1.0, widths / (SQRT_TAU * sd) / (1 + ((place[varied] - centre) / sd) ** 2))
    any_other = STATISTICS if onward < 0 else ()
    for of, tried in ((statistic, 1), *((one, _TRIED) for one in any_other if one.of_places)):
        if (np.abs(of.of(others[:, varied]) - place[varied]) <= within[varied]).all():
            return chance * min(1.0, tried * float(np.prod(steps)))
    return chance


def _is_regular(places: Sequence[float]) -> bool:
    gaps = np.diff(np.unique(places))
    return float(np.ptp(gaps)) <= _UNEVEN * float(gaps.mean())


def value_step(values: Array) -> float:
    """Return the step of which all differences of some values are multiples, as of counts in a window; 0 for none."""
    gaps = np.diff(np.unique(values))
    for parts in _PARTS if len(gaps) else ():
        steps = gaps * parts / gaps.min()
        if (np.abs(steps - np.round(steps)) < _OFF_STEP * parts).all():
            return float(gaps.min()) / parts
    return 0.0


_PARTS = (1, 2, 3, 4, 5)  # of the smallest difference


def decimals_of(row: Row, name: str) -> int:
    """Return the number of decimals of a cell's value: none of 39.0."""
    return max(0, -int(Decimal(f"{row.in_file(name):.12g}").normalize().as_tuple().exponent))


def half_digit(row: Row, name: str) -> float:
    """Return half of the last digit of a cell's value, in the program's unit."""
    return float(0.51 * 10.0 ** -decimals_of(row, name) * row.columns[name].factor)


def refuse_nines(rows: Sequence[Row], *names: str) -> None:
    """Refuse a number such as 999 that is far from all others of its column, as it means that there is no value."""
    for name in names:
        nines = _NINES if column_kind(name).units is LENGTH else _MORE_NINES
        first = {row.in_file(name): row for row in reversed(rows)}
        for value, row in first.items():
            if not nines.fullmatch(f"{abs(value):.12g}"):
                continue
            largest = max((abs(other) for other in first if other != value), default=math.inf)
            if abs(value) > _FAR_FROM * largest:
                raise row.wrong(
                    name,
                    "no_number",
                    f"a measured number: no other is beyond {largest:.6g}, and many tables have such a number for no "
                    "data; delete the row, or correct it",
                )


_NINES, _MORE_NINES = re.compile(r"9{2,}(\.9+)?"), re.compile(r"9{3,}(\.9+)?")
_FAR_FROM = 3.0
