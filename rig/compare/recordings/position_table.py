"""Rates, or counts of spikes, against position, from a user's CSV.

Columns `position_mm,rate[,sd][,repeat]` or `position_mm,count,window_s[,repeat]`, by these names or as `--columns`
says: the indentor's reference point from the receptive field's centre in the finger's frame, and the discharge rate
(any unit, ≥ 0) or the spikes that were counted in a window. Rows of one position need a `repeat`.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rig.compare.errors import RecordingError
from rig.compare.recordings.column_map import Column, ColumnMap
from rig.compare.recordings.recorded import Recording, recording, with_enough_positions
from rig.compare.recordings.table_file import Row, header_of, no_rows, read_table

Roles = tuple[tuple[str, ...], tuple[str, ...]]

RATES: Roles = (("position", "rate"), ("sd", "repeat"))
COUNTS: Roles = (("position", "count", "window"), ("repeat",))
"""Roles of the columns that must be there, and of those that may."""


def holds_counts(path: Path, columns: ColumnMap) -> bool:
    """Whether a table has counts instead of rates."""
    return "rate" not in columns.given and ("count" in columns.given or columns["count"].name in header_of(path))


def read_srp(path: Path, columns: ColumnMap | None = None) -> Recording:
    """Read a table of either kind. Raises RecordingError, naming row (the header is 1) and column."""
    columns = columns or ColumnMap()
    counted = holds_counts(path, columns)
    required, optional = COUNTS if counted else RATES
    in_table = [role for role in required if role != "window" or columns.window_s is None]
    rows = read_table(path, *columns.split(in_table, optional), others=bool(columns.given))
    placed = list(_placed(rows, columns))
    found = _counts(path, placed, columns) if counted else _rates(path, placed, columns)
    return replace(with_enough_positions(path, found), changes=columns.changes(*required, *optional))


def _placed(rows: list[Row], columns: ColumnMap) -> Iterator[tuple[Row, float]]:
    """Rows and their positions in mm; the same place twice needs another repeat."""
    seen: dict[tuple[float, str], Row] = {}
    name, repeat = columns.names("position", "repeat")
    for row in rows:
        position = row.number(name)
        place = (position, row.cells.get(repeat, ""))
        if place in seen:
            raise RecordingError(
                "{path}, row {row}, column {column}: {position:g} again (first in row {first_row}), "
                "expected another value in a column {repeat}",
                code="place_twice",
                path=str(row.path),
                row=row.row,
                column=name,
                position=position,
                first_row=seen[place].row,
                repeat=repeat,
            )
        seen[place] = row
        yield row, columns["position"].factor * position


def _rates(path: Path, rows: list[tuple[Row, float]], columns: ColumnMap) -> Recording:
    rate, sd = columns["rate"], columns["sd"]
    read = [(place, rate.factor * row.number(rate.name, 0.0), _sd(row, sd)) for row, place in rows]
    return recording(path.name, read)


def _sd(row: Row, sd: Column) -> float:
    return sd.factor * row.number(sd.name, 0.0) if row.cells.get(sd.name) else math.nan


def _counts(path: Path, rows: list[tuple[Row, float]], columns: ColumnMap) -> Recording:
    window_s = columns.window_s or _one_window(path, rows, columns["window"])
    count = columns["count"].name
    read = [(place, _whole(row, count) / window_s, math.nan) for row, place in rows]
    return recording(path.name, read, window_s)


def _whole(row: Row, count: str) -> float:
    value = row.number(count, least=0.0)
    if value != round(value):
        raise row.wrong(count, "not_whole", "a whole number")
    return value


def _one_window(path: Path, rows: list[tuple[Row, float]], window: Column) -> float:
    """In s. Every count must be of the same window, since rates are compared by one noise."""
    found = [(row, window.factor * row.number(window.name)) for row, _ in rows]
    for row, seconds in found:
        if seconds <= 0:
            raise row.wrong(window.name, "not_above_0", "a number above 0")
        if seconds != found[0][1]:
            first = found[0][0].cells[window.name]
            raise row.wrong(window.name, "another_window", "the window of every row, {first}", first=first)
    if not found:
        raise no_rows(path, "counts")
    return found[0][1]
