"""A run as a page is told of it, from its journal alone."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from rig.data.folder import RunFolder
from rig.data.run_status import RunStatus
from rig.engine.contact_words import FREE_THE_FINGER
from rig.manual.orders import HOME_FIRST
from rig.panel.run_view import GROWS_S, RunView, growing, limits_state, written_s
from rig.panel.section import Job
from rig.panel.watcher import HAND, BenchView
from rig.plan.config import Config
from rig.session.early_ending import Ending
from rig.units import GWT_N

NOW_S = 2000.0
START = {"protocol": "steps", "title": "Steps", "subject": "S07", "planned_indentations": 2, "soft_trip_n": 0.05}

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


def test_the_events_of_a_virtual_run_have_the_time_when_they_were_written(tmp_path: Path) -> None:
    """Its clock goes as fast as it can, and says nothing of now."""
    run = Written(tmp_path / "run")
    run.doc("start", **START, virtual=True)
    run.event("sample", **SAMPLE)
    seen = RunView(run.path)
    ((unix_s, *_),) = seen.look(NOW_S)
    assert unix_s == run.journal.stat().st_mtime == written_s(run.path)
    assert seen.virtual is True


def test_no_reading_is_younger_than_the_journal_that_holds_it(run: Written) -> None:
    run.doc("event", stream="sample", data=SAMPLE, unix_s=1e11)
    (*_, row) = RunView(run.path).look(NOW_S)
    assert row[0] == written_s(run.path)


def test_the_panel_shows_the_limits_of_the_run(run: Written) -> None:
    assert told(run).limits_state() == limits_state(Config(), 0.05)
    found = limits_state(Config(), 0.05)
    assert (found["trip_gwt"], found["max_doi_mm"]) == (pytest.approx(0.05 / GWT_N), 1.5)
    assert limits_state(Config(), None)["trip_gwt"] == pytest.approx(2.0 / GWT_N)


def test_a_trip_is_told_at_once_and_then_as_the_terminal_words_the_ending(run: Written) -> None:
    run.event("sample", **SAMPLE)
    assert told(run).attention(going=True, stopped=False) is None
    run.event("trip", reason="the force sensor is silent", force_gwt=None)
    at_once = told(run).attention(going=True, stopped=False)
    assert at_once is not None
    assert (at_once["status"], at_once["reason_text"]) == ("tripped", "the force sensor is silent")
    run.event("retract", height_mm=2.0, contact="raised", force_gwt=None)
    assert told(run).newest_state(NOW_S)["height_mm"] == 2.0
    at = {"left": "held", "x_mm": 0.5, "height_mm": -0.1, "trusted": False, "may_touch": True, "contact": "touching"}
    run.doc("stop", status="tripped", reason="the force sensor is silent", indentor=at)
    seen = told(run)
    for going in (True, False):
        ending = seen.attention(going=going, stopped=False)
        expected = Ending.recorded(seen, RunStatus.TRIPPED)
        assert ending is not None
        assert ending["may_touch"] is True
        assert (ending["reason_text"], ending["where_text"], ending["next_text"], ending["resume"]) == (
            expected.reason, expected.at.words, expected.next, expected.resume,
        )  # fmt: skip
    newest = seen.newest_state(NOW_S)
    assert (newest["height_mm"], newest["doi_mm"], newest["phase"]) == (-0.1, 0.1, None)


def test_after_a_lift_no_depth_is_shown(run: Written) -> None:
    run.event("sample", **SAMPLE)
    assert told(run).newest_state(NOW_S)["doi_mm"] == 0.1
    run.event("retract", height_mm=2.0, contact="lifted", force_gwt=0.0)
    newest = told(run).newest_state(NOW_S)
    assert (newest["doi_mm"], newest["height_mm"], newest["force_gwt"]) == (None, 2.0, 1.5)


def test_after_a_stop_the_finger_is_named_before_the_run_has_its_ending(run: Written) -> None:
    run.event("sample", **SAMPLE)
    found = told(run).attention(going=True, stopped=True)
    assert found is not None
    assert (found["status"], found["may_touch"], found["next_text"]) == ("aborted", True, FREE_THE_FINGER)


def test_a_complete_run_gives_no_notice(run: Written) -> None:
    run.doc("stop", status="done")
    seen = told(run)
    assert seen.attention(going=False, stopped=False) is not None, "two presses are missing"
    seen.finished = {0, 1}
    assert seen.attention(going=False, stopped=False) is None


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda run: run.journal.write_text("nonsense\n"), "events.jsonl, line 1: not a journal document"),
        (lambda run: run.event("indentation_start", index=0), "KeyError"),
        (lambda run: (run.path / "config.toml").write_text("[limits]\nmax = 1\n"), "config.toml"),
    ],
    ids=["no journal", "another program's", "no configuration"],
)
def test_a_journal_that_cannot_be_read_is_reported_and_not_read_again(spoil: Any, problem: str, run: Written) -> None:
    spoil(run)
    seen = told(run)
    assert problem in seen.problem
    assert seen.as_json(going=True)["problem"] == seen.problem
    run.event("sample", **SAMPLE)
    assert seen.look(NOW_S) == []


# --- which run ---


def test_the_running_run_is_the_one_whose_journal_grows(tmp_path: Path) -> None:
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


def test_a_silent_run_counts_as_running_while_its_process_holds_the_lock(
    run: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
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


@pytest.mark.parametrize("held", [True, False], ids=["held", "killed"])
def test_a_run_whose_process_is_gone_has_ended_within_half_a_second(
    run: Written, monkeypatch: pytest.MonkeyPatch, held: bool
) -> None:
    monkeypatch.setattr(RunFolder, "busy", property(lambda folder: held))
    os.utime(run.journal, (100.0, 100.0))
    seen = RunView(run.path)
    for now_s, announced, alive in ((100.1, True, True), (100.2, False, True), (100.8, False, held)):
        seen.look(now_s, announced=announced)
        assert seen.alive is alive


# --- the bench ---


def test_manual_control_shows_what_its_process_reports(tmp_path: Path) -> None:
    bench = BenchView(tmp_path / "rig.toml", Config())
    assert (bench.configured, bench.job, bench.since) == (True, Job(tmp_path / "rig.toml"), 0)
    assert bench.update(None) == []
    assert bench.devices_state(9.0)["stage"] == {"word": "no data", "homed": False, "age_s": None}
    new = {"columns": ["t_s", *HAND.columns[2:], "unix_s"], "next": 12, "rows": [[3.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]}
    status = {
        "state": "idle", "homed": True, "zeroed": False, "force_gwt": 1.5, "x_mm": -29.5, "y_mm": -14.0,
        "height_mm": 3.0, "read_unix_s": 100.0, "read_t_s": 3.0, "seen_unix_s": 101.0, "busy": "step",
        "readings": new,
    }  # fmt: skip
    assert bench.update(status) == [[6.0, 3.0, 1.0, 32.0, 18.0, 4.0, 5.0]]
    assert bench.since == 12
    assert bench.newest_state(101.5) == {
        "force_gwt": 1.5, "doi_mm": None, "x_mm": 0.5, "y_mm": 1.0, "height_mm": 3.0, "phase": "step",
        "t_s": 3.0, "age_s": 1.5, "placed_age_s": 0.5,
    }  # fmt: skip
    assert bench.newest_state(99.0)["age_s"] == 0.0
    bench.update({**status, "height_mm": None, "readings": None})
    assert bench.newest_state(99.0)["x_mm"] is None, "the stage is not homed"
    told = bench.devices_state(101.5)
    assert told["stage"] == {"word": "idle", "homed": True, "age_s": 0.5}
    assert told["force"] == {"word": "reads", "age_s": 1.5}
    assert bench.limits_state() == limits_state(Config(), None)
    assert bench.update({**status, "zeroed": True, "readings": None}) == []
    assert bench.devices_state(101.5)["force"]["word"] == "zeroed"
    bench.update({**status, "stage_problem": "the stage is silent", "force_problem": "no reading"})
    assert [one["word"] for one in bench.devices_state(101.5).values()] == ["the stage is silent", "no reading"]
    assert bench.attention is None
    contact = {"where_text": "last known at x = 0.50 mm", "to_do_text": "free the finger", "may_touch": True}
    for stopped, status_word in ((True, "aborted"), (False, "tripped")):
        bench.update({**status, "next": HOME_FIRST, "stopped": stopped, "ended_by": "21 gwt", "contact": contact})
        found = bench.attention
        assert found is not None
        assert (found["status"], found["reason_text"], found["may_touch"]) == (status_word, "21 gwt", True)
        assert found["next_text"].startswith("free the finger; then home")
    bench.begin(7)
    assert (bench.owner, bench.since, bench.newest_state(1.0)["force_gwt"]) == (7, 0, None)


def test_without_a_configuration_there_is_no_manual_control() -> None:
    bench = BenchView()
    assert (bench.configured, bench.job, bench.limits_state(), bench.ports) == (False, None, None, ())
