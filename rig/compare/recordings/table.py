"""A user's table: its header, read as the program's columns with their units, and the numbers in its cells."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import (
    ROLES,
    column_kind,
    header_name,
    is_own_unit,
    means,
    names_a_rate,
    same_name,
)
from rig.compare.recordings.columns import RecordingColumn, role_name, stated_unit
from rig.compare.recordings.number_cells import NumberFormat, number_format, without_separators
from rig.compare.recordings.table_cells import (
    SameInAllRows,
    refuse_not_understood,
    table_cells,
)
from rig_shared.summary_rows import labeled_summary

COLUMNS_HINT = (
    "; name yours with --columns, e.g. position=COLUMN:um,rate=COLUMN:Hz, or time=COLUMN:ms for spike times"
)
"""Advice on a wrong header of a recording."""
LEAVE_EMPTY = "; leave the cell empty if it has no value"
"""What to do with a cell without a number in a column that need not have one."""
_NO_DATA = ("", "nan", "na", "n/a", "-")
_SHOWN_AS = re.compile(r"(?P<number>\S+) \(shown as (?P<unit>.+) in Excel\)")
_MOST_LISTED = 20


@dataclass(frozen=True, slots=True)
class Row:
    """Cells of a row by the program's names of their columns, and its location.

    `columns` are the columns in the file, with their units; `format` is that of the numbers of the table, and
    `comments` a sentence on comments in it.
    """

    path: Path
    row: int  # the header is 1
    cells: Mapping[str, str]
    columns: Mapping[str, RecordingColumn]
    format: NumberFormat
    unread: Mapping[str, str] = field(default_factory=dict)
    """Cells of the columns that are not read, by their names in the file."""
    comments: str = ""

    def number(self, column: str, least: float = -math.inf, *, no_data: str = "; delete rows without data") -> float:
        """Return the cell as a finite number of at least `least`, in the program's unit. Raises RecordingError.

        `no_data`: what to do about a cell such as "n/a".
        """
        text, in_file = self.cells[column], self.columns[column]
        if self.format.could_be_thousands(column, text):
            raise self.wrong(
                column,
                "ambiguous_number",
                f"written without a thousands separator, as {without_separators(text)}, or, if the separator is the "
                "decimal sign, with a point and other than three decimals",
            )
        of = column_kind(column).units
        if shown := _SHOWN_AS.fullmatch(text):
            own = is_own_unit(shown["unit"]) == is_own_unit(in_file.unit)
            text = shown["number"] if own and of.known(shown["unit"]) == in_file.factor else text
        value = self.format.number(text)
        if not value >= least:
            bounded, mixed = least > -math.inf, bool(self.format.comma) and "." in text
            expected = "a number" + f" of {least:g} or more" * bounded
            expected += f" with a decimal comma, as {self.format.comma!r}, or that cell with a point" * mixed
            expected += no_data * (text.casefold() in _NO_DATA)
            if shown is not None:
                expected += " in a cell format without a unit, or with that of the header"
            elif text.endswith(" in Excel)"):
                expected += " in the cell format General; correct it there, e.g. to the unit of the header"
            raise self.wrong(column, "no_number", expected)
        number = in_file.factor * value
        if abs(number) > of.most and not is_own_unit(in_file.unit):
            likely = of.usual if abs(value * (of.known(of.usual) or math.inf)) <= of.most else of.likely
            raise self.wrong(
                column,
                "beyond_a_finger",
                f"at most {of.most:g} {of.usual}; if its unit is another, state it: "
                f"{stated_unit(column, in_file.name, likely)}",
            )
        return number

    def in_file(self, column: str) -> float:
        """Return the number of a cell in the unit of the file."""
        return self.number(column) / self.columns[column].factor

    def wrong(self, column: str, code: str, expected: str) -> RecordingError:
        """Return an error for a cell, which must be what is `expected`."""
        where = f"{self.path}, row {self.row}, column {self.columns[column].name}"
        return RecordingError(f"{where}: {self.cells[column]!r} must be {expected}", code)


def columns_read(rows: Sequence[Row], window_s: float | None = None) -> str:
    """Return which columns of a table were read, in which units, and which were not.

    A column that is not read and has a few values, which differ between the repeats of one position, is named: it
    may have conditions.
    """
    if not rows:
        return ""
    parts = []
    for name, column in rows[0].columns.items():
        kind = column_kind(name)
        role = kind.role or name
        unit = column.unit or (kind.units.usual if name != "sd" else "")
        parts.append(column.name + f" as {role}" * (role != column.name) + f" in {unit}" * bool(unit))
    parts += [] if window_s is None else [f"{window_s:g} s as window"]
    unread = [name for name in rows[0].unread if name]
    said = [f"Columns read: {', '.join(parts)}."]
    said += [f"Not read: {', '.join(unread[:_MOST_LISTED])}."] if unread else []
    mixed = [name for name in unread if _may_be_a_condition(rows, name)]
    said += [f"{mixed[0]} differs between presses at one position, which count as repeats."] if mixed else []
    return " ".join([*said, *filter(None, [rows[0].comments])])


def _may_be_a_condition(rows: Sequence[Row], name: str) -> bool:
    position = role_name("position")
    if position not in rows[0].cells:
        return False
    at: dict[str, set[str]] = {}
    for row in rows:
        at.setdefault(row.cells[position], set()).add(row.unread[name])
    return len(set().union(*at.values())) <= len(rows) // 2 and any(len(values) > 1 for values in at.values())


def read_table(
    path: Path,
    required: Sequence[str],
    optional: Sequence[str] = (),
    *,
    given: Mapping[str, RecordingColumn] | None = None,
    hint: str = "",
    on_wrong_row: Callable[[int, RecordingError], None] | None = None,
) -> list[Row]:
    """Return the rows below the header, which must have the required columns.

    Parameters
    ----------
    path : Path
        Table, separated by commas, semicolons or tabs. Empty rows are skipped, as are empty lines and lines that
        begin with # above the header.
    required, optional : sequence of str
        The program's names of the columns, e.g. "position_mm". The header may have them in other units and words,
        such as "Position (um)".
    given : mapping of str to RecordingColumn, optional
        Columns that the user names, by the program's names; further columns are then ignored.
    hint : str
        Advice that is appended to the error for a wrong header.
    on_wrong_row : callable, optional
        Receives the number of a row of another length, and the error, which is then not raised.

    Raises
    ------
    RecordingError
        If a column is missing, unknown, repeated, or in an unknown unit, if a row has another length, or if a column
        that is not read calls it a mean and the like.
    """
    first, header, lines, semicolons, comments = table_cells(path)
    columns = Header(path, first, header).columns(required, optional, given=given, hint=hint)
    at = {name: header.index(column.name) for name, column in columns.items()}
    found = list[tuple[int, dict[str, str], dict[str, str]]]()
    for number, cells in lines:
        if not any(cells):
            continue
        if len(cells) != len(header):
            wrong = f"{path}, row {number}: {len(cells)} cells, but the header has {len(header)}"
            if on_wrong_row is None:
                raise RecordingError(wrong, "cells_of_row")
            on_wrong_row(number, RecordingError(wrong, "cells_of_row"))
            continue
        for name, k in at.items() if not found else ():
            refuse_not_understood(path, columns[name].name, cells[k])
        unread = {name: cells[k] for k, name in enumerate(header) if k not in at.values()}
        read = {name: _same_name(cells[k]) if column_kind(name).is_label else cells[k] for name, k in at.items()}
        found.append((number, read, unread))
    numbers = number_format((cells for _, cells, _ in found), semicolons=semicolons)
    rows = [Row(path, number, cells, columns, numbers, unread, comments) for number, cells, unread in found]
    for name, cell in rows[0].cells.items() if rows else ():
        if isinstance(cell, SameInAllRows) and not column_kind(name).one_for_all:
            raise rows[0].wrong(name, "same_in_all_rows", "a vector with a number for each row, not a scalar")
    for name in rows[0].unread if rows else ():
        labeled = labeled_summary([row.unread[name] for row in rows])
        if labeled is not None:
            raise RecordingError(
                f"{path}, row {rows[labeled].row}, column {name or 'without a name'}: {rows[labeled].unread[name]!r} "
                "must be the label of a measurement; delete rows with sums, means and the like, or, if it is one, "
                "delete the column, which is not read",
                "totals",
            )
    return rows


def _same_name(cell: str) -> str:
    name = same_name(cell)
    return SameInAllRows(name) if isinstance(cell, SameInAllRows) else name


class Header(NamedTuple):
    """Names of the columns of a file, and their row."""

    path: Path
    row: int
    names: list[str]

    def columns(
        self,
        required: Sequence[str],
        optional: Sequence[str] = (),
        *,
        given: Mapping[str, RecordingColumn] | None = None,
        hint: str = "",
    ) -> dict[str, RecordingColumn]:
        """Return the columns by the program's names.

        Refuse a header without a required column, or with one that is repeated, or unknown (unless some are `given`).
        """
        given = given or {}
        found = {name: given[name] for name in (*required, *optional) if name in given}
        for name, column in found.items():
            if column.name in self.names:
                self._refuse_without_unit(name, column)
        taken = {column.name for column in found.values()}
        for name in (one for one in (*required, *optional) if one not in given):
            recognized = self._recognized(name, [one for one in self.names if one not in taken])
            if recognized is not None:
                found[name] = recognized
                taken.add(recognized.name)
        for name in required:
            if name not in found or found[name].name not in self.names:
                called = {one: given[one].name if one in given else one for one in required}
                raise self._missing(called[name], [*called.values()], optional, hint)
        for one in self.names:
            if self.names.count(one) > 1 and (one in taken or not given):
                raise self._extra(one, required, optional, "; delete or rename one of them")
            if one not in taken and not given:
                of_rows = _ROW_NAMES if not one else ""
                raise self._extra(one, required, optional, of_rows or _suggested(found, required, optional) or hint)
        return found

    def _recognized(self, name: str, names: Sequence[str]) -> RecordingColumn | None:
        """Return the column that has one of the program's names, in any unit, or None."""
        if name in names:
            return RecordingColumn(name)
        kind = column_kind(name)
        meant = {one: said for one in names if (said := header_name(one, kind.units)).words in kind.words}
        if not meant:
            return None
        cell, said = next(iter(meant.items()))
        if len(meant) > 1:
            remedy = f'--columns "{kind.role}={cell}"' if kind.role else f"call it {name}"
            listed = " and ".join(map(repr, meant))
            raise self._wrong("two_columns", f": the columns {listed} may both be {name}; name one: {remedy}")
        if said.factor is None:
            raise self._wrong(
                "unknown_unit",
                f", column {cell!r}: the unit {said.unit!r} is unknown; it must be one of "
                f"{', '.join(kind.units.listed)}: convert the numbers, or, if they are in one of these, "
                f"{_use(stated_unit(name, cell, 'UNIT'))}",
            )
        found = RecordingColumn(cell, said.unit, said.factor)
        if name != said.words:
            self._refuse_without_unit(name, found)
        return found

    def _refuse_without_unit(self, name: str, column: RecordingColumn) -> None:
        """Refuse a column whose unit is needed and is neither in its name nor stated; what means a rate is in 1/s."""
        of = column_kind(name).units
        if column.unit or not (of.needed or (name == "rate" and not names_a_rate(column.name))):
            return
        raise self._wrong(
            "no_unit",
            f", column {column.name!r}: states no unit that is known ({', '.join(of.listed)}); if it is {of.usual}, "
            f"{_use(stated_unit(name, column.name, of.usual))}",
        )

    def _missing(self, name: str, required: Sequence[str], optional: Sequence[str], hint: str) -> RecordingError:
        read = ", ".join(self.names[:_MOST_LISTED]) or "none"
        if len(self.names) == 1 and len(required) > 1 and self.path.suffix.lower() != ".mat":
            hint = "; lines above the names of the columns must begin with #" + hint
        numbers = [number_format([{"": one}]).number(one) for one in self.names]
        if numbers and not any(map(math.isnan, numbers)):
            return self._wrong(
                "no_header",
                f": has numbers ({read}) instead of the names of columns; add a line above it with the names, e.g. "
                f"{column_list(required, optional)}{hint}",
            )
        expected = f"expected {column_list(required, optional)}, read {read}"
        return self._wrong("no_column", f": the column {name} is missing; {expected}{hint}")

    def _extra(self, name: str, required: Sequence[str], optional: Sequence[str], remedy: str) -> RecordingError:
        listed = column_list(required, optional)
        problem = f": the column {name!r} is unknown or repeated; the columns are {listed}{remedy}"
        return self._wrong("extra_column", problem)

    def _wrong(self, code: str, problem: str) -> RecordingError:
        return RecordingError(f"{self.path}, row {self.row}{problem}", code)


