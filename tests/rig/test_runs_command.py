"""`rig runs` and `rig show`: what is listed, what is asked for, one table of many runs, and an index that heals."""

import csv
import json
import os
import shutil
import sqlite3
import threading
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import fields
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import pytest

import rig.data.index as run_index
from rig.cli.runs import RunFilter, _line
from rig.data.folder import RunFolder
from rig.data.index import INDEX, IndexEntry, listed
from rig.data.run import read_run
from rig.data.tables import ENDED_EARLY, HOLD_COLUMNS, RUN_COLUMNS, Row, Summary, summarised
from rig.engine.contact import MAY_TOUCH
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


def test_every_run_has_a_line_and_the_newest_is_the_last(program: Program, runs: Path) -> None:
    ended = program("runs", runs)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.splitlines() == [
        "complete                  -    bar:3.0  5 of 5  done, virtual",
        "complete_with_a_schedule  S07  bar:3.0  8 of 8  done, virtual",
        "stopped                   S07  bar:3.0  5 of 8  killed, virtual",
        "3 runs",
    ]


def test_what_cannot_be_read_comes_last_and_keeps_no_index_from_the_others(runs: Path) -> None:
    (runs / "a_note").mkdir()
    assert names(listed(runs)) == [*NAMES, "a_note"]
    assert (runs / INDEX).exists()
    assert names(listed(runs, unread)) == [*NAMES, "a_note"]
    for name in NAMES:
        shutil.rmtree(runs / name)
    (runs / INDEX).unlink()
    assert names(listed(runs)) == ["a_note"]
    assert not (runs / INDEX).exists()  # where there are no runs it has no business


def test_the_list_as_json(program: Program, runs: Path) -> None:
    told = program("runs", runs, "--json").json
    assert told["unreadable"] == []
    assert told["runs"][0] == {
        "name": "complete", "date_utc": "2026-11-29T18:14:16+00:00", "protocol": "bars_of_five",
        "title": "Bar at five positions", "subject": "", "shapes": ["bar:3.0"], "state": "done", "virtual": True,
        "planned": 5, "done": 5, "duration_s": pytest.approx(read_run(OLD / "complete").duration_s),
    }  # fmt: skip
    assert [one["name"] for one in told["runs"]] == list(NAMES)


@pytest.mark.parametrize(
    ("options", "found"),
    [
        (["--subject", "S07"], NAMES[1:]),
        (["--subject", "S08"], ()),
        (["--shape", "bar"], NAMES),
        (["--shape", "bar:3.0"], NAMES),
        (["--shape", "bar:1.5"], ()),
        (["--shape", "step"], ()),
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
def test_what_is_asked_for(program: Program, runs: Path, options: list[str], found: tuple[str, ...]) -> None:
    ended = program("runs", runs, *options, "--json")
    assert [one["name"] for one in ended.json["runs"]] == list(found)


def test_who_is_asked_for_says_yes_or_no() -> None:
    run = Summary("a", date_utc="2026-03-01T10:00:00+00:00", subject="S07", shapes=("bar:3.0",), state="done")
    none = (None,) * 5
    assert RunFilter(None, *none).has(run) is True
    assert RunFilter("S08", *none).has(run) is False
    assert RunFilter(None, "step", None, None, None, None).has(run) is False
    day = date(2026, 3, 1)
    assert [RunFilter(None, None, None, None, first, last).has(run) for first, last in (
        (day, day), (day + timedelta(1), None), (None, day - timedelta(1)), (day - timedelta(1), day + timedelta(1)),
    )] == [True, False, False, True]  # fmt: skip


@pytest.mark.parametrize(
    ("shapes", "told"),
    [((), "-"), (("bar:3.0",), "bar:3.0"), (("a", "b"), "a and 1 more"), (("a", "b", "c"), "a and 2 more")],
)
def test_many_shapes_are_counted(shapes: tuple[str, ...], told: str) -> None:
    line = _line(Summary("a", shapes=shapes, state="done", planned=3, done=2))
    assert line == ["a", "-", told, "2 of 3", "done"]
    assert _line(Summary("a", shapes=shapes, state="done", virtual=True))[-1] == "done, virtual"


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["nowhere"], "no_such_folder"),
        (["--state", "well"], "unknown_choice"),
        (["--since", "May"], "no_day"),
        (["--until", "1.2.26"], "no_day"),
        (["--table", "no/a.csv"], "not_writable"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], code: str
) -> None:
    monkeypatch.chdir(tmp_path)
    ended = program("runs", *words, "--json")
    assert ended.json == {"error_text": ended.complaint, "code": code, "exit_code": 2}
    assert list(tmp_path.iterdir()) == []


