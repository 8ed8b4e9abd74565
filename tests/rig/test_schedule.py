"""Schedules: the order, the rests, the presses that are no data, the time a finger is touched, and who it is of."""

import itertools
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.bench.checks import checked_subject
from rig.cli import main
from rig.data import RunFolder
from rig.data.documents import as_line
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol import ReferencePress, Rig, Schedule
from rig.protocol.script import load_script
from rig.protocol.steps import Checkpoint, Note, Reference, Rest, Step, Zero
from rig.session.rehearsal_summary import preflight
from rig.session.resume import read_stopped
from rig.session.session import FinishedRun, NewRun, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.rig.script_state import walked

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches."""
CONFIG = Config.model_validate(NEAR)
PLACES = (-0.5, 0.0, 0.5)
SCRIPT = f"""\
from rig.protocol import ScheduledParameters


class Parameters(ScheduledParameters):
    hold_s: float = 0.1


def run(rig):
    p = rig.parameters
    rig.mount("bar:3.0")
    rig.home()
    for block in p.schedule({PLACES}).on(rig):
        if p.precondition:
            rig.move_to(x_mm=0.0)
            rig.precondition(presses=p.precondition, force_gwt=1.5, hold_s=0.2)
        for x_mm in block:
            rig.move_to(x_mm=x_mm)
            rig.indent(force_gwt=1.0, hold_s=p.hold_s)
