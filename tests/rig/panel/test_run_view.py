"""A run as a page is told of it, from its journal alone."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from rig.data.folder import RunFolder
from rig.data.run_state import Course, Timeline
from rig.panel.drawing import Job, PressSummary
from rig.panel.run_view import AT_ONCE, COLUMNS, GROWS_S, RunView, growing, limits_state, written_s
from rig.panel.stream import SHOWN_S
from rig.panel.watcher import HAND, BenchView
from rig.plan.config import Config
from rig.units import GWT_N

NOW_S = 2000.0
START = {"protocol": "steps", "title": "Steps", "subject": "S07", "planned_indentations": 2, "soft_trip_n": 0.05}
PRESS = {"index": 0, "indentor": "bar:3.0", "x_mm": 0.5, "target": "doi_mm", "value": 0.8, "increments": 1}
SAMPLE = {"index": 0, "phase": "press", "x_mm": 0.5, "height_mm": -0.1, "doi_mm": 0.1, "force_gwt": 1.5}


class Written:
    """A run's folder whose journal a test writes."""

    def __init__(self, path: Path) -> None:
        self.path, self.journal = path, path / "events.jsonl"
        path.mkdir(parents=True)
        self.t_s = 0.0

    def doc(self, kind: str, **more: Any) -> None:
        self.t_s += 1.0
        line = {"doc": kind, "t_s": 0.0 if kind == "start" else self.t_s, "unix_s": 1000.0 + self.t_s, **more}
        with self.journal.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")

    def event(self, stream: str, **data: Any) -> None:
        self.doc("event", stream=stream, data=data)


@pytest.fixture
def run(tmp_path: Path) -> Written:
    found = Written(tmp_path / "runs" / "20260101T000000-steps-abcdef")
    (found.path / "config.toml").write_text(Config().as_toml(), encoding="utf-8")
    found.doc("start", **START)
    return found


def told(run: Written) -> RunView:
    seen = RunView(run.path)
    seen.look(NOW_S)
    return seen


def test_readings_as_they_come(run: Written) -> None:
    seen = told(run)
    assert (seen.name, seen.source.run, seen.source.columns) == (run.path.name, run.path.name, COLUMNS)
    assert seen.newest_state(2000.0) == {
        "force_gwt": None, "force_n": None, "doi_mm": None, "x_mm": None, "height_mm": None, "phase": None,
        "t_s": None, "age_s": None,
    }  # fmt: skip
    run.event("sample", **SAMPLE)
    run.event("precondition_sample", **{**SAMPLE, "force_gwt": 2.0, "doi_mm": None})
    assert seen.look(NOW_S) == [
        [1002.0, 2.0, 1.5, 0.1, 0.5, -0.1, "press", 0, "data"],
        [1003.0, 3.0, 2.0, None, 0.5, -0.1, "press", 0, "precondition"],
    ]
    assert seen.look(NOW_S) == []
    assert seen.newest_state(1003.5) == {
        "force_gwt": 2.0, "force_n": 2.0 * GWT_N, "doi_mm": None, "x_mm": 0.5, "height_mm": -0.1, "phase": "press",
        "t_s": 3.0, "age_s": 0.5,
    }  # fmt: skip
    assert seen.newest_state(1000.0)["age_s"] == 0.0


def test_a_virtual_run_is_as_old_as_its_journal(tmp_path: Path) -> None:
    """Its clock goes as fast as it can, and says nothing of now."""
    run = Written(tmp_path / "run")
    run.doc("start", **START, virtual=True)
    run.event("sample", **SAMPLE)
    seen = RunView(run.path)
    ((unix_s, *_),) = seen.look(NOW_S)
    assert unix_s == run.journal.stat().st_mtime == written_s(run.path)
    assert seen.virtual is True


def test_a_clock_that_is_ahead_makes_nothing_younger_than_its_journal(run: Written) -> None:
    run.doc("event", stream="sample", data=SAMPLE, unix_s=1e11)
    (*_, row) = RunView(run.path).look(NOW_S)
    assert row[0] == written_s(run.path)


