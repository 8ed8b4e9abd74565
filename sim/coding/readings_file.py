"""Receptor readings and pressures from CSV files (`docs/coding.md`)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.coding.decoder_results import CodingError
from sim.coding.receptor_readings import FEWEST_AT_REST, LOWEST_SD
from sim.coding.section import SPACING_MM, receptor_points, skin_of
from sim.coding.sheet import FEWEST_READINGS as FEWEST_OF_SHEET
from sim.config import FingertipConfig
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorError, points_below
from sim.tables import TableError, header_of, numbers_of, read_numbered, refuse_rejecting, unread_text
from sim.units import PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]

PLACES = ("x_mm", "place_mm")
KINDS = ("sed", "sed_pa", "rate")
NOISE = ("sd", "at_rest")
FEWEST, MOST = 5, 400
DEPTHS_MM = (0.1, 3.0)
_SAME_MM = 1e-6

Placed = Callable[[int, tuple[float, ...]], tuple[float, ...]]
"""Function that returns a receptor's location, given the line number and the cells of its row."""


@dataclass(frozen=True)
class FileReadings:
    """Readings of m receptors, ordered by location.

    Arrays are (m,). `place_mm` is along the skin from x = 0, or for a sheet x of the receptors, with `z_mm` along the
    finger; `depth_mm` is perpendicular below the skin. Rates, or SED in pseudo-units, whichever unit the file has;
    `sd` and `at_rest`, of the unloaded receptors, are in the same unit.
    """

    kind: str
    place_mm: Array
    depth_mm: Array
    reading: Array
    sd: Array | None
    at_rest: Array | None
    z_mm: Array | None = None
    unread_text: str = ""
    """Clause on the columns of the file that are not read."""


def pa_per_pseudo(finger: FingertipConfig) -> float:
    """Return the Pa in one pseudo-unit of a finger."""
    return 1e6 * finger.tissue.e_epidermis_mpa / PSEUDO_E_EPIDERMIS


def read_readings(path: Path, finger: FingertipConfig) -> FileReadings:
    """Read a row or a sheet of receptors (columns in `docs/coding.md`).

    Parameters
    ----------
    path : Path
        The CSV file.
    finger : FingertipConfig
        The finger in which the receptors must lie, and whose stiffness relates Pa to pseudo-units.

    Returns
    -------
    FileReadings

    Raises
    ------
    TableError
        With the file, the line, the column and what was expected.
    """
    first, names = header_of(path)
    where = f"{path}, line {first}"
    place, kind = _one_of(where, names, PLACES), _one_of(where, names, KINDS)
    noise = [name for name in NOISE if name in names]
    if len(noise) > 1:
        raise TableError(
            f"{where}: the columns {' and '.join(noise)} cannot be combined; keep one", "columns_together"
        )
    if kind == "rate" and noise == ["at_rest"]:
        raise TableError(
            f"{where}: a column rate requires sd, not at_rest, since the noise of a silent receptor is hidden",
            "at_rest_beside_rate",
        )
    along = ["z_mm"] if "z_mm" in names else []
    if along and place != "x_mm":
        raise TableError(f"{where}: a column z_mm requires x_mm, not {place}", "sheet_without_x")
    columns = (place, "depth_mm", kind, *noise, *along)
    refuse_rejecting(path, first, names, (*columns, "noise"))  # which may be meant as sd
    found = _Rows(path, columns, noise, read_numbered(path, columns)).checked(finger)
    return replace(found, unread_text=unread_text(names, columns))


def _one_of(where: str, names: Sequence[str], columns: Sequence[str]) -> str:
    found = [name for name in columns if name in names]
    if len(found) != 1:
        raise TableError(
            f"{where}: must have exactly one of the columns {', '.join(columns)}; found {len(found)}, read "
            f"{', '.join(names) or 'nothing'}",
            "not_one_column",
        )
    return found[0]