"""
SET = ("order=random", "seed=3", "blocks=2", "rest_s=1.5", "block_rest_s=10", "precondition=2")


# --- the order ---


def test_the_random_order_of_a_seed_never_changes() -> None:
    """Written down once; it rests on random.Random(text).random(), which Python keeps from version to version."""
    schedule = Schedule("abcdef", order="random", seed=3, blocks=2)
    assert ["".join(schedule.block(n)) for n in (1, 2)] == ["fcbead", "fdbcea"]


def test_a_schedule_repeats_every_item_as_often_as_requested() -> None:
    schedule = Schedule("abc", order="random", seed=1, repeats=4)
    assert sorted(schedule.block(1)) == sorted("abc" * 4)
    assert len({schedule.block(n) for n in range(1, 9)}) > 1
    assert len({Schedule("abcdef", order="random", seed=seed).block(1) for seed in range(9)}) > 1
    assert Schedule("abc", repeats=2).block(1) == tuple("abcabc")


def test_every_random_order_is_equally_likely() -> None:
    """Of six orders over 1200 seeds each comes 200 ± 5 · √(1200 · 1/6 · 5/6) = 200 ± 65 times."""
    orders = [Schedule("abc", order="random", seed=seed).block(1) for seed in range(1200)]
    counts = [orders.count(order) for order in itertools.permutations("abc")]
    assert min(counts) > 135
    assert max(counts) < 265


# --- every step in its place, with its marks ---


def _marked_steps(schedule: Schedule[Any]) -> list[tuple[Step[Any, Any], dict[str, Any]]]:
    """What is handed on, and with which marks, for a script that notes each block and each item."""

    def script(rig: Rig) -> None:
        rig.mount("bar")
        rig.home()
        for block in schedule.on(rig):
            rig.note("begun")
            for item in block:
                rig.note(str(item))
            rig.note("ended")

    found = walked(script)
    return [(step, dict(place.marks)) for step, place in zip(found.steps, found.places, strict=True)][2:]


def test_a_schedule_rests_between_items_and_between_blocks() -> None:
    """Neither before the first nor after the last; a rest belongs to the block, not to an item."""
    found = _marked_steps(Schedule(("a", "b", "c"), blocks=3, rest_s=1.5, block_rest_s=10.0))
    between: list[tuple[Step[Any, Any], dict[str, Any]]] = [(Rest(10.0), {})]
    assert found == [
        step
        for number in (1, 2, 3)
        for step in (
            *(between if number > 1 else []),
            (Checkpoint(f"block {number} of 3"), {}),
            (Zero(), {}),
            (Note("begun"), {"block": number}),
            (Note("a"), {"block": number, "repeat": 1, "condition": "a"}),
            (Rest(1.5), {"block": number}),
            (Note("b"), {"block": number, "repeat": 1, "condition": "b"}),
            (Rest(1.5), {"block": number}),
            (Note("c"), {"block": number, "repeat": 1, "condition": "c"}),
            (Note("ended"), {"block": number}),
            (Zero(), {}),
        )
    ]


def test_a_schedule_places_a_reference_press_before_every_n_items() -> None:
    """And a schedule without one has none."""
    presses = [
        (step, marks)
        for step, marks in _marked_steps(Schedule("abcde", reference=ReferencePress(2, x_mm=-1.0, doi_mm=0.3)))
        if isinstance(step, Reference) or (isinstance(step, Note) and "condition" in marks)
    ]
    reference = (Reference(x_mm=-1.0, doi_mm=0.3), {"block": 1})
    a, b, c, d, e = ((Note(name), {"block": 1, "repeat": 1, "condition": name}) for name in "abcde")
    assert presses == [reference, a, b, reference, c, d, reference, e]


def test_a_schedule_counts_repeats_from_one_in_each_block() -> None:
    found = _marked_steps(Schedule((0.5, 1), repeats=3, blocks=2))
    assert [tuple(marks.values()) for _, marks in found if "condition" in marks] == [
        (block, repeat, condition) for block in (1, 2) for repeat in (1, 2, 3) for condition in ("0.5", "1")
    ]
    assert [marks["repeat"] for _, marks in _marked_steps(Schedule("aab")) if "condition" in marks] == [1, 2, 1]


# --- a run by a schedule ---


@pytest.fixture(scope="module")
def done(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    folder = tmp_path_factory.mktemp("scheduled")
    (folder / "mine.py").write_text(SCRIPT, encoding="utf-8")
    script = load_script(str(folder / "mine.py"), SET)
    plan = make_plan(script, CONFIG, finger)
    session = Session(script, CONFIG, finger, plan, NewRun(folder / "runs", "S07"))
    found = dry_run(session)
    assert found.complete, found.problem
    return found


def _order(run: Any) -> list[float]:
    return [event["x_mm"] for event in run.stream("indentation_start")]


def test_the_journal_has_blocks_rests_checkpoints_and_zeros_of_a_schedule(done: FinishedRun) -> None:
    run = done.run
    schedule = Schedule(PLACES, order="random", seed=3)
    assert _order(run) == [*schedule.block(1), *schedule.block(2)]
    assert [event["name"] for event in run.stream("checkpoint")] == ["block 1 of 2", "block 2 of 2"]
    assert [event["rest_s"] for event in run.stream("rest")] == [1.5, 1.5, 10.0, 1.5, 1.5]
    drifts = [event["drift_gwt"] for event in run.stream("zero")]
    assert drifts == [None, 0.0, 0.0, 0.0]
    assert not run.stream("alarm")


def test_preconditioning_presses_are_kept_apart_from_data(done: FinishedRun) -> None:
    run = done.run
    pressed = run.stream("precondition_hold_end")
    assert [(e["index"], e["x_mm"]) for e in pressed] == [(n, 0.0) for n in range(4)]
    assert all(e["force_gwt"] == pytest.approx(1.5, abs=0.05) for e in pressed)
    assert done.indentations == run.start["planned_indentations"] == 6
    assert [event["index"] for event in run.stream("hold_end")] == list(range(6))
    table = (done.folder.path / "precondition_hold_end.csv").read_text(encoding="utf-8")
    assert table.count("\n") == 5


def test_check_counts_rests_and_preconditioning(done: FinishedRun, finger: Fingertip, tmp_path: Path) -> None:
    script = load_script(str(done.folder.path / "protocol.py"), SET)
    said = preflight(script, CONFIG, finger, make_plan(script, CONFIG, finger)).as_json()
    assert said["duration_s"] == pytest.approx(done.duration_s, rel=0.05)
    assert said["contact_s"] == pytest.approx(done.run.contact_s, rel=0.05)
    assert (said["indentations"], said["other_presses"]) == (6, 4)
    assert said["peak_force_gwt"] == pytest.approx(1.5, rel=1e-3)
    assert said["margins"]["contact_s"] == 3600.0 - said["contact_s"]


def test_the_contact_time_of_a_run_is_that_of_its_readings(done: FinishedRun) -> None:
    """From the first reading of contact to the end of the lift, of every press, data or not."""
    run, total_s = done.run, 0.0
    samples = sorted([*run.stream("sample"), *run.stream("precondition_sample")], key=lambda e: e["t_s"])
    for lift in run.stream("retract"):
        before = [e["t_s"] for e in run.stream("retract") if e["t_s"] < lift["t_s"]]
        first_s = next(e["t_s"] for e in samples if e["t_s"] > max(before, default=0.0) and e["force_gwt"] >= 0.05)
        total_s += lift["t_s"] - first_s
    assert run.contact_s == pytest.approx(total_s, abs=1e-3 * len(run.stream("retract")))
    assert total_s > 10.0


# --- reference indentations ---

REFERENCES = ("seed=3", "order=random", "reference_every=2", "reference_doi_mm=0.3", "hold_s=0.1")


def _with_references(folder: Path, finger: Fingertip, **tables: Any) -> FinishedRun:
    (folder / "mine.py").write_text(SCRIPT, encoding="utf-8")
    script, config = load_script(str(folder / "mine.py"), REFERENCES), Config.model_validate({**NEAR, **tables})
    plan = make_plan(script, config, finger)
    return dry_run(Session(script, config, finger, plan, NewRun(folder / "runs")))


@pytest.fixture(scope="module")
def referenced(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    return _with_references(tmp_path_factory.mktemp("references"), finger)


def test_reference_presses_are_compared_and_kept_apart_from_data(referenced: FinishedRun) -> None:
    """The same finger answers the same to a step of the sensor, 0.01 of some 0.6 and 2 gwt."""
    run = referenced.run
    assert referenced.complete
    assert referenced.indentations == 3
    pressed = [(e["index"], e["hold"], e["commanded"]) for e in run.stream("reference_hold_end")]
    assert pressed == [(0, 1, 0.15), (0, 2, 0.3), (1, 1, 0.15), (1, 2, 0.3)]
    assert [event["deviation"] for event in run.stream("reference")] == pytest.approx([0.0, 0.0], abs=0.03)
    assert not run.stream("alarm")
    first, second = (e["t_s"] for e in run.stream("reference"))
    assert sum(first < e["t_s"] < second for e in run.stream("indentation_start")) == 2
    assert _order(run) == list(Schedule(PLACES, order="random", seed=3).block(1))


def test_a_resumed_run_compares_with_its_first_reference(
    referenced: FinishedRun, finger: Fingertip, tmp_path: Path
) -> None:
    folder = RunFolder(shutil.copytree(referenced.folder.path, tmp_path / "cut"))
    lines = folder.events.read_bytes().splitlines(keepends=True)
    last = next(n for n, line in enumerate(lines) if b'"indentation_end"' in line and b'"event"' in line)
    (first,) = [e["force_gwt"] for e in referenced.run.stream("reference_hold_end")[1:2]]
    text = b"".join(lines[: last + 1]).replace(f'"force_gwt": {first}'.encode(), f'"force_gwt": {first / 2}'.encode())
    folder.events.write_bytes(b"".join(as_line(json.loads(line)) for line in text.splitlines()))
    stopped = read_stopped(folder.path)
    plan = make_plan(stopped.script, stopped.config, finger)
    again = dry_run(Session(stopped.script, stopped.config, finger, plan, stopped))
    assert again.complete
    assert [e["index"] for e in again.run.stream("reference")] == [0, 0, 1]
    assert again.run.stream("reference")[1]["deviation"] == pytest.approx(1.0, abs=0.1)
    assert again.run.stream("alarm")


# --- the subject ---


@pytest.mark.parametrize("name", ["Anna", "anna01", "S7", "SUBJ01", "S07 Anna", "", "S07\n", "07"])
def test_a_subject_given_by_name_is_refused_without_printing_the_name(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(
        "sys.argv", ["rig", "dry-run", "first_press", "--out", str(tmp_path / "runs"), "--subject", name]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert not (tmp_path / "runs").exists()
    with raises(BadInputError, "no_subject_code") as caught:
        checked_subject(name)
    assert told == f"rig: {caught.value}\n"


def test_the_subject_is_stored_with_the_run(done: FinishedRun) -> None:
    about: Mapping[str, Any] = json.loads(done.folder.provenance.read_text(encoding="utf-8"))
    assert about["subject"] == done.run.start["subject"] == "S07"
