"""Cells of a table, row by row, whatever the kind of its file: CSV, Excel workbook (.xlsx) or MATLAB file (.mat)."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import same_name
from rig.compare.recordings.file_kinds import MATLAB, UTF_16, ZIP, is_matlab_4, kind_of, no_table
from rig.compare.recordings.matlab_file import MATLAB_DAMAGE, matlab_variables
from rig.compare.recordings.workbook import MOST_CELLS, MOST_UNPACKED, sheet_cells
from rig_shared.user_files import MOST_LINES, read_bytes, text_of

Lines = Iterator[tuple[int, list[str]]]
"""Numbers of rows, and their cells."""

MOST_TABLE_BYTES = 100_000_000
_MOST_LISTED, _MOST_SHOWN = 20, 40
_SEPARATORS = (",", ";", "\t")
_COMMENT = ("#", "%", "//")
_COMMENT_ROW = (*_COMMENT, ";", "!", "--")
"""Signs before a row below the header that is commented out; alone, the last ones may mean that there is no value."""
_SEPARATOR_LINE = re.compile(r'"?sep=.?"?', re.IGNORECASE)  # written above the header for Excel
_WORKBOOK = ".xlsx"


class SameInAllRows(str):
    """A cell that a file has once for all rows."""

    __slots__ = ()


class NotUnderstood(str):
    """What a column is that has no cells, such as "a struct"."""

    __slots__ = ()


def refuse_not_understood(path: Path, column: str, cell: str) -> None:
    """Refuse a column that is there and cannot be read. Raises RecordingError."""
    if isinstance(cell, NotUnderstood):
        raise RecordingError(
            f"{path}, column {column}: is {cell}; it must be a full vector of numbers (full, double), a column of "
            "letters (N × 1), or a cell array of texts (cellstr), with one for each row",
            "not_understood",
        )


def file_and_sheet(path: Path) -> tuple[Path, str]:
    """Split the file from the sheet that is named after it, as in "counts.xlsx#Sheet2"; "" if none is named."""
    text = str(path)
    before, mark, sheet = text.rpartition("#")
    if mark and before.lower().endswith(_WORKBOOK) and not path.exists():
        return Path(before), sheet
    return path, ""


class TableCells(NamedTuple):
    """A table: the row of its header, its names (none for an empty file), and the stripped cells of each row below.

    `semicolons`: whether semicolons separate the columns. `comments`: a sentence on comments of cells, "" for none.
    """

    first: int
    header: list[str]
    lines: Lines
    semicolons: bool = False
    comments: str = ""


def table_cells(path: Path) -> TableCells:
    """Return the cells of a table, without comments and empty rows above the header, and empty columns at the right.

    Raises RecordingError, also while the rows are read.
    """
    file, sheet = file_and_sheet(path)
    try:
        content = read_bytes(file, MOST_TABLE_BYTES)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}", "unreadable") from None
    matlab, is_csv, comments = file.suffix.lower() == ".mat", False, ""
    if content.startswith(ZIP):
        rows, comments = sheet_cells(path, content, sheet)
        lines: Lines = iter(rows)
    elif matlab and is_matlab_4(content):
        raise no_table(path, "a MATLAB file of version 4; save it in MATLAB with save(…, '-v7')")
    elif matlab and content.startswith(MATLAB):
        lines = _of_matlab(path, content)
    else:
        lines, is_csv = _of_csv(path, content), True
    first, header = next(lines, (1, []))
    while _is_above(header):
        first, header = next(lines, (first + 1, []))
        if not header and first > MOST_LINES:
            break
    header = [" ".join(same_name(cell).split()) for cell in _without_empty_ends(header, 0)]  # Excel breaks long names
    semicolons = is_csv and _header(_text(content))[2] == ";"
    return TableCells(first, header, _below(path, lines, len(header)), semicolons, comments)


def _below(path: Path, lines: Lines, columns: int) -> Lines:
    for number, cells in lines:
        sign = next((sign for sign in _COMMENT_ROW if cells and cells[0].startswith(sign)), "")
        if sign and (cells[0] != sign or sign in _COMMENT):
            raise RecordingError(
                f"{path}, row {number}: begins with {cells[0][:_MOST_SHOWN]!r}, as a comment does; delete the row or "
                f"the sign {sign}",
                "comment_row",
            )
        yield number, _without_empty_ends(cells, columns)


def _is_above(cells: list[str]) -> bool:
    return bool(cells) and (not any(cells) or cells[0].startswith(_COMMENT) or _is_separator_line(cells))


def _is_separator_line(cells: list[str]) -> bool:
    return _SEPARATOR_LINE.fullmatch(",".join(cells).strip()) is not None


def _without_empty_ends(cells: list[str], columns: int) -> list[str]:
    while len(cells) > columns and not cells[-1]:
        cells = cells[:-1]
    return cells


def _of_csv(path: Path, content: bytes) -> Lines:
    """Yield the rows of a CSV."""
    if max(content.count(b"\n"), content.count(b"\r")) > MOST_LINES:
        raise RecordingError(f"{path}: more than {MOST_LINES} lines, which is the limit", "unreadable")
    kind = kind_of(content) if content and not content.startswith(UTF_16) else ""
    if kind not in ("", "text"):
        raise no_table(path, kind)
    try:
        lines = _text(content)
        row, header, separator = _header(lines)
        for number, line in enumerate(csv.reader(chain([header], lines), delimiter=separator), row):
            yield number, [cell.strip() for cell in line]
    except UnicodeDecodeError as error:
        row = 1 + content[: error.start].count(b"\n")
        reason = f"row {row} has a byte of another encoding (perhaps Latin-1 or Windows-1252)"
        raise no_table(path, "", "its text is not complete" if content.startswith(UTF_16) else reason) from None
    except csv.Error as error:
        raise no_table(path, "", str(error)) from None


def _text(content: bytes) -> Iterator[str]:
    return text_of(content, encoding="utf-16" if content.startswith(UTF_16) else "utf-8-sig")


def _header(lines: Iterator[str]) -> tuple[int, str, str]:
    """Return the row, the text and the separator of the first line with names of columns.

    The separator is the one that splits it into the most columns.
    """
    row, header = 1, next(lines, "")
    while header and (header.startswith(_COMMENT) or not header.strip(" ,;\t\r\n") or _is_separator_line([header])):
        row, header = row + 1, next(lines, "")
    return row, header, max(_SEPARATORS, key=lambda sign: len(next(csv.reader([header], delimiter=sign), [])))


def _of_matlab(path: Path, content: bytes) -> Lines:
    """Yield the vectors of a MATLAB file as columns; scalars and single texts are the same in all rows."""
    try:
        variables = matlab_variables(content, MOST_UNPACKED)
    except MATLAB_DAMAGE as error:
        raise no_table(path, f"a damaged MATLAB file ({error})") from None
    columns = {one.name: one for one in variables if one.length is not None}
    others = {one.name: NotUnderstood(one.problem) for one in variables if one.length is None}
    lengths = {one.length or 0 for one in columns.values()} - {1} or {1}
    if not columns or len(lengths) > 1 or max(lengths) * len(variables) > MOST_CELLS:
        held = ", ".join(f"{one.name} ({one.size})" for one in variables[:_MOST_LISTED]) or "no variables"
        raise RecordingError(
            f"{path}: must have vectors of one length, whose names are the columns; it has {held}; save them with "
            "save(FILE, 'position_mm', 'rate', '-v7'), the fields of a struct with -struct",
            "no_mat_table",
        )
    rows = max(lengths)
    unclear = {name: NotUnderstood(problem) for name, one in columns.items() if (problem := one.row_problem(rows))}
    read = {name: one.column() for name, one in columns.items() if name not in unclear}
    return _as_lines(read, others | unclear, rows)


def _as_lines(columns: Mapping[str, Sequence[str]], others: Mapping[str, NotUnderstood], length: int) -> Lines:
    """Yield the rows of vectors and scalars; `others` have one cell in all rows."""
    texts = {
        name: some if len(some) == length else [SameInAllRows(some[0])] * length for name, some in columns.items()
    }
    yield 1, [*texts, *others]
    for row in range(length):
        yield row + 2, [*(some[row] for some in texts.values()), *others.values()]