@dataclass(frozen=True)
class _Rows:
    """Table rows: location, depth, reading and, if present, the columns of noise and of z."""

    path: Path
    columns: tuple[str, ...]
    noise: list[str]
    numbered: tuple[tuple[int, tuple[float, ...]], ...]

    @property
    def place(self) -> str:
        """Name of the location column."""
        return self.columns[0]

    @property
    def kind(self) -> str:
        """Name of the reading column."""
        return self.columns[2]

    @property
    def sheet(self) -> bool:
        """Whether receptors are spread along the finger too."""
        return self.columns[-1] == "z_mm"

    def checked(self, finger: FingertipConfig) -> FileReadings:
        fewest = FEWEST_OF_SHEET if self.sheet else FEWEST
        if not fewest <= len(self.numbered) <= MOST:
            raise TableError(f"{self.path}: {len(self.numbered)} readings; must be {fewest} to {MOST}", "wrong_count")
        placed = self._placed_in_space(finger) if self.sheet else self._placed_on_skin(finger)
        locations = np.array([placed(n, row) for n, row in self.numbered])
        self._refuse_twice(locations)
        self._refuse_noise()
        self._refuse_low()
        order = np.lexsort(locations.T[::-1])
        reading, *noise = np.array([row[2 : 3 + len(self.noise)] for _, row in self.numbered])[order].T
        unit = pa_per_pseudo(finger) if self.kind == "sed_pa" else 1.0
        known = {name: values / unit for name, values in zip(self.noise, noise, strict=True)}
        location, depth, *along = locations[order].T
        z_mm = along[0] if along else None
        return FileReadings(self.kind, location, depth, reading / unit, known.get("sd"), known.get("at_rest"), z_mm)

    def _refused(self, code: str, n: int, column: str, value: float, expected: str) -> TableError:
        return TableError(f"{self.path}, line {n}, column {column}: {float(value):g} must be {expected}", code)

    def _misplaced(self, n: int, column: str, error: ModelRangeError | ReceptorError) -> TableError:
        return TableError(f"{self.path}, line {n}, column {column}: {error}", error.code)

    def _column(self, k: int) -> Iterator[tuple[int, float]]:
        return ((n, row[k]) for n, row in self.numbered)

    def _placed_on_skin(self, finger: FingertipConfig) -> Placed:
        """Return the function that gives a receptor's location on the skin and its depth."""
        line = skin_of(finger)

        def of(n: int, row: tuple[float, ...]) -> tuple[float, ...]:
            where, depth = row[0], self._depth(n, row)
            try:
                location = line.above(where, depth) if self.place == "x_mm" else where
                receptor_points(finger, line, location, depth)
            except (ModelRangeError, ReceptorError) as error:
                raise self._misplaced(n, self.place, error) from None
            return location, depth

        return of

    def _placed_in_space(self, finger: FingertipConfig) -> Placed:
        """Return the function that gives x, depth and z of a receptor in the whole finger."""
        surface = FingertipSurface.fit(finger.geometry)

        def of(n: int, row: tuple[float, ...]) -> tuple[float, ...]:
            x, depth, z = row[0], self._depth(n, row), row[-1]
            try:
                points_below(finger, surface, x, depth, z)
            except ReceptorError as error:
                raise self._misplaced(n, "x_mm and z_mm", error) from None
            return x, depth, z

        return of

    def _depth(self, n: int, row: tuple[float, ...]) -> float:
        if not DEPTHS_MM[0] <= row[1] <= DEPTHS_MM[1]:
            raise self._refused(
                "outside_range", n, "depth_mm", row[1], f"{DEPTHS_MM[0]:g} to {DEPTHS_MM[1]:g} mm below the skin"
            )
        return row[1]

    def _refuse_twice(self, locations: Array) -> None:
        for k, location in enumerate(locations):
            same = np.flatnonzero(np.abs(locations[:k] - location).max(axis=1) < _SAME_MM)
            if len(same):
                first = self.numbered[same[0]][0]
                expected = f"given once per receptor location; line {first} has the same location"
                raise self._refused("same_place", self.numbered[k][0], self.place, location[0], expected)

    def _refuse_noise(self) -> None:
        if self.noise == ["sd"]:
            for n, sd in self._column(3):
                if sd <= 0:
                    raise self._refused("not_positive", n, "sd", sd, "a positive number")
        if self.noise == ["at_rest"] and len({value for _, value in self._column(3)}) < FEWEST_AT_REST:
            raise TableError(
                f"{self.path}, at_rest: must contain at least {FEWEST_AT_REST} different values", "too_little_noise"
            )

    def _refuse_low(self) -> None:
        """Raise TableError for energies and rates below 0 by more than noise, and if no reading is above 0."""
        noise = [value for _, value in self._column(3)] if self.noise else [0.0] * len(self.numbered)
        if self.noise == ["at_rest"]:
            noise = [float(np.std(noise, ddof=1))] * len(noise)
        for (n, value), sd in zip(self._column(2), noise, strict=True):
            if value < (0 if self.kind == "rate" else -LOWEST_SD * sd):
                negative = bool(self.noise) and self.kind != "rate"
                expected = f"{-LOWEST_SD * sd:.3g} or more (the noise)" if negative else "0 or more"
                raise self._refused("negative", n, self.kind, value, expected)
        if not any(value > 0 for _, value in self._column(2)):
            raise TableError(
                f"{self.path}, column {self.kind}: no reading is above 0; at least one receptor must respond",
                "none_above_zero",
            )


