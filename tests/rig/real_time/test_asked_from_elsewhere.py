"""Runs asked over their own sockets: paused, stopped while the report is made, and without their finger."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.bench.served import ServedBench
from rig.data import read_run
from rig.session.script_run import AT_ONCE
from studies.faults.stops import decides
from tests.program import HELD_REPORT, Program
from tests.rig.real_time.elsewhere import STOP, Elsewhere, at_phase

pytest.importorskip("pty", reason="needs pseudo-terminals")
pytestmark = pytest.mark.usefixtures("empty_figures")


def test_a_stop_while_the_report_is_made_leaves_the_data_what_they_are(
    elsewhere: Callable[..., Elsewhere],
    whole: tuple[ServedBench, Path],
    rig: Program,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, config = whole
    monkeypatch.setenv(HELD_REPORT, "1")
    for _ in range(10):
        run = elsewhere(decides(), "run", "--yes", "--json", "--config", config)
        run.comes_to(lambda run=run: run.is_at("reporting")() and any(one["doc"] == "stop" for one in run.documents))
        if run.documents[-1]["status"] == "done":
            break
        run.ask("stop")  # A busy machine solved the finger too late for the balance.
        run.end()
        shutil.rmtree(run.folder)
    sent = len(run.sent)
    before = read_run(run.folder)
    assert run.ask("stop") == {"ok": True, "stopped": True}
    code, out, err = run.end()
    assert code == 130, err
    assert run.sent[sent:] == [STOP]
    after = read_run(run.folder)
    assert after.stop is not None
    assert after.stop["stopped_while"] == "reporting"
    assert (after.complete, after.done, after.duration_s) == (True, before.done, before.duration_s)
    told = json.loads(out)
    assert (told["complete"], told["indentations"]) == (True, 1)
    assert told["ending"]["reason_text"] == "stopped at once by the operator"
    assert told["ending"]["indentor"]["trusted"] is False
    resumed = rig("resume", run.folder, "--json")
    assert (resumed.code, resumed.json["complete"]) == (0, True)
    assert Path(resumed.json["report"]).exists()
    assert read_run(run.folder).stop == after.stop


def test_a_pause_from_elsewhere_and_rig_stop_over_the_socket(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], rig: Program
) -> None:
    """Without a terminal: whoever asked for the pause ends it. `rig stop` needs no signal where a socket answers."""
    bench, config = whole
    run = elsewhere(decides(hold_s=20.0), "run", "--yes", "--config", config)
    run.comes_to(lambda: at_phase("hold")(run))
    assert run.ask("pause")["ok"]
    run.comes_to(run.is_at("paused"))
    assert run.ask("status")["run"] == str(run.folder)
    assert run.ask("go_on")["state"] == "running"
    count = len(run.documents)
    run.comes_to(lambda: any(one.get("stream") == "sample" for one in run.documents[count:]))
    stopped = rig("stop", "--config", config, "--json")
    assert stopped.code == 0, stopped.err
    told = stopped.json
    assert told.pop("state") in ("Alarm", "Idle")  # between two motions a reset leaves a board idle
    assert told == {"stopped": [bench.ports["stage"]], "owner": run.process.pid, "sent": True}
    code, _, err = run.end()
    assert code == 130
    assert f"\nrig: {AT_ONCE}\n" in f"\n{err}"
    assert "as the panel requested; press Ctrl-C" in err
    assert "continuing, as the panel requested" in err
    assert run.documents[-1]["status"] == "aborted"
    assert {"data.h5", "report.html", "SHA256SUMS"} <= {path.name for path in run.folder.iterdir()}


def test_a_run_whose_finger_is_lost_is_lifted_and_says_so(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path]
) -> None:
    _, config = whole
    run = elsewhere(decides(hold_s=1.0, times=2), "run", "--yes", "--config", config)
    run.comes_to(lambda: at_phase("hold")(run))
    (child,) = _children(run.process.pid)
    os.kill(child, signal.SIGKILL)
    code, _, err = run.end()
    assert code == 1, err
    assert "rig: stopped: the process of the finger model ended (SIGKILL)" in err
    *_, last = run.documents
    assert (last["status"], last["indentor"]["left"]) == ("failed", "lifted")
    assert (run.folder / "report.html").exists(), "another process has made it"


def test_a_dry_run_answers_too(elsewhere: Callable[..., Elsewhere]) -> None:
    run = elsewhere(decides(hold_s=20.0), "dry-run", "--speed", "10")
    assert (run.one.virtual, run.one.ports, run.one.kind) == (True, (), "run")
    run.comes_to(lambda: at_phase("hold")(run))
    assert run.ask("status") == {"ok": True, "state": "running", "run": str(run.folder), "stopped": False}
    assert run.ask("stop")["stopped"]
    assert run.end()[0] == 130
    assert STOP in run.sent[-1]
    assert run.documents[-1]["status"] == "aborted"


def _children(pid: int) -> list[int]:
    """Processes of the finger that a process has begun: those that have left its session."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, parent, _, session, *_ = stat.read_text().rpartition(")")[2].split()
            if int(parent) == pid and session == stat.parent.name:
                found.append(int(stat.parent.name))
        except OSError:
            continue  # it has just ended
    return found