def test_what_a_page_is_told_of_it(run: Written) -> None:
    seen = told(run)
    assert seen.as_json(going=True) == {
        "folder": str(run.path), "name": run.path.name, "protocol": "steps", "title": "Steps", "subject": "S07",
        "virtual": False, "state": "running", "now": "", "next": "", "left_s": None, "done": 0, "planned": 2,
        "said": None, "ending": None, "stopped_while": None, "deviation": None, "problem": None,
    }  # fmt: skip
    run.event("indentation_start", **PRESS)
    seen.look(NOW_S)
    assert seen.as_json(going=True)["now"] == "press bar:3.0 at +0.50 mm to 0.8 mm"
    run.event("indentation_end", index=0, duration_s=1.0)
    run.event("alarm", reason="the zero has drifted")
    seen.look(NOW_S)
    about = seen.as_json(going=False)
    assert (about["state"], about["done"], about["now"], about["said"]) == ("killed", 1, None, "the zero has drifted")
    assert seen.ended is False
    run.doc("stop", status="tripped", reason="force 9 gwt", stopped_while="reporting")
    seen.look(NOW_S)
    about = seen.as_json(going=True)
    assert (about["state"], about["ending"], seen.ended) == ("tripped", "force 9 gwt", True)
    assert about["stopped_while"] == "reporting"
    run.doc("resume", missing=1)
    seen.look(NOW_S)
    assert (seen.as_json(going=True)["state"], seen.ended) == ("running", False)


def test_its_schedule(run: Written) -> None:
    begun, moved = ("indentation_start", 0, 0), ("move", 1, 0)
    course = Course(
        30.0, {moved: 1.0, begun: 2.0, ("indentation_end", 0, 0): 9.0, ("reference_indentation_start", 0, 0): 10.0},
        {moved: "move", begun: "press", ("reference_indentation_start", 0, 0): "reference"},
        {begun: {"block": 1, "repeat": 2, "condition": "c"}},
    )  # fmt: skip
    course.save(RunFolder(run.path))
    assert Course.load(RunFolder(run.path)) == course
    seen = told(run)
    run.event("move", x_mm=0.5, along_mm=0.0)
    seen.look(NOW_S)
    nothing = {"block": None, "repeat": None, "condition": None}
    assert seen.schedule_state() == [
        {"index": None, "purpose": None, "words": "move", **nothing, "done": True, "now": False},
        {"index": 0, "purpose": "data", "words": "press", "block": 1, "repeat": 2, "condition": "c", "done": False,
         "now": True},
        {"index": 0, "purpose": "reference", "words": "reference", **nothing, "done": False, "now": False},
    ]  # fmt: skip


def test_devices_by_what_was_heard_of_them(run: Written) -> None:
    seen = told(run)
    unknown = {"word": "no data", "age_s": None}
    assert seen.devices_state(2000.0) == {"stage": {**unknown, "homed": False}, "force": unknown}

    def after(stream: str, **data: Any) -> tuple[Any, ...]:
        run.event(stream, **data)
        seen.look(NOW_S)
        found = seen.devices_state(1000.0 + run.t_s + 2.0)
        stage, force = found["stage"], found["force"]
        return stage["word"], stage["homed"], stage["age_s"], force["word"], force["age_s"]

    assert after("home", controller="a") == ("homed", True, 2.0, "no data", None)
    assert after("zero", sensor="a") == ("homed", True, 3.0, "zeroed", 2.0)
    assert after("move", x_mm=1.0) == ("at rest", True, 2.0, "zeroed", 3.0)
    assert after("find_sample", **SAMPLE) == ("press", True, 2.0, "reads", 2.0)
    assert after("retract", height_mm=2.0) == ("at rest", True, 2.0, "reads", 3.0)
    assert after("trip", reason="force") == ("tripped", True, 2.0, "reads", 4.0)
    assert seen.as_json(going=True)["said"] == "force"


def test_what_there_is_to_draw(run: Written) -> None:
    seen, config = told(run), run.path / "config.toml"
    assert seen.job is None
    run.event("mount", indentor="step:1")
    seen.look(NOW_S)
    assert seen.job == Job(config, run.path, "step:1")
    run.event("move", x_mm=0.5, along_mm=1.5)
    seen.look(NOW_S)
    assert seen.job == Job(config, run.path, "step:1", 1.5)
    run.event("reference_indentation_start", **PRESS)
    seen.look(NOW_S)
    assert seen.job == Job(config, run.path, "bar:3.0", 1.5, PressSummary(0, "reference", 0.5, "doi_mm", 0.8))
    run.event("move", x_mm=0.5)
    seen.look(NOW_S)
    assert seen.job == Job(config, run.path, "bar:3.0")


