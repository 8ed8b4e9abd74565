"""Rows that are no measurements: sums, means and the like, by their labels and by their numbers."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import Row

Array = NDArray[np.float64]

ROUNDED = 1e-3
"""Share by which a mean in a table may be rounded."""

_SUMMARIES = (
    "all", "overall", "sd", "std", "se", "sem", "min", "max", "minimum", "maximum", "var", "count", "range", "ci",
    "cv", "iqr",
)  # fmt: skip
_LEVELS = {"all", "min", "max", "minimum", "maximum"}
"""Words that may be those of conditions."""
_NO_WORD = re.compile(r"[^\w%=.]+|_")
_SUMMARY_WORD = re.compile(
    r"(?<![^\W\d_])(means?|avg|averages?|medians?|sums?|totals?|pooled|mittel(?:wert)?|durchschnitt|summe|gesamt"
    r"|moyennes?|sommes?|promedio|media|suma|somma|totale|variances?|varianz|std ?dev|std|sem"
    r"|standard (?:deviation|error)|quantiles?|percentiles?|quartiles?|confidence|populations?|grand)(?![^\W\d_])"
    r"|\bn\s*=\s*\d|\b\d+(?:\.\d+)?\s*%"
)


def is_summary(label: str) -> bool:
    """Return whether the label of a repeat is that of a row of sums, means and the like, such as "mean (n=2)"."""
    return label.casefold() in _SUMMARIES or _SUMMARY_WORD.search(label.casefold()) is not None


def refuse_summary_labels(rows: Sequence[Row]) -> None:
    """Refuse a row that a column which is not read calls a sum, a mean and the like, as an index of pandas does."""
    for name in rows[0].unread if rows else ():
        labels = [" ".join(_NO_WORD.sub(" ", row.unread[name].casefold()).split()) for row in rows]
        found = [n for n, label in enumerate(labels) if label and all(map(_is_summary_word, label.split()))]
        if len(found) == len(rows) or {labels[n] for n in found} <= _LEVELS:
            continue
        row = rows[found[0]]
        raise RecordingError(
            f"{row.path}, row {row.row}, column {name or 'without a name'}: {row.unread[name]!r} must be the "
            "label of a measurement; delete rows with sums, means and the like",
            "totals",
        )


def _is_summary_word(word: str) -> bool:
    return word in _SUMMARIES or _SUMMARY_WORD.fullmatch(word) is not None


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
            tolerances = [[_half_a_digit(row, column) for column in columns] for row in rows[block]]
            tolerance = np.maximum(ROUNDED * np.abs(table).max(axis=0), tolerances)
            for words, of in _TOTALS.items():
                near = (np.abs(values[block] - of(table)) <= tolerance).all(axis=1)
                if near.any():
                    where = "above" if at else "below"
                    raise rows[at + int(near.argmax())].wrong(
                        columns[0],
                        "totals",
                        f"a {what}, but this row has the {words} of the rows {where}; delete it, or, if it is a "
                        f"{what}, move it into the middle",
                    )


def _half_a_digit(row: Row, name: str) -> float:
    """Return by how much a number may be rounded, in the program's unit; 0 for a whole one."""
    decimals = decimals_of(row, name)
    return 0.51 * 10.0**-decimals * row.columns[name].factor if decimals else 0.0


def decimals_of(row: Row, name: str) -> int:
    """Return the number of decimals of a cell's value: none of 39.0."""
    in_file = row.number(name) / row.columns[name].factor
    return max(0, -int(Decimal(f"{in_file:.12g}").normalize().as_tuple().exponent))


_TOTALS: Mapping[str, Callable[[Array], Array]] = {
    "sums": lambda table: table.sum(axis=0),
    "means": lambda table: table.mean(axis=0),
    "sds": lambda table: table.std(axis=0, ddof=1),
    "sds (of n)": lambda table: table.std(axis=0),
    "standard errors": lambda table: table.std(axis=0, ddof=1) / math.sqrt(len(table)),
    "variances": lambda table: table.var(axis=0, ddof=1),
}
_MOST_TOTALS = 8  # rows that pandas' describe() gives
