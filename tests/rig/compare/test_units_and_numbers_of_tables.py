"""What is not understood is not absent: units and numbers of every table convert, or are refused."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.afferents_table import read_afferents
from rig.compare.recordings.deflection import read_skin_deflection
from rig.compare.recordings.presses_table import read_srp
from rig.compare.recordings.reading import Reading
from rig.compare.recordings.spikes import read_spike_times
from rig.design.presses import PossiblePress
from rig.design.recorded_counts import read_counts
from rig.report.recording_sections import read_deflections
from tests.error_codes import raises
from tests.rig.compare.recording_files import (
    ALL,
    RISES,
    STARTS,
    TIMES,
    Case,
    amplifier,
    check,
    journal,
    mat,
    spikes_csv,
    syncs,
    table,
    text,
)

COUNTS_250MS = ("-0.5|3|250", "0|12|250", "0.25|6|250", "1|1|250")

IN_QUARTER = [12, 48, 24, 4]
"""Rates of these counts in 0.25 s."""

UNITS = {
    "window (msec)": Case("a synonym of ms", table("position_mm|count|window (msec)", *COUNTS_250MS),
                          rates=IN_QUARTER),
    "window (fortnights)": Case("unknown", table("position_mm|count|window (fortnights)", *COUNTS_250MS),
                                code="unknown_unit", says=("window (fortnights)", "fortnights", "ms")),
    "window (mm)": Case("a length is no time", table("position_mm|count|window (mm)", *COUNTS_250MS),
                        code="unknown_unit", says=("'mm'",)),
    "Position [MM]": Case("mm", table("Position [MM]|Rate", "-0.5|6", "0|24", "0.25|12", "1|1"), rates=ALL),
    "position (micron)": Case("µm", table("position (micron)|rate", "-500|6", "0|24", "250|12", "1000|1"), rates=ALL),
    "rate (imp/min)": Case("a minute has 60 s", table("position_mm|rate (imp/min)", "-0.5|360", "0|1440", "0.25|720",
                                                      "1|60"), rates=ALL),
    **{
        header: Case(why, table(f"position_mm|{header}", "-0.5|6", "0|24", "0.25|12", "1|1"), rates=ALL, read_as=said)
        for header, why, said in (
            ("impulses/sec", "a unit of rates alone", "impulses/sec as rate in impulses/sec"),
            ("spikes per second", "a unit of rates alone", "spikes per second as rate in spikes per second"),
            ("Hz", "a unit of rates alone", "Hz as rate in Hz"),
            ("normalized rate", "in units of their own", "normalized rate as rate in normalized"),
        )
    },
    "imp/min": Case("a minute has 60 s", table("position_mm|imp/min", "-0.5|360", "0|1440", "0.25|720", "1|60"),
                    rates=ALL),
    "a unit of rates beside rates": Case("which of the two?", table("position_mm|rate|Hz", "-0.5|6|6", "0|24|24"),
                                         code="extra_column", says=("'Hz'",)),
    "rate (kHz)": Case("1000/s", table("position_mm|rate (kHz)", "-0.5|.006", "0|.024", "0.25|.012", "1|.001"),
                       rates=ALL),
    "sd with the rates": Case("an sd without a unit has that of the rates, so its rates are read",
                              table("position_mm|rate (1/ms)|sd", "-0.5|.006|.001", "0|.024|.001", "0.25|.012|.001",
                                    "1|.001|.001"), rates=ALL),
    "rate (V)": Case("unknown", table("position_mm|rate (V)", "-0.5|6", "0|24", "0.25|12"), code="unknown_unit",
                     says=("'V'",)),
    "--columns x (in)": Case("an inch has 25.4 mm", table("x (in)|rate", "-.02|6", "0|24", ".01|12", ".04|1"),
                             ("position=x (in)",), rates=ALL),
    "--columns x:inch": Case("an inch has 25.4 mm", table("x|rate", "-.02|6", "0|24", ".01|12", ".04|1"),
                             ("position=x:inch",), rates=ALL),
    "--columns x (parsec)": Case("unknown", table("x (parsec)|rate", "1|6", "2|24", "3|12"), ("position=x (parsec)",),
                                 code="unknown_unit", says=("parsec",)),
    "--columns x (parsec):mm": Case("stated", table("x (parsec)|rate", "1|6", "2|24", "3|12", "4|1"),
                                    ("position=x (parsec):mm",), rates=ALL),
    "count (spikes)": Case("counts may say what they count", table("position_mm|count (spikes)|window_ms",
                                                                   *COUNTS_250MS), rates=IN_QUARTER),
    "count (kHz)": Case("a rate is no count", table("position_mm|count (kHz)|window_ms", *COUNTS_250MS),
                        code="unknown_unit", says=("kHz",)),
    "time (msec)": Case("a synonym of ms", text("time (msec)\n" + "".join(f"{1e3 * t}\n" for t in TIMES)), rates=ALL,
                        pulses=False),
    "no unit": Case("mm or µm?", table("position|rate", "-0.5|6", "0|24", "0.25|12"), code="no_unit",
                    says=("--columns position=position:mm",)),
    "two columns": Case("which of the two?", table("position (mm)|x (um)|rate", "1|1000|6", "2|2000|24", "3|3000|12"),
                        code="two_columns", says=("position (mm)", "x (um)")),
    "µm called mm": Case("no finger is 2 m wide", table("position_mm|rate", "-2000|6", "0|24", "2000|12"),
                         code="beyond_a_finger", says=("row 2", "-2000", "'position (um)'")),
    "µm called mm by --columns": Case("no finger is 2 m wide", table("x|rate", "-2000|6", "0|24", "2000|12"),
                                      ("position=x:mm",), code="beyond_a_finger", says=("row 2", "position=x:um")),
    "mm called cm": Case("no finger is 20 cm wide", table("position_cm|rate", "-20|6", "0|24", "20|12"),
                         code="beyond_a_finger", says=("row 2", "'position (mm)'")),
    "mm called µm": Case("no profile lies within 10 µm", table("position_um|rate", "-.5|6", "0|24", "1|12"),
                         code="beyond_a_finger", says=("'position (mm)'",)),
    "s called min": Case("no hold lasts 15 min", table("position_mm|count|window_min", "-0.5|3|15", "0|12|15"),
                         code="beyond_a_finger", says=("'window (s)'",)),
    "1/s called 1/ms": Case("a rate of 24/ms is none, 24/s is", table("position_mm|rate_per_ms", "-0.5|6", "0|24"),
                            code="beyond_a_finger", says=("'rate (1/s)'",)),
    "1/s called 1/ms in --columns": Case(
        "a rate of 24/ms is none, 24/s is", table("position_mm|rate_per_ms", "-0.5|6", "0|24"),
        ("rate=rate_per_ms",), code="beyond_a_finger", says=("'rate (1/s)'",)),
    "m called mm": Case("no profile lies within 10 µm", table("position_mm|rate", "-.002|6", "0|24", ".002|12"),
                        code="beyond_a_finger", says=("0.004", "'position (m)'")),
    "ms called s": Case("no hold lasts 16 min", table("position_mm|count|window_s", "-0.5|3|1000", "0|12|1000"),
                        code="beyond_a_finger", says=("1000", "'window (ms)'")),
    "spikes too dense": Case(
        "no afferent fires 2000 spikes in 20 ms", text("time (s)\n" + "".join(
            f"{start + 1e-5 * k}\n" for start in STARTS for k in range(2000))), pulses=False,
        code="spikes_twice", says=("0.5 ms", "unit of time"),
    ),
    "window=500": Case("no hold lasts 8 min", table("position_mm|count", "-0.5|3", "0|12", "0.25|6"),
                       ("window=500",), code="beyond_a_finger", says=("500", ":ms")),
    "counts called rates per min": Case("no afferent fires 3600 times a second",
                                        table("position_mm|rate", "-0.5|360", "0|3600", "0.25|72"),
                                        code="beyond_a_finger", says=("3600", ":1/min")),
    "rates in units of their own": Case("stated", table("position_mm|rate", "-0.5|3600", "0|4800", "0.25|7200"),
                                        ("rate=rate:a.u.",), rates=[3600, 4800, 7200]),
    "trials": Case(
        "a table of trials: presses at one place are told apart by the number of the trial",
        table("trial|position (mm)|spike_count|duration_ms", "1|-0.5|2|500", "2|0|10|500", "3|0|14|500",
              "4|-0.5|4|500", "5|0.25|6|500", "6|0.25|6|500", "7|1|0|500", "8|1|1|500"), rates=ALL,
    ),
    "trials without a unit": Case(
        "one line says all that is missing",
        table("trial|position|spike_count|duration_ms", "1|-0.5|2|500", "2|0|10|500", "3|0.25|6|500"), code="no_unit",
        says=("--columns position=position:mm",),
    ),
    "trials with another column": Case(
        "one line says how to go on",
        table("subject|trial|position (mm)|spike_count|duration_ms", "S1|1|-0.5|2|500", "S1|2|0|10|500"),
        code="extra_column",
        says=("'subject'", "position=position (mm),count=spike_count,window=duration_ms,repeat=trial"),
    ),
    "CSV, kinds in a column of another name": Case(
        "pulses are no spikes",
        spikes_csv(*syncs(amplifier(RISES)), spikes=amplifier(TIMES).tolist(), header="t_s,type"), ("time=t_s",),
        rates=ALL,
    ),
}  # fmt: skip

NUMBERS = {
    "thousands of µm": Case("−2 mm or −0.002 mm?", table('x (um);rate', "-2,000;6", "-800;24", "0;12", "1,000;1"),
                            code="ambiguous_number", says=("row 2", "'-2,000'", "2000")),
    "thousands, quoted": Case("−2 mm or −0.002 mm?", table("x (um),rate", '"-2,000",6', "-800,24", "0,12"),
                              code="ambiguous_number", says=("row 2", "'-2,000'")),
    "thousands of counts": Case("1449 or 1.449?", table("position_mm,count,window_s", "-0.5,935,20", '0,"1,449",20',
                                                        "0.25,537,20"),
                                code="ambiguous_number", says=("row 3", "'1,449'")),
    "thousands with a point": Case("−2000 or −2.000 µm?", table("x (um);rate", "-2.000;6", "-800;24", "0;12"),
                                   code="ambiguous_number", says=("row 2", "'-2.000'")),
    "points with three digits in every cell, semicolons": Case(
        "1120/min or 1.12/min?", table("position_mm;rate per min", "-1;1.120", "0;4.300", "1;2.500"),
        code="ambiguous_number", says=("row 2", "'1.120'", "1120"),
    ),
    "points with three digits, semicolons, and a decimal point": Case(
        "-0.5 is no thousand, so the point is decimal",
        table("position_mm;rate", "-0.5;6.000", "0;24.000", "0.25;12.000", "1;1.000"), rates=ALL,
    ),
    "points with three digits, commas": Case(
        "where commas separate columns, the point is decimal",
        table("position_mm,rate", "-1,6.000", "0,24.000", "2,12.000", "3,1.000"), rates=ALL,
    ),
    "a decimal comma in a text among numbers": Case(
        "both cells are named, since either may be wrong", table("position_mm;rate", "-1;5", "-0.5;12", "0;40,5"),
        code="no_number", says=("row 3", "'-0.5'", "as '40,5', or that cell with a point"),
    ),
    "millions": Case("two separators", table("x (um);rate", "-2,000,000;6", "-800;24", "0;12"),
                     code="ambiguous_number", says=("'-2,000,000'",)),
    "decimal commas with three digits": Case("0,250 is no thousand, so the comma is decimal",
                                             table("position_mm;rate", "-0,500;6", "0;24", "0,250;12", "1,000;1"),
                                             rates=ALL),
    "decimal points with three digits": Case("all cells have a point and three digits", table(
        "position_mm;rate", "-0.500;6", "0.000;24", "0.250;12", "1.000;1"), rates=ALL),
    "decimal points, without zeros": Case("1.125 beside 2 is decimal",
                                          table("position_mm,rate", "1.125,6", "2,24", "3,12", "4,1"), rates=ALL),
    "a space between thousands": Case("no number", table("position_mm;count;window_s", "0;1 449;20", "1;2;20",
                                                         "2;3;20"), code="no_number", says=("row 2", "'1 449'")),
}  # fmt: skip

OTHER_UNITS = {
    "position": ("position_steps", "pos_thou", "x mils", "angle deg", "x_px", "position_deg", "index", "x"),
    "window": ("window_frames", "window_samples", "bins", "window"),
    "rate": ("rate_spm", "rate_per_trial", "rate_zscore", "spikes per trial", "norm rate", "dF/F", "response", "z"),
    "time": ("t", "time_ticks", "frames"),
}


def named(role: str, column: str) -> Callable[[Path], str]:
    if role == "time":
        return text(f"{column}\n" + "".join(f"{t}\n" for t in TIMES))
    if role == "window":
        return table(f"position_mm,count,{column}", *(one.replace("|250", "|60") for one in COUNTS_250MS))
    header = {"position": f"{column},rate", "rate": f"position_mm,{column}"}[role]
    return table(header, *(f"{x},{y}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True)))


UNKNOWN_UNITS = {
    f"{role}={column}": Case(
        "a unit that is not known is not mm, s or 1/s", named(role, column), (f"{role}={column}",), code="no_unit",
        says=(repr(column), f"{role}={column}:"), pulses=False,
    )
    for role, columns in OTHER_UNITS.items() for column in columns
} | {
    "position=pos_thou:um": Case("stated", table("pos_thou,rate", "-500,6", "0,24", "250,12", "1000,1"),
                                 ("position=pos_thou:um",), rates=ALL, read_as="pos_thou as position in um"),
    "rate_mean": Case("a mean is no unit", named("rate", "rate_mean"), ("rate=rate_mean",), rates=ALL,
                      read_as="rate_mean as rate in 1/s"),
    "mean FR": Case("also of another name", named("rate", "mean FR"), ("rate=mean FR",), rates=ALL,
                    read_as="mean FR as rate in 1/s"),
    "rate=response:1/s": Case("stated", named("rate", "response"), ("rate=response:1/s",), rates=ALL,
                              read_as="response as rate in 1/s"),
    "unit in brackets": Case(
        "the remedy has no unit that would be wrong", table("position (mil),rate", "1,6", "2,24", "3,12"),
        code="unknown_unit", says=("convert the numbers", "position=position (mil):UNIT"),
    ),
    "a comma in a name": Case(
        "it is a part of the name", table('"x, left",rate', "-500,6", "0,24", "250,12", "1000,1"),
        ("position=x, left:um,rate=rate",), rates=ALL,
    ),
    "a colon in a name": Case(
        "a unit follows after another colon", text("Time (h:mm:ss)\n" + "".join(f"{t}\n" for t in TIMES)),
        ("time=Time (h:mm:ss)",), code="unknown_unit", says=("after another",), pulses=False,
    ),
    "a colon in a name, with a unit": Case(
        "it is a part of the name", text("Time (h:mm:ss)\n" + "".join(f"{t}\n" for t in TIMES)),
        ("time=Time (h:mm:ss):s",), rates=ALL, pulses=False,
    ),
    "conditions": Case(
        "two forces are no repeats", table("position_mm,rate,repeat,force_gwt", "0,6,1,1", "0,24,2,2", "1,3,1,1"),
        code="extra_column", says=("'force_gwt'", "file of their own", "count as repeats"),
    ),
    "conditions, ignored": Case(
        "it is said what differs", table("position_mm,rate,repeat,force_gwt", *(
            f"{x},{y + d},{d},{d + 2}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True) for d in (-1, 1))),
        ("position=position_mm,repeat=repeat",), rates=ALL,
        read_as="force_gwt differs between presses at one position",
    ),
}  # fmt: skip


def skin(path: Path) -> list[float]:
    found = read_skin_deflection(path)
    return [*found.deflection_mm, *found.x_mm]


def along(path: Path) -> list[float]:
    (found,) = read_deflections(path)
    return [*found.deflection_mm, *found.z_mm, found.doi_mm]


def counted(path: Path) -> list[float]:
    presses = [PossiblePress("bar:3", x, "doi_mm", 0.5) for x in (-1.0, 0.5)]
    return [value for one in read_counts(path, presses, 1.0) for value in one]


def afferents(path: Path) -> list[float]:
    (path.parent / "a.csv").write_text("position_mm,rate\n0,1\n1,2\n2,3\n", encoding="utf-8")
    stimulus = SimpleNamespace(shape="step:1", condition="4 gwt")
    found = read_afferents(path, [], [], [stimulus], Reading())  # type: ignore[list-item]
    (key,) = found["a1"]
    return [float(key.partition("@")[2].removesuffix(" gwt"))]


TABLES = {
    "skin deflection": (skin, "deflection ({um})|x ({um})", "100|-500", [0.1, -0.5]),
    "deflection along the finger": (along, "z ({um})|deflection ({um})|doi ({um})", "1000|100|500", [0.1, 1.0, 0.5]),
    "counts of a designed session": (counted, "shape|x ({um})|doi ({um})|count", "bar:3|500|500|7", [1, 7]),
    "afferents": (afferents, "afferent|shape|force ({mN})|file", "a1|step:1|39.2266|a.csv", [4.0]),
}
"""Every other table whose columns have units: its reader, header, a row, and what is right in the program's units."""

