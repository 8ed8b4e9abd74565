"""Rates, or counts of spikes, against position, from a user's table.

Columns `position_mm,rate[,sd][,repeat]` or `position_mm,count,window_s[,repeat]`, by these names or as `--columns`
says: the indentor's reference point from the receptive field's center in the finger's frame, and the discharge rate
(any unit, ≥ 0) or the spikes that were counted in a window. Rows of one position need a `repeat`.

`CHECKS` are the questions that are asked of all presses of a table, in order; a new one is a function there.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import LEAST_PROFILE_MM, is_own_unit
from rig.compare.recordings.columns import ColumnMap, RecordingColumn, role_name, stated_unit
from rig.compare.recordings.number_cells import label_key
from rig.compare.recordings.recording import (
    SAME_PLACE_DECIMALS,
    Recording,
    recording,
    refuse_impossible_rate,
    with_enough_positions,
)
from rig.compare.recordings.table import (
    COLUMNS_HINT,
    Row,
    columns_read,
    has_column,
    header_of,
    no_rows,
    read_table,
)
from rig.compare.recordings.table_cells import SameInAllRows
from rig.compare.recordings.totals import refuse_nines, refuse_summary_rows
from rig_shared.summary_rows import is_summary, summary_row

Roles = tuple[tuple[str, ...], tuple[str, ...]]

RATES: Roles = (("position", "rate"), ("sd", "repeat"))
COUNTS: Roles = (("position", "count", "window"), ("repeat",))
"""Roles of required and of optional columns."""
_POSITION, _REPEAT, _WINDOW = map(role_name, ("position", "repeat", "window"))
_MOST_LISTED = 20


class TablePress(NamedTuple):
    """A row of a table: its position (mm), rounded to those that count as one, its repeat, and its rate or count."""

    row: Row
    position_mm: float
    repeat: str
    measured: str
    """Name of the column of the rate or count."""

    @property
    def value(self) -> float:
        """The rate (1/s) or count."""
        return self.row.number(self.measured)


TablePresses = Sequence[TablePress]


def holds_counts(header: Sequence[str], columns: ColumnMap) -> bool:
    """Return whether a table has counts instead of rates, by its header."""
    return "rate" not in columns.named and ("count" in columns.named or has_column(header, "count", {}))


def read_srp(path: Path, columns: ColumnMap | None = None) -> Recording:
    """Read a table of rates or of counts. Raises RecordingError with row (the header is 1) and column."""
    columns = columns or ColumnMap()
    counted = holds_counts(header_of(path), columns)
    required, optional = COUNTS if counted else RATES
    in_table = [role for role in required if role != "window" or columns.window_s is None]
    rows = read_table(path, *columns.split(in_table, optional), given=columns.by_name, hint=COLUMNS_HINT)
    presses = [
        TablePress(row, round(row.number(_POSITION), SAME_PLACE_DECIMALS) + 0.0, row.cells.get(_REPEAT, ""),
              "count" if counted else "rate") for row in rows
    ]  # fmt: skip
    sentences = [check(presses) for check in REPEAT_CHECKS]
    found = _counts(path, presses, columns) if counted else _rates(path, presses)
    sentences += [check(presses) for check in CHECKS if presses]
    read_as = " ".join(filter(None, [columns_read(rows, columns.window_s if counted else None), *sentences]))
    changes = [*columns.changes(*required, *optional), *_header_changes(rows, (*required, *optional))]
    highest = f"row {max(presses, key=lambda one: one.value).row.row}" if presses else ""
    found = replace(
        found,
        changes=tuple(dict.fromkeys(changes)),
        read_as=read_as,
        highest_in=highest,
        rows_text=_in_words(presses),
    )
    found = with_enough_positions(path, found)
    refuse_impossible_rate(path, found)
    _refuse_narrow_profile(path, found, rows[0].columns[_POSITION])
    return found


def _in_words(presses: TablePresses) -> str:
    """Return the first and the last row of a table, and the sum, so that a row that is no press is seen."""
    if not presses:
        return ""
    unit = "" if presses[0].measured == "count" else f" {presses[0].row.columns['rate'].unit or '1/s'}"
    ends = [f"row {one.row.row} has {one.row.in_file(one.measured):.6g}{unit} at {one.position_mm:g} mm"
            for one in (presses[0], presses[-1])]  # fmt: skip
    total = sum(one.row.in_file(one.measured) for one in presses)
    return f"{' and '.join(ends)} (first and last row); the sum of all is {total:.6g}{unit}."


def _header_changes(rows: Sequence[Row], roles: Sequence[str]) -> list[str]:
    """Return notes on the roles that were converted from the units of a header, for captions."""
    columns = rows[0].columns if rows else {}
    each = [(role, columns.get(role_name(role))) for role in roles]
    return [f"{role} from {column.unit}" for role, column in each if column is not None and column.changed]


def _refuse_narrow_profile(path: Path, found: Recording, position: RecordingColumn) -> None:
    span_mm = float(np.ptp(found.position_mm))
    if span_mm < LEAST_PROFILE_MM:
        likely = "mm" if span_mm / position.factor >= LEAST_PROFILE_MM else "m"
        raise RecordingError(
            f"{path}, column {position.name}: all positions lie within {span_mm:g} mm, at least "
            f"{LEAST_PROFILE_MM:g} mm are required; if the unit is another, state it: "
            f"{stated_unit(_POSITION, position.name, likely)}",
            "beyond_a_finger",
        )


def _rates(path: Path, presses: TablePresses) -> Recording:
    _refuse_unclear_sd(path, presses)
    rows = [(one.position_mm, one.row.number("rate", 0.0), _sd(one.row)) for one in presses]
    unit = presses[0].row.columns["rate"].unit if presses else ""
    found = recording(path.name, rows)
    return replace(found, rate_unit=unit) if is_own_unit(unit) else found


_NO_SD = "; fill it in, or delete the column"


def _refuse_unclear_sd(path: Path, presses: TablePresses) -> None:
    """Refuse an sd that some rows lack, and one beside repeats, which have their own: it would not count."""
    stated = [one.row for one in presses if one.row.cells.get("sd")]
    for one in presses if stated else []:
        if not one.row.cells["sd"]:
            raise one.row.wrong("sd", "no_number", "a number of 0 or more, since other rows have an sd" + _NO_SD)
    if stated and len({one.position_mm for one in presses}) < len(presses):
        raise RecordingError(
            f"{path}, column {stated[0].columns['sd'].name}: an sd cannot be stated beside repeats, over which it "
            "is computed; delete the column, or keep one row of each position, with the mean and its sd",
            "sd_and_repeats",
        )


def _sd(row: Row) -> float:
    """Return the sd of a row, NaN without one; an sd without a unit has that of the rates. Raises RecordingError."""
    if not row.cells.get("sd"):
        return math.nan
    unit, of_rates = row.columns["sd"].unit, row.columns["rate"].unit
    if unit and (is_own_unit(unit) or is_own_unit(of_rates)) and unit.casefold() != of_rates.casefold():
        raise row.wrong("sd", "other_unit", f"in the unit of the rates, not in {unit}; convert it")
    sd = row.number("sd", 0.0, no_data=_NO_SD)
    return sd if unit else sd * row.columns["rate"].factor


def _counts(path: Path, presses: TablePresses, columns: ColumnMap) -> Recording:
    window_s = columns.window_s or _one_window(path, presses)
    rows = []
    for one in presses:
        count = one.row.number("count", least=0.0)
        if count != round(count):
            raise one.row.wrong("count", "not_whole", "a whole number")
        rows.append((one.position_mm, count / window_s, math.nan))
    return recording(path.name, rows, window_s)


def _one_window(path: Path, presses: TablePresses) -> float:
    """Return the window (s), which must be the same in all rows, since one noise model applies to all rates."""
    found = [(one.row, one.row.number(_WINDOW)) for one in presses]
    for row, seconds in found:
        if seconds <= 0:
            raise row.wrong(_WINDOW, "not_above_0", "a number above 0")
        if seconds != found[0][1]:
            raise row.wrong(_WINDOW, "another_window", f"the window of all rows, {found[0][0].cells[_WINDOW]}")
    if not found:
        raise no_rows(path, "counts")
    return found[0][1]


def _unclear_repeats(presses: TablePresses) -> str:
    """Refuse a repeat that is empty, that means a summary, or that is no number, or has none, as others are or do."""
    labels = [one.repeat for one in presses]
    keys = {label: label_key(label) for label in labels}

    def is_number(label: str) -> bool:
        return isinstance(keys[label], float)

    def is_whole(label: str) -> bool:
        return is_number(label) and float(keys[label]).is_integer()

    def has_digit(label: str) -> bool:
        return any(map(str.isdigit, label))

    rules: list[tuple[bool, Callable[[str], bool], str]] = [
        (any(labels), lambda label: label != "" and not is_summary(label),
         "the number or name of a press at this position"),
        (any(map(is_number, labels)), is_number, "a number, as others are"),
        (any(map(is_whole, labels)), lambda label: is_whole(label) or not is_number(label),
         "a whole number, as others are"),
        (any(map(has_digit, labels)), has_digit, "a name with a number, as others are"),
    ]  # fmt: skip
    for applies, fits, expected in rules:
        for one in presses if applies else ():
            if not fits(one.repeat):
                problem = f"{expected}; delete rows with sums, means and the like"
                raise one.row.wrong(_REPEAT, "no_repeat", problem)
    names = [label for label in dict.fromkeys(labels) if label and not is_number(label)]
    if not names:
        return ""
    more = f" and {len(names) - _MOST_LISTED} more" * (len(names) > _MOST_LISTED)
    are = "The repeat {} is counted as a press" if len(names) == 1 else "The repeats {} are counted as presses"
    return f"{are.format(', '.join(names[:_MOST_LISTED]) + more)}: delete rows of sums and means."


def _place_twice(presses: TablePresses) -> str:
    """Refuse a position that occurs twice in the same repeat."""
    seen: dict[tuple[float, str | float], Row] = {}
    for one in presses:
        row, place = one.row, (one.position_mm, label_key(one.repeat))
        if place in seen:
            raise RecordingError(
                f"{row.path}, row {row.row}, column {row.columns[_POSITION].name}: position {row.cells[_POSITION]} "
                f"is repeated (first in row {seen[place].row}); {_how_to_number(one)}",
                "place_twice",
            )
        seen[place] = row
    return ""


def _how_to_number(press: TablePress) -> str:
    """Return how to tell repeated presses apart, and why a column of repeats that is there does not."""
    if _REPEAT not in press.row.columns:
        return f"number repeated presses in a column {_REPEAT}"
    column = press.row.columns[_REPEAT].name
    if isinstance(press.repeat, SameInAllRows):
        return (
            f"the column {column} is there, but has one value for all rows, {press.repeat!r}: it must be a vector, a "
            "column of letters (N × 1) or a cell array, with a number for each row"
        )
    return f"both have {press.repeat!r} in the column {column}: give each press at one position a number of its own"


def _nines(presses: TablePresses) -> str:
    refuse_nines([one.row for one in presses], presses[0].measured, _POSITION)
    return ""


def _summary_rows(presses: TablePresses) -> str:
    return refuse_summary_rows([one.row for one in presses], presses[0].measured, [_POSITION], "press", _REPEAT)


def _summary_repeat(presses: TablePresses) -> str:
    """Refuse a first or last repeat that has what the others are together at every position."""
    at, labels = ({value: k for k, value in enumerate(dict.fromkeys(some))} for some in (
        [one.position_mm for one in presses], [one.repeat for one in presses]))  # fmt: skip
    if len(at) < _FEWEST_PLACES:
        return ""
    rates = np.full((len(labels), len(at)), np.nan)
    for one in presses:
        rates[labels[one.repeat], at[one.position_mm]] = float(f"{one.row.in_file(one.measured):.12g}")
    found = summary_row(rates, fewest=_FEWEST_REPEATS)
    if found is None or not found.sure:
        return ""
    label, places = list(labels)[found.row], int(np.isfinite(rates[found.row]).sum())
    row = next(one.row for one in presses if one.repeat == label)
    raise row.wrong(
        _REPEAT,
        "totals",
        f"a press, but it has the {found.word} of the other repeats at each of {places} positions; delete its rows",
    )


_FEWEST_REPEATS, _FEWEST_PLACES = 2, 4  # three presses of few spikes may be one another's mean by chance


def _close_positions(presses: TablePresses) -> str:
    """Return a sentence on positions that are nearly equal. Raises RecordingError if they are of several repeats."""
    placed = sorted(presses, key=lambda one: one.position_mm)
    close = [pair for pair in pairwise(placed)
             if _TICK_MM < pair[1].position_mm - pair[0].position_mm < _NEAR_MM - _TICK_MM]  # fmt: skip
    for one, other in close:
        if label_key(one.repeat) != label_key(other.repeat):
            raise other.row.wrong(
                _POSITION,
                "close_positions",
                f"the position of row {one.row.row}, {one.row.cells[_POSITION]}, or {_NEAR_MM:g} mm or more from it: "
                "presses at one position are repeats only if it is the same number; round the positions",
            )
    if not close:
        return ""
    one, other = close[0]
    return (
        f"The positions {one.position_mm:g} and {other.position_mm:g} mm lie within {_NEAR_MM:g} mm of one another "
        "and count as two; if they are one, round them and number the presses in a column repeat."
    )


_NEAR_MM, _TICK_MM = 0.01, 1e-6  # closer positions may be one, read from a stage

REPEAT_CHECKS = (_unclear_repeats, _place_twice)
"""Questions that come before the rates or counts are read, since a row of means need not have one."""
CHECKS = (_nines, _close_positions, _summary_rows, _summary_repeat)
"""Questions about all presses of a table: a sentence for the page, "" for none; or RecordingError."""
