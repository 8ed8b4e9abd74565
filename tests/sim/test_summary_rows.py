"""Rows of sums and means in the files that the library reads, and columns in which there are none."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from rig_shared.summary_rows import labeled_summary, summary_row
from sim.coding.readings_file import read_pressures, read_readings
from sim.config import POINT_COLUMNS, SECTION_COLUMNS, FingertipConfig
from sim.contact.measured_profile import ProfileError, read_profile
from sim.contact.shapes import ShapeError, parse_shape
from sim.errors import SimError
from sim.tables import TableError, read_columns
from tests.error_codes import raises

Array = NDArray[np.float64]
SUMMARIES: dict[str, Callable[..., Any]] = {"sum": np.sum, "mean": np.mean}

# --- the readers ---


def pressures() -> Array:
    return np.round(20 * np.exp(-(np.linspace(-2, 2, 21) ** 2)), 2)[:, None]


def profile() -> Array:
    x = np.linspace(2, 4, 21)
    return np.round(np.stack([x, 0.5 * (1 - np.sqrt(1 - 0.75 * (x - 3) ** 2))], axis=1), 4)


def readings() -> Array:
    x = np.linspace(-2, 2, 21)
    return np.round(np.stack([x, np.full(21, 0.76), 3 * np.exp(-(x**2)) + 0.01 * x], axis=1), 4)


def sections() -> Array:
    z = np.linspace(1, 12, 12)
    return np.round(np.stack([z, 7 - 0.02 * z**2, 8 - 0.03 * z**2, 0.1 * np.sin(z)], axis=1), 3)


def points() -> Array:
    angle, z = np.meshgrid(np.linspace(-1, 1, 7), np.linspace(1, 12, 7))
    return np.round(np.stack([7 * np.sin(angle), 7 * np.cos(angle) - 0.02 * z**2, z], axis=-1).reshape(-1, 3), 3)


def heights() -> Array:
    x = np.linspace(-1.5, 1.5, 21)
    far = (x**2)[:, None] + x**2, ((x - 0.8) ** 2)[:, None] + (x - 0.8) ** 2
    return np.round(0.4 * np.exp(-far[0] / 0.3) + 0.2 * np.exp(-far[1] / 0.1), 4)


class Reader(NamedTuple):
    """Reader of a file, its columns, a table that it reads, and the rows of summaries that are told from others."""

    read: Callable[[Path], object]
    columns: tuple[str, ...]
    table: Callable[[], Array]
    refused: tuple[str, ...]


MAP = ",spacing_mm=0.15,raised=high"
READERS = {
    "pressures": Reader(read_pressures, ("pressure",), pressures, ("sum last", "mean last", "mean first")),
    "profile": Reader(lambda path: read_profile(str(path)), ("x_mm", "height_mm"), profile, ("sum last",)),
    "readings": Reader(
        lambda path: read_readings(path, FingertipConfig()), ("x_mm", "depth_mm", "sed"), readings,
        ("mean last", "mean first", "sum last"),
    ),
    "sections": Reader(
        lambda path: read_columns(path, SECTION_COLUMNS), SECTION_COLUMNS, sections,
        ("mean last", "mean first", "sum last"),
    ),
    "points": Reader(
        lambda path: read_columns(path, POINT_COLUMNS), POINT_COLUMNS, points, ("mean last", "mean first", "sum last")
    ),
    "heights": Reader(
        lambda path: parse_shape(f"heightmap:{path}{MAP}"), (), heights,
        ("mean last", "mean first", "sum last", "sum first"),
    ),
}  # fmt: skip


def with_summary(table: Array, summary: str) -> Array:
    what, _, where = summary.partition(" ")
    row = np.round(SUMMARIES[what](table, axis=0), 4)
    return np.vstack([row, table] if where == "first" else [table, row])


def write(path: Path, columns: tuple[str, ...], table: Array) -> Path:
    lines = [",".join(f"{cell:.6g}" for cell in row) for row in table]
    path.write_text("\n".join([*([",".join(columns)] if columns else []), *lines]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("name", READERS)
def test_a_table_without_summaries_is_read(name: str, tmp_path: Path) -> None:
    reader = READERS[name]
    reader.read(write(tmp_path / "a.csv", reader.columns, reader.table()))


@pytest.mark.parametrize(("name", "summary"), [(name, one) for name in READERS for one in READERS[name].refused])
def test_a_first_or_last_row_with_the_sum_or_mean_of_the_others_is_refused(
    name: str, summary: str, tmp_path: Path
) -> None:
    reader = READERS[name]
    table = with_summary(reader.table(), summary)
    line = (len(table) if "last" in summary else 1) + bool(reader.columns)
    code, kind = ("summary_among_heights", ShapeError) if name == "heights" else ("summary_row", SimError)
    with raises(kind, code, line=line, what=summary.partition(" ")[0]):
        reader.read(write(tmp_path / "a.csv", reader.columns, table))


def test_a_sum_below_a_mean_does_not_hide_it(tmp_path: Path) -> None:
    column = pressures()
    both = np.vstack([column, np.round(column.mean(axis=0), 2), column.sum(axis=0)])
    with raises(TableError, "summary_row", line=23, what="mean"):
        read_pressures(write(tmp_path / "p.csv", ("pressure",), both))
    with raises(ProfileError, "summary_row", line=23, what="sum"):
        both = np.vstack([profile(), profile().sum(axis=0), profile().sum(axis=0) + 1])
        read_profile(str(write(tmp_path / "f.csv", ("x_mm", "height_mm"), both)))


WITHOUT_ITS_PLACE = {
    "a mean at the next place": (2.1, np.mean),
    "a sum at the next place": (2.1, np.sum),
    "a mean at 0": (0.0, np.mean),
}


@pytest.mark.parametrize("name", WITHOUT_ITS_PLACE)
def test_a_sum_or_mean_at_any_place_of_an_equally_spaced_table_is_refused(name: str, tmp_path: Path) -> None:
    """Its reading alone has the digits: the next of equally spaced places is what a copied row of numbers gets."""
    place, of = WITHOUT_ITS_PLACE[name]
    x = np.round(np.arange(-2, 2.05, 0.1), 1)
    sed = np.round(30 * np.exp(-(x**2)) + 0.01 * x**2, 3)
    rows = np.column_stack([np.append(x, place), np.full(len(x) + 1, 0.76), np.append(sed, np.round(of(sed), 3))])
    with raises(TableError, "summary_row", line=len(x) + 2):
        read_columns(write(tmp_path / "a.csv", ("x_mm", "depth_mm", "sed"), rows), ("x_mm", "depth_mm", "sed"))


LABELED = ("mean", "Total", "min", "max", "SD", "median", "n", "SEM", "Mittelwert", "moyenne", "gemiddelde", "\u00d8",
           "\u03a3", "m\u00e9dia", "\u0441\u0440\u0435\u0434\u043d\u0435\u0435", "\u5e73\u5747",
           "95% CI", "mean of 3 rows")  # fmt: skip


@pytest.mark.parametrize("label", LABELED)
def test_a_row_that_a_column_of_labels_calls_a_summary_is_refused(label: str, tmp_path: Path) -> None:
    """Also where its numbers do not tell: the largest pressure stands as the last sample of skin."""
    path = tmp_path / "p.csv"
    path.write_text(f"row,pressure\n1,2\n2,20\n3,5\n{label},20\n", encoding="utf-8")
    with raises(TableError, "summary_row", line=5, column="row"):
        read_columns(path, ("pressure",))


NO_SUMMARIES = (["min", "max", "min", "max"], ["low", "min", "max", "min", "max"], ["mean", "mean"], ["SD12", "SD13"],
                ["1", "2", "3"], ["y", "n", "n", "y"])  # fmt: skip


@pytest.mark.parametrize("labels", NO_SUMMARIES, ids=str)
def test_labels_of_conditions_and_of_all_rows_are_no_summaries(labels: list[str]) -> None:
    assert labeled_summary(labels) is None


@pytest.mark.parametrize(
    "column",
    [
        *([5] * 9, [0] * 9, [20, 14], [1, 2, 3], [2, 3, 5], [0, 0, 5, 9, 5, 0, 0], [7], [0] * 4 + [5, 5]),
        *([1.2, 0.1, 0.0, 0.1, 1.2], [0.1, 0.4, 0.1, 0.2, 0.9]),  # one digit: 1.2 for 1.4, and 0.9 for 0.8
    ],
)
def test_short_constant_and_coarse_columns_are_no_summaries(column: list[float]) -> None:
    assert summary_row(np.array(column, dtype=float)[:, None]) is None


def test_the_total_of_a_constant_column_is_a_summary() -> None:
    assert summary_row(np.array([5.0] * 9 + [45.0])[:, None]) == (9, "sum", True)


# --- an axis among heights ---

AXIS = 0.15 * (np.arange(21) - 10)
WITH_AXES: dict[str, Callable[[Array], Array]] = {
    "first row": lambda table: np.vstack([AXIS, table]),
    "first row in um": lambda table: np.vstack([1000 * AXIS, table]),
    "first row of numbers": lambda table: np.vstack([np.arange(21), table]),
    "first column": lambda table: np.column_stack([AXIS[::-1], table]),
    "first row, beside a first column": lambda table: np.vstack(
        [np.append(0.0, AXIS), np.column_stack([AXIS[::-1], table])]
    ),
    "last column": lambda table: np.column_stack([table, AXIS]),
}


@pytest.mark.parametrize("suffix", ["csv", "npy"])
@pytest.mark.parametrize("name", WITH_AXES)
def test_a_row_or_column_of_positions_among_heights_is_refused(name: str, suffix: str, tmp_path: Path) -> None:
    """As of a data frame with the positions as the names of its columns."""
    table, path = WITH_AXES[name](heights()), tmp_path / f"a.{suffix}"
    np.save(path, table) if suffix == "npy" else write(path, (), table)
    with raises(ShapeError, "axis_among_heights", side=" ".join(name.split()[:2]).rstrip(",")):
        parse_shape(f"heightmap:{path}{MAP}")


# --- none by chance ---


def random_pressures(rng: np.random.Generator) -> Array:
    n = int(rng.integers(6, 60))
    u = 2 * (np.arange(n) - (n - 1) / 2 + rng.uniform(-2, 2)) / (n * rng.uniform(0.15, 0.7))
    smooth, edges = np.exp(-(u**2)), 1 / np.sqrt(np.maximum(1.02 - u**2, 0.02))
    kinds = (
        smooth,
        np.sqrt(np.maximum(0, 1 - u**2)),
        1.0 * (np.abs(u) < 1),  # a flat top
        np.where(np.abs(u) < 1, edges, 0) * (1 + rng.uniform(-0.5, 0.5) * u),  # edges of a bar
        np.maximum(0, smooth + rng.normal(0, 0.05, n)),
        np.maximum(0, 1 - np.abs(u)),
    )
    column = kinds[rng.integers(len(kinds))]
    if rng.random() < 0.25 and (column > 0).sum() > 5:  # in contact only
        column = column[column > 0]
    return np.round(rng.uniform(5, 60) * column, int(rng.choice([0, 1, 2, 3, 8])))[:, None]


def random_profile(rng: np.random.Generator) -> Array:
    digits = int(rng.choice([1, 2, 3, 4, 12]))
    x = np.unique(np.round(np.linspace(-rng.uniform(0.2, 4), rng.uniform(0.2, 4), rng.integers(5, 80)), digits))
    u = x / np.abs(x).max()
    kinds = u**2, 1 - np.sqrt(1 - 0.9 * u**2), np.abs(u), 1.0 * (np.abs(u) > 0.5), 0.5 * np.cos(6 * u)
    return np.stack([x, np.round(rng.uniform(0.05, 2) * kinds[rng.integers(len(kinds))], digits)], axis=1)


def random_readings(rng: np.random.Generator) -> Array:
    n = int(rng.integers(6, 60))
    x = np.linspace(-3, 3, n)
    reading = 40 * np.exp(-(x**2)) + rng.normal(0, 0.3, n)
    table = np.stack([np.round(x, 2), np.full(n, 0.76), np.round(reading, int(rng.integers(4)))], axis=1)
    return table if rng.random() < 0.5 else rng.permutation(table)


@pytest.mark.parametrize("draw", [random_pressures, random_profile, random_readings])
def test_no_row_of_random_tables_counts_as_a_summary(draw: Callable[..., Array]) -> None:
    rng = np.random.default_rng(11)
    found = [(table, summary_row(table[:, -1:], table[:, :-1])) for table in (draw(rng) for _ in range(200))]
    assert [table.tolist() for table, one in found if one is not None and one.sure] == []


def random_heights(rng: np.random.Generator) -> tuple[Array, float]:
    rows, columns = rng.integers(4, 40, 2)
    spacing_mm = float(rng.choice([0.02, 0.05, 0.1, 0.15, 0.25]))
    x, z = np.meshgrid(*(spacing_mm * (np.arange(n) - (n - 1) / 2) for n in (columns, rows)))
    half, (a, b) = max(rows, columns) * spacing_mm / 2, rng.uniform(-0.4, 0.4, 2)
    r, tilted = np.hypot(x - a * half, z - b * half), a * x + b * z
    kinds = (
        0.4 * np.exp(-((r / half / 0.4) ** 2)),
        -np.maximum(np.abs(x), np.abs(z)),
        -(r**2) / (2 * rng.uniform(1, 8)),
        -np.abs(x + a * z),
        tilted,
        tilted + 0.4 * np.exp(-((r / half / 0.3) ** 2)),
        0.2 * np.cos(2 * np.pi * x / (half * rng.uniform(0.3, 1))),
        0.4 * (r < 0.5 * half),
        0.3 * ((np.abs(x) < 0.3 * half) & (z > -0.6 * half)),
    )
    height = rng.uniform(0.2, 1.5) * kinds[rng.integers(len(kinds))] + rng.normal(
        0, 0.01 * (rng.random() < 0.3), r.shape
    )
    return np.round(height, int(rng.choice([1, 2, 3, 4, 12]))), spacing_mm


def test_no_row_of_random_maps_counts_as_an_axis_or_a_summary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.contact.map_files.HeightMap.from_arrays", lambda *_, **__: None)  # splines are slow
    rng, wrong = np.random.default_rng(3), []
    for _ in range(200):
        height, spacing_mm = random_heights(rng)
        np.save(tmp_path / "a.npy", height)
        try:
            parse_shape(f"heightmap:{tmp_path / 'a.npy'},spacing_mm={spacing_mm},raised=high,edge_mm=0")
        except ShapeError as error:
            wrong += [str(error)] if error.code in ("axis_among_heights", "summary_among_heights") else []
    assert wrong == []