_ROW_NAMES = "; if it has the names of rows, write it without them (in R: row.names = FALSE), or delete the column"


def _use(remedy: str) -> str:
    return f"use {remedy}" if remedy.startswith("-") else remedy


def _suggested(found: Mapping[str, RecordingColumn], required: Sequence[str], optional: Sequence[str]) -> str:
    """Return how to read a table whose further columns are unknown, if the others were recognized."""
    if not all(name in found and column_kind(name).role for name in required):
        return ""
    names = (name for name in (*required, *optional) if name in found)
    named = ",".join(f"{column_kind(name).role}={found[name].name}" for name in names)
    return (
        "; if it distinguishes conditions or rejected presses, first keep the rows of one of them in a file of "
        f'their own, since presses at one position count as repeats; to ignore it, use --columns "{named}"'
    )


def column_list(required: Sequence[str], optional: Sequence[str] = ()) -> str:
    """Return the columns as text, e.g. "position_mm,rate[,sd]"."""
    return ",".join(required) + "".join(f"[,{name}]" for name in optional)


def no_rows(path: Path, expected: str) -> RecordingError:
    """Return the error for a table without rows below the header."""
    return RecordingError(f"{path}: no rows below the header; the file must contain {expected}", "no_rows")


def has_column(header: Sequence[str], role: str, given: Mapping[str, RecordingColumn]) -> bool:
    """Return whether a header has a column that is given for a role, or is called by its name or means it."""
    kind = ROLES[role]
    if kind.name in given:
        return given[kind.name].name in header
    return kind.name in header or any(means(header_name(one, kind.units).words, kind.name) for one in header)


def header_of(path: Path) -> list[str]:
    """Return the names of the columns; an empty list for an empty file. Raises RecordingError."""
    return table_cells(path).header
