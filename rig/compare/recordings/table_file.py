"""A user's table as text, whatever separates its columns and decimals; complaints name file, row and column."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.compare.errors import RecordingError

_SEPARATORS = (",", ";", "\t")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d*([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Row:
    """The cells of a row by column, and where it is; with decimal commas if any number of the table has one."""

    path: Path
    row: int  # the header is 1
    cells: Mapping[str, str]
    commas: bool = False

    def number(self, column: str, least: float = -math.inf) -> float:
        """A finite number that is not below `least`. Raises RecordingError."""
        text = self.cells[column]
        value = float(text.replace(",", ".")) if self._is_number(text) else math.nan
        if not (math.isfinite(value) and value >= least):
            bounded, mixed = least > -math.inf, self.commas and "." in text
            expected = "a number" + " of {least:g} or more" * bounded + " with a decimal comma" * mixed
            fields = {"least": least} if bounded else {}
            raise self.wrong(column, "no_number", expected, decimal_comma=mixed, **fields)
        return value

    def wrong(self, column: str, code: str, expected: str, **fields: Any) -> RecordingError:
        """The complaint about a cell; what was expected may name further fields."""
        return RecordingError(
            "{path}, row {row}, column {column}: {cell!r}, expected " + expected,
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


def read_table(
    path: Path, required: Sequence[str], optional: Sequence[str] = (), *, others: bool = False
) -> list[Row]:
    """The rows below a header (row 1) that has the required columns. Empty rows are skipped.

    Separators are commas, semicolons or tabs; `others` says that columns besides these are no mistake. Raises
    RecordingError.
    """
    lines = _lines(path)
    header = lines[0] if lines else []
    wanted = (*required, *optional)
    for name in required:
        if name not in header:
            problem = "{path}, row 1: no column {column}, expected {columns}"
            raise _wrong_header(problem, "no_column", path, name, told(required, optional))
    for name in header:
        if (name not in wanted and not others) or (name in wanted and header.count(name) > 1):
            problem = "{path}, row 1: column {column!r}, expected {columns}"
            raise _wrong_header(problem, "extra_column", path, name, told(required, optional))
    rows = []
    for number, cells in enumerate(lines[1:], 2):
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise RecordingError(
                "{path}, row {row}: {cells} cells, expected {columns}",
                code="cells_of_row",
                path=str(path),
                row=number,
                cells=len(cells),
                columns=len(header),
            )
        named = zip(header, cells, strict=True)
        rows.append((number, {name: cell for name, cell in named if name in wanted}))
    commas = any(_DECIMAL_COMMA.fullmatch(cell) for _, cells in rows for cell in cells.values())
    return [Row(path, number, cells, commas) for number, cells in rows]


def _wrong_header(sentence: str, code: str, path: Path, column: str, columns: str) -> RecordingError:
    return RecordingError(sentence, code=code, path=str(path), column=column, columns=columns)


def told(required: Sequence[str], optional: Sequence[str] = ()) -> str:
    """Columns as one writes them: "position_mm,rate[,sd]"."""
    return ",".join(required) + "".join(f"[,{name}]" for name in optional)


def no_rows(path: Path, expected: str) -> RecordingError:
    """The complaint about a table that ends with its header."""
    sentence = "{path}: no rows below the header, expected {expected}"
    return RecordingError(sentence, code="no_rows", path=str(path), expected=expected)


def header_of(path: Path) -> list[str]:
    """The names of the columns; none of an empty file. Raises RecordingError."""
    return (_lines(path) or [[]])[0]


def _lines(path: Path) -> list[list[str]]:
    """Stripped cells, by the separator that makes the most columns of the header."""
    try:
        text = path.read_text(encoding="utf-8-sig").splitlines()
        split = [list(csv.reader(text, delimiter=sign)) for sign in _SEPARATORS]
    except OSError as error:
        reason = error.strerror or str(error)
        raise RecordingError("{path}: {reason}", code="unreadable", path=str(path), reason=reason) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(
            "{path}: not a CSV file in UTF-8: {reason}", code="no_csv", path=str(path), reason=str(error)
        ) from None
    lines = max(split, key=lambda rows: len(rows[0]) if rows else 0)
    return [[cell.strip() for cell in cells] for cells in lines]
