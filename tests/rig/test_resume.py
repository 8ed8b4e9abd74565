"""A run that stopped goes on: what is done stays, what is missing is done, what was interrupted is done anew."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.data import FolderBusyError, RunFolder, read_run
from rig.data.journal import read_journal
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.session.resume import StoppedRun, read_stopped
from rig.session.session import FinishedRun, NewRun, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.preloaded import Popen
from tests.program import WHOLE
from tests.waiting import DEADLINE_S, journal_says, until

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
import random

from rig.protocol import Field, ProtocolParameters, Rig

METADATA = {"title": "Three places in a seeded order"}


class Parameters(ProtocolParameters):
    seed: int = Field(7, ge=0)


def run(rig: Rig) -> None:
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.note("in the air")
    places = [-0.5, 0.0, 0.5]
    random.Random(rig.parameters.seed).shuffle(places)
    for x_mm in places:
        rig.move_to(x_mm=x_mm)
        rig.indent(force_gwt=1.0, increments=2, hold_s=0.1)
    rig.note("finished")
"""
Make = Callable[..., Any]


def _session(script: Script, config: Config, finger: Fingertip, into: NewRun | StoppedRun) -> Session:
    return Session(script, config, finger, make_plan(script, config, finger), into)


@pytest.fixture(scope="module")
def whole(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An undisturbed run of the script with a seed that is not its default."""
    folder = tmp_path_factory.mktemp("whole")
    path = folder / "three.py"
    path.write_text(SCRIPT, encoding="utf-8")
    done = dry_run(_session(load_script(str(path), ["seed=3"]), Config(), finger, NewRun(folder / "runs")))
    assert done.complete, done.problem
    return done.folder.path


@pytest.fixture
def cut(whole: Path, tmp_path: Path) -> Callable[[Callable[[dict[str, Any]], bool], bytes], Path]:
    """The run as a kill leaves it: the journal ends with the first document that answers, and a torn line."""

    def make(last: Callable[[dict[str, Any]], bool], torn: bytes = b'{"doc": "eve') -> Path:
        folder = tmp_path / "cut"
        shutil.copytree(whole, folder)
        lines = (folder / "events.jsonl").read_bytes().splitlines(keepends=True)
        end = next(n for n, line in enumerate(lines) if last(json.loads(line)))
        (folder / "events.jsonl").write_bytes(b"".join(lines[: end + 1]) + torn)
        return folder

    return make


def _resume(folder: Path, finger: Fingertip) -> FinishedRun:
    stopped = read_stopped(folder)
    return dry_run(_session(stopped.script, stopped.config, finger, stopped))


def _presses(folder: Path) -> list[tuple[int, str, float, float]]:
    starts = read_run(folder).stream("indentation_start")
    return [(e["index"], e["indentor"], e["x_mm"], e["value"]) for e in starts]


def _at(stream: str, **data: Any) -> Callable[[dict[str, Any]], bool]:
    def fits(document: Mapping[str, Any]) -> bool:
        if document["doc"] != "event" or document["stream"] != stream:
            return False
        return all(document["data"].get(key) == value for key, value in data.items())

    return fits


CUT: dict[str, tuple[Callable[[dict[str, Any]], bool], int]] = {
    "start": (lambda document: document["doc"] == "start", 0),
    "home": (_at("home"), 0),
    "move": (_at("move", x_mm=0.5), 0),
    "press": (_at("sample", index=1, phase="press"), 1),
    "first hold": (_at("hold_end", index=1, hold=1), 1),
    "last hold": (_at("hold_end", index=1, hold=2), 0),
    "between": (_at("indentation_end", index=1), 0),
    "all held": (_at("hold_end", index=2, hold=2), 0),
    "no stop": (_at("note", text="finished"), 0),
}
"""The last document on disk, and how many indentations are begun anew."""


@pytest.mark.quick(rows=lambda after: after not in ("start", "move", "between"))
@pytest.mark.parametrize("after", CUT)
def test_resuming_makes_exactly_the_missing_presses(finger: Fingertip, whole: Path, cut: Make, after: str) -> None:
    """And gives what it would have: the force is a target, so it agrees to the tolerance of seeking it."""
    last, restarted = CUT[after]
    folder = cut(last)
    done = _resume(folder, finger)
    run = read_run(folder)
    assert (done.complete, run.missing, run.repeated, run.restarted) == (True, 0, 0, restarted)
    assert _presses(folder) == _presses(whole)
    assert [event["text"] for event in run.stream("note")] == ["in the air", "finished"]
    documents = list(read_journal(folder / "events.jsonl"))
    assert [d["seq"] for d in documents] == list(range(len(documents)))
    times = [d["t_s"] for d in documents]
    assert times == sorted(times)
    after = documents[[d["doc"] for d in documents].index("resume") :]
    moved = [d["stream"] for d in after if d["doc"] == "event" and d["stream"] in ("home", "zero", "move")]
    assert moved[0] == "home"
    if any(d.get("stream") == "indentation_start" for d in after):
        assert moved[:3] == ["home", "zero", "move"]
    was, now = (read_run(path).stream("hold_end") for path in (whole, folder))
    assert [(e["index"], e["hold"]) for e in now] == [(i, k) for i in range(3) for k in (1, 2)]
    assert [e["force_gwt"] for e in now] == pytest.approx([e["force_gwt"] for e in was], abs=0.05)
    assert [e["true_doi_mm"] for e in now] == pytest.approx([e["true_doi_mm"] for e in was], abs=0.02)
    if after == "first hold":  # interrupted attempts are kept apart
        assert [(e["index"], e["hold"]) for e in done.run.superseded["hold_end"]] == [(1, 1)]
        assert (folder / "hold_end_superseded.csv").read_text(encoding="utf-8").count("\n") == 2
        assert {e["index"] for e in done.run.superseded["sample"]} == {1}


def test_a_run_killed_before_its_first_document_is_resumed_from_the_start(
    finger: Fingertip, whole: Path, cut: Make
) -> None:
    folder = cut(lambda document: document["doc"] == "start")
    (folder / "events.jsonl").write_bytes(b'{"doc": "start", "ui')
    assert _resume(folder, finger).complete
    assert _presses(folder) == _presses(whole)


def test_resuming_a_complete_run_changes_no_journal_line(finger: Fingertip, whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "again"
    shutil.copytree(whole, folder)
    before = (folder / "events.jsonl").read_bytes()
    (folder / "data.h5").unlink()
    done = _resume(folder, finger)
    assert done.complete
    assert (folder / "events.jsonl").read_bytes() == before
    assert (folder / "data.h5").is_file()


def test_two_processes_cannot_write_to_one_run(cut: Make) -> None:
    folder = cut(_at("home"))
    with RunFolder(folder).owned(), raises(FolderBusyError, "folder_busy", run=str(folder)):
        read_stopped(folder)


# --- the journal ---


# --- pause ---


def test_ctrl_c_then_enter_at_a_terminal_pauses_and_continues_a_run(finger: Fingertip, tmp_path: Path) -> None:
    """Ctrl-C, look, Enter: the run ends complete, exit 0."""
    script = tmp_path / "three.py"
    script.write_text(SCRIPT, encoding="utf-8")
    ours, theirs = os.openpty()
    options = ["dry-run", str(script), "--out", str(tmp_path / "out"), "--speed", "20", "--json"]
    run = Popen([sys.executable, WHOLE, *options], stdin=theirs, stdout=subprocess.PIPE, stderr=theirs)
    os.close(theirs)
    try:
        until(journal_says(tmp_path / "out", '"press"'))
        run.send_signal(signal.SIGINT)
        until(journal_says(tmp_path / "out", '"paused"'))
        os.write(ours, b"\n")
        out, _ = run.communicate(timeout=DEADLINE_S)
    finally:
        run.kill()
        run.wait()
        os.close(ours)
    assert run.returncode == 0
    answer = json.loads(out)
    assert answer["complete"] is True
    assert answer["indentations"] == 3
    assert read_run(Path(answer["run"])).restarted == 1
