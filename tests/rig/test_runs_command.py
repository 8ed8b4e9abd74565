"""`rig runs` and `rig show`: what is listed, what is asked for, one table of many runs, and an index that heals."""

import csv
import json
import os
import shutil
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from rig.data.folder import RunFolder
from rig.data.index import INDEX, IndexEntry, listed
from rig.data.run import read_run
from rig.data.tables import HOLD_COLUMNS, RUN_COLUMNS, Row, Summary, summarised
from tests.journals import append, rewrite
from tests.program import Program
from tests.waiting import DEADLINE_S

OLD = Path(__file__).parents[1] / "data" / "runs"
NAMES = ("complete", "complete_with_a_schedule", "stopped")


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Two complete runs and one that was killed."""
    for name in NAMES:
        shutil.copytree(OLD / name, tmp_path / "runs" / name)
    return tmp_path / "runs"


def unread(path: Path) -> tuple[Summary, list[Row]]:
    raise AssertionError(f"{path} is read again")


def stopped(run: Path, status: str, reason: str) -> None:
    """Give its journal an end."""
    append(run / "events.jsonl", {"doc": "stop", "t_s": 90.0, "status": status, "reason": reason})


def names(entries: list[IndexEntry]) -> list[str]:
    return [entry.summary.name for entry in entries]


# --- the list ---


def test_rig_runs_lists_unreadable_folders_last_and_indexes_the_others(runs: Path) -> None:
    (runs / "a_note").mkdir()
    assert names(listed(runs)) == [*NAMES, "a_note"]
    assert (runs / INDEX).exists()
    assert names(listed(runs, unread)) == [*NAMES, "a_note"]
    for name in NAMES:
        shutil.rmtree(runs / name)
    (runs / INDEX).unlink()
    assert names(listed(runs)) == ["a_note"]
    assert not (runs / INDEX).exists()  # where there are no runs it has no business


@pytest.mark.parametrize(
    ("options", "found"),
    [
        (["--subject", "S07"], NAMES[1:]),
        (["--shape", "bar"], NAMES),
        (["--shape", "bar:1.5"], ()),
        (["--shape", "bar:3"], NAMES),
        (["--protocol", "bars_of_five"], NAMES[:1]),
        (["--state", "killed"], NAMES[2:]),
        (["--state", "done", "--subject", "S07"], NAMES[1:2]),
        (["--since", "2026-11-29"], NAMES),
        (["--since", "2026-11-30"], ()),
        (["--until", "2026-11-29"], NAMES),
        (["--until", "2026-11-28"], ()),
    ],
    ids=" ".join,
)
def test_rig_runs_filters_by_subject_shape_protocol_and_state(
    program: Program, runs: Path, options: list[str], found: tuple[str, ...]
) -> None:
    ended = program("runs", runs, *options, "--json")
    assert [one["name"] for one in ended.json["runs"]] == list(found)


START = {"doc": "start", "t_s": 0, "unix_s": 0, "protocol": "p", "title": "t", "virtual": True}
BROKEN: dict[str, tuple[bytes | None, str]] = {
    "foreign": (b'{"doc": "start", "t_s": 0}\n', "KeyError: 'unix_s'"),
    "lacking": (json.dumps(START).encode(), "KeyError: 'planned_indentations'"),
    "number": (
        json.dumps(START | {"planned_indentations": "many"}).encode(),
        "ValueError: invalid literal for int() with base 10: 'many'",
    ),
    "noise": (b"\xff\xfe\x00\nnoise\n", "line 1"),
}
"""What a journal holds, and what the system or Python says of it, or the place."""


@pytest.mark.parametrize("name", BROKEN)
def test_rig_runs_names_each_unreadable_run_in_one_line(program: Program, runs: Path, name: str) -> None:
    content, named = BROKEN[name]
    (runs / name).mkdir()
    if content is not None:
        (runs / name / "events.jsonl").write_bytes(content)
    for _ in range(2):  # read, and from the index
        ended = program("runs", runs)
        assert ended.code == 0
        assert ended.complaint.startswith(f"{runs / name}: ")
        assert named in ended.complaint
        assert [line.split()[0] for line in ended.out.splitlines()] == [*NAMES, "3"]
    (unreadable,) = program("runs", runs, "--json").json["unreadable"]
    assert unreadable["name"] == name
    of_one = program("show", runs / name, "--json")
    assert of_one.code == 2
    assert of_one.complaint.endswith(unreadable["problem_text"])
    assert (of_one.error_code == "foreign_run") is ("Error: " in named)


def test_rig_runs_ignores_files_and_hidden_folders(runs: Path) -> None:
    """Files and hidden folders are nobody's runs; one that is being made is, and a journal must be a file."""
    (runs / "notes.txt").touch()
    for name in (".hidden", ".20260101T000000-a-b.part", "odd/events.jsonl"):
        (runs / name).mkdir(parents=True)
    os.mkfifo(runs / ".hidden" / "events.jsonl")
    told = {entry.summary.name: entry.summary.problem for entry in listed(runs) if entry.summary.problem}
    assert told == {
        ".20260101T000000-a-b.part": "incomplete folder: its program is still running or was killed",
        "odd": "events.jsonl: not a file",
    }


