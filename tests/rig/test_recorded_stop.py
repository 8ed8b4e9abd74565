"""A stop is recorded whenever it came, and no data look worse for it."""

import json
import os
import shutil
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.data import RunFolder, read_run
from rig.data.documents import as_line, fits
from rig.data.journal import add_to_end, read_journal
from rig.data.run_state import RunState
from rig.data.tables import state_of, summary_of
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.session.early_ending import FinalPosition
from rig.session.resume import ending_on_record, read_stopped
from rig.session.session import NewRun, Session, dry_run, record_after, record_before
from sim.models.fingertip import Fingertip
from tests.error_codes import raises

SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (0.0, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=0.1)
"""
WIRE = '{"t_s": 3.5, "port": "stage", "dir": "tx", "hex": "2118"}\n'
AT_ONCE = "stopped at once by the operator"


@pytest.fixture
def script(tmp_path: Path) -> Script:
    path = tmp_path / "two.py"
    path.write_text(SCRIPT, encoding="utf-8")
    return load_script(str(path))


@pytest.fixture(scope="module")
def made(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole run."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "two.py").write_text(SCRIPT, encoding="utf-8")
    script = load_script(str(folder / "two.py"))
    plan = make_plan(script, Config(), finger)
    return dry_run(Session(script, Config(), finger, plan, NewRun(folder / "runs", "S07"))).folder.path


@pytest.fixture
def whole(made: Path, tmp_path: Path) -> RunFolder:
    return RunFolder(shutil.copytree(made, tmp_path / "runs" / made.name))


def _last(folder: RunFolder) -> Mapping[str, Any]:
    *_, last = read_journal(folder.events)
    return last


def _sums_fit(folder: RunFolder) -> bool:
    before = (folder.path / "SHA256SUMS").read_bytes()
    folder.write_checksums()
    return (folder.path / "SHA256SUMS").read_bytes() == before


# --- before it began ---


@pytest.mark.parametrize("virtual", [False, True])
def test_a_run_stopped_during_planning_has_a_folder_and_is_aborted(
    script: Script, tmp_path: Path, virtual: bool
) -> None:
    folder = record_before(script, Config(), NewRun(tmp_path / "runs", "S07"), virtual=virtual)
    record_after(folder, "planning", WIRE)
    run = read_run(folder.path)
    start, stop = read_journal(folder.events)
    assert (start["doc"], start["planned_indentations"], start["virtual"]) == ("start", 0, virtual)
    assert (start["protocol"], start["title"], start["subject"]) == ("two", script.title, "S07")
    assert (stop["status"], stop["reason"], stop["stopped_while"]) == ("aborted", AT_ONCE, "planning")
    assert stop["indentor"]["left"] == "not moved"
    assert folder.bytes_log.read_text(encoding="ascii") == WIRE
    assert (run.complete, state_of(run), summary_of(run).done) == (False, "aborted", 0)
    assert json.loads(folder.provenance.read_text(encoding="utf-8"))["model"] is None
    assert _sums_fit(folder)
    assert folder.changed() == []
    with folder.owned():
        pass


def test_a_run_stopped_during_planning_cannot_be_resumed(script: Script, tmp_path: Path) -> None:
    folder = record_before(script, Config(), NewRun(tmp_path / "runs"), virtual=True)
    with raises(BadInputError, "never_planned", path=str(folder.path)):
        read_stopped(folder.path)


def _cut(folder: RunFolder, last: Callable[[Mapping[str, Any]], bool]) -> None:
    lines = folder.events.read_bytes().splitlines(keepends=True)
    end = next(n for n, line in enumerate(lines) if last(json.loads(line)))
    folder.events.write_bytes(b"".join(lines[: end + 1]))


@pytest.mark.parametrize("said", [False, True], ids=["killed", "ended"])
def test_a_stop_while_a_resume_is_planned_keeps_where_the_indentor_was_left(whole: RunFolder, said: bool) -> None:
    _cut(whole, lambda one: one["doc"] == "event" and one["data"].get("phase") == "hold")
    left: Any = None
    if said:
        left = {"left": "held", "x_mm": 0.25, "height_mm": -0.1, "trusted": False, "may_touch": True,
                "contact": "touching", "force_gwt": 2.0}  # fmt: skip
        with whole.events.open("a", encoding="ascii") as file:
            number = sum(1 for _ in read_journal(whole.events))
            document = {"doc": "stop", "seq": number, "t_s": 99.0, "unix_s": 1.0, "status": "failed", "reason": "x"}
            file.write(as_line({**document, "indentor": left}).decode())
    stopped = read_stopped(whole.path)
    assert stopped.run is not None
    end_s, duration_s = stopped.run.end_s, stopped.run.duration_s
    assert record_before(stopped.script, stopped.config, stopped, virtual=True) == whole
    record_after(whole, "planning", "")
    *_, resume, stop = read_journal(whole.events)
    assert (resume["doc"], resume["missing"], resume["after"]) == ("resume", 2, None)
    assert (stop["status"], stop["reason"], stop["stopped_while"]) == ("aborted", AT_ONCE, "planning")
    assert resume["t_s"] >= end_s
    again = read_run(whole.path)
    assert again.duration_s == pytest.approx(duration_s, abs=1.0)
    ending = ending_on_record(again)
    assert ending is not None
    assert ending.at.may_touch is True, "planning has not lifted it"
    if said:
        assert stop["indentor"] == {**left, "measured_unix_s": None, "aged": False}
    assert read_stopped(whole.path).complete is False


def test_a_stop_while_an_empty_run_is_resumed_journals_start_and_stop(whole: RunFolder) -> None:
    whole.events.unlink()
    stopped = read_stopped(whole.path)
    record_before(stopped.script, stopped.config, stopped, virtual=True)
    start, stop = read_journal(whole.events)
    assert (start["doc"], start["subject"], stop["status"]) == ("start", "S07", "aborted")


# --- after it ended ---


def test_a_stop_during_the_report_leaves_the_run_done(whole: RunFolder) -> None:
    before, documents = read_run(whole.path), list(read_journal(whole.events))
    wire = whole.bytes_log.read_text(encoding="ascii")
    record_after(whole, "reporting", WIRE)
    after, (*kept, last) = read_run(whole.path), read_journal(whole.events)
    assert kept == documents
    assert last["stopped_while"] == "reporting"
    differs = {key for key in last if last[key] != documents[-1].get(key)}
    assert differs == {"uid", "seq", "unix_s", "stopped_while", "crc32"}
    assert last["seq"] == documents[-1]["seq"] + 1
    assert (after.complete, state_of(after), after.done) == (True, "done", before.done)
    assert (after.duration_s, after.end_s) == (before.duration_s, before.end_s)
    assert whole.bytes_log.read_text(encoding="ascii") == wire + WIRE
    assert _sums_fit(whole)


@pytest.mark.parametrize(
    ("status", "state", "said_again"),
    [
        ("aborted", "running", False),
        ("aborted", "paused", False),
        ("aborted", "reporting", True),
        ("done", "running", True),
        ("tripped", "running", True),
    ],
)
def test_a_second_end_document_is_written_only_if_the_first_omits_the_stop(
    whole: RunFolder, status: str, state: str, said_again: bool
) -> None:
    """What the engine's own journal has written down as aborted is the record."""
    add_to_end(whole.events, {"status": status}, 5.0)
    documents = len(list(read_journal(whole.events)))
    record_after(whole, state, "")
    *_, last = found = list(read_journal(whole.events))
    assert len(found) == documents + said_again
    assert (last["status"], last.get("stopped_while")) == (status, state if said_again else None)


