"""Numbers from a user's CSV file, by the names of its columns."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from sim.errors import SimError

Row = tuple[float, ...]


class TableError(SimError, ValueError):
    """The file holds no usable table; the message names file, line, column and what was expected."""


def read_columns(path: Path, columns: Sequence[str]) -> tuple[Row, ...]:
    """The named columns of a CSV file, row by row, in the order asked for.

    The first line names the columns, in any order; others are ignored. Empty lines and lines that begin with # are
    skipped. Raises TableError.
    """
    return tuple(row for _, row in read_numbered(path, columns))


def header_of(path: Path) -> tuple[int, tuple[str, ...]]:
    """The line that names the columns, and the names; line 1 and none in an empty file. Raises TableError."""
    lines = _lines(path)
    return (lines[0][0], tuple(cell.strip() for cell in lines[0][1])) if lines else (1, ())


def read_numbered(path: Path, columns: Sequence[str]) -> tuple[tuple[int, Row], ...]:
    """As `read_columns`, each row with the number of its line in the file. Raises TableError."""
    lines = _lines(path)
    if not lines:
        raise TableError(f"{path}: no table, expected the columns {','.join(columns)}")
    (first, header), *rows = lines
    place = _places(f"{path}, line {first}", [cell.strip() for cell in header], columns)
    if not rows:
        raise TableError(f"{path}: no rows below line {first}, expected numbers")
    for n, row in rows:
        if len(row) != len(header):
            raise TableError(f"{path}, line {n}: {len(row)} cells, expected {len(header)}, as in line {first}")
    return tuple(
        (n, tuple(_number(f"{path}, line {n}, {name}", row[k]) for name, k in zip(columns, place, strict=True)))
        for n, row in rows
    )


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """The lines that count, with their numbers."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream)
            return [(reader.line_num, row) for row in reader if any(row) and not row[0].startswith("#")]
    except OSError as error:
        raise TableError(f"{path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise TableError(f"{path}: not a CSV file in UTF-8: {error}") from None


def _places(where: str, names: list[str], columns: Sequence[str]) -> list[int]:
    for name in columns:
        if names.count(name) != 1:
            raise TableError(f"{where}: {names.count(name)} columns {name}, expected the columns {','.join(columns)}")
    return [names.index(name) for name in columns]


def _number(where: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TableError(f"{where}: expected a number, got {cell.strip()!r}")
    return value
