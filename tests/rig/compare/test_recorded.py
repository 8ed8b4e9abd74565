"""A user's CSV: read as it is, refused by row and column."""

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.presses_table import read_srp
from rig.compare.recordings.recording import recording
from tests.error_codes import raises


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "mine.csv"
    path.write_text(text, encoding=encoding)
    return path


@pytest.mark.parametrize(
    ("header", "refused"),
    [
        ("position_mm,rate,sd (%)", True),  # 10 % of 80/s are 8/s, not 10/s
        ("position_mm,rate (a.u.),sd (1/s)", True),
        ("position_mm,rate (%),sd (%)", False),
        ("position_mm,rate,sd (Hz)", False),
    ],
)
def test_an_sd_in_another_unit_than_the_rates_is_refused(tmp_path: Path, header: str, refused: bool) -> None:
    path = written(tmp_path, f"{header}\n0,80,10\n1,40,10\n2,20,10\n")
    with raises(RecordingError, "other_unit") if refused else nullcontext():
        assert read_srp(path).sd.tolist() == [10.0, 10.0, 10.0]


def test_positions_rates_and_sds(tmp_path: Path) -> None:
    found = read_srp(written(tmp_path, "position_mm,rate,sd\n0.5,20,2\n-1,4,1\n0,12.5,1.5\n"))
    np.testing.assert_array_equal(found.position_mm, [-1, 0, 0.5])
    np.testing.assert_array_equal(found.rate, [4, 12.5, 20])
    np.testing.assert_array_equal(found.sd, [1, 1.5, 2])
    assert (found.name, found.changes) == ("mine.csv", ())


def test_repeats_give_mean_and_sd(tmp_path: Path) -> None:
    rows = [
        f"{x},{rate},{n}"
        for x, rates in ((0, (2, 4, 6)), (1, (1, 1, 4)), (2, (0, 0, 0)))
        for n, rate in enumerate(rates)
    ]
    found = read_srp(written(tmp_path, "position_mm,rate,repeat\n" + "\n".join(rows)))
    assert [len(rates) for rates in found.repeats] == [3, 3, 3]
    np.testing.assert_allclose(found.rate, [4, 2, 0])
    np.testing.assert_allclose(found.sd, [2, np.sqrt(3), 0])  # with n − 1


def test_mirrored_and_normalised(tmp_path: Path) -> None:
    found = read_srp(written(tmp_path, "position_mm,rate,sd\n-1,4,1\n0,8,2\n2,16,4\n"))
    mirrored = found.mirrored()
    np.testing.assert_array_equal(mirrored.position_mm, [-2, 0, 1])
    np.testing.assert_array_equal(mirrored.rate, [16, 8, 4])
    np.testing.assert_array_equal(mirrored.sd, [4, 2, 1])
    np.testing.assert_array_equal(mirrored.normalized(16).rate, [1, 0.5, 0.25])
    np.testing.assert_array_equal(mirrored.normalized(16).sd, [0.25, 0.125, 0.0625])
    assert mirrored.normalized(16).changes == ("mirrored", "rates divided by 16")
    np.testing.assert_array_equal(mirrored.mirrored().position_mm, found.position_mm)


GOOD = "position_mm,rate\n0,1\n1,2\n2,3\n"
COUNTED = "position_mm,count,window_s\n0,3,0.5\n"
RATES, COUNTS = "position_mm,rate[,sd][,repeat]", "position_mm,count,window_s[,repeat]"


def no_number(row: int, column: str, cell: str, least: float) -> dict[str, Any]:
    return {"row": row, "column": column, "cell": cell, "least": least}


@pytest.mark.parametrize(
    ("text", "code", "fields"),
    [
        ("", "no_column", {"column": "position_mm", "columns": RATES}),
        ("position,rate\n0,1\n", "no_unit", {"row": 1, "column": "position", "unit": "mm"}),
        (GOOD + "3,-1\n", "no_number", no_number(5, "rate", "-1", least=0.0)),
        ("position_mm,rate,sd\n0,1,-2\n", "no_number", no_number(2, "sd", "-2", least=0.0)),
        (
            GOOD + "1,9\n",
            "place_twice",
            {"row": 5, "column": "position_mm", "position": 1.0, "first_row": 3, "repeat": "repeat"},
        ),
        ("position_mm,count\n0,1\n", "no_column", {"column": "window_s", "columns": COUNTS}),
        (COUNTED + "1,2.5,0.5\n", "not_whole", {"row": 3, "column": "count", "cell": "2.5"}),
        (
            COUNTED + "1,2,0.25\n",
            "another_window",
            {"row": 3, "column": "window_s", "cell": "0.25", "first": "0.5"},
        ),
        (COUNTED + "1,2,0\n", "not_above_0", {"row": 3, "column": "window_s", "cell": "0"}),
    ],
)
def test_what_is_wrong_and_where(tmp_path: Path, text: str, code: str, fields: dict[str, Any]) -> None:
    path = written(tmp_path, text)
    with raises(RecordingError, code, path=str(path), **fields) as caught:
        read_srp(path)
    assert " or more" in str(caught.value) if "least" in fields else "decimal comma" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "sep=;\nposition_mm;rate\n-1,5;4\n0;8,5\n1;3\n",
        "position_mm;rate;;\n-1,5;4;;\n0;8,5;;\n1;3;;\n;;;\n",
        "\ufeffposition_mm;rate\r\n-1,5;4;\r\n0;8,5;\r\n1;3;\r\n",
        ";;\n# from the amplifier\nposition_mm;rate\n-1,5;4\n0;8,5\n1;3\n",
        "position_mm\trate\n−1.5\t4\n0\t8.5\n1\t3\n",
    ],
    ids=["separator line", "empty columns", "rows end with a separator", "empty line above", "sign of minus"],
)
def test_what_spreadsheets_write_is_read(tmp_path: Path, text: str) -> None:
    found = read_srp(written(tmp_path, text))
    np.testing.assert_array_equal(found.position_mm, [-1.5, 0.0, 1.0])
    np.testing.assert_array_equal(found.rate, [4.0, 8.5, 3.0])


def test_a_window_makes_counts_of_rates_also_of_normalised_ones() -> None:
    found = recording("x", [(0.0, 4.0, np.nan), (1.0, 8.0, np.nan), (2.0, 6.0, np.nan)], window_s=0.5)
    assert found.window_s == 0.5
    assert found.normalized(8.0).window_s == 4.0
    assert found.mirrored().window_s == 0.5
    assert recording("x", [(0.0, 4.0, np.nan)]).normalized(8.0).window_s is None


def test_commas_and_points_in_one_table_are_refused(tmp_path: Path) -> None:
    with raises(
        RecordingError, "no_number", row=3, column="rate", cell="2.5", least=0.0, also="with a decimal comma"
    ):
        read_srp(written(tmp_path, "position_mm;rate\n-0,5;1\n0;2.5\n1;3\n"))
