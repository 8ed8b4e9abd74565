"""A file of readings as it is read: its bounds, its order, its units."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.coding.decoder_results import CodingError
from sim.coding.readings_file import (
    FEWEST,
    MOST,
    FileReadings,
    checked_pressures,
    pa_per_pseudo,
    read_pressures,
    read_readings,
)
from sim.coding.task import DecodeTask, decode_task
from sim.config import FingertipConfig
from sim.tables import TableError
from tests.error_codes import raises

FINGER = FingertipConfig()
PA = pa_per_pseudo(FINGER)
Read = Callable[..., FileReadings]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def of(header: str, *rows: str) -> FileReadings:
        (tmp_path / "r.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
        return read_readings(tmp_path / "r.csv", FINGER)

    return of


def test_readings_are_ordered_by_place_and_then_depth(read: Read) -> None:
    rows = ("5,50,0.76,a,1", "1,10,0.9,b,-1", "4,40,0.8,c,0.5", "2,20,0.7,d,0.5", "3,30,0.1,e,0")
    given = read("sd,sed,depth_mm,more,place_mm", *rows)
    assert_allclose(given.place_mm, [-1, 0, 0.5, 0.5, 1])
    assert_allclose(given.depth_mm, [0.9, 0.1, 0.7, 0.8, 0.76])
    assert_allclose(given.reading, [10, 30, 20, 40, 50])
    assert_allclose(given.sd, [1, 3, 2, 4, 5])
    assert (given.kind, given.at_rest) == ("sed", None)


@pytest.mark.parametrize(("kind", "unit"), [("sed", 1.0), ("sed_pa", 18.6266)])
def test_readings_and_noise_in_pascals_are_converted_to_pseudo_units(kind: str, unit: float, read: Read) -> None:
    rows = [f"{x},0.76,{10 + x},{x * (-1) ** x / 4}" for x in range(-2, 3)]
    given = read(f"x_mm,depth_mm,{kind},at_rest", *rows)
    assert_allclose(given.reading, np.arange(8, 13) / unit, rtol=1e-5)
    assert_allclose(given.at_rest, np.array([-0.5, 0.25, 0, -0.25, 0.5]) / unit, rtol=1e-5)
    assert given.sd is None
    assert pytest.approx(18.6266) == PA
    # farther along the skin than across the finger, the more so below it
    assert (np.abs(given.place_mm) > np.abs(np.arange(-2, 3)) - 1e-9)[[0, 1, 3, 4]].all()


def test_a_readings_file_has_5_to_400_readings(read: Read) -> None:
    assert (FEWEST, MOST) == (5, 400)
    rows = [f"{place:.3f},0.76,1,0.1" for place in np.linspace(-2, 2, MOST + 1)]
    assert len(read("place_mm,depth_mm,sed,sd", *rows[:5]).reading) == 5
    assert len(read("place_mm,depth_mm,sed,sd", *rows[:MOST]).reading) == MOST
    for some in (rows[:4], rows):
        with raises(TableError, "wrong_count", readings=len(some), fewest=5, most=400):
            read("place_mm,depth_mm,sed,sd", *some)


@pytest.mark.parametrize(
    ("kind", "noise", "value", "there"),
    [
        ("sed", "sd", -0.601, False),
        ("sed", "at_rest", -0.94, True),  # six sd of 0.1 … 0.5: 0.158
        ("sed", "at_rest", -0.96, False),
        ("sed", "nothing", -1e-9, False),
        ("rate", "sd", -1e-9, False),
    ],
)
def test_a_negative_reading_is_refused_beyond_six_sd_of_noise(
    kind: str, noise: str, value: float, there: bool, read: Read
) -> None:
    column = [0.1] * 5 if noise != "at_rest" else [0.1, 0.2, 0.3, 0.4, 0.5]
    rows = [f"{0.1 * k},0.76,{value if k == 3 else 5},{column[k]}" for k in range(5)]
    header = f"place_mm,depth_mm,{kind},{noise}"
    if there:
        assert read(header, *rows).reading[3] == value
    else:
        with raises(TableError, "negative", line=5, column=kind, value=float(value)):
            read(header, *rows)


def test_two_readings_at_one_place_are_refused_unless_their_depths_differ(read: Read) -> None:
    rows = [f"0,{0.7 + 0.01 * k},1,0.1" for k in range(5)]
    assert len(read("place_mm,depth_mm,sed,sd", *rows).reading) == 5
    assert len(read("place_mm,depth_mm,sed,sd", *rows, "0,0.740002,1,0.1").reading) == 6
    with raises(TableError, "same_place", line="line 7", column="place_mm", value=0.0, expected="line 6"):
        read("place_mm,depth_mm,sed,sd", *rows, "0,0.7400005,1,0.1")


# --- pressures ---


def test_a_pressure_that_is_negative_or_infinite_is_refused(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("pressure\n3\n0\n", encoding="utf-8")
    assert read_pressures(tmp_path / "p.csv").tolist() == [3.0, 0.0]
    assert checked_pressures((20, 14)).tolist() == [20.0, 14.0]
    assert checked_pressures(5).tolist() == [5.0]
    for wrong in (-1.0, float("inf")):
        with raises(CodingError, "negative", pressure="pressure", value=wrong):
            checked_pressures([20.0, wrong])
    for number in (0, 401):
        with raises(CodingError, "wrong_count", pressure="pressure", numbers=number, most=400):
            checked_pressures(np.ones(number))


@pytest.mark.parametrize(
    ("text", "spacing_mm", "found"),
    [
        ("x_mm;pressure\n-0,5;10,5\n0;20\n0,5;10\n", 0.5, [10.5, 20, 10]),
        ("x_mm;pressure\n0;1,234\n", 0.5, "ambiguous_number"),  # 1.234 or 1234?
        ("place_mm,pressure\n-0.25,10\n0.25,20\n", 0.5, [10, 20]),
        ("x_mm,pressure\n-0.5,10\n0,20\n0.5,10\n", 0.17, "other_place"),  # they were put 0.17 mm apart
        ("x_mm,pressure\n0,10\n0.5,20\n1,10\n", 0.5, "other_place"),  # not about the middle of the pad
        ("pressure\n10\n\n20\n", 0.17, "empty_row"),  # the two became neighbors
        ("pressure,unit\n10,kPa\n", 0.17, "extra_column"),
        ("x_mm,place_mm,pressure\n0,0,1\n", 0.17, "not_one_column"),
    ],
)
def test_pressures_in_a_file_must_lie_at_the_sample_spacing(
    text: str, spacing_mm: float, found: list[float] | str, tmp_path: Path
) -> None:
    (tmp_path / "p.csv").write_text(text, encoding="utf-8")
    if isinstance(found, str):
        with raises(TableError, found):
            read_pressures(tmp_path / "p.csv", spacing_mm)
    else:
        assert read_pressures(tmp_path / "p.csv", spacing_mm).tolist() == found


@pytest.mark.parametrize("column", ["exclude", "Excluded", "valid", "bad_channel", "artifact"])
def test_a_readings_file_with_a_column_that_excludes_rows_is_refused(column: str, read: Read) -> None:
    """It would count them."""
    rows = [f"{x},0.76,{10 + x},{int(x == 0)}" for x in range(-2, 3)]
    with raises(TableError, "extra_column"):
        read(f"x_mm,depth_mm,sed,{column}", *rows)


UNREAD = ("outlier", "use", "include", "ok", "flag", "quality", "discard", "status", "masked", "skip", "Remark")


@pytest.mark.parametrize("column", UNREAD)
def test_an_unread_column_of_a_readings_file_is_named(column: str, read: Read) -> None:
    rows = [f"{x},0.76,{10 + x},{int(x == 0)}" for x in range(-2, 3)]
    assert read(f"x_mm,depth_mm,sed,{column}", *rows).unread_text == f"columns that are not read: {column}"
    assert read("x_mm,depth_mm,sed,sd", *[row[:-1] + "1" for row in rows]).unread_text == ""


def test_decoding_reports_unread_columns_among_its_problems(read: Read) -> None:
    rows = [f"{0.4 * x:g},0.76,{10 - abs(x)},0.1,{int(x == 0)},1" for x in range(-5, 6)]
    found = decode_task(DecodeTask(read("place_mm,depth_mm,sed,sd,outlier,use", *rows)))
    assert "readings: columns that are not read: outlier, use" in found.problems
