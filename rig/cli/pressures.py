"""Pressures or readings as they are given on a command line: numbers, or a column of a CSV file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import code_of, fields_of
from rig.protocol.errors import BadInputError
from sim.tables import TableError, read_columns

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
                "--pressure {problem}: expected numbers, as 20,14, or a CSV with a column pressure",
                code=code_of(error),
                **{**fields_of(error), "problem": str(error)},
            ) from None
    if not 1 <= len(values) <= MOST_SAMPLES:
        raise BadInputError(
            "{option}: {numbers} samples, expected 1 … {most}",
            code="wrong_count", option="--pressure", numbers=len(values), most=MOST_SAMPLES,
        )  # fmt: skip
    wrong = values[~(np.isfinite(values) & (values >= 0))]
    if len(wrong):
        raise BadInputError(
            "{option} {value:g}: expected numbers that are not negative, nothing pulls at skin",
            code="negative", option="--pressure", value=float(wrong[0]),
        )  # fmt: skip
    return values


def _numbers(text: str) -> Array | None:
    try:
        return np.array([float(cell) for cell in text.split(",")])
    except ValueError:
        return None