def test_rig_runs_shows_a_run_in_progress_as_running(program: Program, runs: Path) -> None:
    def states() -> list[str]:
        return [one["state"] for one in program("runs", runs, "--json").json["runs"]]

    folder = RunFolder(runs / "stopped")
    assert states() == ["done", "done", "killed"]
    assert not (folder.path / ".lock").exists()
    with folder.owned(), RunFolder(runs / "complete").owned():
        assert states() == ["done", "done", "running"]
        assert program("runs", runs, "--state", "running", "--json").json["runs"][0]["name"] == "stopped"
        assert program("show", folder.path, "--json").json["state"] == "running"
    assert states() == ["done", "done", "killed"]


# --- the table ---


def test_rig_runs_writes_all_holds_of_many_runs_to_one_table(program: Program, runs: Path, tmp_path: Path) -> None:
    path, journal = tmp_path / "all.csv", runs / "complete" / "events.jsonl"

    def marked(document: dict[str, Any]) -> dict[str, Any]:
        first = document.get("stream") == "indentation_start" and document.get("data", {}).get("index") == 0
        marks = {"block": 2, "repeat": 1, "condition": "near"}
        return {**document, "data": {**document["data"], **marks}} if first else document

    rewrite(journal, marked)
    ended = program("runs", runs, "--table", path)
    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    assert (ended.code, ended.err) == (0, "")
    assert list(rows[0]) == [*RUN_COLUMNS, *HOLD_COLUMNS]
    assert b"\r" not in path.read_bytes()
    holds = {name: read_run(OLD / name).stream("hold_end") for name in NAMES}
    assert [(row["run"], row["index"], row["hold"]) for row in rows] == [
        (name, str(hold["index"]), str(hold["hold"])) for name in NAMES for hold in holds[name]
    ]
    assert ended.out == f"{len(rows)} holds of 3 runs: {path}\n"
    for name in ("force_gwt", "doi_mm", "peak_gwt", "t_s", "x_mm"):
        assert [float(row[name]) for row in rows] == [hold[name] for n in NAMES for hold in holds[n]], name
    assert {(row["run"], row["state"]) for row in rows} == {
        ("complete", "done"), ("complete_with_a_schedule", "done"), ("stopped", "killed"),
    }  # fmt: skip
    marks = [(row["block"], row["repeat"], row["condition"]) for row in rows if row["run"] == "complete"]
    assert [found for found in marks if found != ("", "", "")] == [("2", "1", "near")]
    assert marks[0] == ("2", "1", "near")
    assert {(row["target_doi_mm"] == "", row["target_force_gwt"] == "") for row in rows} == {
        (True, False), (False, True),
    }  # fmt: skip
    touches = {touch["index"]: touch["contact_height_mm"] for touch in read_run(OLD / "complete").stream("touch")}
    of_one = [row for row in rows if row["run"] == "complete"]
    assert [float(row["contact_height_mm"]) for row in of_one] == [touches[int(row["index"])] for row in of_one]


# --- the index ---


def test_rig_runs_reads_an_unchanged_journal_once(runs: Path) -> None:
    first = listed(runs)
    assert listed(runs, unread) == first
    assert [len(entry.rows) for entry in first] == [len(summarised(OLD / name)[1]) for name in NAMES]


def test_rig_runs_reads_only_changed_journals_again(runs: Path) -> None:
    listed(runs)
    read: list[str] = []

    def reading(path: Path) -> tuple[Summary, list[Row]]:
        read.append(path.name)
        return summarised(path)

    stopped(runs / "stopped", "aborted", "by hand")
    shutil.rmtree(runs / "complete")
    shutil.copytree(runs / "complete_with_a_schedule", runs / "copied")
    found = listed(runs, reading)
    assert sorted(read) == ["copied", "stopped"]
    assert sorted(names(found)) == ["complete_with_a_schedule", "copied", "stopped"]
    assert {entry.summary.name: entry.summary.state for entry in found}["stopped"] == "aborted"
    with closing(sqlite3.connect(runs / INDEX)) as index:
        assert {name for (name,) in index.execute("SELECT name FROM runs")} == set(names(found))


def test_rig_runs_reads_a_changed_journal_of_the_same_size_and_time_again(runs: Path) -> None:
    listed(runs)
    journal = runs / "complete" / "events.jsonl"
    was, content = journal.stat(), journal.read_bytes()
    journal.write_bytes(content.replace(b'"protocol": "bars_of_five"', b'"protocol": "bars_of_four"'))
    os.utime(journal, ns=(was.st_atime_ns, was.st_mtime_ns))
    assert {entry.summary.protocol for entry in listed(runs)} == {"bars_of_four", "mixed"}


