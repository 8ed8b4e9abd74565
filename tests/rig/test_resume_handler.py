"""A resumed run: what its folder holds, what its journal answers, what is compared, and what is repeated."""

import errno
import json
import math
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from rig.clock import WallClock
from rig.data import Run, RunFolder, new_run_folder
from rig.data.events import STREAMS
from rig.data.folder import IDENTIFICATION_PAGE
from rig.data.folder import SCRIPT as SCRIPT_OF_IDENTIFICATION
from rig.data.journal import Journal
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.protocol.check import PressPlace
from rig.protocol.handlers import ResumeHandler
from rig.protocol.same_steps import SamePlan, SameSteps, as_lines, planned_step
from rig.protocol.script import load_script
from rig.protocol.steps import (
    Checkpoint,
    Home,
    Indent,
    Mount,
    MoveTo,
    Note,
    Precondition,
    Ramp,
    Reference,
    Rest,
    ResumeRule,
    Retract,
    Step,
    Touch,
    Zero,
)
from rig.records import Hold, Indentation, PressId, Target
from rig.session import resume
from rig.session.resume import commit, first_reference_gwt, provenance, read_stopped
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

# --- what is answered, and what is done ---


def _end(hold: int, force_gwt: float) -> dict[str, Any]:
    return {"hold": hold, "x_mm": 0.5, "doi_mm": 0.1 * hold, "force_gwt": force_gwt, "force_sd_gwt": 0.01}


@dataclass
class Told:
    """A journal with these indentations done, in two holds each, and these events in its streams."""

    indentations: tuple[int, ...] = ()
    streams: dict[str, list[dict[str, Any]]] = field(default_factory=dict)

    @property
    def done(self) -> dict[int, list[dict[str, Any]]]:
        return {index: [_end(1, 1.0 + index), _end(2, 2.0 + index)] for index in self.indentations}

    def stream(self, name: str) -> list[dict[str, Any]]:
        held = [
            {"index": index, "hold": k, "target": "doi_mm", "commanded": 0.1 * k}
            for index in self.indentations
            for k in (1, 2)
        ]
        return held if name == "hold_start" else self.streams.get(name, [])