def test_limits_and_margins_in_either_unit(run: Written) -> None:
    seen = told(run)
    assert seen.limits_state() is not None
    run.event("sample", **{**SAMPLE, "force_gwt": -1.5})
    seen.look(NOW_S)
    assert seen.limits_state() == limits_state(Config(), 0.05, -1.5)
    found = limits_state(Config(), 0.05, -1.5)
    assert found["trip_n"] == pytest.approx(0.05)
    assert found["trip_gwt"] == pytest.approx(0.05 / GWT_N)
    assert found["margin_gwt"] == pytest.approx(0.05 / GWT_N - 1.5)
    assert found["margin_n"] == pytest.approx(0.05 - 1.5 * GWT_N)
    assert (found["hard_trip_n"], found["hard_margin_n"]) == pytest.approx((5.0, 5.0 - 1.5 * GWT_N))
    assert found["hard_margin_gwt"] == pytest.approx(5.0 / GWT_N - 1.5)
    assert (found["max_doi_mm"], found["max_force_gwt"]) == (1.5, 100.0)
    none = limits_state(Config(), None, None)
    assert none["trip_n"] == pytest.approx(2.0)
    assert [none[f"{name}_{unit}"] for name in ("margin", "hard_margin") for unit in ("gwt", "n")] == [None] * 4


def test_without_its_configuration_there_are_no_limits_until_it_comes(tmp_path: Path) -> None:
    run = Written(tmp_path / "run")
    run.doc("start", **START)
    seen = told(run)
    assert (seen.limits_state(), seen.problem) == (None, "")
    (run.path / "config.toml").write_text("[limits]\nmax_doi_mm = 1.0\n", encoding="utf-8")
    seen.look(NOW_S)
    limits = seen.limits_state()
    assert limits is not None
    assert limits["max_doi_mm"] == 1.0


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda run: run.journal.write_text("nonsense\n"), "events.jsonl, line 1: not a journal document"),
        (lambda run: run.event("indentation_start", index=0), "KeyError"),
        (lambda run: (run.path / "config.toml").write_text("[limits]\nmax = 1\n"), "config.toml"),
    ],
    ids=["no journal", "another program's", "no configuration"],
)
def test_what_cannot_be_read_is_told_and_not_looked_at_again(spoil: Any, problem: str, run: Written) -> None:
    spoil(run)
    seen = told(run)
    assert problem in seen.problem
    assert seen.as_json(going=True)["problem"] == seen.problem
    run.event("sample", **SAMPLE)
    assert seen.look(NOW_S) == []


