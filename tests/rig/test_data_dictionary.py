"""What the files of a run say of themselves: the press of every row, units, meanings, the run; and docs/data.md."""

import csv
import re
import runpy
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import pytest

from rig.data import Run, export_nwb, export_run, read_run
from rig.data.dictionary import ATTRIBUTES, FAMILIES, FLAGS, MEANINGS, TABLES, TEXT, about_table, columns, meaning
from rig.data.schema import PRESS_STREAMS, STREAMS
from rig.data.tables import HOLD_COLUMNS, OF_THE_PRESS, RUN_COLUMNS, tables
from rig.engine import PressId, Target, indent, verbs
from tests.program import Program

OLD = Path(__file__).parents[1] / "data" / "runs"
PAGE = Path(__file__).parents[2] / "docs" / "data.md"
COLUMNS = PAGE.with_name("columns_page.py")
START = {
    "protocol": "two", "title": "Two presses", "source": "", "parameters": {}, "planned_indentations": 2,
    "subject": "S07", "virtual": True,
}  # fmt: skip
MARKS = {"block": 2, "repeat": 1, "condition": "near"}


@pytest.fixture
def run(spring: Callable[..., Any]) -> Run:
    """A preconditioning press to a force, and two of the data: to a depth in two holds, marked, and to a force."""
    bench = spring()
    bench.journal.start(START)
    engine = bench.ready()
    indent(engine, Target("force_gwt", 1.0), hold_s=0.2, press_id=PressId(0, "precondition", {"block": 2}))
    indent(engine, Target("doi_mm", 0.4), increments=2, hold_s=0.2, press_id=PressId(0, "data", MARKS))
    indent(engine, Target("force_gwt", 2.0), hold_s=0.2, press_id=PressId(1))
    verbs.note(engine, "over")
    bench.journal.stop("done")
    return read_run(bench.journal_path.parent)


# --- the dictionary ---


def test_every_column_there_is_has_one_meaning_and_no_other_has() -> None:
    there = {"t_s", *OF_THE_PRESS, *(key for keys in STREAMS.values() for key in keys)}
    said = {name.rpartition(".")[2] for name in MEANINGS}
    assert said == there
    assert not (TEXT | FLAGS) - there
    named = {name.partition(".")[0] for name in MEANINGS if "." in name}
    assert named <= set(STREAMS)
    for words in (*MEANINGS.values(), *TABLES.values(), *ATTRIBUTES.values()):
        assert re.fullmatch(r"[^\n|]{5,110}(?<![.])", words), words


def test_every_table_there_is_is_told() -> None:
    assert set(STREAMS) == {
        *TABLES,
        *(f"{begin}{name}" for begin in FAMILIES for name in PRESS_STREAMS if f"{begin}{name}" in STREAMS),
    }
    assert all(about_table(stream) for stream in STREAMS)
    assert about_table("precondition_touch_superseded") == (
        f"{about_table('touch')} (of preconditioning presses, which are not data)"
    )
    assert (
        meaning("reference_hold_end", "force_gwt")
        == meaning("hold_end", "force_gwt")
        != meaning("touch", "force_gwt")
    )
    assert (meaning("tap", "times"), about_table("tap")) == ("", "")


def test_the_page_of_columns_ends_with_what_the_command_writes(program: Program) -> None:
    ended = program("show", "--columns")
    assert ended.code == 0
    page = runpy.run_path(str(COLUMNS))["columns_page"]()
    assert page.partition("## Every column")[1:] == ("## Every column", ended.out.removeprefix("## Every column"))
    assert "\\n" not in ended.out
    told = program("show", "--columns", "--json").json["columns"]
    assert {"table": "hold_end", "name": "force_gwt", "unit": "gwt", "dtype": "float64",
            "what_text": "mean force over the readings of the hold"} in told  # fmt: skip
    assert len(told) == len(list(columns()))
    for name in (*RUN_COLUMNS, *HOLD_COLUMNS):
        assert f"| `{name}` |" in ended.out.partition("rig runs --table")[2], name


@pytest.mark.parametrize("words", [[], ["run", "--columns"]], ids=["nothing", "both"])
def test_a_run_or_the_columns_are_shown(program: Program, words: list[str]) -> None:
    ended = program("show", *words, "--json")
    assert (ended.code, ended.json["code"]) == (2, "exactly_one")
    assert ended.complaint == ended.json["error_text"]


# --- tables ---


