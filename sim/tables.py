"""Tables of numbers and text: as CSV files, or for pandas and xarray."""

import csv
import logging
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig_shared.number_text import read_number
from rig_shared.summary_rows import labeled_summary, summary_row
from rig_shared.user_files import MOST_TABLE_BYTES, lines_of
from sim.errors import ArgumentError, SimError, has_unit, is_plain_number

_log = logging.getLogger(__name__)

# --- arguments ---


def numbers_of(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return the array of an argument, with nan for None.

    Raises ArgumentError for everything else that is no number: text, True and False, quantities, masked values, and
    lists of unequal length.
    """
    wrong = _no_number_in(values)
    if wrong is None:
        try:
            return np.asarray(values, dtype=float)
        except (TypeError, ValueError):
            wrong = type(values).__name__
    raise ArgumentError(
        f"{name}: must be numbers, ints or floats in the unit of the name, not {wrong}", "not_numbers"
    )


def _no_number_in(values: object) -> str | None:
    """Return in words what in an argument is no number, or None."""
    if isinstance(values, np.ndarray | np.generic):
        if np.ma.is_masked(values):
            return "masked values; fill them with nan (values.filled(numpy.nan)) or leave them out"
        if has_unit(values):
            return f"{type(values).__name__}, which has a unit"
        if values.dtype != object:
            return None if values.dtype.kind in "iuf" else values.dtype.type.__name__
        each: Iterable[object] = values.flat
    elif isinstance(values, list | tuple | range):
        each = values
    elif values is None or is_plain_number(values):
        return None
    elif hasattr(values, "__array__") and not has_unit(values):  # as of pandas
        return _no_number_in(np.asarray(values))
    else:
        return type(values).__name__
    return next((found for one in each if (found := _no_number_in(one)) is not None), None)


def broadcast(**arguments: NDArray[Any]) -> list[NDArray[Any]]:
    """Return the arrays of arguments in one shape. Raises ArgumentError with their shapes if there is none."""
    try:
        return list(np.broadcast_arrays(*arguments.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {' × '.join(map(str, one.shape)) or 1}" for name, one in arguments.items())
        raise ArgumentError(
            f"the arguments have unequal lengths ({shapes}); each must have the same, or one value for all",
            "unequal_lengths",
        ) from None


# --- csv table ---

Row = tuple[float, ...]


class TableError(SimError, ValueError):
    """Error of a file that holds no usable table; the message names file, line and column."""

    default_code = "bad_table"


def read_columns(path: Path, columns: Sequence[str]) -> tuple[Row, ...]:
    """Read the named columns of a CSV file, row by row, in the requested order.

    The first line names the columns, in any order. Others are named in a warning, and refused if they may say which
    rows do not count. Cells are separated by commas, semicolons or tabs; numbers may have a decimal comma. Empty
    lines and lines that begin with # are skipped; a row below the header that is commented out is refused. Raises
    TableError.
    """
    line, names = header_of(path)
    refuse_rejecting(path, line, names, columns)
    rows = tuple(row for _, row in read_numbered(path, columns))
    if text := unread_text(names, columns):
        warn_once(f"{path}: {text}")
    return rows


def unread_text(names: Sequence[str], columns: Sequence[str]) -> str:
    """Return a clause on the columns of a table that are not among those to be read; "" without any."""
    unread = [name or "(without a name)" for name in names if name not in columns]
    more = f" and {len(unread) - _MOST_LISTED} more" * (len(unread) > _MOST_LISTED)
    return f"columns that are not read: {', '.join(unread[:_MOST_LISTED])}{more}" if unread else ""


@cache
def warn_once(text: str) -> None:
    """Log a warning once in a process, which may read a table several times."""
    _log.warning(text)


def header_of(path: Path) -> tuple[int, tuple[str, ...]]:
    """Return the line that names the columns, and the names; line 1 and none in an empty file. Raises TableError."""
    lines = _lines(path)
    return (lines[0][0], tuple(cell.strip() for cell in lines[0][1])) if lines else (1, ())


def read_numbered(path: Path, columns: Sequence[str]) -> tuple[tuple[int, Row], ...]:
    """Read columns as `read_columns`, each row with the number of its line in the file. Raises TableError."""
    lines = _lines(path)
    if not lines:
        raise TableError(f"{path}: the file is empty; it must have the columns {','.join(columns)}", "no_table")
    (first, header), *rows = lines
    order = _column_numbers(path, first, [cell.strip() for cell in header], columns)
    if not rows:
        raise TableError(f"{path}: no rows below line {first}; numbers are required", "no_rows")
    for n, row in rows:
        if len(row) != len(header):
            raise TableError(f"{path}, line {n}: {len(row)} cells, but line {first} has {len(header)}", "row_length")
    numbered = tuple(
        (n, tuple(_number(path, n, name, row[k]) for name, k in zip(columns, order, strict=True))) for n, row in rows
    )
    _refuse_summaries(path, header, rows, columns, numbered)
    return numbered


_PLACES = ("x_mm", "y_mm", "z_mm", "place_mm", "depth_mm")


def _refuse_summaries(
    path: Path, header: list[str], rows: list[tuple[int, list[str]]], columns: Sequence[str],
    numbered: Sequence[tuple[int, Row]],
) -> None:  # fmt: skip
    """Refuse a row that sums up the others, by its label in a column that is not read, or by its numbers."""
    for at, name in enumerate(header):
        labeled = None if name.strip() in columns else labeled_summary([row[at] for _, row in rows])
        if labeled is not None:
            raise TableError(
                f"{path}, line {rows[labeled][0]}, column {name.strip() or '(without a name)'}: "
                f"{rows[labeled][1][at].strip()!r} is the label of a sum, a mean and the like; delete the row, or, "
                "if it is a measurement, the column, which is not read",
                "summary_row",
            )
    table = np.array([row for _, row in numbered])
    is_place = np.isin(columns, _PLACES)
    found = summary_row(table) if is_place.all() else summary_row(table[:, ~is_place], table[:, is_place])
    if found is None:
        return
    has = f"line {numbered[found.row][0]}: has the {found.word} of the other rows"
    if found.sure:
        raise TableError(f"{path}, {has}, and would count as one of them; delete it", "summary_row")
    warn_once(f"{path}, {has} and counts as one of them: delete it if it is not one")


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return the lines that are not empty or comments, with their numbers."""
    try:
        lines = list(lines_of(path, most=MOST_TABLE_BYTES))
        header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
        reader = csv.reader(lines, delimiter=next((one for one in ";\t" if one in header), ","))
        found = [(reader.line_num, row) for row in reader if any(row)]
    except OSError as error:
        raise TableError(f"{path}: {error.strerror or str(error)}", "unreadable") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise TableError(f"{path}: not a CSV file in UTF-8: {error}", "not_csv") from None
    rows = [(n, row) for n, row in found if not row[0].startswith("#")]
    (first, names), *_ = rows or [(0, [])]
    out = next((n for n, row in found if n > first and row[0].startswith("#") and 1 < len(row) == len(names)), 0)
    if out:
        raise TableError(
            f"{path}, line {out}: is commented out with #; delete the line or the sign #, since a row that does not "
            "count is in no table",
            "comment_row",
        )
    return rows


REJECTING = re.compile(r"artifact|artefact|reject|bad|exclude|invalid|noise|valid|keep|good", re.IGNORECASE)
"""Names of columns that may say which rows do not count."""


def refuse_rejecting(path: Path, line: int, names: Sequence[str], columns: Sequence[str]) -> None:
    """Raise TableError for a column that is not among those to be read, and may say which rows do not count."""
    unread = next((name for name in names if name not in columns and REJECTING.search(name)), None)
    if unread is not None:
        raise TableError(
            f"{path}, line {line}: the column {unread!r} may say which rows do not count, and is not read; delete "
            "these rows, and the column",
            "extra_column",
        )


_MOST_LISTED = 20


def _column_numbers(path: Path, line: int, names: list[str], columns: Sequence[str]) -> list[int]:
    for name in columns:
        if names.count(name) != 1:
            raise TableError(
                f"{path}, line {line}: the column {name} must occur once, not {names.count(name)} times; the "
                f"columns are {','.join(columns)}; read {', '.join(names[:_MOST_LISTED])}",
                "column_count",
            )
    return [names.index(name) for name in columns]


LARGEST = 1e100
"""Largest number of a table; its square is one, too."""


def is_number(value: Any) -> Any:
    """Return whether a value from a file, or each of an array, can be computed with: neither NaN nor huge."""
    return abs(value) <= LARGEST


_DECIMAL_COMMA = re.compile(r"([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)\Z")
_MAY_BE_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


def _number(path: Path, line: int, column: str, cell: str) -> float:
    if _MAY_BE_THOUSANDS.fullmatch(cell.strip()):
        raise TableError(
            f"{path}, line {line}, column {column}: {cell.strip()!r} may have a decimal comma or a separator of "
            "thousands; write a point",
            "ambiguous_number",
        )
    try:
        value = read_number(_DECIMAL_COMMA.sub(r"\1.\2", cell.strip()))
    except ValueError:
        value = math.nan
    if not is_number(value):
        raise TableError(f"{path}, line {line}, column {column}: {cell.strip()!r} must be a number", "not_a_number")
    return value


Columns = Mapping[str, NDArray[Any]]


class HasTable(Protocol):
    """Results that have a table of columns, as `Indentations`."""

    def table(self) -> Columns:
        """Return the columns by name."""


ROW = "row"
"""Name of the one dimension of a data set."""


class NotInstalledError(SimError, ImportError):
    """Error of an optional package that is not installed."""

    default_code = "not_installed"


def write_csv(path: str | Path, columns: Columns | HasTable) -> None:
    """Write columns to a CSV file, with their names in the first line and every digit of the numbers.

    Parameters
    ----------
    path : str or Path
        The file.
    columns : Indentations, or mapping of str to ndarray of shape (n,)
        The results of `indent_many`, or columns by name.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from sim import write_csv
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "forces.csv"
    ...     write_csv(path, {"doi_mm": np.array([0.5, 1.0]), "force_gwt": np.array([2.5, 8.0])})
    ...     path.read_text().split()
    ['doi_mm,force_gwt', '0.5,2.5', '1.0,8.0']
    """
    found = _columns(columns)
    with Path(path).open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(found)
        table.writerows(zip(*(values.tolist() for values in found.values()), strict=True))


def to_pandas(columns: Columns | HasTable) -> Any:
    """Return columns as a data frame of pandas.

    Parameters
    ----------
    columns : Indentations, or mapping of str to ndarray of shape (n,)
        The results of `indent_many`, or columns by name.

    Returns
    -------
    pandas.DataFrame
        One column for each name.

    Raises
    ------
    NotInstalledError
        If pandas is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from sim import to_pandas
    >>> to_pandas({"doi_mm": np.array([0.5, 1.0]), "force_gwt": np.array([2.5, 8.0])}).shape
    (2, 2)
    """
    return _installed("pandas").DataFrame(dict(_columns(columns)))


def to_xarray(columns: Columns | HasTable) -> Any:
    """Return columns as a data set of xarray, along the dimension `row`.

    Parameters
    ----------
    columns : Indentations, or mapping of str to ndarray of shape (n,)
        The results of `indent_many`, or columns by name.

    Returns
    -------
    xarray.Dataset
        One variable for each name.

    Raises
    ------
    NotInstalledError
        If xarray is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from sim import to_xarray
    >>> to_xarray({"doi_mm": np.array([0.5, 1.0]), "force_gwt": np.array([2.5, 8.0])}).sizes["row"]
    2
    """
    found = _columns(columns)
    length = len(next(iter(found.values()), ()))
    along = {name: (ROW, values) for name, values in found.items()}
    return _installed("xarray").Dataset(along, coords={ROW: np.arange(length)})


def _columns(given: Columns | HasTable) -> Columns:
    if not isinstance(given, Mapping) and not hasattr(given, "table"):
        raise ArgumentError(
            f"{type(given).__name__} is no table; give the results of indent_many, or columns by name", "no_table"
        )
    return given if isinstance(given, Mapping) else given.table()


def _installed(package: str) -> Any:
    try:
        return import_module(package)
    except ImportError:
        raise NotInstalledError(f"{package} is not installed; install it with pip install {package}") from None
