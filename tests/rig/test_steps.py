"""Steps and their handlers: what is solved when, what a resumed run does again, how steps are marked."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.data import Run
from rig.data.documents import as_line
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import Plan, make_plan
from rig.protocol.api import Rig
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.script import Script, load_script
from rig.protocol.steps import Mount, Step
from rig.records import Prediction
from rig.session.resume import read_stopped
from rig.session.session import FinishedRun, NewRun, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.error_codes import has_code

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches."""
CONFIG = Config.model_validate(NEAR)
BODY = """\
from rig.protocol import ScheduledParameters


class Parameters(ScheduledParameters):
    pass


def run(rig):
    rig.mount("cylinder:9")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.25)
    rig.indent(doi_mm=0.3, hold_s=0.1)
    for block in rig.parameters.schedule((-0.5, 0.5)).on(rig):
        if rig.parameters.precondition:
            rig.move_to(x_mm=0.0)
            rig.precondition(presses=rig.parameters.precondition, force_gwt=1.5, hold_s=0.1)
        for x_mm in block:
            rig.move_to(x_mm=x_mm)
            rig.indent(doi_mm=0.3, hold_s=0.1)
    rig.note("finished")
"""
SCHEDULED = ("repeats=2", "blocks=2", "precondition=2", "reference_every=2", "reference_doi_mm=0.2")
# Nine indentations at three places, four preconditioning presses and four references of one kind each.
DIFFERENT = 5


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    return _counted(monkeypatch)


