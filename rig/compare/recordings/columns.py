"""Read a user's table: separators, decimal signs, and the roles and units of its columns."""

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import (
    COUNT,
    FORCE,
    LENGTH,
    MOST_HOLD_S,
    NONE,
    RATE,
    TIME,
    WINDOW,
    Dimension,
    contradicts,
    dimension_of,
    header_name,
    is_own_unit,
    means,
    names_a_rate,
    renamed,
    same_name,
)
from rig.compare.recordings.number_cells import NumberFormat, number_format, without_separators
from rig.compare.recordings.table_cells import (
    SameInAllRows,
    cell_comments,
    has_semicolons,
    refuse_not_understood,
    table_lines,
)
from rig_shared.number_text import read_number


class RecordingColumn(NamedTuple):
    """Column of a file, with its unit and the factor that converts its numbers to mm, s or 1/s."""

    name: str
    unit: str = ""
    factor: float = 1.0
    stated: bool = False
    """Whether the unit is stated after a colon."""

    @property
    def changed(self) -> bool:
        """Whether the numbers are converted."""
        return self.factor != 1.0


_ROLES = {
    "position": "position_mm",
    "rate": "rate",
    "sd": "sd",
    "repeat": "repeat",
    "count": "count",
    "window": "window_s",
    "time": "time_s",
    "kind": "kind",
    "unit": "unit",
    "sync": "sync_pulses",
    "observed": "obs_intervals",
    "segment": "segment",
}
"""Roles of --columns, and the program's own names of their columns."""


def role_name(role: str) -> str:
    """Return the program's own name for the column of a role, e.g. "position_mm"."""
    return _ROLES[role]


_THROUGHOUT = "throughout"


