"""Columns of numbers and words: as a CSV file, or for pandas and xarray where these are installed."""

import csv
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError

Columns = Mapping[str, NDArray[Any]]

ROW = "row"
"""The one dimension of a data set."""


class NotInstalledError(SimError, ImportError):
    """A package that is no part of the simulator is wanted and not there."""

    default_code = "not_installed"


def write_csv(path: str | Path, columns: Columns) -> None:
    """A file with the columns' names in its first line; numbers to the last digit."""
    with Path(path).open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(columns)
        table.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))


def to_pandas(columns: Columns) -> Any:
    """A `pandas.DataFrame` of columns of one length. Raises NotInstalledError."""
    return _installed("pandas").DataFrame(dict(columns))


def to_xarray(columns: Columns) -> Any:
    """An `xarray.Dataset` of columns of one length, along `row`. Raises NotInstalledError."""
    length = len(next(iter(columns.values()), ()))
    along = {name: (ROW, values) for name, values in columns.items()}
    return _installed("xarray").Dataset(along, coords={ROW: np.arange(length)})


def _installed(package: str) -> Any:
    try:
        return import_module(package)
    except ImportError:
        raise NotInstalledError(
            "{package} is not installed: expected pip install {package}", package=package
        ) from None
