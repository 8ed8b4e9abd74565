"""Columns of numbers and words, as a pandas table or an xarray data set where these are installed."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, NDArray[Any]]

ROW = "row"
"""The one dimension of a data set."""


class NotInstalledError(ImportError):
    """A package that is no part of the simulator is wanted and not there."""


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
        raise NotInstalledError(f"{package} is not installed: expected pip install {package}") from None