@dataclass
class Again:
    """Hands a script's steps to a run that is taken up, and keeps what is done."""

    told: Told
    done: list[Step[Any, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._taken_up = ResumeHandler(self.told, self, 1.0)

    def handle(self, step: Step[Any, Any], place: PressPlace) -> str:
        self.done.append(step)
        return "done now"

    def give(self, *steps: Step[Any, Any]) -> None:
        for step in steps:
            self._taken_up.handle(step, PressPlace("bar", 0.0, 0.0, ()))

    def press(self, step: Step[Any, Any], index: int) -> Any:
        purpose: Any = "find" if isinstance(step, Touch) else "data"
        return self._taken_up.handle(step, PressPlace("bar", 0.0, 0.0, (PressId(index, purpose),)))


INDENT = Indent(doi_mm=0.2, increments=2)


def test_a_resumed_script_receives_the_journaled_holds_of_a_finished_indentation() -> None:
    again = Again(Told((0, 1)))
    holds = tuple(
        Hold(Target("doi_mm", 0.1 * k), doi_mm=0.1 * k, force_gwt=k + 1.0, force_sd_gwt=0.01) for k in (1, 2)
    )
    assert again.press(INDENT, 1) == Indentation(1, 0.5, holds)
    assert again.done == []


TO, PRESSED = MoveTo, Precondition(presses=1, doi_mm=0.2)
AFTER = (Retract(), Home(), Note(text="a"), Rest(seconds=1.0), TO(x_mm=2.0))
OWED: dict[str, tuple[Told, list[Any], list[Step[Any, Any]]]] = {
    # what the journal has, the steps of the script (a press with its index), and what is done of them
    "nothing is done": (
        Told(), [Home(), Zero(), TO(x_mm=1.0), (INDENT, 0), *AFTER], [Zero(), TO(x_mm=1.0), INDENT, *AFTER]),
    "from the first missing press on everything": (
        Told((0, 1)), [Home(), Zero(), TO(x_mm=1.0), (INDENT, 0), (INDENT, 1), (INDENT, 2), *AFTER],
        [Zero(), TO(x_mm=1.0), INDENT, *AFTER]),
    "a press between others, and what lies after it only for the next that is missing": (
        Told((0, 2)),
        [TO(x_mm=0.0), (INDENT, 0), TO(x_mm=1.0), (INDENT, 1), Retract(), TO(x_mm=2.0), Rest(seconds=5.0),
         (INDENT, 2), TO(x_mm=3.0), Rest(seconds=6.0), (INDENT, 3), Retract()],
        [TO(x_mm=1.0), INDENT, TO(x_mm=3.0), Rest(seconds=6.0), INDENT, Retract()]),
    "no word twice, each kind by its number": (
        Told((0,), {"note": [{}, {}], "checkpoint": [{}]}),
        [Note(text="1"), Note(text="2"), Checkpoint(name="1"), Checkpoint(name="2"), Note(text="3")],
        [Checkpoint(name="2"), Note(text="3")]),
    "a touch, after which what is done stays done": (
        Told((0,), {"find": [{"index": 0, "contact_height_mm": -0.25}]}),
        [Home(), Zero(), TO(x_mm=1.0), Rest(seconds=1.0), (Touch(), 0), TO(x_mm=2.0), (Touch(), 1), Retract(),
         TO(x_mm=3.0), Rest(seconds=2.0), (INDENT, 0), (INDENT, 1)],
        [Zero(), Rest(seconds=1.0), TO(x_mm=2.0), Touch(), TO(x_mm=3.0), INDENT]),
    "no preconditioning of an indentor that is off": (
        Told((0,)),
        [Mount(indentor="a"), Zero(), TO(x_mm=0.0), PRESSED, (INDENT, 0), Mount(indentor="b"), TO(x_mm=1.0),
         (INDENT, 1)],
        [Zero(), Mount(indentor="b"), TO(x_mm=1.0), INDENT]),
    "only the last move before a preconditioning and after it": (
        Told((0,)), [Zero(), TO(x_mm=0.0), PRESSED, (INDENT, 0), TO(x_mm=1.0), (INDENT, 1)],
        [Zero(), PRESSED, TO(x_mm=1.0), INDENT]),
    "the zero before the preconditioning, and the one after it": (
        Told((0,)),
        [Mount(indentor="a"), Zero(), TO(x_mm=0.0), PRESSED, (INDENT, 0), Zero(), Zero(), (INDENT, 1)],
        [Mount(indentor="a"), Zero(), TO(x_mm=0.0), PRESSED, Zero(), INDENT]),
}  # fmt: skip


@pytest.mark.parametrize("what", OWED)
def test_a_resumed_run_repeats_the_preparations_of_each_missing_press(what: str) -> None:
    told, steps, done = OWED[what]
    again = Again(told)
    for step in steps:
        if isinstance(step, tuple):
            again.press(*step)
        else:
            again.give(step)
    assert again.done == done


def test_a_resumed_script_receives_the_journaled_height_of_a_finished_touch() -> None:
    assert Again(Told((), {"find": [{"index": 0, "contact_height_mm": -0.25}]})).press(Touch(), 0) == -0.25


def test_a_resumed_run_repeats_a_verb_that_journals_no_answer() -> None:
    class Ask(Touch):
        """Answers, and leaves nothing in the journal."""

        verb: ClassVar[str] = "ask"
        on_resume: ClassVar[ResumeRule] = ResumeRule.ANSWER
        answers = Step.answers

    assert Again(Told((0,))).press(Ask(), 0) == "done now"


def test_a_resumed_run_refuses_another_press_for_good_and_lists_another_note() -> None:
    """At every step, and at the end: a script may catch the refusal."""
    journal = Told((0,), {"indentation_start": [PRESSED_BEFORE], "note": [{"text": "a"}]})
    handler = ResumeHandler(journal, Again(journal), 1.0)
    handler.handle(Note(text="b"), PressPlace("bar", 0.0, 0.0, ()))
    assert handler.differences == ["note: 'b', where the run has 'a'"]
    handler.end()
    for step in (Indent(doi_mm=0.3, increments=2), INDENT):
        with raises(BadInputError, "another_press"):
            handler.handle(step, AT)
    with raises(BadInputError, "another_press"):
        handler.end()


def test_a_checkpoint_in_the_journal_is_answered_and_the_next_one_carried_out() -> None:
    class Counted(Checkpoint):
        """It has an answer in the journal."""

        @classmethod
        def answers(cls, before: Any) -> dict[int, Any]:
            return {n: f"answer {n}" for n in range(len(before.stream("checkpoint")))}

    told = Told((), {"checkpoint": [{}, {}]})
    again = Again(told)
    at = PressPlace("bar", 0.0, 0.0, ())
    found = [again._taken_up.handle(Counted(name=name), at) for name in "abc"]
    assert found == ["answer 0", "answer 1", "done now"]


# --- what is compared with the journal, and with the plan ---

AT = PressPlace("bar", 0.0, 0.0, (PressId(0),))
PRESSED_BEFORE: dict[str, Any] = {
    "index": 0, "indentor": "bar", "x_mm": 0.0, "verb": "indent", "target": "doi_mm", "value": 0.2, "increments": 2,
    "speed_mm_s": 1.0, "hold_s": 1.0, "rest_s": 0.0,
}  # fmt: skip
OLD = {key: value for key, value in PRESSED_BEFORE.items() if key not in ("verb", "speed_mm_s", "hold_s", "rest_s")}
"""A press in a journal of 0.2."""
RAMP = Ramp(doi_mm=0.2, speed_mm_s=0.3)
MARKED = PressPlace("bar", 0.0, 0.0, (PressId(0, "data", {"block": 1}),))
COMPARED: dict[str, tuple[dict[str, list[dict[str, Any]]], Step[Any, Any], PressPlace, bool]] = {
    # the streams of the journal, the step that the script makes now and where; whether it is another one
    "the same press": ({"indentation_start": [PRESSED_BEFORE]}, INDENT, AT, False),
    "a press that is not in the journal": ({"indentation_start": [PRESSED_BEFORE | {"index": 1}]}, INDENT, AT, False),
    **{
        f"another {key}": ({"indentation_start": [PRESSED_BEFORE | {key: value}]}, INDENT, AT, True)
        for key, value in (
            ("indentor", "step"), ("x_mm", 0.1), ("verb", "ramp"), ("target", "force_gwt"), ("value", 0.3),
            ("increments", 1), ("speed_mm_s", 0.5), ("hold_s", 2.0), ("rest_s", 2.0), ("block", 1),
            ("repeat", 1), ("condition", "a"),
        )
    },
    "another mark": ({"indentation_start": [PRESSED_BEFORE]}, INDENT, MARKED, True),
    "a press of 0.2": ({"indentation_start": [OLD]}, INDENT, AT, False),
    "a press of 0.2, which recorded no mark": ({"indentation_start": [OLD]}, INDENT, MARKED, False),
    "a ramp of 0.2": (
        {"indentation_start": [OLD | {"increments": 1}], "ramp": [{"index": 0, "speed_mm_s": 0.3}]}, RAMP, AT, False),
    "another speed of a ramp of 0.2": (
        {"indentation_start": [OLD | {"increments": 1}], "ramp": [{"index": 0, "speed_mm_s": 0.4}]}, RAMP, AT, True),
    "a press for a ramp of 0.2": (
        {"indentation_start": [OLD], "ramp": [{"index": 0, "speed_mm_s": 1.0}]}, INDENT, AT, True),
    "a reference press of that index": ({"reference_indentation_start": [OLD | {"value": 9.0}]}, INDENT, AT, False),
    **{
        f"a {purpose} press that has the index of a ramp": (
            {f"{purpose}_indentation_start": [OLD | {"increments": 1}], "ramp": [{"index": 0, "speed_mm_s": 0.4}]},
            step, PressPlace("bar", 0.0, 0.0, (PressId(0, purpose),)), False)
        for purpose, step in (
            ("reference", Reference(x_mm=0.0, doi_mm=0.2, increments=1)),
            ("precondition", PRESSED),
        )
    },
    "the same checkpoint": ({"checkpoint": [{"name": "a"}]}, Checkpoint(name="a"), AT, False),
    "another checkpoint": ({"checkpoint": [{"name": "a"}]}, Checkpoint(name="b"), AT, True),
    "a checkpoint that is not in the journal": ({}, Checkpoint(name="b"), AT, False),
}  # fmt: skip


@pytest.mark.parametrize("what", COMPARED)
def test_a_step_other_than_that_in_the_journal_is_refused_for_good(what: str) -> None:
    streams, step, place, other = COMPARED[what]
    same = SameSteps(Told(streams=streams))
    if not other:
        same.compare(step, place, 1.0)
        same.end()
        assert same.differences == []
        return
    for again in (lambda: same.compare(step, place, 1.0), lambda: same.compare(Home(), AT, 1.0), same.end):
        with raises(BadInputError, "another_press"):
            again()


def test_another_note_or_rest_than_in_the_journal_is_listed() -> None:
    same = SameSteps(Told(streams={"note": [{"text": "a"}, {"text": "b"}], "rest": [{"rest_s": 1.0}]}))
    for step in (Note(text="a"), Note(text="c"), Note(text="d"), Rest(seconds=1.0), Rest(seconds=2.0)):
        same.compare(step, AT, 1.0)
    same.end()
    assert same.differences == ["note: 'c', where the run has 'b'", "rest: 2 s, where the run has 1 s"]


PLANNED: list[dict[str, Any]] = [
    {"verb": "home"}, {"verb": "note", "what": "a"}, {"press": "data", "index": 0, "presses": 1, "x_mm": 0.5},
    {"verb": "rest", "what": 1.0},
]  # fmt: skip


@pytest.mark.parametrize(
    ("now", "refused", "differences"),
    [
        (PLANNED, False, []),
        (PLANNED[:1] + PLANNED[2:], False, ["note: none, where the run has 'a'"]),
        ([*PLANNED, {"verb": "note", "what": "b"}], False, ["note: 'b', where the run has 'none'"]),
        ([*PLANNED[:3], {"verb": "rest", "what": 2.0}], False, ["rest: 2 s, where the run has 1 s"]),
        (PLANNED[:2], True, []),
        ([*PLANNED, {"verb": "retract"}], True, []),
        ([{"verb": "zero"}, *PLANNED[1:]], True, []),
        ([*PLANNED[:2], PLANNED[2] | {"index": 1}], True, []),
        ([*PLANNED[:2], PLANNED[2] | {"x_mm": 0.6}], True, []),
        ([*PLANNED[:2], PLANNED[2] | {"presses": 2}], True, []),
    ],
)
def test_a_step_other_than_that_in_the_plan_is_refused_and_another_note_or_rest_is_listed(
    now: list[dict[str, Any]], refused: bool, differences: list[str]
) -> None:
    same = SamePlan(PLANNED)

    def compared() -> None:
        for asked in now:
            same.compare(asked)
        same.end()

    if not refused:
        compared()
        assert same.differences == differences
        return
    for _ in range(2):
        with raises(BadInputError, "another_press"):
            compared()


@pytest.mark.parametrize(
    ("step", "place", "expected"),
    [
        (Home(), PressPlace("", math.nan, 0.0, ()), {"verb": "home"}),
        (Mount(indentor="bar"), AT, None),
        (Rest(seconds=np.float64(1.5)), PressPlace("bar", 0.0, 0.0, ()), {"verb": "rest", "what": 1.5}),
        (INDENT, AT, PRESSED_BEFORE | {"press": "data", "presses": 1}),
        (
            Touch(),
            PressPlace("bar", math.nan, np.int64(1), (PressId(2, "find"), PressId(3, "find"))),  # type: ignore[arg-type]
            {"press": "find", "index": 2, "presses": 2, "indentor": "bar", "x_mm": None, "along_mm": 1},
        ),
    ],
)
def test_a_planned_step_is_stored_in_types_of_json(
    step: Step[Any, Any], place: PressPlace, expected: dict[str, Any] | None
) -> None:
    found = planned_step(step, place, 1.0)
    assert found == expected
    if found is not None:
        assert json.loads(as_lines([found])) == found


# --- what the folder tells ---

SCRIPT = "def run(rig):\n    rig.mount('bar:3')\n"


@pytest.fixture
def stopped(tmp_path: Path) -> Callable[..., Path]:
    """A run of a script that says two things, stopped with this status, or killed before it has one."""

    def make(status: str | None = None, planned: int = 0, **more: Any) -> Path:
        script = tmp_path / "mine.py"
        script.write_text(SCRIPT, encoding="utf-8")
        about = {"protocol": "mine.py", "parameters": {}, "virtual": False, "subject": "S07", **more}
        folder = new_run_folder(tmp_path, "mine", datetime.now(UTC), script, Config().as_toml(), about)
        with Journal(folder.events, VirtualClock(), STREAMS) as journal:
            journal.start({"planned_indentations": planned})
            journal.event("note", {"text": "one"})
            journal.event("note", {"text": "two"})
            journal.stop(status or "done")
        if status is None:
            lines = folder.events.read_bytes().splitlines(keepends=True)
            folder.events.write_bytes(b"".join(lines[:-1]))
        return folder.path

    return make


def test_a_resumed_run_uses_its_copies_of_modules_and_files(tmp_path: Path) -> None:
    """A copy that has changed is refused as that of the script is."""
    beside = {"places.py": b"TIMES = 3", "trials.csv": b"x_mm,1"}
    path = tmp_path / "mine.py"
    for name, content in beside.items():
        (tmp_path / name).write_bytes(content)
    path.write_text(f"import places\nMETADATA = {{'files': ['trials.csv']}}\n{SCRIPT}", encoding="utf-8")
    script, now = load_script(str(path)), datetime.now(UTC)
    about = provenance(script, Config(), None, now, virtual=True)
    folder = new_run_folder(tmp_path / "runs", "mine", now, path, Config().as_toml(), about, script.beside)
    for name in beside:
        (tmp_path / name).unlink()
    assert read_stopped(folder.path).script.beside == beside
    assert beside.items() <= folder.copies().items()
    for name in beside:
        (folder.path / name).write_bytes(b"TIMES = 4")
    assert set(folder.changed()) == set(beside)


@pytest.mark.parametrize(
    ("status", "planned", "complete"),
    [("done", 0, True), ("done", 1, False), ("aborted", 0, False), (None, 0, False)],
)
def test_a_run_is_complete_only_if_done_with_all_planned_presses(
    stopped: Callable[..., Path], status: str | None, planned: int, complete: bool
) -> None:
    found = read_stopped(stopped(status, planned))
    assert found.complete is complete
    assert (found.script.name, found.virtual, found.subject, found.config) == ("mine", False, "S07", Config())
    assert found.run is not None
    assert [event["text"] for event in found.run.stream("note")] == ["one", "two"]


def test_a_run_with_an_empty_journal_is_not_complete(stopped: Callable[..., Path]) -> None:
    path = stopped()
    RunFolder(path).events.write_bytes(b'{"doc": "sta')
    found = read_stopped(path)
    assert found.run is None
    assert (found.complete, found.begins_at_s) == (False, 0.0)


@pytest.mark.parametrize("name", ["provenance.json", "protocol.py", "config.toml", "SHA256SUMS"])
def test_resuming_names_the_missing_file_of_a_run(stopped: Callable[..., Path], name: str) -> None:
    path = stopped()
    (path / name).unlink()
    problem = os.strerror(errno.ENOENT)
    with raises(BadInputError, "no_run_folder", path=str(path), file=str(path / name), problem=problem):
        read_stopped(path)


def test_resuming_names_all_changed_copies_of_a_run(stopped: Callable[..., Path]) -> None:
    path = stopped()
    for name in ("config.toml", "protocol.py"):
        (path / name).write_text("# another\n", encoding="utf-8")
    with raises(BadInputError, "changed_since", path=str(path), files="protocol.py, config.toml"):
        read_stopped(path)


def test_resuming_a_journal_without_a_start_document_is_refused(stopped: Callable[..., Path]) -> None:
    path = stopped()
    lines = RunFolder(path).events.read_bytes().splitlines(keepends=True)
    RunFolder(path).events.write_bytes(b"".join(lines[1:]))
    with raises(BadInputError, "no_start", run=str(path)):
        read_stopped(path)


# --- the first reference ---


def _run(compared: list[int], forces: dict[tuple[int, int], float]) -> Run:
    ends = [{"index": i, "hold": k, "force_gwt": gwt} for (i, k), gwt in forces.items()]
    events = {"reference": [{"index": i} for i in compared], "reference_hold_end": ends}
    return Run(RunFolder(Path()), {}, None, {}, events, {}, duration_s=0.0, end_s=0.0)


def test_the_first_reference_press_is_the_first_complete_one() -> None:
    """In the order of its holds; one that was interrupted between its holds was not compared."""
    forces = {(0, 1): 9.0, (2, 2): 2.0, (2, 1): 1.0, (3, 1): 3.0, (3, 2): 4.0}
    assert first_reference_gwt(_run([3, 2], forces)) == [1.0, 2.0]
    assert first_reference_gwt(_run([], forces)) is None


def test_parameters_of_any_type_are_on_record(tmp_path: Path) -> None:
    path = tmp_path / "dated.py"
    path.write_text(
        "import datetime\nfrom rig.protocol import ProtocolParameters\n"
        "class Parameters(ProtocolParameters):\n    day: datetime.date = datetime.date(2026, 3, 1)\n"
        "def run(rig):\n    rig.home()\n",
        encoding="utf-8",
    )
    made = provenance(load_script(str(path)), Config(), None, datetime(2026, 3, 1, tzinfo=UTC), virtual=True)
    assert json.loads(json.dumps(made))["parameters"] == {"day": "2026-03-01"}


# --- what a folder says against resuming ---


def _journal(path: Path, change: Callable[[list[dict[str, Any]]], object]) -> None:
    events = RunFolder(path).events
    lines = [json.loads(line) for line in events.read_text(encoding="utf-8").splitlines()]
    change(lines)
    for line in lines:
        line.pop("crc32")
    events.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")


@pytest.mark.parametrize(
    ("about", "page", "code", "words"),
    [
        ({"protocol": SCRIPT_OF_IDENTIFICATION}, False, "identification", "its presses remain in its journal"),
        ({"protocol": SCRIPT_OF_IDENTIFICATION}, True, "identification", "its result is in its finger file and in"),
        ({"choose": True}, False, "earlier_choice", "--choose"),
    ],
)
def test_a_run_of_a_kind_that_cannot_be_resumed_says_so(
    stopped: Callable[..., Path], about: dict[str, Any], page: bool, code: str, words: str
) -> None:
    path = stopped("aborted", **about)
    if page:
        (path / IDENTIFICATION_PAGE).write_text("<p>found</p>", encoding="utf-8")
    with raises(BadInputError, code) as caught:
        read_stopped(path)
    assert f"{path}" in str(caught.value)
    assert words in str(caught.value)
    assert (str(path / IDENTIFICATION_PAGE) in str(caught.value)) is page


@pytest.mark.parametrize("planned", [0, 2])
def test_a_run_that_was_stopped_while_planning_is_resumed_only_with_presses_planned(
    stopped: Callable[..., Path], planned: int
) -> None:
    path = stopped("aborted", planned)
    _journal(path, lambda lines: lines[-1].update(stopped_while="planning"))
    with nullcontext() if planned else raises(BadInputError, "never_planned", path=str(path)):
        assert not read_stopped(path).complete


@pytest.mark.parametrize(("virtual", "begins_s"), [(True, 3.0), (False, 3600.0)])
def test_a_resumed_part_begins_where_the_clock_of_the_run_stands(
    stopped: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, virtual: bool, begins_s: float
) -> None:
    """An hour after the start, by the wall clock; the clock of a virtual run stood still since its last event."""
    path = stopped("aborted", virtual=virtual)
    _journal(path, lambda lines: (lines[0].update(unix_s=1.7e9), lines[-1].update(t_s=3.0)))
    monkeypatch.setattr(WallClock, "unix_s", lambda self: 1.7e9 + 3600.0)
    assert read_stopped(path).begins_at_s == pytest.approx(begins_s)


def test_a_resumed_run_keeps_its_parameters(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from rig.protocol import ProtocolParameters\nclass Parameters(ProtocolParameters):\n    presses: int = 1\n"
        "def run(rig):\n    rig.home()\n",
        encoding="utf-8",
    )
    script, now = load_script(str(path), ["presses=3"]), datetime.now(UTC)
    about = provenance(script, Config(), None, now, virtual=True, subject="S07")
    folder = new_run_folder(tmp_path / "runs", "mine", now, path, Config().as_toml(), about)
    found = read_stopped(folder.path)
    assert found.script.parameters.model_dump() == {"presses": 3}
    assert (found.script.name, found.subject, found.virtual) == ("mine", "S07", True)


# --- what a run says of its own making ---


@pytest.mark.parametrize("virtual", [True, False])
def test_a_run_has_its_versions_command_commit_and_devices_on_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, virtual: bool
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(SCRIPT, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["/usr/bin/rig", "run", "mine.py"])
    now = datetime(2026, 3, 1, 12, 0, 7, 250_000, tzinfo=UTC)
    config = Config.model_validate({"stage": {"kind": "zaber"}, "force": {"kind": "mtsics"}})
    made = json.loads(
        json.dumps(provenance(load_script(str(path)), config, None, now, virtual=virtual, subject="S07"))
    )
    before = "virtual " if virtual else ""
    packages = ("indentation-rig", "numpy", "scipy", "h5py", "pydantic", "matplotlib")
    assert made == {
        "started_utc": "2026-03-01T12:00:07+00:00",
        "command": ["rig", "run", "mine.py"],
        "protocol": "mine.py",
        "parameters": {},
        "subject": "S07",
        "virtual": virtual,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "versions": {name: version(name) for name in packages},
        "commit": commit(Path(resume.__file__)),
        "model": None,
        "devices": {"stage": f"{before}zaber", "force": f"{before}mtsics"},
    }


@pytest.mark.skipif(shutil.which("git") is None, reason="no git")
def test_a_stored_commit_is_that_of_the_file_and_marked_if_files_changed_since(tmp_path: Path) -> None:
    def git(*words: str) -> str:
        who = ("-c", "user.name=somebody", "-c", "user.email=", "-c", "commit.gpgsign=false")
        done = subprocess.run(["git", *who, *words], cwd=tmp_path, check=True, capture_output=True, text=True)
        return done.stdout.strip()

    module = tmp_path / "module.py"
    module.write_text("a = 1\n")
    git("init", "-q")
    assert commit(module) is None, "nothing is committed"
    git("add", "module.py")
    git("commit", "-q", "-m", "one")
    assert commit(module) == git("rev-parse", "HEAD")
    other = tmp_path / "other.py"
    other.write_text("b = 1\n")
    assert commit(module) == git("rev-parse", "HEAD"), "a file that git does not know is no change of the program"
    assert commit(other) is None
    module.write_text("a = 2\n")
    assert commit(module) == git("rev-parse", "HEAD") + " with changes"


def test_without_git_no_commit_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert commit(Path(resume.__file__)) is None
