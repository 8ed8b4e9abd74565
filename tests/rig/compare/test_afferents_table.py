"""A table or folder of several afferents: what is read, and a line for every row that cannot be used."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.afferents_table import Recordings, read_afferents
from rig.compare.recordings.reading import Reading, read_recordings
from rig.compare.stimuli import StimulusRow
from rig.data import Run
from tests.error_codes import raises
from tests.rig.compare.recording_files import PRESSES, STARTS, TIMES, WINDOW_S, journal

Make = Callable[..., StimulusRow]

CSV = "position_mm,rate\n" + "".join(f"{x},{y}\n" for x, y in ((-1, 2), (-0.5, 5), (0, 9), (0.5, 4)))
HEADER = "afferent,shape,depth_mm,file"


@pytest.fixture
def stimuli(make_stimulus: Make) -> list[StimulusRow]:
    x, receptor = np.linspace(-2, 2, 9), np.array([0.0])
    return [
        make_stimulus("bar:3.0", x, receptor, {}, kind="doi_mm", commanded=1.0),
        make_stimulus("step:1", x, receptor, {}, kind="doi_mm", commanded=0.5),
        make_stimulus("step:1", x, receptor, {}, kind="doi_mm", commanded=1.0),
    ]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in "abcd":
        peak = {"a": "9", "b": "8", "c": "7", "d": "6"}[name]
        (tmp_path / f"{name}.csv").write_text(CSV.replace("9", peak), encoding="utf-8")
    (tmp_path / "copy_of_d.csv").write_text((tmp_path / "d.csv").read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "d_written_otherwise.csv").write_text(CSV.replace("9", "6.0"), encoding="utf-8")
    (tmp_path / "bad.csv").write_text(CSV.replace("5,4", "5,x"), encoding="utf-8")
    (tmp_path / "named.csv").write_text(CSV.replace("rate", "Q").replace("9", "5.5"), encoding="utf-8")
    return tmp_path


def table(folder: Path, *rows: str, header: str = HEADER) -> Path:
    path = folder / "afferents.csv"
    path.write_text("\n".join((header, *rows)) + "\n", encoding="utf-8")
    return path


def read(path: Path, stimuli: list[StimulusRow], mirror: list[str] | None = None) -> Recordings:
    return read_afferents(path, mirror or [], [], stimuli, Reading())


def test_a_table(folder: Path, stimuli: list[StimulusRow]) -> None:
    path = table(folder, "a1,bar:3,1.0,a.csv", "", "a1,step:1,0.5,b.csv", "a2,bar:3,,c.csv")
    found = read(path, stimuli, ["bar:3"])
    assert {name: list(some) for name, some in found.items()} == {
        "a1": ["bar:3@1 mm", "step:1@0.5 mm"],
        "a2": ["bar:3"],
    }
    assert found["a1"]["bar:3@1 mm"].changes == ("mirrored",)
    assert found["a1"]["step:1@0.5 mm"].changes == ()
    assert read(folder, stimuli).keys() == found.keys()  # a folder with such a table


@pytest.mark.parametrize(
    ("mirror", "mirrored"),
    [
        (["step:1@0.5mm"], ["a1 step:1@0.5 mm"]),
        (["step:1"], ["a1 step:1@0.5 mm", "a1 step:1@1 mm"]),
        (["step:1", "step:1@1mm", "bar:3"], ["a1 step:1@0.5 mm", "a1 step:1@1 mm", "a2 bar:3"]),
        (["bar:3@1mm"], ["a2 bar:3"]),
        (["bar:3@2mm"], "nothing_to_mirror"),
        (["step:1@2mm"], "nothing_to_mirror"),
        (["step:1", "cylinder:3"], "nothing_to_mirror"),
    ],
)
def test_mirror_means_the_same_as_for_one_afferent(
    folder: Path, stimuli: list[StimulusRow], mirror: list[str], mirrored: list[str] | str
) -> None:
    """A shape with a condition is that one alone; what no recording has is refused.

    A recording without a condition has the only one of the runs.
    """
    path = table(folder, "a1,step:1,0.5,a.csv", "a1,step:1,1,b.csv", "a2,bar:3,,c.csv")
    if isinstance(mirrored, str):
        with raises(RecordingError, mirrored, shape=mirror[-1]):
            read(path, stimuli, mirror)
        return
    found = read(path, stimuli, mirror)
    every = {f"{name} {key}": one for name, some in found.items() for key, one in some.items()}
    assert [name for name, one in every.items() if one.changes == ("mirrored",)] == mirrored


def test_one_name_is_one_afferent_however_it_is_written(folder: Path, stimuli: list[StimulusRow]) -> None:
    """é is one letter, or e and an accent: macOS names files so."""
    table(folder, "\u00e9,bar:3,1.0,a.csv", "e\u0301,step:1,0.5,b.csv")
    assert list(read(folder, stimuli)) == ["\u00e9"]
    for name, file in (("\u00e9", "bar-3@1mm"), ("e\u0301", "step-1@0.5mm")):
        (folder / "names" / name).mkdir(parents=True)
        (folder / "names" / name / f"{file}.csv").write_text(f"{CSV}9,{len(file)}\n", encoding="utf-8")
    assert list(read(folder / "names", stimuli)) == ["\u00e9"]


def test_a_header_in_capitals(folder: Path, stimuli: list[StimulusRow]) -> None:
    path = table(folder, "a1,bar:3,1.0,a.csv", header="Afferent,SHAPE,Depth (mm),File")
    assert list(read(path, stimuli)["a1"]) == ["bar:3@1 mm"]


def test_columns_of_one_file(folder: Path, stimuli: list[StimulusRow]) -> None:
    header = "afferent,shape,file,columns"
    path = table(folder, "a1,bar:3,named.csv,rate=Q:Hz;position=position_mm", "a2,bar:3,a.csv,", header=header)
    assert read(path, stimuli)["a1"]["bar:3"].rate.tolist() == [2, 5, 5.5, 4]


def test_the_rates_of_an_afferent_are_in_one_unit(folder: Path, stimuli: list[StimulusRow]) -> None:
    header, rows = "afferent,shape,depth_mm,file,columns", ("a1,bar:3,1,a.csv,", "a1,step:1,1,b.csv,rate=rate:a.u.")
    with raises(RecordingError, "several_units", first="1/s", second="a.u."):
        read(table(folder, *rows, header=header), stimuli)


def test_a_folder_of_folders(tmp_path: Path, stimuli: list[StimulusRow]) -> None:
    files = (("a1", "bar-3@1mm.csv"), ("a1", "step-1@0.5mm.csv"), ("a2", "bar-3.csv"), ("a2", ".notes"))
    for rate, (name, file) in enumerate(files):
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / file).write_text(f"{CSV}9,{rate}\n", encoding="utf-8")
    found = read(tmp_path, stimuli)
    assert {name: list(some) for name, some in found.items()} == {
        "a1": ["bar:3@1 mm", "step:1@0.5 mm"],
        "a2": ["bar:3"],
    }


def test_a_unit_without_a_spike_is_a_silent_afferent(folder: Path, stimuli: list[StimulusRow], bar_run: Run) -> None:
    """The group leaves it out and lists it; one empty unit in a file refuses no group."""
    (folder / "silent.csv").write_text("time_s\n", encoding="utf-8")
    path = table(folder, "a1,bar:3,,a.csv", "a2,bar:3,,silent.csv")
    found = read_afferents(path, [], [bar_run], stimuli, Reading(window_s=(0.1, 0.2)))
    assert not found["a2"]["bar:3"].rate.any()
    with raises(RecordingError, "no_spikes"):
        read_recordings([f"bar:3={folder / 'silent.csv'}"], [], [bar_run], Reading())


BAD = {
    "a1,bar:3,1.0": "3 cells, but the header has 4",
    ",bar:3,1.0,a.csv": "column afferent must not be empty",
    "a1,,1.0,a.csv": "column shape must not be empty",
    "a1,bar:3,1.0,": "column file must not be empty",
    "a1,bar:3,1.0,nowhere.csv": "nowhere.csv: No such file",
    "a1,bar:3,1.0,bad.csv": "bad.csv, row 5, column rate: 'x' must be",
    "a1,bar:3,1.0,named.csv": "named.csv, row 1: the column rate is missing",
    "a1,bar:3,2.0,a.csv": "the runs contain no bar:3@2 mm",
    "a1,cylinder:3,1.0,a.csv": "the runs contain no cylinder:3@1 mm",
    "a1,step:1,,a.csv": "step:1 was pressed to 0.5 mm and 1 mm",
    "a1,step:1@0.5mm,0.5,a.csv": "state one depth or force",
    "a1,bar:3,deep,a.csv": "column depth_mm: 'deep' must be a number",
    "a9,bar:3,1.0,d.csv": "d.csv is the recording of bar:3@1mm of afferent a7 already",
    "a10,bar:3,1.0,copy_of_d.csv": "copy_of_d.csv is the recording of bar:3@1mm of afferent a7 already",
    "a11,bar:3,1.0,d_written_otherwise.csv": "d_written_otherwise.csv is the recording of bar:3@1mm of",
    "A8,bar:3,,c.csv": "'A8' is no name of an afferent, or the same as 'a8'",
    "a12,bar:3,n/a,b.csv": "column depth_mm: 'n/a' must be a number of 0 or more",
    "mean,bar:3,,c.csv": "'mean' is no name of an afferent;",
    "Population,bar:3,,c.csv": "'Population' is no name of an afferent;",
    "grand average,bar:3,,c.csv": "'grand average' is no name of an afferent;",
    "a8,bar:3,,c.csv": "afferent a8 already has a recording of bar:3;",
}


def test_every_bad_row_has_a_line_with_its_number(folder: Path, stimuli: list[StimulusRow]) -> None:
    path = table(folder, "a8,bar:3,,b.csv", "a7,bar:3,1.0,d.csv", *BAD)
    with raises(RecordingError, "bad_rows", path=str(path), bad=len(BAD)) as caught:
        read(path, stimuli)
    lines = str(caught.value).splitlines()[1:]
    assert len(lines) == len(BAD)
    for (number, problem), line in zip(enumerate(BAD.values(), 4), lines, strict=True):
        assert line.startswith(f"{path}, row {number}: ")
        assert problem in line


@pytest.mark.parametrize(
    ("header", "rows", "code"),
    [
        ("afferent,shape", ["a1,bar:3"], "no_column"),
        (f"{HEADER},hand", ["a1,bar:3,1.0,a.csv,left"], "extra_column"),
        (f"{HEADER},file", ["a1,bar:3,1.0,a.csv,b.csv"], "extra_column"),
        (HEADER, [], "no_rows"),
    ],
)
def test_a_wrong_table(folder: Path, stimuli: list[StimulusRow], header: str, rows: list[str], code: str) -> None:
    with raises(RecordingError, code, path=str(folder / "afferents.csv")):
        read(table(folder, *rows, header=header), stimuli)


def test_an_empty_folder(tmp_path: Path, stimuli: list[StimulusRow]) -> None:
    with raises(RecordingError, "no_rows", path=str(tmp_path)):
        read(tmp_path, stimuli)


LEFT_IN_A_FOLDER = {
    "an empty folder": (lambda path: (path / "a2").mkdir(), "a2: has no recording"),
    "a folder with hidden files": (lambda path: laid(path / "a2" / ".notes"), "a2: has no recording"),
    "a loose recording": (lambda path: laid(path / "a3-bar-3.csv"), "a3-bar-3.csv: in no folder of an afferent"),
    "a loose file of a recording system": (lambda path: laid(path / "a3.plx"), "a3.plx: in no folder of an afferent"),
    "a loose recording without suffix": (lambda path: laid(path / "a3"), "a3: in no folder of an afferent"),
    "a link to nothing": (lambda path: (path / "a4").symlink_to("gone"), "a4: a link to gone, which is missing"),
    "a link to nothing in a folder": (
        lambda path: [(path / "a5").mkdir(), (path / "a5" / "bar-3.csv").symlink_to("gone")],
        "a5/bar-3.csv: a link to gone, which is missing",
    ),
    "a readme and a page": (lambda path: [laid(path / "README.txt"), laid(path / "comparison.html")], ""),
    "a hidden file": (lambda path: laid(path / ".DS_Store"), ""),
}  # fmt: skip
"""What may lie in a folder beside the recordings, and what is said: a file may have been lost in copying."""


def nwb(*spikes: list[float], about: str = "") -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            file["units/id"], file["units/spike_times"] = range(len(spikes)), np.concatenate(spikes)
            file["units/spike_times_index"] = np.cumsum([len(one) for one in spikes])
            file.attrs["about"] = about

    return write


def as_text(content: str) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(content.encode())  # type: ignore[return-value]


OTHERS = [t + 0.003 * (1 + n % 3) for n, t in enumerate(TIMES)]
"""Of a unit that fires as often as the other in each press, at other times."""

ROWS = ("-1,33.3333333", "-0.5,5", "0,66.6666667", "0.5,4")
RATES = "\n".join(["position_mm,rate", *ROWS])
ONE, TWO = nwb(TIMES), nwb(TIMES, OTHERS)
TUNED = {-2: 4.2, -1.5: 6.0, -1: 16.0, -0.5: 39.0, 0: 54.0, 0.5: 41.0, 1: 19.0, 1.5: 8.0, 2: 5.2}


def counted(window_s: float, *, rates: bool = False, other: int = 0) -> Callable[[Path], None]:
    """Spikes of TIMES in a window of each press, or their rates; `other` is added to the first count."""
    per, header = (window_s, "position_mm,rate,repeat") if rates else (1, "position_mm,count,window_s,repeat")
    rows = []
    for k, ((x, _, number), start) in enumerate(zip(PRESSES, STARTS, strict=True)):
        spikes = sum(start <= t < start + window_s for t in TIMES) + other * (not k)
        rows.append(f"{x},{spikes / per:g}," + f"{window_s}," * (not rates) + f"{number}")
    return as_text("\n".join([header, *rows]) + "\n")


def tuned(
    positions: int = 9, factor: float = 1.0, shift_mm: float = 0.0, other: float = 0.0, first: int = 0
) -> Callable[[Path], None]:
    """Rates under a bell; `other` is added to the last one."""
    rows = [(x + shift_mm, factor * rate) for x, rate in list(TUNED.items())[first:positions]]
    rows[-1] = rows[-1][0], rows[-1][1] + other
    return as_text("position_mm,rate\n" + "".join(f"{x},{rate:.4f}\n" for x, rate in rows))


def repeated(*without: int, repeats: int = 3, other: int = 0) -> Callable[[Path], None]:
    """Rates of some presses at each place, without some rows; `other` is added to every third one."""
    rows = [
        (x, round(rate) + (-4, 1, 4 + other)[n], n + 1)
        for x, rate in TUNED.items() for n in range(repeats)
    ]  # fmt: skip
    kept = [f"{x},{rate},{n}" for k, (x, rate, n) in enumerate(rows) if k not in without]
    return as_text("\n".join(["position_mm,rate,repeat", *kept]) + "\n")


COPIES = {
    "a table without a repeat in the middle": (repeated(), "one.csv", "other.csv", repeated(13), True),
    "a table without its last repeat": (repeated(), "one.csv", "other.csv", repeated(26), True),
    "a table with two repeats of three": (repeated(), "one.csv", "other.csv", repeated(repeats=2), True),
    "a table without a repeat and with others": (repeated(), "one.csv", "other.csv", repeated(13, other=1), False),
    "a table with a row fewer": (tuned(), "one.csv", "other.csv", tuned(8), True),
    "a normalized table": (tuned(), "one.csv", "other.csv", tuned(factor=1 / 54), True),
    "a table with another center of the field": (tuned(), "one.csv", "other.csv", tuned(shift_mm=0.5), True),
    "a table with a row fewer and another rate": (tuned(), "one.csv", "other.csv", tuned(8, other=0.2), False),
    "a normalized table with another rate": (
        tuned(), "one.csv", "other.csv", tuned(factor=1 / 54, other=0.01), False,
    ),
    **{
        f"a unit that fires {1e3 * lag_s:g} ms later": (
            TWO, "one.nwb#0", "other.nwb", nwb([t + lag_s for t in TIMES]), is_copy)
        for lag_s, is_copy in ((0.0005, True), (0.0008, True), (0.0019, True), (0.004, False))
    },
    "a unit named, and the only one": (ONE, "one.nwb", "one.nwb#0", ONE, True),
    "a row and an id": (TWO, "one.nwb#row=1", "one.nwb#0", TWO, True),
    "another unit": (TWO, "one.nwb#0", "one.nwb#1", TWO, False),
    "a file saved again": (ONE, "one.nwb", "other.nwb", nwb(TIMES, about="again"), True),
    "a file saved with its spikes as text": (
        ONE, "one.nwb", "other.csv", as_text("time_s\n" + "".join(f"{t:.3f}\n" for t in TIMES)), True,
    ),
    "a copy that was cut shorter": (ONE, "one.nwb", "other.nwb", nwb(TIMES[:-3]), True),
    "copies that share the middle of the recording": (
        nwb(TIMES[:-6]), "one.nwb", "other.nwb", nwb(TIMES[6:]), True,
    ),
    "other units of which each covers a part": (nwb(TIMES[:-6]), "one.nwb", "other.nwb", nwb(OTHERS[6:]), False),
    "a table of counts in another window": (ONE, "one.nwb", "other.csv", counted(0.06), True),
    "a table of rates in another window": (ONE, "one.nwb", "other.csv", counted(0.1, rates=True), True),
    "a table of other counts in another window": (ONE, "one.nwb", "other.csv", counted(0.06, other=1), False),
    "a table with another center and without both ends": (
        tuned(), "one.csv", "other.csv", tuned(8, shift_mm=0.37, first=1), True,
    ),
    "a table with another center, both ends and a rate": (
        tuned(), "one.csv", "other.csv", tuned(8, shift_mm=0.37, first=1, other=0.5), False,
    ),
    "a unit with as many spikes": (ONE, "one.nwb", "other.nwb", nwb(OTHERS), False),
    "a table with other ends of lines": (
        as_text(RATES), "one.csv", "other.csv", as_text(RATES.replace("\n", "\r\n")), True,
    ),
    "a table with fewer digits": (as_text(RATES), "one.csv", "other.csv", as_text(RATES.replace("33333", "")), True),
    "a table in another order": (
        as_text(RATES), "one.csv", "other.csv", as_text("\n".join(["position_mm,rate", *ROWS[::-1]])), True,
    ),
    "a table with one more": (as_text(RATES), "one.csv", "other.csv", as_text(RATES.replace(",5", ",6")), False),
}  # fmt: skip
"""Two afferents: the file of the first, the names of both, the file of the second, and whether they are one."""


@pytest.mark.parametrize("name", COPIES)
def test_one_recording_is_one_afferent(name: str, tmp_path: Path, make_stimulus: Make) -> None:
    write, one, other, write_other, is_copy = COPIES[name]
    write(tmp_path / one.partition("#")[0])
    write_other(tmp_path / other.partition("#")[0])
    x, receptor = np.linspace(-2, 2, 9), np.array([0.0])
    stimuli = [make_stimulus("bar:3.0", x, receptor, {}, kind="doi_mm", commanded=1.0)]
    clock = ["" if (tmp_path / file.partition("#")[0]).read_bytes().startswith(b"position_mm") else "sync=none"
             for file in (one, other)]  # fmt: skip
    path = table(
        tmp_path, f"a1,bar:3,,{one},{clock[0]}", f"a2,bar:3,1,{other},{clock[1]}", header=f"{HEADER},columns"
    )
    reading = Reading(window_s=(0.0, WINDOW_S))
    if not is_copy:
        assert len(read_afferents(path, [], [journal(tmp_path)], stimuli, reading)) == 2
        return
    with raises(RecordingError, "bad_rows", path=str(path), bad=1) as caught:
        read_afferents(path, [], [journal(tmp_path)], stimuli, reading)
    assert "is the recording of bar:3 of afferent a1 already" in str(caught.value)


def test_two_units_with_the_same_rates_by_chance_are_read_if_the_table_says_so(
    tmp_path: Path, make_stimulus: Make
) -> None:
    """The message names the column, and the column is the way out."""
    for name in ("one.csv", "other.csv"):
        (tmp_path / name).write_text("position_mm,rate\n-1,4\n-.5,7\n0,12\n.5,7\n1,3\n", encoding="utf-8")
    stimuli = [make_stimulus("bar:3.0", np.linspace(-2, 2, 9), np.array([0.0]), {}, kind="doi_mm", commanded=1.0)]
    rows = "a1,bar:3,,one.csv", "a2,bar:3,,other.csv"
    with raises(RecordingError, "bad_rows") as caught:
        read(table(tmp_path, *rows), stimuli)
    assert "if they are two, write a1 into a column distinct_from of this row" in str(caught.value)
    header = f"{HEADER},distinct_from"
    assert len(read(table(tmp_path, f"{rows[0]},", f"{rows[1]},A1", header=header), stimuli)) == 2
    with raises(RecordingError, "bad_rows"):
        read(table(tmp_path, f"{rows[0]},", f"{rows[1]},a7", header=header), stimuli)


def laid(file: Path) -> None:
    file.parent.mkdir(exist_ok=True)
    file.write_text(CSV, encoding="utf-8")


@pytest.mark.parametrize("name", LEFT_IN_A_FOLDER)
def test_nothing_in_a_folder_is_left_out_silently(name: str, tmp_path: Path, stimuli: list[StimulusRow]) -> None:
    lay, said = LEFT_IN_A_FOLDER[name]
    laid(tmp_path / "a1" / "bar-3.csv")
    lay(tmp_path)
    if not said:
        assert list(read(tmp_path, stimuli)) == ["a1"]
        return
    with raises(RecordingError, "bad_rows", path=str(tmp_path), bad=1) as caught:
        read(tmp_path, stimuli)
    assert said in str(caught.value)