def test_who_comes_late_reads_in_pieces_and_is_told_of_the_last_minute(
    run: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert AT_ONCE == 2**20
    monkeypatch.setattr("rig.panel.run_view.AT_ONCE", 1000)
    for _ in range(200):
        run.event("sample", **SAMPLE)
    run.event("note", text="a")
    seen = RunView(run.path)
    seconds = [row[1] for row in seen.look(NOW_S)]
    assert seconds[-1] == 201.0
    assert 201.0 - SHOWN_S - 10.0 <= seconds[0] <= 201.0 - SHOWN_S
    assert seconds == [seconds[0] + k for k in range(len(seconds))]
    assert seen.newest_state(NOW_S)["t_s"] == 201.0
    run.event("sample", **SAMPLE)
    assert [row[1] for row in seen.look(NOW_S)] == [203.0]


def test_what_came_at_once_is_told_whole(run: Written) -> None:
    """A server that hung for minutes tells all that it missed."""
    for _ in range(200):
        run.event("sample", **SAMPLE)
    assert len(RunView(run.path).look(NOW_S)) == 200


def test_a_schedule_marks_its_presses() -> None:
    timeline = Timeline(lambda: 1.0)
    timeline.event("indentation_start", {**PRESS, "block": 1, "repeat": 2, "condition": "c"})
    timeline.event("move", {"x_mm": 0.5, "along_mm": 0.0})
    timeline.event("reference_indentation_start", PRESS)
    assert timeline.marks == {("indentation_start", 0, 0): {"block": 1, "repeat": 2, "condition": "c"}}


# --- which run ---


def test_the_run_that_goes_on_is_the_one_that_is_written_to(tmp_path: Path) -> None:
    out = tmp_path / "runs"
    assert growing(out, 0.0) is None
    for name, then_s in (("20260101T000000-a-1", 100.0), ("20260102T000000-b-2", 98.0), (".20260103-c.part", 101.0)):
        Written(out / name).doc("start", **START)
        os.utime(out / name / "events.jsonl", (then_s, then_s))
    (out / "20260104T000000-d-3").mkdir()
    (out / "20260105T000000-e-4" / "events.jsonl").mkdir(parents=True)
    assert growing(out, 100.0 + GROWS_S - 0.1) == out / "20260101T000000-a-1"
    assert growing(out, 100.0 + GROWS_S) is None
    assert written_s(tmp_path / "none") == 0.0


def test_a_silent_run_goes_on_while_somebody_holds_it(run: Written, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, holds = list[float](), [True]

    def busy(folder: RunFolder) -> bool:
        asked.append(now_s)
        return holds[0]

    monkeypatch.setattr(RunFolder, "busy", property(busy))
    os.utime(run.journal, (100.0, 100.0))
    seen, found = RunView(run.path), list[bool]()
    for now_s in (104.9, 105.0, 109.8, 110.0, 114.9):
        seen.look(now_s)
        found.append(seen.alive)
    assert (found, asked) == ([True] * 5, [110.0])
    holds[0] = False
    for now_s in (115.0, 130.0, 150.0):
        seen.look(now_s)
        assert seen.alive is False
    assert asked == [110.0, 115.0]
    os.utime(run.journal, (150.0, 150.0))
    seen.look(151.0)
    assert seen.alive is True
    run.doc("stop", status="done")
    os.utime(run.journal, (151.0, 151.0))
    seen.look(151.0)
    assert seen.alive is False


def test_a_run_that_was_left_long_ago_is_not_asked_for(run: Written, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RunFolder, "busy", property(lambda folder: 1 / 0))
    os.utime(run.journal, (100.0, 100.0))
    seen = RunView(run.path)
    seen.look(200.0)
    assert seen.alive is False


def test_only_the_newest_folders_are_looked_at(tmp_path: Path) -> None:
    for n in range(51):
        Written(tmp_path / f"{n:03d}").doc("start", **START)
        os.utime(tmp_path / f"{n:03d}" / "events.jsonl", (n if n else 100.0,) * 2)
    assert growing(tmp_path, 54.0) == tmp_path / "050"
    os.utime(tmp_path / "001" / "events.jsonl", (60.0, 60.0))
    assert growing(tmp_path, 60.0) == tmp_path / "001"


# --- the bench ---


def test_the_bench_by_what_its_owner_answers(tmp_path: Path) -> None:
    bench = BenchView(tmp_path / "rig.toml", Config())
    assert (bench.configured, bench.job, bench.since) == (True, Job(tmp_path / "rig.toml"), 0)
    assert bench.update(None) == []
    assert bench.devices_state(9.0)["stage"] == {"word": "no data", "homed": False, "age_s": None}
    new = {"columns": ["t_s", *HAND.columns[2:], "unix_s"], "next": 12, "rows": [[3.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]}
    status = {
        "state": "idle", "homed": True, "zeroed": False, "force_gwt": 1.5, "x_mm": 0.5, "height_mm": 3.0,
        "read_unix_s": 100.0, "read_t_s": 3.0, "seen_unix_s": 101.0, "busy": "jog", "readings": new,
    }  # fmt: skip
    assert bench.update(status) == [[6.0, 3.0, 1.0, 2.0, 3.0, 4.0, 5.0]]
    assert bench.since == 12
    assert bench.newest_state(101.5) == {
        "force_gwt": 1.5, "force_n": 1.5 * GWT_N, "doi_mm": None, "x_mm": 0.5, "height_mm": 3.0, "phase": "jog",
        "t_s": 3.0, "age_s": 1.5,
    }  # fmt: skip
    assert bench.newest_state(99.0)["age_s"] == 0.0
    told = bench.devices_state(101.5)
    assert told["stage"] == {"word": "idle", "homed": True, "age_s": 0.5}
    assert told["force"] == {"word": "reads", "age_s": 1.5}
    assert bench.limits_state() == limits_state(Config(), None, 1.5)
    assert bench.update({**status, "zeroed": True, "readings": None}) == []
    assert bench.devices_state(101.5)["force"]["word"] == "zeroed"
    bench.update({**status, "stage_problem": "the stage is silent", "force_problem": "no reading"})
    assert [one["word"] for one in bench.devices_state(101.5).values()] == ["the stage is silent", "no reading"]
    bench.begin(7)
    assert (bench.owner, bench.since, bench.newest_state(1.0)["force_gwt"]) == (7, 0, None)


def test_no_bench_without_a_configuration() -> None:
    bench = BenchView()
    assert (bench.configured, bench.job, bench.limits_state(), bench.ports) == (False, None, None, ())
