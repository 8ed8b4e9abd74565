"""Read a user's table: separators, decimal signs, and the roles and units of its columns."""

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from rig.compare.exceptions import RecordingError
from rig_shared.user_files import lines_of
from sim.tables import is_number

MOST_TABLE_BYTES = 100_000_000

_LENGTHS = {"nm": 1e-6, "um": 1e-3, "µm": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0}
_TIMES = {"us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0}
_RATES = {"1/s": 1.0, "/s": 1.0, "Hz": 1.0, "spikes/s": 1.0, "imp/s": 1.0, "1/ms": 1000.0, "/ms": 1000.0,
          "1/min": 1 / 60, "/min": 1 / 60}  # fmt: skip


class RecordingColumn(NamedTuple):
    """Column of a file, with its unit and the factor that converts its numbers to mm, s or 1/s."""

    name: str
    unit: str = ""
    factor: float = 1.0

    @property
    def changed(self) -> bool:
        """Whether the numbers are converted."""
        return self.factor != 1.0


class _Role(NamedTuple):
    default: str
    units: Mapping[str, float]


_ROLES = {
    "position": _Role("position_mm", _LENGTHS),
    "rate": _Role("rate", _RATES),
    "sd": _Role("sd", _RATES),
    "repeat": _Role("repeat", {}),
    "count": _Role("count", {}),
    "window": _Role("window_s", _TIMES),
    "time": _Role("time_s", _TIMES),
    "kind": _Role("kind", {}),
    "unit": _Role("unit", {}),
    "sync": _Role("sync_pulses", _TIMES),
    "observed": _Role("obs_intervals", _TIMES),
    "segment": _Role("segment", {}),
}


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
        return self.named.get(role, RecordingColumn(_ROLES[role].default))

    @property
    def observed_throughout(self) -> bool:
        """Whether the user states that the unit was observed throughout the run."""
        return "observed" in self.named and self.named["observed"].name == _THROUGHOUT

    def names(self, *roles: str) -> list[str]:
        """Return the names of the columns of several roles."""
        return [self[role].name for role in roles]

    def split(self, required: Sequence[str], optional: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the names of the required and the optional columns; a column named by `--columns` is required."""
        asked = [role for role in optional if role in self.named]
        return self.names(*required, *asked), self.names(*(role for role in optional if role not in asked))

    def changes(self, *roles: str) -> tuple[str, ...]:
        """Return notes on the converted roles, for captions."""
        return tuple(f"{role} from {self[role].unit}" for role in roles if self[role].changed)


def column_map(texts: Sequence[str]) -> ColumnMap:
    """Parse the values of `--columns`, "ROLE=COLUMN[:UNIT],…". Raises RecordingError.

    Without a unit, the unit at the end of the column's name applies, as in "x (um)" or "x_um"; an sd without a unit
    has the unit of the rates.
    """
    given: dict[str, RecordingColumn] = {}
    for text in texts:
        for part in text.split(","):
            role, equals, name = (word.strip() for word in part.partition("="))
            if role not in _ROLES or not (equals and name):
                raise RecordingError(
                    "--columns {given!r}: must be ROLE=COLUMN[:UNIT], with ROLE one of {roles}",
                    code="no_role",
                    given=part,
                    roles=", ".join(_ROLES),
                )
            if role in given:
                raise RecordingError(
                    "--columns {given!r}: the role {role} is given twice; give it once",
                    code="role_twice",
                    given=part,
                    role=role,
                )
            given[role] = _column(part, name, _ROLES[role].units)
    _refuse_what_cannot_be(given)
    if "sd" in given and "rate" in given and not given["sd"].unit:
        given["sd"] = given["rate"]._replace(name=given["sd"].name)
    return ColumnMap(given, _stated_window(given))


def _stated_window(given: dict[str, RecordingColumn]) -> float | None:
    """Return the window in s if it is a number instead of a column, else None. Raises RecordingError."""
    try:
        seconds = float(given["window"].name) * given["window"].factor
    except (KeyError, ValueError):
        return None
    if not 0 < seconds < math.inf:
        raise RecordingError(
            "--columns window={window}: must be a number of seconds above 0",
            code="window_not_above_0",
            window=given["window"].name,
        )
    return seconds


def _refuse_what_cannot_be(given: Mapping[str, RecordingColumn]) -> None:
    names = [column.name for column in given.values()]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise RecordingError(
            "--columns: the column {column!r} has two roles; give it one", code="column_twice", column=twice[0]
        )
    if "count" in given and ("rate" in given or "sd" in given):
        raise RecordingError(
            "--columns: count cannot be combined with rate or sd; use counts with a window, or rates with an sd",
            code="counts_and_rates",
        )


def _column(part: str, name: str, units: Mapping[str, float]) -> RecordingColumn:
    before, colon, unit = name.rpartition(":")
    if colon:
        if not before or _known(unit, units) is None:
            expected = "one of {units}" if units else "omitted for this role"
            raise RecordingError(
                "--columns {given!r}: the unit {unit!r} must be " + expected,
                code="unknown_unit",
                given=part,
                unit=unit,
                units=", ".join(units),
            )
        return RecordingColumn(before.strip(), unit.strip(), _known(unit, units) or 1.0)
    said = re.search(r"[(\[]([^)\]]+)[)\]]$|_([^_\s]+)$", name)
    unit = next(filter(None, said.groups())) if said else ""
    factor = _known(unit, units)
    return RecordingColumn(name) if factor is None else RecordingColumn(name, unit, factor)


def _known(unit: str, units: Mapping[str, float]) -> float | None:
    """Return the factor of a unit, ignoring case and the variant of the micro sign; None for an unknown unit."""
    return {name.casefold(): factor for name, factor in units.items()}.get(unit.strip().casefold())


_SEPARATORS = (",", ";", "\t")
_SEPARATOR_LINE = re.compile(r'"?sep=.?"?', re.IGNORECASE)  # written above the header for Excel
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d*([eE][+-]?\d+)?")


_MOST_LISTED = 20
_NO_DATA = ("", "nan", "na", "n/a", "-")


@dataclass(frozen=True, slots=True)
class Row:
    """Cells of a row by column, and its location; with decimal commas if any number of the table has one."""

    path: Path
    row: int  # the header is 1
    cells: Mapping[str, str]
    commas: bool = False

    def number(self, column: str, least: float = -math.inf) -> float:
        """Return the cell as a finite number of at least `least`. Raises RecordingError."""
        text = self.cells[column].replace("−", "-")
        value = float(text.replace(",", ".")) if self._is_number(text) else math.nan
        if not (is_number(value) and value >= least):
            bounded, mixed = least > -math.inf, self.commas and "." in text
            expected = "a number" + " of {least:g} or more" * bounded + " with a decimal comma" * mixed
            expected += "; delete rows without data" * (text.casefold() in _NO_DATA)
            fields = {"least": least} if bounded else {}
            raise self.wrong(column, "no_number", expected, decimal_comma=mixed, **fields)
        return value

    def wrong(self, column: str, code: str, expected: str, **fields: Any) -> RecordingError:
        """Return an error for a cell; `expected` is a format string over the further fields."""
        return RecordingError(
            "{path}, row {row}, column {column}: {cell!r} must be " + expected,
            code=code,
            path=str(self.path),
            row=self.row,
            column=column,
            cell=self.cells[column],
            **fields,
        )

    def _is_number(self, text: str) -> bool:
        if self.commas and "." in text:  # 1.234,5 or a mixture: which of the two is the decimal sign?
            return False
        return _NUMBER.fullmatch(text.replace(",", ".")) is not None


COLUMNS_HINT = "; name yours with --columns, e.g. position=COLUMN:um,rate=COLUMN, or time=COLUMN:ms for spike times"
"""Advice on a wrong header of a recording."""


def read_table(
    path: Path, required: Sequence[str], optional: Sequence[str] = (), *, others: bool = False, hint: str = ""
) -> list[Row]:
    """Return the rows below the header, which must have the required columns.

    Empty rows are skipped, as are empty lines and lines that begin with # above the header. Separators are commas,
    semicolons or tabs. `others` allows further columns; `hint` is appended to the error for a wrong header. Raises
    RecordingError.
    """
    lines = table_lines(path)
    first, header = next(lines)
    wanted = {name: header.index(name) for name in (*required, *optional) if name in header}
    check_header(path, first, header, required, optional, others=others, hint=hint)
    rows = []
    for number, cells in lines:
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise RecordingError(
                "{path}, row {row}: {cells} cells, but the header has {columns}",
                code="cells_of_row",
                path=str(path),
                row=number,
                cells=len(cells),
                columns=len(header),
            )
        rows.append((number, {name: cells[at] for name, at in wanted.items()}))
    commas = any("," in cell and _DECIMAL_COMMA.fullmatch(cell) for _, cells in rows for cell in cells.values())
    return [Row(path, number, cells, commas) for number, cells in rows]


def check_header(
    path: Path,
    row: int,
    header: Sequence[str],
    required: Sequence[str],
    optional: Sequence[str] = (),
    *,
    others: bool = False,
    hint: str = "",
) -> None:
    """Refuse a header without a required column, or with one that is unknown (unless `others`) or repeated."""
    wanted = (*required, *optional)
    read = ", ".join(header[:_MOST_LISTED]) or "none"
    for name in required:
        if name not in header:
            problem = "{path}, row {row}: the column {column} is missing; expected {columns}, read {read}" + hint
            raise _wrong_header(problem, "no_column", path, row, name, column_list(required, optional), read)
    for name in header:
        if (name not in wanted and not others) or (name in wanted and header.count(name) > 1):
            problem = (
                "{path}, row {row}: the column {column!r} is unknown or repeated; the columns are {columns}" + hint
            )
            raise _wrong_header(problem, "extra_column", path, row, name, column_list(required, optional), read)


def _wrong_header(
    sentence: str, code: str, path: Path, row: int, column: str, columns: str, read: str
) -> RecordingError:
    return RecordingError(sentence, code=code, path=str(path), row=row, column=column, columns=columns, read=read)


def column_list(required: Sequence[str], optional: Sequence[str] = ()) -> str:
    """Return the columns as text, e.g. "position_mm,rate[,sd]"."""
    return ",".join(required) + "".join(f"[,{name}]" for name in optional)


def no_rows(path: Path, expected: str) -> RecordingError:
    """Return the error for a table without rows below the header."""
    sentence = "{path}: no rows below the header; the file must contain {expected}"
    return RecordingError(sentence, code="no_rows", path=str(path), expected=expected)


def header_of(path: Path) -> list[str]:
    """Return the names of the columns; an empty list for an empty file. Raises RecordingError."""
    return next(table_lines(path))[1]


def table_lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the stripped cells of the header (no cells for an empty file), then of each row.

    The separator is the one that splits the header into the most columns. Comments and empty lines above the header
    are skipped, as are empty columns at the right. Raises RecordingError.
    """
    try:
        lines = lines_of(path, most=MOST_TABLE_BYTES)
        above = 1
        header = next(lines, "")
        while header and (header.startswith("#") or not header.strip(" ,;\t\r\n") or _is_separator_line(header)):
            above, header = above + 1, next(lines, "")
        sign = max(_SEPARATORS, key=lambda sign: len(next(csv.reader([header], delimiter=sign), [])))
        columns = 0
        for number, line in enumerate(csv.reader(chain([header], lines), delimiter=sign), above):
            cells = [cell.strip() for cell in line]
            while len(cells) > columns and not cells[-1]:
                cells.pop()
            columns = columns or len(cells)
            yield number, cells
    except OSError as error:
        reason = error.strerror or str(error)
        raise RecordingError("{path}: {reason}", code="unreadable", path=str(path), reason=reason) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(
            "{path}: not a CSV file in UTF-8: {reason}; save it as CSV UTF-8",
            code="no_csv",
            path=str(path),
            reason=str(error),
        ) from None


def _is_separator_line(line: str) -> bool:
    return _SEPARATOR_LINE.fullmatch(line.strip()) is not None