MOST_SAMPLES = 400


_PLACED = 0.02  # largest error of a place, of the spacing


def read_pressures(path: Path, spacing_mm: float = SPACING_MM) -> Array:
    """Read the column `pressure` (pseudo-units) of a CSV file, one sample of skin a row.

    The samples are `spacing_mm` apart about the middle of the pad; columns `x_mm` or `place_mm` must agree. Raises
    TableError for another column, an empty row or other places, and CodingError as `checked_pressures`.
    """
    line, names = header_of(path)
    where = f"{path}, line {line}"
    unknown = [name for name in names if name not in ("pressure", *PLACES)]
    if "pressure" in names and unknown:
        raise TableError(
            f"{where}: the column {unknown[0]!r} is unknown; the columns are pressure, and x_mm or place_mm if "
            "you like",
            "extra_column",
        )
    place = [_one_of(where, names, PLACES)] if set(PLACES) & set(names) else []
    numbered = read_numbered(path, ("pressure", *place))
    for (before, _), (n, _) in pairwise(numbered):
        if n != before + 1:
            raise TableError(
                f"{path}, line {before + 1}: has no pressure; each row is the next sample of skin: write 0, or "
                "delete it",
                "empty_row",
            )
    if place:
        _refuse_other_places(path, place[0], [(n, row[1]) for n, row in numbered], spacing_mm)
    return checked_pressures([row[0] for _, row in numbered])


def _refuse_other_places(path: Path, column: str, numbered: Sequence[tuple[int, float]], spacing_mm: float) -> None:
    middle = (len(numbered) - 1) / 2
    for k, (n, at) in enumerate(numbered):
        expected_mm = spacing_mm * (k - middle)
        if abs(at - expected_mm) > _PLACED * spacing_mm:
            raise TableError(
                f"{path}, line {n}, column {column}: {at:g} must be {expected_mm + 0.0:.3g}, since places must rise "
                f"by {spacing_mm:g} mm (--spacing-mm) about 0, the middle of the pad",
                "other_place",
            )


def checked_pressures(values: ArrayLike) -> Array:
    """Return 1 to 400 pressures as an (n,) array. Raises CodingError for more, none, or what is not finite or < 0."""
    pressure = np.atleast_1d(numbers_of("pressure", values))
    if not 1 <= len(pressure) <= MOST_SAMPLES:
        raise CodingError(
            f"pressure: {len(pressure)} samples; must be 1 to {MOST_SAMPLES}", "wrong_count", ("pressure",)
        )
    wrong = pressure[~(np.isfinite(pressure) & (pressure >= 0))]
    if len(wrong):
        raise CodingError(
            f"pressure {float(wrong[0]):g}: pressures must be finite, and 0 or more", "negative", ("pressure",)
        )
    return pressure