CASES = UNITS | NUMBERS | UNKNOWN_UNITS


@pytest.mark.parametrize("name", CASES)
def test_units_and_numbers_of_a_table_convert_or_are_refused(name: str, tmp_path: Path) -> None:
    check(CASES[name], tmp_path)


@pytest.mark.parametrize("name", TABLES)
def test_units_convert_in_every_table_that_has_them(name: str, tmp_path: Path) -> None:
    read, header, row, right = TABLES[name]
    words = {"um": ("um", "micron", "µm"), "mN": ("mN", "millinewtons")}
    for um, mn in zip(words["um"], (*words["mN"], "mN"), strict=True):
        path = Path(table(header.format(um=um, mN=mn), row)(tmp_path))
        np.testing.assert_allclose(read(path), right, rtol=1e-5)
    path = Path(table(header.format(um="furlong", mN="slug"), row)(tmp_path))
    with raises(RecordingError, "unknown_unit", path=str(path)) as caught:
        read(path)
    assert any(word in str(caught.value) for word in ("furlong", "slug"))


@pytest.mark.parametrize("sign", ["#", "%", "//", ";", "!", "--"])
@pytest.mark.parametrize("name", [*TABLES, "rates", "spikes of units"])
def test_a_row_that_is_commented_out_is_in_no_table(name: str, sign: str, tmp_path: Path) -> None:
    """It does not count, and as a label that begins with the sign it would; above the header it is a comment."""
    others = {
        "rates": (read_srp, "repeat|position_mm|rate", "a|0|1"),
        "spikes of units": (lambda path: read_spike_times(path, journal(tmp_path), "a"), "unit|time_s", "a|10"),
    }
    read, header, row = TABLES[name][:3] if name in TABLES else others[name]
    above = sign if sign in ("#", "%", "//") else "#"
    path = Path(table(f"{above} one", header.format(um="um", mN="mN"), row, f"{sign}{row}")(tmp_path))
    with raises(RecordingError, "comment_row", path=str(path)) as caught:
        read(path)
    assert "row 4" in str(caught.value)
    assert str(caught.value).endswith(f"the sign {sign}")