def _flipped(index: Path) -> None:
    content = index.read_bytes()
    assert b"bars_of_five" in content
    index.write_bytes(content.replace(b"bars_of_five", b"bars_of_fire"))


def _execute(command: str) -> Callable[[Path], None]:
    def executed(path: Path) -> None:
        with closing(sqlite3.connect(path)) as index, index:
            index.execute(command)

    return executed


DAMAGE: dict[str, Callable[[Path], Any]] = {
    "deleted": lambda index: index.unlink(),
    "cut": lambda index: index.write_bytes(index.read_bytes()[:5000]),
    "a flipped byte": _flipped,
    "of another version": _execute("PRAGMA user_version = 7"),
    "a row of nothing": _execute("UPDATE runs SET holds = NULL"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_rig_runs_rebuilds_a_damaged_index(runs: Path, damage: str) -> None:
    first = listed(runs)
    DAMAGE[damage](runs / INDEX)
    assert listed(runs) == first
    assert listed(runs, unread) == first


def test_rig_runs_works_without_a_writable_index(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = listed(runs)
    (runs / INDEX).unlink()
    (runs / INDEX).mkdir()
    assert listed(runs) == first
    assert (runs / INDEX).is_dir()
    (runs / INDEX).rmdir()
    listed(runs)
    shutil.copytree(runs / "complete", runs / "copied")
    monkeypatch.setattr("rig.data.index._BUSY_S", 0.0)
    with closing(sqlite3.connect(runs / INDEX)) as held:
        held.execute("BEGIN EXCLUSIVE")
        assert sorted(names(listed(runs))) == sorted([*NAMES, "copied"])
        held.rollback()
    assert sorted(names(listed(runs))) == sorted([*NAMES, "copied"])
    assert len(listed(runs, unread)) == 4


def test_several_rig_runs_at_once_list_the_same(runs: Path) -> None:
    first = [listed(runs)]
    (runs / INDEX).unlink()
    begin, seen = threading.Barrier(4), list[list[IndexEntry]]()

    def look() -> None:
        begin.wait()
        seen.append(listed(runs))

    looking = [threading.Thread(target=look) for _ in range(4)]
    for one in looking:
        one.start()
    for one in looking:
        one.join(DEADLINE_S)
    assert seen == first * 4
    assert listed(runs, unread) == first[0]


# --- one run ---


def test_rig_show_summarizes_state_presses_limits_and_files_of_a_run(program: Program, runs: Path) -> None:
    told = program("show", runs / "complete_with_a_schedule", "--json").json
    run = read_run(OLD / "complete_with_a_schedule")
    expected = {"state": "done", "planned": 8, "done": 8, "subject": "S07", "protocol": "mixed", "ending": None}
    assert {name: told[name] for name in expected} == expected
    assert told["limits"]["max_contact_s"] == 600.0
    assert (
        told["limits"]["soft_trip_of_the_plan_n"] == read_run(OLD / "complete_with_a_schedule").start["soft_trip_n"]
    )
    assert {"package": "indentation-rig", "version": "0.3.0"} in told["versions"]
    assert told["devices"]["sensor"] == "MT-SICS balance 0123456789"
    assert sum(one["holds"] for one in told["presses"]) == len(run.stream("hold_end"))
    first = told["presses"][0]
    forces = [hold["force_gwt"] for hold in run.stream("hold_end") if hold["commanded"] == first["target_force_gwt"]]
    assert first["mean_force_gwt"] == pytest.approx(sum(forces) / len(forces))
    size = (OLD / "complete_with_a_schedule" / "events.jsonl").stat().st_size
    assert {"name": "events.jsonl", "bytes": size} in told["files"]


def test_rig_show_tells_where_a_killed_run_left_the_indentor(program: Program, runs: Path) -> None:
    ended = program("show", runs / "stopped")
    assert "because     the run has no end record: its program was killed or the power failed\n" in ended.out
    assert (
        "where       held, at x = 0.50 mm, 0.12 mm below the nominal apex (last known and not trusted)" in ended.out
    )
    assert f"resume      rig resume {runs / 'stopped'}\n" in ended.out
    stopped(runs / "stopped", "tripped", "too much")
    ended = program("show", runs / "stopped")
    assert "state       tripped, 5 of 8 indentations\nbecause     too much\npressed" in ended.out


def test_rig_show_summarizes_a_run_without_its_stored_copies(program: Program, runs: Path) -> None:
    folder = runs / "complete"
    (folder / "provenance.json").unlink()
    (folder / "config.toml").write_text("[limits", encoding="utf-8")
    told = program("show", folder, "--json").json
    assert told["limits"] == {"soft_trip_of_the_plan_n": read_run(OLD / "complete").start["soft_trip_n"]}
    assert told["versions"] == [{"package": "python", "version": "unknown"}]
    assert set(told["devices"]) == {"controller", "sensor"}
