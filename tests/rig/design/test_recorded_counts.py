"""Verdict on the counts of a session, and tables of counts that are refused."""

from pathlib import Path

import numpy as np
import pytest

from rig.compare.exceptions import RecordingError
from rig.design.counts import CountModel
from rig.design.fibers import Unknowns, draw_fibers, relative_rates
from rig.design.press_times import PressTimes
from rig.design.recorded_counts import FITS, CountedPress, read_counts, session_verdict
from rig.design.response_table import ResponseTable
from tests.error_codes import raises

THREE = ("ep1", "sed", "e22")
MODEL = CountModel(1.0, Unknowns())
GOOD = "shape,x_mm,doi_mm,count\nbar:1.5,1.7,0.25,3\nbar:3,-0.17,1,12\n"


def a_session(table: ResponseTable, name: str, seed: int) -> list[CountedPress]:
    """Return Poisson counts of a fiber that follows a candidate, under every second press."""
    chance = np.random.default_rng(seed)
    fiber = draw_fibers(1, table, MODEL.unknowns, seed, evenly=False)
    mean = 60 * relative_rates(table, name, fiber)[0]
    return [CountedPress(k, float(chance.poisson(mean[k]))) for k in chance.permutation(len(mean))[::2].tolist()]


@pytest.mark.parametrize("name", THREE)
def test_the_candidate_that_made_the_counts_is_found(table: ResponseTable, times: PressTimes, name: str) -> None:
    found = session_verdict(table, times, THREE, MODEL, a_session(table, name, 5), 2048, 1)
    assert sum(row.probability for row in found.candidates) == pytest.approx(1.0)
    best = found.candidates[0]
    assert (best.name, best.in_set) == (name, True)
    assert best.probability > 0.95
    assert best.p_fit > FITS
    assert found.presses == len(table.presses) // 2


def test_counts_that_no_candidate_makes(table: ResponseTable, times: PressTimes) -> None:
    chance = np.random.default_rng(0)
    noise = [CountedPress(k, float(chance.choice([0, 60]))) for k in range(0, len(table.presses), 2)]
    found = session_verdict(table, times, THREE, MODEL, noise, 1024, 1)
    assert max(row.p_fit for row in found.candidates) < FITS


def test_a_table_of_counts(table: ResponseTable, tmp_path: Path) -> None:
    path = tmp_path / "counts.csv"
    path.write_text(GOOD, encoding="utf-8")
    found = read_counts(path, table.presses, 1.0)
    assert [(table.presses[k].shape, table.presses[k].target, count) for k, count in found] == [
        ("bar:1.5", 0.25, 3.0),
        ("bar:3.0", 1.0, 12.0),
    ]


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        (",12", ",nan", "no_number"),
        (",12", ",1.5", "no_whole_number"),
        ("bar:3,", "bar:4,", "shape_not_designed"),
        ("-0.17", "-0.2", "press_not_designed"),
        (",count", ",rates", "no_column"),
        ("0.25,", "0.2,", "press_not_designed"),  # a depth that was not among those of the design
    ],
)
def test_tables_that_are_refused(table: ResponseTable, tmp_path: Path, old: str, new: str, code: str) -> None:
    path = tmp_path / "counts.csv"
    path.write_text(GOOD.replace(old, new), encoding="utf-8")
    with raises(RecordingError, code):
        read_counts(path, table.presses, 1.0)


FOUR = ("bar:1.5,1.7,0.25,3", "bar:3,-0.17,1,12", "bar:3,-0.17,1,9", "bar:1.5,1.7,0.25,4")
SILENT = tuple(row.rpartition(",")[0] + ",0" for row in FOUR)


@pytest.mark.parametrize(
    ("rows", "row"),
    [
        ((*FOUR, *FOUR), 6),
        ((*FOUR, *FOUR, *FOUR), 6),
        ((*FOUR, *FOUR[:3]), 6),
        ((*FOUR, "bar:3,-0.17,1,999"), 6),
        ((*FOUR, "bar:3,-0.17,1,28"), 6),
        (("bar:3,-0.17,1,28", *FOUR), 2),
        ((*FOUR, *FOUR[::-1]), None),
        ((*SILENT, *SILENT), None),
    ],
    ids=[
        "appended to itself",
        "twice",
        "in part",
        "no data",
        "a sum below",
        "a sum above",
        "counts that were found again",
        "a silent fiber",
    ],
)
def test_a_count_is_of_one_press(
    table: ResponseTable, tmp_path: Path, rows: tuple[str, ...], row: int | None
) -> None:
    path = tmp_path / "counts.csv"
    path.write_text("\n".join(["shape,x_mm,doi_mm,count", *rows]), encoding="utf-8")
    if row is None:
        assert len(read_counts(path, table.presses, 1.0)) == len(rows)
        return
    with pytest.raises(RecordingError, match=f"row {row}, column count") as caught:
        read_counts(path, table.presses, 1.0)
    assert caught.value.code in ("place_twice", "no_number", "totals")


@pytest.mark.parametrize(
    ("window", "hold_s", "code"),
    [("window_s,1", 1.0, None), ("window_ms,1000", 1.0, None), ("window_s,0.5", 1.0, "other_window")],
)
def test_counts_belong_to_the_hold(
    table: ResponseTable, tmp_path: Path, window: str, hold_s: float, code: str | None
) -> None:
    """Counts over half of a hold were taken for those of the whole hold."""
    path, (name, value) = tmp_path / "counts.csv", window.split(",")
    header, *rows = GOOD.splitlines()
    path.write_text("\n".join([f"{header},{name}", *(f"{row},{value}" for row in rows)]), encoding="utf-8")
    if code is None:
        assert [one.spikes for one in read_counts(path, table.presses, hold_s)] == [3.0, 12.0]
    else:
        with raises(RecordingError, code, row=2, cell=value, hold_s=hold_s):
            read_counts(path, table.presses, hold_s)