@pytest.mark.parametrize("name", TABLES)
def test_values_a_thousand_times_beyond_a_finger_are_questioned_in_every_table(name: str, tmp_path: Path) -> None:
    read, header, row, _ = TABLES[name]
    if name == "afferents":
        row = row.replace("39.2266", "39226.6")
    path = Path(table(header.format(um="mm", mN="gwt"), row)(tmp_path))
    with pytest.raises(RecordingError, match="at most"):
        read(path)


@pytest.mark.parametrize(
    ("read", "header", "row"),
    [
        (along, "z_mm|deflection_mm|doi_mm", "1|.1|n/a"),
        (afferents, "afferent|shape|force_gwt|file", "a1|step:1|-|a.csv"),
    ],
)
def test_a_cell_that_need_not_have_a_number_may_be_empty_and_says_so(
    read: Callable[[Path], list[float]], header: str, row: str, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match="leave the cell empty"):
        read(Path(table(header, row)(tmp_path)))


def test_one_shape_in_a_matlab_table_of_counts_is_that_of_all_presses(tmp_path: Path) -> None:
    write = mat(shape="bar:3", x_mm=np.array([0.5, -1.0]), doi_mm=0.5, count=np.array([7.0, 3.0]))
    with raises(RecordingError, "same_in_all_rows", column="doi_mm"):
        counted(Path(write(tmp_path)))
    write = mat(shape="bar:3", x_mm=np.array([0.5, -1.0]), doi_mm=np.array([0.5, 0.5]), count=np.array([7.0, 3.0]))
    assert counted(Path(write(tmp_path))) == [1, 7.0, 0, 3.0]


def test_decimal_commas_in_a_table_of_afferents(tmp_path: Path) -> None:
    """As Excel writes it in German."""
    path = tmp_path / "synthetic_afferents.csv"
    path.write_text("\ufeffafferent;shape;force_gwt;file\na1;step:1;4,0;a.csv\n", encoding="utf-8")
    assert afferents(path) == [4.0]
