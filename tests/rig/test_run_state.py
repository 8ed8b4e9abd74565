"""A run's own terminal, `rig watch`, the panel, `rig show` and `rig resume` say the same of a run at any moment."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.cli.progress import IndentationProgress
from rig.cli.runs import _described
from rig.cli.watch import RunScreen, _now
from rig.data.documents import Document
from rig.data.folder import RunFolder
from rig.data.run import Following, read_run
from rig.data.run_state import Course, RunState, TimeLeft
from rig.panel.run_view import RunView
from rig.session.resume import ending_on_record
from tests.program import Program

OLD = Path(__file__).parents[1] / "data" / "runs"
SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.reference(x_mm=0.0, doi_mm=0.2)
    for x_mm in (0.0, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, increments=2, hold_s=0.1)
    rig.rest(1.5)
"""
UNREACHABLE = "[virtual]\nz_screw_steps_per_mm = 460.0\n"
EACH = 13
"""Documents: so often a journal is read again as a whole."""


def _dry_run(program: Program, tmp_path: Path, config: str = "") -> Path:
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    (tmp_path / "rig.toml").write_text(config, encoding="utf-8")
    told = program(
        "dry-run", tmp_path / "mine.py", "--config", tmp_path / "rig.toml", "--out", tmp_path / "runs", "--json"
    )
    return Path(told.json["run"])


def _resumed(program: Program, tmp_path: Path) -> Path:
    """Killed after its first indentation, and taken up."""
    folder = _dry_run(program, tmp_path)
    journal = folder / "events.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    end = next(n for n, line in enumerate(lines) if '"stream": "indentation_end", "data"' in line)
    journal.write_text("".join(lines[: end + 1]), encoding="utf-8")
    assert program("resume", folder, "--json").json["complete"]
    return folder


def _old(name: str) -> Callable[[Program, Path], Path]:
    return lambda program, tmp_path: OLD / name


MADE: dict[str, Callable[[Program, Path], Path]] = {
    **{name: _old(name) for name in ("complete", "complete_with_a_schedule", "stopped")},
    "a dry run": _dry_run,
    "a run that trips": lambda program, tmp_path: _dry_run(program, tmp_path, UNREACHABLE),
    "a run that was taken up": _resumed,
}


ENDS = {"stopped": "killed", "a run that trips": "tripped"}


class Shown:
    """A run whose journal is written line by line, and all who look at it."""

    def __init__(self, made: Path, path: Path) -> None:
        path.mkdir()
        for name in ("config.toml", "provenance.json", "timeline.json"):
            if (made / name).exists():
                shutil.copy(made / name, path / name)
        self.folder = RunFolder(path)
        self.lines = (made / "events.jsonl").read_bytes().splitlines(keepends=True)
        self.course = Course.load(self.folder)
        self.watch, self.journal, self.panel = RunScreen(self.folder), Following(self.folder), RunView(path)
        self.terminal = IndentationProgress(0, None)
        self.before: set[int] = set()  # indentations of the parts before

    def write(self, line: bytes) -> Document | None:
        """Everybody looks; returns the document, None where the line is torn."""
        with self.folder.events.open("ab") as file:
            file.write(line)
        self.watch.take(self.journal.new())
        self.panel.look(0.0)
        if not line.endswith(b"\n"):
            return None
        document: Document = json.loads(line)
        if document["doc"] in ("start", "resume"):
            self._begin(document["t_s"])
        elif document["doc"] == "event":
            self.t_s = document["t_s"]
            self.terminal.event(document["stream"], document["data"])
        return document

    def _begin(self, t_s: float) -> None:
        """A part has a process of its own, which knows the course before anything happens."""
        self.t_s, self.before = t_s, set(self.watch.finished)
        course = self.course
        left = None if course is None else TimeLeft(course.instants_s, course.duration_s, lambda: self.t_s, pace=1.0)
        self.terminal = IndentationProgress(0, left, course)


@pytest.mark.quick(rows=lambda name: name != "a dry run")  # as the first part of one that was taken up
@pytest.mark.usefixtures("empty_figures", "finger")
@pytest.mark.parametrize("name", MADE)
def test_all_views_of_a_run_agree_after_every_document(name: str, program: Program, tmp_path: Path) -> None:
    shown = Shown(MADE[name](program, tmp_path), tmp_path / "shown")
    last_s, latest = 0.0, RunState()
    for number, line in enumerate(shown.lines):
        document = shown.write(line)
        if document is None:
            break
        latest.apply(document)
        _the_same_of_what_goes_on(shown)
        if document["doc"] != "event":
            continue
        # at one instant of a virtual clock `rig show` knows no order
        alone, last_s = document["t_s"] > last_s, document["t_s"]
        if number % EACH == 0:
            _the_same_of_what_was_killed(shown, placed=alone and document["stream"].endswith("sample"))
    assert (shown.panel.problem, shown.panel.as_json(going=False)["state"]) == ("", ENDS.get(name, "done"))
    _the_same_of_what_has_ended(shown)
    at_once = RunScreen(shown.folder)
    at_once.take(Following(shown.folder).new())
    for other in (at_once, latest):
        for what in ("stop", "finished", "indentation", "holds", "placed", "newest", "said", "contact", "homed"):
            assert getattr(other, what) == getattr(shown.watch, what), what
    assert (at_once.now, at_once.next) == (shown.watch.now, shown.watch.next)


