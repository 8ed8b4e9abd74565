"""Numbers that are no measurements: rows that sum up the others, and 999 for no data."""

import math
import re
from collections.abc import Sequence

import numpy as np

from rig.compare.recordings.column_units import LENGTH, column_kind
from rig.compare.recordings.table import Row
from rig_shared.summary_rows import summary_row


def refuse_summary_rows(rows: Sequence[Row], measured: str, places: Sequence[str], what: str, group: str = "") -> str:
    """Refuse a first or last row that is the sum, mean and the like of the others, or of its group.

    `what` is a row in words, `group` a column whose cells tell groups apart. Return a sentence on a row that has the
    sum or mean of the others to so few digits that it may be a measurement.
    """
    values = np.array([[_as_written(row, name) for name in (measured, *places)] for row in rows])
    said = ""
    for at, others in _groups(rows, group):
        found = summary_row(values[at, :1], values[at, 1:])
        if found is None:
            continue
        row = rows[at[found.row]]
        has = f"the {found.word} of the {others or ('rows above' if found.row else 'rows below')}"
        if found.sure:
            raise row.wrong(
                measured,
                "totals",
                f"a {what}, but this row has {has}; delete it, or, if it is a {what}, move it into the middle",
            )
        said = said or f"Row {row.row} has {has} and is counted as a {what}: delete it if it is not one."
    return said


def _groups(rows: Sequence[Row], group: str) -> list[tuple[list[int], str]]:
    """Return the numbers of all rows, and of those of each group, with the words for its others."""
    labeled: dict[str, list[int]] = {}
    for k, row in enumerate(rows):
        labeled.setdefault(row.cells.get(group, ""), []).append(k)
    every = [(list(range(len(rows))), "")]
    if len(labeled) > 1:
        every += [(at, f"other rows of {rows[0].columns[group].name} {label}") for label, at in labeled.items()]
    return every


def _as_written(row: Row, name: str) -> float:
    return float(f"{row.in_file(name):.12g}")


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
