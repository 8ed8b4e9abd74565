"""A user's table as text, whatever separates its columns and decimals; complaints name file, row and column."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.compare.errors import RecordingError

_SEPARATORS = (",", ";", "\t")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d*([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Row:
    """The cells of a row by column, and where it is; with decimal commas if any number of the table has one."""

    where: str
    cells: Mapping[str, str]
    commas: bool = False

    def number(self, column: str, least: float = -math.inf) -> float:
        """A finite number that is not below `least`. Raises RecordingError."""
        text = self.cells[column]
        value = float(text.replace(",", ".")) if self._is_number(text) else math.nan
        if not (math.isfinite(value) and value >= least):
            expected = "a number" if least == -math.inf else f"a number of {least:g} or more"
            raise self.wrong(column, expected + (" with a decimal comma" if self.commas and "." in text else ""))
        return value

    def wrong(self, column: str, expected: str) -> RecordingError:
        """The complaint about a cell."""
        return RecordingError(f"{self.where}, column {column}: {self.cells[column]!r}, expected {expected}")

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
    problem = next((f"no column {name}" for name in required if name not in header), None)
    wrong = [n for n in header if (n not in wanted and not others) or (n in wanted and header.count(n) > 1)]
    if problem or wrong:
        raise RecordingError(
            f"{path}, row 1: {problem or f'column {wrong[0]!r}'}, expected {told(required, optional)}"
        )
    rows = []
    for number, cells in enumerate(lines[1:], 2):
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise RecordingError(f"{path}, row {number}: {len(cells)} cells, expected {len(header)}")
        named = zip(header, cells, strict=True)
        rows.append((f"{path}, row {number}", {name: cell for name, cell in named if name in wanted}))
    commas = any(_DECIMAL_COMMA.fullmatch(cell) for _, cells in rows for cell in cells.values())
    return [Row(where, cells, commas) for where, cells in rows]


def told(required: Sequence[str], optional: Sequence[str] = ()) -> str:
    """Columns as one writes them: "position_mm,rate[,sd]"."""
    return ",".join(required) + "".join(f"[,{name}]" for name in optional)


def header_of(path: Path) -> list[str]:
    """The names of the columns; none of an empty file. Raises RecordingError."""
    return (_lines(path) or [[]])[0]


def _lines(path: Path) -> list[list[str]]:
    """Stripped cells, by the separator that makes the most columns of the header."""
    try:
        text = path.read_text(encoding="utf-8-sig").splitlines()
        split = [list(csv.reader(text, delimiter=sign)) for sign in _SEPARATORS]
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: not a CSV file in UTF-8: {error}") from None
    lines = max(split, key=lambda rows: len(rows[0]) if rows else 0)
    return [[cell.strip() for cell in cells] for cells in lines]