def _the_same_of_what_goes_on(shown: Shown) -> None:
    """The run's own terminal, `rig watch`, the panel."""
    watch, terminal, told = shown.watch, shown.terminal, shown.panel.as_json(going=True)
    assert (told["now"], told["next"], told["left_s"]) == (watch.now, watch.next, watch.left_s)
    assert (told["done"], told["planned"]) == (len(watch.finished), watch.start["planned_indentations"])
    assert shown.before | terminal.finished == watch.finished
    newest = shown.panel.newest_state(0.0)
    assert newest["force_gwt"] == watch.newest.get("force_gwt")
    if watch.stop is None:
        assert newest["phase"] == watch.newest.get("phase")
        assert (newest["x_mm"], newest["height_mm"]) == (watch.x_mm, watch.height_mm)
    moved = watch.height_mm != watch.newest.get("height_mm")
    assert newest["doi_mm"] in (watch.newest.get("doi_mm"), *([None] if moved else []))
    if watch.agenda is not None:
        assert (terminal.now, terminal.next, terminal.left_s) == (watch.now, watch.next, watch.left_s)
    if terminal.newest:
        assert terminal.force.line == watch.force.line
    if terminal.pressing and terminal.placed is not None and terminal.placed.press is not None:
        assert shown.panel.job is not None
        assert shown.panel.job.press is not None
        assert shown.panel.job.press.index == terminal.placed.press[1]["index"]


def _the_same_of_what_was_killed(shown: Shown, *, placed: bool) -> None:
    """`rig watch`, the panel, `rig show`, `rig resume`; placed: also of where it is."""
    watch, panel, show = shown.watch, shown.panel.as_json(going=False), _described(shown.folder.path)
    assert (panel["state"], show["state"]) == ("killed", "killed")
    assert show["planned"] == panel["planned"]
    assert show["done"] - panel["done"] in (0, 1)  # held to its end, and not yet over
    assert show["title"] == panel["title"]
    ending = ending_on_record(read_run(shown.folder.path))
    assert ending is not None
    assert show["ending"] == ending.as_json()
    if placed:
        at = ending.at
        assert (at.x_mm, at.height_mm, at.force_gwt) == (watch.x_mm, watch.height_mm, watch.force_gwt)
        assert at.contact == watch.contact
        newest = shown.panel.newest_state(0.0)
        assert (newest["x_mm"], newest["height_mm"], newest["force_gwt"]) == (at.x_mm, at.height_mm, at.force_gwt)


def _the_same_of_what_has_ended(shown: Shown) -> None:
    """All but the run's own terminal, which is told no end."""
    panel, show, watched = shown.panel.as_json(going=False), _described(shown.folder.path), _now(shown.watch)
    assert [watched[key] for key in ("state", "done", "planned", "ending")] == [
        show[key] for key in ("state", "done", "planned", "ending")
    ]
    assert (panel["state"], panel["done"]) == (show["state"], show["done"])
    ending: dict[str, Any] = show["ending"] or {"reason_text": ""}
    attention = shown.panel.attention(going=False, stopped=False)
    assert (attention or {"reason_text": ""})["reason_text"] == ending["reason_text"]
    assert bool(attention) == (panel["state"] != "done")


@pytest.mark.parametrize("name", ["complete_with_a_schedule", "stopped"])
def test_a_live_view_follows_a_journal_that_is_cut_within_any_line(name: str, tmp_path: Path) -> None:
    shown = Shown(OLD / name, tmp_path / "shown")
    for number, line in enumerate(shown.lines[:-1]):
        for piece in (line[: len(line) // 2], line[len(line) // 2 :]):
            with shown.folder.events.open("ab") as file:
                file.write(piece)
            shown.watch.take(shown.journal.new())
            shown.panel.look(0.0)
            told = shown.panel.as_json(going=True)
            assert (told["now"], told["done"]) == (shown.watch.now, len(shown.watch.finished))
            if number and number % (4 * EACH) == 0:
                found = read_run(shown.folder.path)
                assert found.killed
                assert {*shown.watch.finished} <= {*found.done}
    assert shown.panel.problem == ""