def rows(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_every_table_of_a_press_ends_with_what_was_pressed_and_why(run: Run) -> None:
    export_run(run)
    for stream in run.units:
        found, of_a_press = rows(run.folder.path / f"{stream}.csv"), stream.endswith(tuple(PRESS_STREAMS))
        assert (list(found[0])[-6:] == list(OF_THE_PRESS)) is of_a_press, stream
        for row in found if of_a_press else []:
            told = tuple(row[name] for name in OF_THE_PRESS)
            if row["index"] == "-1":
                expected = ("", "", "", "", "", "")
            elif stream.startswith("precondition_"):
                expected = ("bar:3.0", "", "1.0", "2", "", "")
            elif row["index"] == "0":
                target = "0.2" if stream in ("hold_start", "hold_end") and row["hold"] == "1" else "0.4"
                expected = ("bar:3.0", target, "", "2", "1", "near")
            else:
                expected = ("bar:3.0", "", "2.0", "", "", "")
            assert told == expected, (stream, row)


def test_what_was_begun_anew_has_the_marks_of_its_press(run: Run) -> None:
    touch = run.stream("touch")
    again = replace(run, superseded={"touch": touch[:1], "indentation_start": run.stream("indentation_start")[:1]})
    (row,) = tables(again)["touch_superseded"].rows
    assert (row["condition"], row["target_doi_mm"]) == ("near", 0.4)
    only = replace(run, events={**run.events, "indentation_start": []}, superseded=again.superseded)
    assert [row.get("condition") for row in tables(only)["touch"].rows] == ["near", None]


def test_every_dataset_has_its_unit_its_meaning_and_its_type(run: Run) -> None:
    export_run(run)
    kinds = {"float64": "f", "bool": "b", "text (UTF-8)": "O"}
    types = {one.name: kinds[one.dtype] for one in columns()}
    with h5py.File(run.folder.data) as file:
        assert set(file) == set(tables(run))
        for stream, group in file.items():
            assert group.attrs["description"] == about_table(stream)
            for name, dataset in group.items():
                assert dataset.attrs["description"] == meaning(stream, name) != ""
                assert dataset.attrs["unit"] == (
                    "s" if name == "t_s" else {**STREAMS[stream], **OF_THE_PRESS}.get(name)
                )
                assert dataset.dtype.kind == types[name], f"{stream}/{name}"
        assert file["touch/condition"].asstr()[:].tolist() == ["near", ""]
        assert file["precondition_touch/condition"].asstr()[:].tolist() == [""]  # no row has one
        assert file["touch/block"][:].tolist()[0] == 2.0
        assert file["touch/block"][1] != file["touch/block"][1]


def test_a_column_that_nobody_has_told_is_exported(run: Run) -> None:
    events = [{"t_s": 1.0, "times": 2, "how": "softly"}, {"t_s": 2.0, "times": None}]
    export_run(replace(run, events={"tap": events}, units={"tap": {"times": "", "how": ""}}))
    with h5py.File(run.folder.data) as file:
        assert file["tap/times"][0] == 2.0
        assert file["tap/how"].asstr()[:].tolist() == ["softly", ""]


# --- the run itself ---


def test_the_attributes_say_which_run_it_is(tmp_path: Path) -> None:
    shutil.copytree(OLD / "stopped", tmp_path / "mine")
    run = read_run(tmp_path / "mine")
    export_run(run)
    with h5py.File(tmp_path / "mine" / "data.h5") as file:
        assert dict(file.attrs) == {
            "run": "mine", "uid": run.start["uid"], "date_utc": "2026-11-29T18:14:44+00:00", "version": "0.3.0",
            "protocol": "mixed", "title": "Everything a script may ask for", "subject": "S07", "virtual": True,
            "planned_indentations": 8, "complete": False,
        }  # fmt: skip
        assert set(file.attrs) == set(ATTRIBUTES)


def test_without_provenance_the_version_is_not_known(run: Run) -> None:
    for content in (None, "[1]", "{", '{"versions": {}}'):
        if content is not None:
            run.folder.provenance.write_text(content, encoding="utf-8")
        export_run(run)
        with h5py.File(run.folder.data) as file:
            assert file.attrs["version"] == ""


def test_nwb_has_the_devices(tmp_path: Path) -> None:
    pynwb: Any = pytest.importorskip("pynwb", reason="needs pynwb: pip install 'indentation-rig[nwb]'")
    shutil.copytree(OLD / "complete", tmp_path / "run")
    run = read_run(tmp_path / "run")
    mounted = [{"t_s": 0.0, "indentor": shape} for shape in ("bar:3.0", "profile:a/b.csv", "bar:3.0")]
    for events, sensor, shapes in (
        (run.events, "MT-SICS balance 0123456789", ["bar:3.0"]),
        ({**run.events, "zero": [], "mount": mounted}, "nothing", ["bar:3.0", "profile:a/b.csv"]),
    ):
        with pynwb.NWBHDF5IO(export_nwb(replace(run, events=events)), "r") as io:
            told = {name: device.description for name, device in io.read().devices.items()}
        indentors = {f"indentor {n}": f"rigid shape {shape}" for n, shape in enumerate(shapes, 1)}
        assert told == {
            "stage": told["stage"],
            "force": f"measures the force on the finger: virtual mtsics; identification: {sensor}",
            **indentors,
        }
        assert told["stage"].startswith("moves the indentor: virtual grbl; identification: [VER:")


# --- the documented lines ---


@pytest.mark.parametrize("number", range(3))
def test_the_lines_of_the_page_open_a_run(
    run: Run, number: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)
    assert len(blocks) == 3
    if "pandas" in blocks[number]:
        pytest.importorskip("pandas", reason="needs pandas")
    export_run(run)
    monkeypatch.chdir(run.folder.path)
    found: dict[str, Any] = {}
    exec(compile(blocks[number], str(PAGE), "exec"), found)
    forces = [hold["force_gwt"] for hold in run.stream("hold_end")]
    if number == 0:
        assert found["mean"].tolist() == pytest.approx([forces[2], *forces[:2]])
    elif number == 1:
        assert (found["unit"], found["held_gwt"].size) == (
            "gwt",
            sum(e["phase"] == "hold" for e in run.stream("sample")),
        )
        assert "S07" in capsys.readouterr().out
    else:
        assert found["touches"]["condition"].tolist() == ["near", ""]
        assert found["touches"]["contact_height_mm"].tolist() == [e["contact_height_mm"] for e in run.stream("touch")]