START = {"doc": "start", "t_s": 0, "unix_s": 0, "protocol": "p", "title": "t", "virtual": True}
BROKEN: dict[str, tuple[bytes | None, str]] = {
    "empty": (None, "events.jsonl: No such file or directory"),
    "nothing": (b"", "events.jsonl"),
    "torn": (b'{"doc": "st', "events.jsonl"),
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
def test_what_is_no_run_has_one_line_and_the_others_theirs(program: Program, runs: Path, name: str) -> None:
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


def test_what_else_lies_there(runs: Path) -> None:
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


def test_a_run_that_is_written_to_is_running(program: Program, runs: Path) -> None:
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


def test_all_holds_of_many_runs_are_one_table(program: Program, runs: Path, tmp_path: Path) -> None:
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


def test_a_table_of_what_is_asked_for(program: Program, runs: Path, tmp_path: Path) -> None:
    told = program("runs", runs, "--subject", "S08", "--table", tmp_path / "none.csv", "--json").json
    assert (told["holds"], told["runs"], told["table"]) == (0, [], str(tmp_path / "none.csv"))
    assert (tmp_path / "none.csv").read_text(encoding="utf-8") == ",".join([*RUN_COLUMNS, *HOLD_COLUMNS]) + "\n"


# --- the index ---


def test_a_journal_is_read_once(runs: Path) -> None:
    first = listed(runs)
    assert listed(runs, unread) == first
    assert [len(entry.rows) for entry in first] == [len(summarised(OLD / name)[1]) for name in NAMES]


def test_where_nothing_changed_nothing_is_written(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = listed(runs)
    with monkeypatch.context() as patched:
        patched.setattr(run_index, "_store", unread)
        assert listed(runs) == first
    shutil.rmtree(runs / "complete")
    listed(runs)
    with closing(sqlite3.connect(runs / INDEX)) as index:
        assert {name for (name,) in index.execute("SELECT name FROM runs")} == set(NAMES[1:])


def test_an_index_is_of_its_columns_and_edition(runs: Path) -> None:
    listed(runs)
    names_of_it = [field.name for field in fields(Summary)]
    mark = zlib.crc32(repr((2, names_of_it, HOLD_COLUMNS)).encode()) & 0x7FFFFFFF
    with closing(sqlite3.connect(runs / INDEX)) as index:
        assert index.execute("PRAGMA user_version").fetchone() == (mark,)
    assert run_index._BUSY_S == 2.0


def test_what_changed_is_read_again_and_no_other(runs: Path) -> None:
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


def test_another_journal_of_the_same_size_and_time_is_read_again(runs: Path) -> None:
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
    "empty": lambda index: index.write_bytes(b""),
    "no index": lambda index: index.write_bytes(b"noise" * 5000),
    "cut": lambda index: index.write_bytes(index.read_bytes()[:5000]),
    "a flipped byte": _flipped,
    "of another version": _execute("PRAGMA user_version = 7"),
    "of another table": _execute("ALTER TABLE runs DROP COLUMN holds"),
    "without a table": _execute("DROP TABLE runs"),
    "a row that is none": _execute("UPDATE runs SET summary = 'x'"),
    "a row of numbers": _execute("UPDATE runs SET mark = 7"),
    "a row of nothing": _execute("UPDATE runs SET holds = NULL"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_index_is_made_anew(runs: Path, damage: str) -> None:
    first = listed(runs)
    DAMAGE[damage](runs / INDEX)
    assert listed(runs) == first
    assert listed(runs, unread) == first


def test_an_index_that_cannot_be_written_is_done_without(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def _error(code: int | None) -> sqlite3.Error:
    error = sqlite3.OperationalError("no")
    if code is not None:
        error.sqlite_errorcode = code
    return error


@pytest.mark.parametrize(
    ("errors", "writes", "removes"),
    [
        ([], 1, 0),
        ([_error(sqlite3.SQLITE_BUSY)], 1, 0),
        ([_error(sqlite3.SQLITE_BUSY_SNAPSHOT)], 1, 0),
        ([_error(sqlite3.SQLITE_READONLY_DIRECTORY)], 1, 0),
        ([_error(sqlite3.SQLITE_CORRUPT)], 2, 1),
        ([_error(None)], 2, 1),
        ([_error(sqlite3.SQLITE_NOTADB), _error(sqlite3.SQLITE_BUSY)], 2, 1),
        ([_error(sqlite3.SQLITE_FULL)] * 3, 2, 2),
    ],
)
def test_what_passes_is_waited_for_and_what_is_broken_is_removed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, errors: list[sqlite3.Error], writes: int, removes: int
) -> None:
    done, left = list[str](), list(errors)

    def write(*_: object, anew: bool) -> None:
        done.append("write")
        if left:
            raise left.pop(0)

    monkeypatch.setattr(run_index, "_write", write)
    monkeypatch.setattr(run_index, "_remove", lambda path: done.append("remove"))
    run_index._store(tmp_path / INDEX, {}, set(), anew=True)
    assert (done.count("write"), done.count("remove")) == (writes, removes)


def test_one_of_another_version_is_made_anew_in_its_place(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = listed(runs)
    DAMAGE["of another version"](runs / INDEX)
    monkeypatch.setattr(run_index, "_remove", unread)
    assert listed(runs) == first == listed(runs, unread)


def test_what_cannot_be_removed_is_left(tmp_path: Path) -> None:
    run_index._remove(tmp_path / INDEX)
    (tmp_path / INDEX).mkdir()
    (tmp_path / f"{INDEX}-journal").touch()
    run_index._remove(tmp_path / INDEX)
    assert (tmp_path / INDEX).is_dir()
    (tmp_path / INDEX).rmdir()
    run_index._remove(tmp_path / INDEX)
    assert list(tmp_path.iterdir()) == []


def test_where_there_is_no_run_there_is_no_index(tmp_path: Path) -> None:
    (tmp_path / "holiday").mkdir()
    (found,) = listed(tmp_path)
    assert (found.mark, found.summary.name, found.rows) == ("", "holiday", [])
    assert not (tmp_path / INDEX).exists()


def test_several_at_once_see_the_same(runs: Path) -> None:
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


def test_one_run_is_told(program: Program, runs: Path) -> None:
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


def test_one_run_in_lines(program: Program, runs: Path) -> None:
    ended = program("show", runs / "complete")
    assert (ended.code, ended.err) == (0, "")
    size = sum(path.stat().st_size for path in (runs / "complete").iterdir() if path.name != "SHA256SUMS")
    lines = {line[:12].strip(): line[12:] for line in ended.out.splitlines()}
    assert lines["run"] == str(runs / "complete")
    assert lines["source"] == "tests/data/runs"
    assert lines["parameters"] == "doi_mm 0.4"
    assert lines["began"] == "2026-11-29T18:14:16+00:00, 85 s"
    assert lines["limits"].startswith("max_doi_mm 1.5, max_force_gwt 100.0, ")
    assert lines["devices"].startswith("stage virtual grbl, force virtual mtsics, controller [VER:")
    assert lines["versions"].startswith("python 3.11.7, indentation-rig 0.3.0, ")
    assert lines["model"] == "nodes 34164, e_epidermis_mpa 0.186266, from_cache True"
    assert lines["files"].startswith(f"17, {size / 1e6:.1f} MB: config.toml, data.h5, ")
    assert lines["what"] == "Bar at five positions (bars_of_five), on the virtual bench"
    assert lines["subject"] == "none"
    assert lines["state"] == "done, 5 of 5 indentations"
    assert lines["pressed"].startswith("bar:3.0 to 0.4 mm, x = -3.00 … 3.00 mm: 5 holds, mean ")
    assert "because" not in lines


def test_a_run_that_was_killed_says_where_it_left_the_indentor(program: Program, runs: Path) -> None:
    ended = program("show", runs / "stopped")
    assert "because     the run has no end record: its program was killed or the power failed\n" in ended.out
    assert (
        "where       held, at x = 0.50 mm, 0.12 mm below the nominal apex (last known and not trusted)" in ended.out
    )
    assert f"resume      rig resume {runs / 'stopped'}\n" in ended.out
    stopped(runs / "stopped", "tripped", "too much")
    ended = program("show", runs / "stopped")
    assert "state       tripped, 5 of 8 indentations\nbecause     too much\npressed" in ended.out


def test_a_script_that_did_less_than_was_planned(program: Program, runs: Path) -> None:
    stopped(runs / "stopped", "done", "")
    told = program("show", runs / "stopped", "--json").json
    assert (told["state"], told["done"]) == ("incomplete", 5)
    assert told["ending"] == {"reason_text": ENDED_EARLY, "where_text": None}
    assert "subject     S07\n" in program("show", runs / "stopped").out
    at = {"left": "lifted", "x_mm": 0.5, "height_mm": 2.0, "trusted": True, "may_touch": False}
    ending = {"doc": "stop", "t_s": 91.0, "status": "aborted", "reason": "x", "indentor": at}
    append(runs / "stopped" / "events.jsonl", ending)
    assert program("show", runs / "stopped", "--json").json["ending"] == {
        "reason_text": "x",
        "where_text": "lifted, at x = 0.50 mm, 2.00 mm above the nominal apex (trusted); "
        f"by position only, not confirmed by force; {MAY_TOUCH}",  # of before it was measured
    }


def test_a_run_that_had_no_time_for_anything(program: Program, tmp_path: Path) -> None:
    events = [{"doc": "event", "t_s": 0, "stream": "home", "data": {}}]
    documents = [START | {"planned_indentations": 1}, *events]
    (tmp_path / "events.jsonl").write_text("".join(json.dumps(one) + "\n" for one in documents), encoding="utf-8")
    told = program("show", tmp_path, "--json").json
    assert (told["devices"], told["presses"], told["parameters"], told["subject"]) == ({}, [], {}, None)
    lines = program("show", tmp_path).out.splitlines()
    assert {line[:12].strip(): line[12:] for line in lines}["source"] == "-"
    assert [line[12:] for line in lines if line[:12].strip() in ("parameters", "devices", "model")] == ["none"] * 3


def test_a_run_without_its_copies_is_told_all_the_same(program: Program, runs: Path) -> None:
    folder = runs / "complete"
    (folder / "provenance.json").unlink()
    (folder / "config.toml").write_text("[limits", encoding="utf-8")
    told = program("show", folder, "--json").json
    assert told["limits"] == {"soft_trip_of_the_plan_n": read_run(OLD / "complete").start["soft_trip_n"]}
    assert told["versions"] == [{"package": "python", "version": "unknown"}]
    assert set(told["devices"]) == {"controller", "sensor"}
