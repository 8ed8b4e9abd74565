"""Numbers from a user's CSV file, by the names of its columns."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

Row = tuple[float, ...]


class TableError(ValueError):
    """The file holds no usable table; the message names file, line, column and what was expected."""


def read_columns(path: Path, columns: Sequence[str]) -> tuple[Row, ...]:
    """The named columns of a CSV file, row by row, in the order asked for.

    The first line names the columns, in any order; others are ignored. Empty lines and lines that begin with # are
    skipped. Raises TableError.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            lines = [(n, row) for n, row in enumerate(csv.reader(stream), 1) if any(row) and row[0][:1] != "#"]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TableError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if not lines:
        raise TableError(f"{path}: no table, expected the columns {','.join(columns)}")
    (first, header), *rows = lines
    names = [cell.strip() for cell in header]
    for name in columns:
        if names.count(name) != 1:
            raise TableError(
                f"{path}, line {first}: {names.count(name)} columns {name}, expected the columns {','.join(columns)}"
            )
    place = [names.index(name) for name in columns]
    return tuple(
        tuple(_number(path, n, name, row, k) for name, k in zip(columns, place, strict=True)) for n, row in rows
    )


def _number(path: Path, line: int, name: str, row: list[str], column: int) -> float:
    cell = row[column].strip() if column < len(row) else ""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TableError(f"{path}, line {line}, {name}: expected a number, got {cell!r}")
    return value
