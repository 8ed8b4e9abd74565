"""Pressures or readings as they are given on a command line: numbers, or a column of a CSV file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.protocol.errors import BadInputError
from sim.config.csv_table import TableError, read_columns

Array = NDArray[np.float64]

MOST_SAMPLES = 400


def read_pressures(text: str) -> Array:
    """(n,) pressures from `20,14` or a CSV with a column pressure; pseudo-units. Raises BadInputError."""
    values = _numbers(text)
    if values is None:
        try:
            values = np.array(read_columns(Path(text), ("pressure",)))[:, 0]
        except TableError as error:
            raise BadInputError(
                f"--pressure {error}: expected numbers, as 20,14, or a CSV with a column pressure"
            ) from None
    if not 1 <= len(values) <= MOST_SAMPLES:
        raise BadInputError(f"--pressure: {len(values)} samples, expected 1 … {MOST_SAMPLES}")
    wrong = values[~(np.isfinite(values) & (values >= 0))]
    if len(wrong):
        raise BadInputError(f"--pressure {wrong[0]:g}: expected numbers that are not negative, nothing pulls at skin")
    return values


def _numbers(text: str) -> Array | None:
    try:
        return np.array([float(cell) for cell in text.split(",")])
    except ValueError:
        return None
