"""What version 0.3 wrote is still read, exported and resumed (tests/data/runs)."""

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from rig.cli import main
from rig.data import export_nwb, export_run, read_run
from rig.report.run_tables import limits
from rig.session.resume import read_stopped

OLD = Path(__file__).parents[1] / "data" / "runs"


def _is_in(old: Any, new: Any, where: str = "") -> None:
    """Every key and value of the old one; numbers within 1e-6."""
    if isinstance(old, dict):
        for key, value in old.items():
            assert key in new, f"{where}.{key}"
            _is_in(value, new[key], f"{where}.{key}")
    elif isinstance(old, list):
        assert len(old) == len(new), where
        for n, (one, other) in enumerate(zip(old, new, strict=True)):
            _is_in(one, other, f"{where}[{n}]")
    else:
        assert old == new, where


def _copy(name: str, to: Path) -> Path:
    shutil.copytree(OLD / name, to / name)
    return to / name


def _told(
    arguments: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> dict[str, Any]:
    monkeypatch.setattr("sys.argv", ["rig", *arguments, "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    return dict(json.loads(capsys.readouterr().out))


@pytest.mark.parametrize(("name", "presses"), [("complete", 5), ("complete_with_a_schedule", 8)])
def test_a_complete_run_of_version_0_3_is_read_and_exported(name: str, presses: int, tmp_path: Path) -> None:
    """Every table has the rows that were stored with the run; a later version may add columns.

    On the virtual clock a press may begin at the instant at which the one before ended.
    """
    folder = _copy(name, tmp_path)
    stored = {path.name: _rows(path) for path in folder.glob("*.csv")}
    run = read_run(folder)
    assert (run.complete, len(run.done), run.missing, run.repeated) == (True, presses, 0, 0)
    for path in folder.glob("*.csv"):
        path.unlink()
    export_run(run)
    assert {path.name for path in folder.glob("*.csv")} >= {"presses.csv", *stored}
    for table, rows in stored.items():
        _is_in(rows, _rows(folder / table), table)
    ends_s = [row["end_s"] for row in _rows(folder / "presses.csv")]
    assert ends_s == [row["t_s"] for row in _rows(folder / "indentation_end.csv")]
    assert export_nwb(run).is_file()


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_stopped_run_of_version_0_3_is_resumed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, empty_figures: None
) -> None:
    """Killed in indentation 5 of 8; what comes of it are the presses of the run that nobody killed."""
    folder = _copy("stopped", tmp_path)
    stopped = read_stopped(folder)
    assert stopped.run is not None
    assert sorted(stopped.run.done) == [0, 1, 2, 3, 4]
    told = _told(["resume", str(folder)], capsys, monkeypatch)
    assert (told["complete"], told["indentations"], told["missing"], told["repeated"]) == (True, 8, 0, 0)
    assert told["restarted"] == 1
    now, whole = read_run(folder), read_run(OLD / "complete_with_a_schedule")
    measured = ("value", "predicted_doi_mm", "predicted_force_gwt")
    for stream in (
        "indentation_start",
        "reference_indentation_start",
        "precondition_indentation_start",
        "checkpoint",
    ):
        kept = [{key: e.get(key) for key in whole.units[stream] if key not in measured} for e in now.stream(stream)]
        expected = [
            {key: e.get(key) for key in whole.units[stream] if key not in measured} for e in whole.stream(stream)
        ]
        if stream.startswith("precondition") or stream.startswith("reference"):
            kept = kept[: len(expected)]  # the last ones before the kill are owed again
        assert kept == expected, stream
    assert [e["value"] for e in now.stream("indentation_start")] == pytest.approx(
        [e["value"] for e in whole.stream("indentation_start")], abs=0.01
    )
    assert [e["text"] for e in now.stream("note")] == [e["text"] for e in whole.stream("note")]
    assert now.start["subject"] == "S07"


def test_the_highest_force_of_a_report_includes_reference_presses() -> None:
    """Of a run whose reference presses are the strongest: the table is compared with its trip."""
    run = read_run(OLD / "complete_with_a_schedule")
    highest = {name: max(one["force_gwt"] for one in run.stream(name)) for name in ("sample", "reference_sample")}
    assert highest["sample"] < highest["reference_sample"]
    assert dict(limits(run))["highest measured force"].startswith(f"{highest['reference_sample']:.2f} gwt")
