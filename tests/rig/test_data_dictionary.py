"""What the files of a run say of themselves: the press of every row, units, meanings, the run; and docs/data.md."""

import csv
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import pytest

from rig.data import Run, export_run, read_run
from rig.data.dictionary import ATTRIBUTES, about_table, column_of, described_tables
from rig.data.events import OF_THE_PRESS, PRESS_STREAMS
from rig.data.presses import presses
from rig.data.tables import tables
from rig.engine import PressId, Target, indent, verbs

PAGE = Path(__file__).parents[2] / "docs" / "data.md"
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
    verbs.move_to(engine, 0.0)
    indent(engine, Target("force_gwt", 1.0), hold_s=0.2, press_id=PressId(0, "precondition", {"block": 2}))
    indent(engine, Target("doi_mm", 0.4), increments=2, hold_s=0.2, press_id=PressId(0, "data", MARKS))
    indent(engine, Target("force_gwt", 2.0), hold_s=0.2, press_id=PressId(1))
    verbs.note(engine, "over")
    bench.journal.stop("done")
    return read_run(bench.journal_path.parent)


# --- the dictionary ---


def test_every_table_and_column_has_a_description_of_one_line() -> None:
    columns = [column for found in described_tables().values() for column in found]
    for words in (*(one.what for one in columns), *map(about_table, described_tables()), *ATTRIBUTES.values()):
        assert re.fullmatch(r"[^\n|]{5,110}(?<![.])", words), words


# --- tables ---


def rows(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_every_press_table_ends_with_shape_target_and_condition(run: Run) -> None:
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


def test_superseded_rows_keep_condition_and_target_of_their_press(run: Run) -> None:
    touch = run.stream("touch")
    again = replace(run, superseded={"touch": touch[:1], "indentation_start": run.stream("indentation_start")[:1]})
    (row,) = tables(again)["touch_superseded"].rows
    assert (row["condition"], row["target_doi_mm"]) == ("near", 0.4)
    only = replace(run, events={**run.events, "indentation_start": []}, superseded=again.superseded)
    assert [row.get("condition") for row in tables(only)["touch"].rows] == ["near", None]


def test_every_hdf5_dataset_has_its_unit_description_and_type(run: Run) -> None:
    export_run(run)
    kinds = {"float64": "f", "bool": "b", "text (UTF-8)": "O"}
    with h5py.File(run.folder.data) as file:
        assert set(file) == set(tables(run))
        for stream, group in file.items():
            assert group.attrs["description"] == about_table(stream)
            for name, dataset in group.items():
                column = column_of(stream, name)
                assert column is not None, f"{stream}/{name}"
                assert (dataset.attrs["description"], dataset.attrs["unit"]) == (column.what, column.unit)
                assert dataset.dtype.kind == kinds[column.dtype], f"{stream}/{name}"
        assert file["touch/condition"].asstr()[:].tolist() == ["near", ""]
        assert file["precondition_touch/condition"].asstr()[:].tolist() == [""]  # no row has one
        assert file["touch/block"][:].tolist()[0] == 2.0
        assert file["touch/block"][1] != file["touch/block"][1]


# --- one row for each press ---


def test_the_presses_table_has_one_row_a_press_with_target_and_last_hold(run: Run) -> None:
    export_run(run)
    to_depth, to_force = rows(run.folder.path / "presses.csv")
    first_end, last_end, other_end = run.stream("hold_end")[:3]
    moves = [move["along_mm"] for move in run.stream("move")]
    shown = {
        name: to_depth[name] for name in ("index", "block", "repeat", "condition", "target_doi_mm", "increments")
    }
    assert list(shown.values()) == ["0", "2", "1", "near", "0.4", "2"]
    assert (to_depth["complete"], to_depth["asked_s"], to_depth["along_mm"]) == ("True", "0.2", str(moves[-1]))
    assert float(to_depth["doi_mm"]) == last_end["doi_mm"] != first_end["doi_mm"]
    assert float(to_depth["hold_end_s"]) == last_end["t_s"] > float(to_depth["hold_start_s"]) > float(to_depth["t_s"])
    assert float(to_depth["contact_height_mm"]) == run.stream("touch")[0]["contact_height_mm"]
    assert (to_force["target_doi_mm"], to_force["target_force_gwt"], to_force["condition"]) == ("", "2.0", "")
    assert float(to_force["force_gwt"]) == other_end["force_gwt"]
    with h5py.File(run.folder.data) as file:
        assert file["presses/complete"][:].tolist() == [True, True]
        assert file["presses/force_gwt"][:].tolist() == [last_end["force_gwt"], other_end["force_gwt"]]


def test_an_interrupted_press_has_a_row_marked_incomplete_without_results(run: Run) -> None:
    """Its first hold had ended, and the press was made again."""
    start, hold = run.stream("indentation_start")[0], run.stream("hold_end")[0]
    earlier = {"indentation_start": [{**start, "t_s": 1.0}], "hold_end": [{**hold, "t_s": 2.0}]}
    interrupted, again, _ = presses(replace(run, superseded=earlier))
    assert (interrupted.index, interrupted.complete, interrupted.condition) == (0, False, "near")
    assert {interrupted.doi_mm, interrupted.force_gwt, interrupted.hold_end_s, interrupted.end_s} == {None}
    assert (again.index, again.complete) == (0, True)
    assert again.doi_mm == run.stream("hold_end")[1]["doi_mm"]


# --- the documented lines ---


@pytest.mark.parametrize("number", range(3))
def test_the_python_code_on_the_data_page_opens_a_run(
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
        assert found["mean"].tolist() == pytest.approx([forces[2], forces[1]])
    elif number == 1:
        assert (found["unit"], found["held_gwt"].size) == (
            "gwt",
            sum(e["phase"] == "hold" for e in run.stream("sample")),
        )
        assert "S07" in capsys.readouterr().out
    else:
        assert found["touches"]["condition"].tolist() == ["near", ""]
        assert found["touches"]["contact_height_mm"].tolist() == [e["contact_height_mm"] for e in run.stream("touch")]