def _counted(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What the model is asked for by plans, scripts and rehearsals, not what the virtual finger feels."""
    found: list[tuple[Any, ...]] = []
    solve = FingerModel._solved

    def counted(model: FingerModel, *asked: Any) -> Prediction:
        found.append(asked)
        return solve(model, *asked)

    monkeypatch.setattr(FingerModel, "_solved", counted)
    return found


def _script(folder: Path, body: str = BODY, *assignments: str) -> Script:
    path = folder / "mine.py"
    path.write_text(body, encoding="utf-8")
    return load_script(str(path), assignments)


@pytest.fixture(scope="module")
def carried_out(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, int, FinishedRun, int]:
    """A plan by a schedule and its run, undisturbed; after each, how often the model was asked."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        solved = _counted(patch)
        script = _script(folder, BODY, *SCHEDULED)
        plan, after_plan = make_plan(script, CONFIG, finger), len(solved)
        done = dry_run(Session(script, CONFIG, finger, plan, NewRun(folder / "runs")))
    return plan, after_plan, done, len(solved)


@pytest.fixture(scope="module")
def whole(carried_out: tuple[Plan, int, FinishedRun, int]) -> Run:
    return carried_out[2].run


# --- what is solved, and when ---


def test_the_plan_solves_each_press_once_and_the_run_solves_none(
    carried_out: tuple[Plan, int, FinishedRun, int],
) -> None:
    plan, after_plan, done, after_run = carried_out
    assert done.complete, done.problem
    assert (len(plan.indentations), len(plan.all_presses)) == (9, 9 + 4 + 4)
    assert (after_plan, after_run) == (DIFFERENT, DIFFERENT)


def test_a_step_that_differs_from_the_plan_is_solved_and_checked(
    finger: Fingertip, tmp_path: Path, solves: list[tuple[Any, ...]]
) -> None:
    body = (
        "import sys\npasses = vars(sys).setdefault(__file__, [])\n"
        "def run(rig):\n    passes.append(1)\n    rig.mount('cylinder:9')\n    rig.home()\n"
        "    rig.zero()\n    rig.move_to(x_mm=0.0)\n    rig.indent(doi_mm=0.2, hold_s=0.1)\n"
        "    rig.indent(doi_mm=0.2 if len(passes) == 1 else 0.3, hold_s=0.1)\n"
        "    if len(passes) > 1:\n        rig.indent(force_gwt=30.0)\n"
    )
    script = _script(tmp_path, body)
    plan = make_plan(script, CONFIG, finger)
    assert [target.value for _, _, target in solves] == [0.2]
    done = dry_run(Session(script, CONFIG, finger, plan, NewRun(tmp_path / "runs")))
    assert [target.value for _, _, target in solves] == [0.2, 0.3, 30.0]
    assert done.indentations == 2
    has_code(done.problem, "means_beyond_limit", key="force_gwt", value=30.0, x_mm=0.0)


# --- a run that is taken up ---


@pytest.fixture
def cut(whole: Run, tmp_path: Path) -> Callable[..., Path]:
    """The whole run as a kill leaves it just after an indentation."""

    def make(index: int) -> Path:
        folder = tmp_path / "cut"
        shutil.copytree(whole.folder.path, folder)
        documents = [json.loads(line) for line in (folder / "events.jsonl").read_bytes().splitlines()]
        last = next(
            n
            for n, d in enumerate(documents)
            if d.get("stream") == "indentation_end" and d["doc"] == "event" and d["data"]["index"] == index
        )
        (folder / "events.jsonl").write_bytes(b"".join(as_line(d) for d in documents[: last + 1]))
        return folder

    return make


@pytest.mark.parametrize(("index", "new"), [(6, 4), (8, 0)])
def test_a_resumed_run_plans_only_what_is_missing(
    finger: Fingertip, whole: Run, cut: Callable[..., Path], solves: list[tuple[Any, ...]], index: int, new: int
) -> None:
    """After 6 both places, reference and preconditioning are owed again; after 8 nothing is."""
    stopped = read_stopped(cut(index))
    assert stopped.run is not None
    before_s = stopped.run.contact_s
    plan = make_plan(stopped.script, stopped.config, finger, stopped.run)
    assert len(solves) == new
    assert len(plan.indentations) == 8 - index
    assert plan.soft_trip_n == whole.start["soft_trip_n"] > 0.0
    again = dry_run(Session(stopped.script, stopped.config, finger, plan, stopped))
    assert len(solves) == new
    run = again.run
    assert (again.complete, run.missing, run.repeated, run.restarted) == (True, 0, 0, 0)
    assert [event["name"] for event in run.stream("checkpoint")] == ["block 1 of 2", "block 2 of 2"]
    streams = ("precondition_sample", "reference_sample", "sample")
    since_s = [sample["contact_s"] - before_s for stream in streams for sample in run.stream(stream)]
    assert (run.contact_s > before_s) is (new > 0)
    assert new == 0 or min(contact_s for contact_s in since_s if contact_s > 0.0) < 1.0, "it goes on counting"
    kept = ("index", "x_mm", "value", "block", "repeat", "condition")
    assert [[e.get(key) for key in kept] for e in run.stream("indentation_start")] == [
        [e.get(key) for key in kept] for e in whole.stream("indentation_start")
    ]


def test_a_run_whose_journal_has_no_soft_trip_is_planned_completely(
    finger: Fingertip, whole: Run, cut: Callable[..., Path]
) -> None:
    events = cut(6) / "events.jsonl"
    first, *rest = [json.loads(line) for line in events.read_bytes().splitlines()]
    del first["soft_trip_n"]
    events.write_bytes(b"".join(as_line(document) for document in (first, *rest)))
    stopped = read_stopped(events.parent)
    plan = make_plan(stopped.script, stopped.config, finger, stopped.run)
    assert len(plan.indentations) == 9
    assert plan.soft_trip_n == pytest.approx(whole.start["soft_trip_n"])


# --- marks ---


def test_indentations_of_a_schedule_are_marked_with_block_repeat_and_condition(whole: Run) -> None:
    starts = whole.stream("indentation_start")
    assert {"block", "repeat", "condition"}.isdisjoint(starts[0])
    assert [(e["block"], e["repeat"], e["condition"], e["x_mm"]) for e in starts[1:]] == [
        (block, repeat, f"{x_mm:g}", x_mm) for block in (1, 2) for repeat in (1, 2) for x_mm in (-0.5, 0.5)
    ]
    for stream in ("precondition_indentation_start", "reference_indentation_start"):
        assert [(e["block"], "repeat" in e, "condition" in e) for e in whole.stream(stream)] == [
            (block, False, False) for block in (1, 1, 2, 2)
        ]


def test_schedule_marks_end_with_their_loop() -> None:
    """Also with one that is left by `break`."""
    from rig.protocol import Schedule

    seen: list[tuple[Step[Any, Any], PressPlace]] = []

    class Noting:
        def handle(self, step: Step[Any, Any], place: PressPlace) -> Any:
            seen.append((step, place))

    class Anything:
        def refuse_shape(self, indentor: str) -> None:
            """Every name will do."""

    rig = Rig(None, ScriptState(CONFIG, Anything()), Noting())  # type: ignore[arg-type]
    rig.home()
    for block in Schedule(("a", ("b", 2)), repeats=2).on(rig):
        for _ in block:
            rig.mount("one")
        rig.mount("two")
        for _ in block:
            rig.mount("three")
            break
        rig.mount("four")
        break
    rig.mount("five")
    marks = [tuple(place.marks.values()) for step, place in seen if isinstance(step, Mount)]
    assert marks[:4] == [(1, 1, "a"), (1, 1, "('b', 2)"), (1, 2, "a"), (1, 2, "('b', 2)")]
    assert marks[4:] == [(1,), (1, 1, "a"), (1,), ()]