def test_a_stopped_run_without_an_end_document_receives_one(whole: RunFolder) -> None:
    _cut(whole, lambda one: one["doc"] == "event" and one["data"].get("phase") == "hold")
    known = FinalPosition.last_known(read_run(whole.path))
    t_s = _last(whole)["t_s"]
    record_after(whole, "running", WIRE)
    last = _last(whole)
    assert (last["doc"], last["status"], last["reason"], last["t_s"]) == ("stop", "aborted", AT_ONCE, t_s)
    assert last["stopped_while"] == "running"
    assert FinalPosition(**last["indentor"]) == known
    assert known.may_touch is True


def test_a_run_killed_after_any_document_is_where_its_last_event_says(finger: Fingertip, tmp_path: Path) -> None:
    """Events of one instant, of which a virtual clock has many, count in the journal's order."""
    path = tmp_path / "rests.py"
    rests = SCRIPT.replace("        rig.indent", "        if x_mm:\n            rig.rest(1.0)\n        rig.indent")
    path.write_text(rests, encoding="utf-8")
    script = load_script(str(path))
    plan = make_plan(script, Config(), finger)
    whole = dry_run(Session(script, Config(), finger, plan, NewRun(tmp_path / "runs"))).folder
    lines = whole.events.read_bytes().splitlines(keepends=True)
    state, contacts = RunState(), Counter[tuple[str, Any]]()
    for n, document in enumerate(map(json.loads, lines[:-1]), 1):
        state.apply(document)
        whole.events.write_bytes(b"".join(lines[:n]))
        known = FinalPosition.last_known(read_run(whole.path))
        place = (state.x_mm, state.height_mm)
        assert (known.x_mm, known.height_mm) == place, document
        assert known.contact not in ("lifted", "raised"), "a finger moves, and nobody looks"
        assert known.force_gwt == (None if state.contact is None else state.force_gwt)
        if document["doc"] == "event":
            contacts[document["stream"], known.may_touch] += 1
    assert contacts["indentation_start", True] == contacts["retract", True] == 2


def test_an_appended_document_is_flushed_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, bytes_at_sync = tmp_path / "events.jsonl", list[int]()
    path.write_bytes(b'{"doc": "stop", "uid": "b", "seq": 0, "t_s": 2.5, "status": "done"}\n')
    monkeypatch.setattr(os, "fsync", lambda descriptor: bytes_at_sync.append(os.fstat(descriptor).st_size))
    add_to_end(path, {"reason": "again"}, 12.0)
    assert bytes_at_sync[-1] == path.stat().st_size


def test_an_appended_end_document_extends_the_last_complete_one(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_bytes(
        b'{"doc": "start", "uid": "a", "seq": 0, "t_s": 1.5}\n'
        b'{"doc": "stop", "uid": "b", "seq": 1, "t_s": 2.5, "unix_s": 9.0, "status": "done"}\n{"doc": "st'
    )
    add_to_end(path, {"reason": "again"}, 12.3456789)
    *_, before, last = read_journal(path)
    assert before["uid"] == "b"
    assert last.pop("uid") not in ("a", "b")
    assert fits(as_line(last).rstrip(b"\n"))
    assert last.pop("crc32")
    assert last == {"doc": "stop", "seq": 2, "t_s": 2.5, "unix_s": 12.345679, "status": "done", "reason": "again"}
