"""Recorded spatial response profiles (SRP), read from a user's CSV.

Columns `position_mm,rate[,sd][,repeat]`: the indentor's reference point from the receptive field's centre in the
finger's frame, and the discharge rate (any unit, ≥ 0). Rows of one position need a `repeat`.
"""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.compare.errors import RecordingError

Array = NDArray[np.float64]

_COLUMNS = ("position_mm", "rate", "sd", "repeat")
_FEWEST_POSITIONS = 3


@dataclass(frozen=True)
class Recording:
    """Rates against position, for one shape.

    `position_mm` (p,) ascending; `repeats` the rates at each; `sd` (p,) over repeats or as given, NaN where unknown.
    `window_s` is what the spikes of each press were counted in: rate × window is a count. None where it is not known.
    """

    name: str
    position_mm: Array
    repeats: tuple[Array, ...]
    sd: Array
    changes: tuple[str, ...] = ()  # what was done to the file's numbers, for every plot
    sha256: str = ""  # of the file
    window_s: float | None = None

    @property
    def rate(self) -> Array:
        """(p,) mean over repeats."""
        return np.array([rates.mean() for rates in self.repeats])

    @property
    def repeated(self) -> bool:
        """Whether every position was recorded at least twice."""
        return min(len(rates) for rates in self.repeats) > 1

    def mirrored(self) -> "Recording":
        """Positions negated: for profiles published in the mirror image of the finger's frame."""
        return replace(
            self,
            position_mm=-self.position_mm[::-1],
            repeats=self.repeats[::-1],
            sd=self.sd[::-1],
            changes=(*self.changes, "mirrored"),
        )

    def normalised(self, largest: float) -> "Recording":
        """Rates as parts of a family's largest mean rate; the window grows with them, so that counts stay."""
        repeats = tuple(rates / largest for rates in self.repeats)
        changes = (*self.changes, f"rates divided by {largest:g}")
        window_s = None if self.window_s is None else self.window_s * largest
        return replace(self, repeats=repeats, sd=self.sd / largest, changes=changes, window_s=window_s)


def recording(name: str, rows: list[tuple[float, float, float]], window_s: float | None = None) -> Recording:
    """A recording from (position_mm, rate, sd or NaN) of every repeat, in any order; the window of counts."""
    places = sorted({position for position, _, _ in rows})
    repeats = tuple(np.array([rate for position, rate, _ in rows if position == place]) for place in places)
    given = [next(sd for position, _, sd in rows if position == place) for place in places]
    sd = [np.std(r, ddof=1) if len(r) > 1 else g for r, g in zip(repeats, given, strict=True)]
    return Recording(name, np.array(places), repeats, np.array(sd), window_s=window_s)


def read_srp(path: Path) -> Recording:
    """Read a CSV of position and rate. Raises RecordingError, naming row (the header is 1) and column."""
    rows: list[tuple[float, float, float]] = []
    seen: dict[tuple[float, str], int] = {}
    for number, row in csv_rows(path, required=_COLUMNS[:2], optional=_COLUMNS[2:]):
        where = f"{path}, row {number}"
        position = csv_number(row["position_mm"], where, "position_mm")
        rate = csv_number(row["rate"], where, "rate", least=0.0)
        sd = csv_number(row["sd"], where, "sd", least=0.0) if row.get("sd") else math.nan
        place = (position, row.get("repeat", ""))
        if place in seen:
            raise RecordingError(
                f"{where}, column position_mm: {position:g} again (first in row {seen[place]}), "
                "expected another value in a column repeat"
            )
        seen[place] = number
        rows.append((position, rate, sd))
    found = recording(path.name, rows)
    if len(found.repeats) < _FEWEST_POSITIONS:
        raise RecordingError(f"{path}: {len(found.repeats)} positions, expected {_FEWEST_POSITIONS} or more")
    return found


def csv_rows(
    path: Path, required: tuple[str, ...], optional: tuple[str, ...] = ()
) -> Iterator[tuple[int, dict[str, str]]]:
    """Row numbers and stripped cells of a CSV whose header has the required columns and no unknown ones."""
    lines = _lines(path)
    expected = ",".join(required) + "".join(f"[,{name}]" for name in optional)
    header = lines[0] if lines else []
    problem = next((f"no column {name}" for name in required if name not in header), None)
    unknown = [name for name in header if name not in (*required, *optional) or header.count(name) > 1]
    if problem or unknown:
        raise RecordingError(f"{path}, row 1: {problem or f'column {unknown[0]!r}'}, expected {expected}")
    for number, cells in enumerate(lines[1:], 2):
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise RecordingError(f"{path}, row {number}: {len(cells)} cells, expected {len(header)}")
        yield number, dict(zip(header, cells, strict=True))


def csv_header(path: Path) -> list[str]:
    """The names of the columns; none of an empty file."""
    return (_lines(path) or [[]])[0]


def _lines(path: Path) -> list[list[str]]:
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: not a CSV file in UTF-8: {error}") from None
    return [[cell.strip() for cell in cells] for cells in lines]


def csv_number(text: str, where: str, column: str, least: float = -math.inf) -> float:
    """A finite number that is not below `least`."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= least):
        expected = "a number" if least == -math.inf else f"a number of {least:g} or more"
        raise RecordingError(f"{where}, column {column}: {text!r}, expected {expected}")
    return value
