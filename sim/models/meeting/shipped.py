"""Tables that come with the program, of the default finger under usual shapes: nobody waits for them.

`python -m studies.meeting.shipped` makes them; `tests/rig/test_meeting_shipped.py` holds them to direct presses.
"""

import json
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.models.cache import Arrays
from sim.models.meeting.shape_table import Scope, ShapeTable

FILE = "meeting_tables.json"
_DIGITS = 5  # of ln force, and of a height in mm


def shipped(indentor: str, scope: Scope) -> ShapeTable | None:
    """Of the default finger; None where there is none of this shape and scope."""
    kept = _content()
    if indentor not in kept["tables"] or not _alike(kept["scope"], scope.about):
        return None
    arrays: Arrays = {name: np.array(values) for name, values in kept["tables"][indentor].items()}
    return ShapeTable(indentor, scope, arrays)


def as_json(tables: Iterable[ShapeTable]) -> str:
    """The file, of tables of one scope."""
    tables = list(tables)
    told = {table.indentor: {name: _rounded(values) for name, values in table.arrays.items()} for table in tables}
    return json.dumps({"scope": tables[0].scope.about, "tables": told})


def _rounded(values: NDArray[np.generic]) -> Any:
    return np.round(np.asarray(values, dtype=float), _DIGITS).tolist()


def _alike(kept: list[list[Any]], about: list[list[Any]]) -> bool:
    """Whether two scopes are the same, but for the last digit of a logarithm."""
    names = [[axis[0], axis[3]] for axis in kept] == [[axis[0], axis[3]] for axis in about]
    return names and bool(np.allclose([axis[1:3] for axis in kept], [axis[1:3] for axis in about], rtol=1e-9))


@cache
def _content() -> dict[str, Any]:
    content: dict[str, Any] = json.loads((files("sim") / "data" / FILE).read_text(encoding="utf-8"))
    return content
