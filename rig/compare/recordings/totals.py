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

    `of_rows`: a row of a table that has it in all columns is no measurement. `of_repeats`: nor is a repeat that has
    it at all positions. `exact`: no press equals it by chance, unless it is rounded to a whole number.
    """

    word: str
    of: Callable[[Array], Array]
    of_rows: bool = False
    of_repeats: bool = True
    exact: bool = False


def _sd(values: Array) -> Array:
    return np.asarray(values.std(axis=0, ddof=1))


STATISTICS = (
    Statistic("sum", lambda values: values.sum(axis=0), of_rows=True, exact=True),
    Statistic("mean", lambda values: values.mean(axis=0), of_rows=True, exact=True),
    Statistic("rounded mean", lambda values: values.mean(axis=0)),
    Statistic("median", lambda values: np.median(values, axis=0)),
    Statistic("minimum", lambda values: values.min(axis=0)),
    Statistic("maximum", lambda values: values.max(axis=0)),
    Statistic("sd", _sd, of_rows=True),
    Statistic("sd (of n)", lambda values: values.std(axis=0), of_rows=True),
    Statistic("standard error", lambda values: _sd(values) / math.sqrt(len(values)), of_rows=True),
    Statistic("variance", lambda values: values.var(axis=0, ddof=1), of_rows=True, of_repeats=False),
)
ROUNDED = 1e-3
"""Share by which a mean in a table may be rounded."""
_MOST_TOTALS = 8  # rows that pandas' describe() gives


def refuse_total_rows(rows: Sequence[Row], columns: Sequence[str], values: Array, what: str, fewest: int = 3) -> None:
    """Refuse one of the first or last rows whose numbers are all the sums, means and the like of the other rows.

    values (n, k) are those of k columns in n rows, `what` is a row in words, `fewest` the others that can show it.
    """
    for beside in range(1, min(_MOST_TOTALS, len(rows) - fewest) + 1):
        for block, others in ((slice(-beside, None), slice(-beside)), (slice(beside), slice(beside, None))):
            table = values[others]
            if np.ptp(table[:, 0]) == 0:
                continue
            at = block.indices(len(rows))[0]
            digits = [[half_digit(row, column) if decimals_of(row, column) else 0.0 for column in columns]
                      for row in rows[block]]  # fmt: skip
            tolerance = np.maximum(ROUNDED * np.abs(table).max(axis=0), digits)
            for statistic in (one for one in STATISTICS if one.of_rows):
                near = (np.abs(values[block] - statistic.of(table)) <= tolerance).all(axis=1)
                if near.any():
                    where = "above" if at else "below"
                    raise rows[at + int(near.argmax())].wrong(
                        columns[0],
                        "totals",
                        f"a {what}, but this row has the {statistic.word} of the rows {where}; delete it, or, if it "
                        f"is a {what}, move it into the middle",
                    )


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