@dataclass(frozen=True)
class ColumnMap:
    """Columns that `--columns` names, by role; the other roles have the default names of docs/comparison.md.

    `window_s` is the window of the counts if it was given as a number instead of a column, else None.
    """

    named: Mapping[str, RecordingColumn] = field(default_factory=dict)
    window_s: float | None = None

    def __getitem__(self, role: str) -> RecordingColumn:
        """Return the column of a role."""
        return self.named.get(role, RecordingColumn(_ROLES[role]))

    @property
    def observed_throughout(self) -> bool:
        """Whether the user states that the unit was observed throughout the run."""
        return "observed" in self.named and self.named["observed"].name == _THROUGHOUT

    def names(self, *roles: str) -> list[str]:
        """Return the names of the columns of several roles."""
        return [self[role].name for role in roles]

    def split(self, required: Sequence[str], optional: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the program's names of required and optional columns; a column named by `--columns` is required."""
        asked = [role for role in optional if role in self.named]
        return [_ROLES[role] for role in (*required, *asked)], [
            _ROLES[role] for role in optional if role not in asked
        ]

    @property
    def by_name(self) -> dict[str, RecordingColumn]:
        """The columns that `--columns` names, by the program's own names."""
        return {_ROLES[role]: column for role, column in self.named.items()}

    def changes(self, *roles: str) -> tuple[str, ...]:
        """Return notes on the converted roles, for captions."""
        return tuple(f"{role} from {self[role].unit}" for role in roles if self[role].changed)


def column_map(texts: Sequence[str]) -> ColumnMap:
    """Parse the values of `--columns`, "ROLE=COLUMN[:UNIT],…". Raises RecordingError.

    Without a unit, the unit at the end of the column's name applies, as in "x (um)" or "x_um"; an sd without a unit
    has the unit of the rates.
    """
    given: dict[str, RecordingColumn] = {}
    for text in map(same_name, texts):
        for part in _roles_in(text):
            role, equals, name = (word.strip() for word in part.partition("="))
            if role not in _ROLES or not (equals and name):
                raise RecordingError(
                    f"--columns {part!r}: must be ROLE=COLUMN[:UNIT], with ROLE one of {', '.join(_ROLES)}", "no_role"
                )
            if role in given:
                raise RecordingError(
                    f"--columns {part!r}: the role {role} is given twice; give it once", "role_twice"
                )
            given[role] = _column(part, name, dimension_of(_ROLES[role]))
    _refuse_what_cannot_be(given)
    if "sd" in given and "rate" in given and not given["sd"].unit:
        given["sd"] = given["rate"]._replace(name=given["sd"].name)
    return ColumnMap(given, _stated_window(given))


def _roles_in(text: str) -> list[str]:
    """Split "position=x, left:mm,rate=FR" at the commas that are before a role."""
    parts: list[str] = []
    for part in text.split(","):
        if parts and "=" not in part:
            parts[-1] += f",{part}"
        else:
            parts.append(part)
    return parts


def _stated_window(given: dict[str, RecordingColumn]) -> float | None:
    """Return the window in s if it is a number instead of a column, else None. Raises RecordingError."""
    try:
        seconds = read_number(given["window"].name) * given["window"].factor
    except (KeyError, ValueError):
        return None
    if MOST_HOLD_S < seconds < math.inf:
        raise RecordingError(
            f"--columns window={given['window'].name}: at most {MOST_HOLD_S:g} s; if it is in ms, use "
            f"window={given['window'].name}:ms",
            "beyond_a_finger",
        )
    if not 0 < seconds < math.inf:
        raise RecordingError(
            f"--columns window={given['window'].name}: must be a number of seconds above 0", "window_not_above_0"
        )
    return seconds


def _refuse_what_cannot_be(given: Mapping[str, RecordingColumn]) -> None:
    names = [column.name for column in given.values()]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise RecordingError(f"--columns: the column {twice[0]!r} has two roles; give it one", "column_twice")
    if "count" in given and ("rate" in given or "sd" in given):
        raise RecordingError(
            "--columns: count cannot be combined with rate or sd; use counts with a window, or rates with an sd",
            "counts_and_rates",
        )


def _column(part: str, name: str, of: Dimension) -> RecordingColumn:
    before, colon, unit = name.rpartition(":")
    if colon:
        factor = of.known(unit) if of.listed and of is not COUNT else None
        if not before or factor is None:
            listed = of.listed and of is not COUNT
            expected = f"one of {', '.join(of.listed)}" if listed else "omitted for this role"
            if colon in before:
                expected += "; if the colon belongs to the name, add the unit after another one"
            raise RecordingError(f"--columns {part!r}: the unit {unit!r} must be {expected}", "unknown_unit")
        if named := contradicts(before.strip(), unit, of):
            raise RecordingError(
                f"--columns {part!r}: the column's name states {named}, the option {unit.strip()}; correct the "
                "wrong one",
                "two_units",
            )
        return RecordingColumn(before.strip(), unit.strip(), factor, True)
    said = header_name(name, of)
    if said.factor is None and of is not NONE:
        remedy = f"state it as {part.strip()}:UNIT"
        if contradicts(name, "", of):
            remedy = f"call the column {renamed(name, 'UNIT', of)!r}"
        raise RecordingError(
            f"--columns {part!r}: the unit {said.unit!r} is unknown; it must be one of {', '.join(of.listed)}: "
            f"convert the numbers, or, if they are in one of these, {remedy}",
            "unknown_unit",
        )
    return RecordingColumn(name, said.unit, said.factor or 1.0)


_SHOWN_AS = re.compile(r"(?P<number>\S+) \(shown as (?P<unit>.+) in Excel\)")
_MOST_LISTED = 20
_NO_DATA = ("", "nan", "na", "n/a", "-")
LEAVE_EMPTY = "; leave the cell empty if it has no value"
"""What to do with a cell without a number in a column that need not have one."""


@dataclass(frozen=True, slots=True)
class Row:
    """Cells of a row by the program's names of their columns, and its location.

    `columns` are the columns in the file, with their units; `format` is that of the numbers of the table.
    """

    path: Path
    row: int  # the header is 1
    cells: Mapping[str, str]
    columns: Mapping[str, RecordingColumn]
    format: NumberFormat
    unread: Mapping[str, str] = field(default_factory=dict)
    """Cells of the columns that are not read, by their names in the file."""

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
        if (shown := _SHOWN_AS.fullmatch(text)) and _is_unit_of(shown["unit"], column, in_file):
            text = shown["number"]
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
        return self._of_a_finger(column, in_file.factor * value)

    def _of_a_finger(self, column: str, value: float) -> float:
        of, in_file = dimension_of(column), self.columns[column]
        if abs(value) > of.most and not is_own_unit(in_file.unit):
            number = value / in_file.factor
            usual = unit_of_name(column)
            likely = usual if abs(number * (of.known(usual) or math.inf)) <= of.most else of.likely
            raise self.wrong(
                column,
                "beyond_a_finger",
                f"at most {of.most:g} {usual}; if its unit is another, state it: "
                f"{stated_unit(column, in_file.name, likely)}",
            )
        return value

    def wrong(self, column: str, code: str, expected: str) -> RecordingError:
        """Return an error for a cell, which must be what is `expected`."""
        where = f"{self.path}, row {self.row}, column {self.columns[column].name}"
        return RecordingError(f"{where}: {self.cells[column]!r} must be {expected}", code)


def refuse_nines(rows: Sequence[Row], *names: str) -> None:
    """Refuse a number such as 999 that is far from all others of its column, as it means that there is no value."""
    for name in names:
        values = [row.number(name) for row in rows]
        nines = _NINES if dimension_of(name) is LENGTH else _MORE_NINES
        first = dict(zip(reversed(values), reversed(rows), strict=True))
        for value, row in first.items():
            if not nines.fullmatch(f"{abs(value / row.columns[name].factor):.12g}"):
                continue
            others = {abs(other) for other in first if other != value}
            if others and abs(value) > _FAR_FROM * max(others):
                largest = f"{max(others) / row.columns[name].factor:.6g}"
                raise row.wrong(
                    name,
                    "no_number",
                    f"a measured number: no other is beyond {largest}, and many tables have such a number for no "
                    "data; delete the row, or correct it",
                )


_NINES, _MORE_NINES = re.compile(r"9{2,}(\.9+)?"), re.compile(r"9{3,}(\.9+)?")
_FAR_FROM = 3.0


def _is_unit_of(unit: str, name: str, column: RecordingColumn) -> bool:
    """Return whether a unit is that of a column."""
    same_kind = is_own_unit(unit) == is_own_unit(column.unit)
    return same_kind and dimension_of(name).known(unit) == column.factor


def unit_of_name(name: str) -> str:
    """Return the unit in one of the program's names of columns, e.g. "mm" of "position_mm"."""
    return "1/s" if dimension_of(name) is RATE else name.rpartition("_")[2]


def stated_unit(name: str, column: str, unit: str) -> str:
    """Return how to state the unit of a column: in its name if that states one, or without a role; by --columns."""
    role = next((role for role, own in _ROLES.items() if own == name), None)
    of = dimension_of(name)
    if role is None or contradicts(column, unit, of):
        return f"call the column {renamed(column, unit, of)!r}"
    stated = f"{role}={column}:{unit}"
    return f"--columns {shlex.quote(stated)}"


def columns_read(rows: Sequence[Row], window_s: float | None = None) -> str:
    """Return which columns of a table were read, in which units, and which were not.

    A column that is not read and has a few values, which differ between the repeats of one position, is named: it
    may have conditions.
    """
    if not rows:
        return ""
    parts = [
        column.name
        + (f" as {role}" if (role := _WORDS.get(name, name)) != column.name else "")
        + (f" in {unit}" if (unit := _unit_read(name, column)) else "")
        for name, column in rows[0].columns.items()
    ]
    parts += [] if window_s is None else [f"{window_s:g} s as window"]
    unread = [name for name in rows[0].unread if name]
    said = [f"Columns read: {', '.join(parts)}."]
    said += [f"Not read: {', '.join(unread[:_MOST_LISTED])}."] if unread else []
    mixed = [name for name in unread if _may_be_a_condition(rows, name)]
    said += [f"{mixed[0]} differs between presses at one position, which count as repeats."] if mixed else []
    return " ".join([*said, *filter(None, [cell_comments(rows[0].path)])])


_WORDS = {own: role for role, own in _ROLES.items()}


def _unit_read(name: str, column: RecordingColumn) -> str:
    if dimension_of(name) in (NONE, COUNT) or name == "sd":
        return column.unit
    return column.unit or unit_of_name(name)


def _may_be_a_condition(rows: Sequence[Row], name: str) -> bool:
    position = role_name("position")
    if position not in rows[0].cells:
        return False
    at: dict[str, set[str]] = {}
    for row in rows:
        at.setdefault(row.cells[position], set()).add(row.unread[name])
    return len(set().union(*at.values())) <= len(rows) // 2 and any(len(values) > 1 for values in at.values())


COLUMNS_HINT = (
    "; name yours with --columns, e.g. position=COLUMN:um,rate=COLUMN:Hz, or time=COLUMN:ms for spike times"
)
"""Advice on a wrong header of a recording."""


def read_table(
    path: Path,
    required: Sequence[str],
    optional: Sequence[str] = (),
    *,
    given: Mapping[str, RecordingColumn] | None = None,
    others: bool = False,
    hint: str = "",
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
    others : bool
        Whether further columns are ignored in any case.
    hint : str
        Advice that is appended to the error for a wrong header.

    Raises
    ------
    RecordingError
        If a column is missing, unknown, repeated, or in an unknown unit, or if a row has another length.
    """
    lines = table_lines(path)
    first, header = next(lines)
    columns = check_header(path, first, header, required, optional, given=given, others=others, hint=hint)
    at = {name: header.index(column.name) for name, column in columns.items()}
    rows = list[tuple[int, dict[str, str], dict[str, str]]]()
    for number, cells in lines:
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise RecordingError(
                f"{path}, row {number}: {len(cells)} cells, but the header has {len(header)}", "cells_of_row"
            )
        for name, k in at.items() if not rows else ():
            refuse_not_understood(path, columns[name].name, cells[k])
        unread = {name: cells[k] for k, name in enumerate(header) if k not in at.values()}
        read = {name: _same_name(cells[k]) if name in _NAMES else cells[k] for name, k in at.items()}
        rows.append((number, read, unread))
    numbers = number_format((cells for _, cells, _ in rows), semicolons=has_semicolons(path))
    found = [Row(path, number, cells, columns, numbers, unread) for number, cells, unread in rows]
    for name, cell in found[0].cells.items() if found else ():
        if isinstance(cell, SameInAllRows) and name not in _MAY_BE_SAME:
            raise found[0].wrong(
                name,
                "same_in_all_rows",
                f"a vector with a number for each row; only {', '.join(_MAY_BE_SAME)} may be a scalar",
            )
    return found


def _same_name(cell: str) -> str:
    name = same_name(cell)
    return SameInAllRows(name) if isinstance(cell, SameInAllRows) else name


_NAMES = ("unit", "repeat")
_MAY_BE_SAME = ("window_s", "sd", "repeat", "kind", "unit")


def check_header(
    path: Path,
    row: int,
    header: Sequence[str],
    required: Sequence[str],
    optional: Sequence[str] = (),
    *,
    given: Mapping[str, RecordingColumn] | None = None,
    others: bool = False,
    hint: str = "",
) -> dict[str, RecordingColumn]:
    """Return the columns of a header by the program's names.

    Refuse a header without a required column, or with one that is unknown (unless some are `given`, or `others` are
    allowed) or repeated.
    """
    given = given or {}
    others = others or bool(given)
    found = {name: column for name in (*required, *optional) if (column := given.get(name)) is not None}
    taken = {column.name for column in found.values()}
    for name in (one for one in found if given[one].name in header):
        _refuse_unknown_unit(path, row, name, found[name])
    for name in (one for one in (*required, *optional) if one not in given):
        column = _recognized(path, row, [cell for cell in header if cell not in taken], name)
        if column is not None:
            found[name] = column
            taken.add(column.name)
    read = ", ".join(header[:_MOST_LISTED]) or "none"
    shown = [given[name].name if name in given else name for name in required], optional
    for name in required:
        column = found.get(name)
        if column is None or column.name not in header:
            if len(header) == 1 and len(required) > 1 and path.suffix.lower() != ".mat":
                hint = "; lines above the names of the columns must begin with #" + hint
            if _is_numbers(header):
                raise RecordingError(
                    f"{path}, row {row}: has numbers ({read}) instead of the names of columns; add a line above it "
                    f"with the names, e.g. {column_list(*shown)}{hint}",
                    "no_header",
                )
            missing = given[name].name if name in given else name
            raise RecordingError(
                f"{path}, row {row}: the column {missing} is missing; expected {column_list(*shown)}, read {read}"
                f"{hint}",
                "no_column",
            )
    for cell in header:
        if (cell not in taken and not others) or (cell in taken and header.count(cell) > 1):
            remedy = (
                "; delete or rename one of them"
                if header.count(cell) > 1
                else _suggested(found, required, optional) or hint
            )
            raise RecordingError(
                f"{path}, row {row}: the column {cell!r} is unknown or repeated; the columns are "
                f"{column_list(required, optional)}{remedy}",
                "extra_column",
            )
    return found


def _is_numbers(header: Sequence[str]) -> bool:
    numbers = [number_format([{"": cell}]).number(cell) for cell in header]
    return bool(header) and not any(map(math.isnan, numbers))


def _recognized(path: Path, row: int, header: Sequence[str], name: str) -> RecordingColumn | None:
    """Return the column of a header that has one of the program's names, in any unit, or None."""
    if name in header:
        return RecordingColumn(name)
    of = dimension_of(name)
    every = [(cell, header_name(cell, of)) for cell in header]
    meant = [(cell, said) for cell, said in every if means(said.words, name)]
    if not meant:
        return None
    if len({cell for cell, _ in meant}) > 1:
        raise RecordingError(
            f"{path}, row {row}: the columns {' and '.join((repr(cell) for cell, _ in meant))} may both be "
            f"{name}; name one: {stated_column(name, meant[0][0])}",
            "two_columns",
        )
    cell, said = meant[0]
    if said.factor is None:
        raise RecordingError(
            f"{path}, row {row}, column {cell!r}: the unit {said.unit!r} is unknown; it must be one of "
            f"{', '.join(of.listed)}: convert the numbers, or, if they are in one of these, "
            f"{_use(stated_unit(name, cell, 'UNIT'))}",
            "unknown_unit",
        )
    found = RecordingColumn(cell, said.unit, said.factor)
    if name != said.words:
        _refuse_unknown_unit(path, row, name, found)
    return found


_NEED_A_UNIT = (LENGTH, TIME, WINDOW, FORCE)


def _refuse_unknown_unit(path: Path, row: int, name: str, column: RecordingColumn) -> None:
    """Refuse a column whose unit is needed and is neither in its name nor stated; what means a rate is in 1/s."""
    of = dimension_of(name)
    if column.unit or not (of in _NEED_A_UNIT or (name == "rate" and not names_a_rate(column.name))):
        return
    remedy = _use(stated_unit(name, column.name, unit_of_name(name)))
    raise RecordingError(
        f"{path}, row {row}, column {column.name!r}: states no unit that is known ({', '.join(of.listed)}); if it "
        f"is {unit_of_name(name)}, {remedy}",
        "no_unit",
    )


def _use(remedy: str) -> str:
    return f"use {remedy}" if remedy.startswith("-") else remedy


def stated_column(name: str, column: str) -> str:
    """Return how to name a column: by --columns, or by the program's name."""
    role = next((role for role, own in _ROLES.items() if own == name), None)
    return f"call it {name}" if role is None else f'--columns "{role}={column}"'


def _suggested(found: Mapping[str, RecordingColumn], required: Sequence[str], optional: Sequence[str]) -> str:
    """Return how to read a table whose further columns are unknown, if the others were recognized."""
    roles = {own: role for role, own in _ROLES.items()}
    if not all(name in found and name in roles for name in required):
        return ""
    named = ",".join(f"{roles[name]}={found[name].name}" for name in (*required, *optional) if name in found)
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


def has_column(header: Sequence[str], name: str, given: Mapping[str, RecordingColumn]) -> bool:
    """Return whether a header has a column that is given, or is called by the program's name or means it."""
    if name in given:
        return given[name].name in header
    of = dimension_of(name)
    return name in header or any(means(header_name(cell, of).words, name) for cell in header)


def header_of(path: Path) -> list[str]:
    """Return the names of the columns; an empty list for an empty file. Raises RecordingError."""
    return next(table_lines(path))[1]
