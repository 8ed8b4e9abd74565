"""Runs asked over their own sockets: stopped in every phase, paused, and without their finger."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.control.client import Announced, ControlError, announced
from rig.data import read_run
from rig.data.journal import read_journal
from rig.data.tables import state_of
from rig.session.script_run import AT_ONCE
from rig.transport import first_owner
from sim.models.fingertip import Fingertip
from studies.faults.stops import decides
from tests.error_codes import raises
from tests.program import EMPTY_FIGURES, Program
from tests.waiting import DEADLINE_S, until

pytest.importorskip("pty", reason="needs pseudo-terminals")

STOP = "2118"  # feed hold and reset


class Elsewhere:
    """`rig COMMAND` in a process of its own, and what it announces."""

    def __init__(self, out: Path, *words: object) -> None:
        command = [sys.executable, "-c", f"{EMPTY_FIGURES}from rig.cli import main; main()", *map(str, words)]
        self.out = out
        self.process = subprocess.Popen(
            [*command, "--out", str(out)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdin is not None
        self.process.stdin.write("\n" * 9)
        self.process.stdin.flush()
        self.one: Announced = self.comes_to(lambda: next((o for o in announced() if o.pid == self.process.pid), None))

    def comes_to(self, look: Callable[[], Any]) -> Any:
        """What look() finds; the process must not end before."""
        found: list[Any] = []
        until(lambda: found.append(look()) or found[-1] or self.process.poll() is not None)
        assert found[-1], self.process.communicate()
        return found[-1]

    def ask(self, do: str) -> dict[str, Any]:
        return self.one.ask(do, within_s=DEADLINE_S)

    def is_at(self, state: str) -> Callable[[], bool]:
        return lambda: self.ask("status")["state"] == state

    def end(self) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=DEADLINE_S)
        return self.process.returncode, out, err

    @property
    def folder(self) -> Path:
        (found,) = (path for path in self.out.iterdir() if not path.name.startswith("."))
        return found

    @property
    def documents(self) -> list[Any]:
        found = list(self.out.glob("*/events.jsonl"))
        return list(read_journal(found[0])) if found else []

    @property
    def sent(self) -> list[str]:
        """What went to the devices, as hex."""
        lines = map(json.loads, (self.folder / "bytes.jsonl").read_text(encoding="ascii").splitlines())
        return [line["hex"] for line in lines if line["dir"] == "tx"]


@pytest.fixture
def elsewhere(tmp_path: Path) -> Iterator[Callable[..., Elsewhere]]:
    begun: list[Elsewhere] = []

    def begin(script: str, *words: object) -> Elsewhere:
        path = tmp_path / "decides.py"
        path.write_text(script, encoding="utf-8")
        command, *options = words
        begun.append(Elsewhere(tmp_path / "runs", command, path, *options))
        return begun[-1]

    yield begin
    for one in begun:
        if one.process.poll() is None:
            one.process.kill()
            one.process.communicate()


def _solves(run: Elsewhere) -> bool:
    """It has moved on after its first press, to a place that was not planned."""
    events = [one.get("stream") for one in run.documents]
    return "indentation_end" in events and events[-1] == "move"


def _in(phase: str) -> Callable[[Elsewhere], bool]:
    return lambda run: any(one.get("data", {}).get("phase") == phase for one in run.documents)


PHASES: dict[str, tuple[str, Callable[[Elsewhere], bool]]] = {
    "plan": (decides(), lambda run: run.is_at("planning")()),
    "approach": (decides(), _in("approach")),
    "solve": (decides(times=40), _solves),
    "hold": (decides(hold_s=60.0), _in("hold")),
}


@pytest.mark.parametrize("phase", PHASES)
def test_a_stop_is_on_the_wire_and_on_record_whatever_the_run_is_at(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], finger: Fingertip, phase: str
) -> None:
    bench, config = whole
    script, there = PHASES[phase]
    run = elsewhere(script, "run", "--yes", "--config", config)
    assert set(run.one.ports) == set(bench.ports.values())
    run.comes_to(lambda: there(run))
    assert run.ask("stop") == {"ok": True, "stopped": True}
    code, _, err = run.end()
    assert code == 130, err
    assert STOP in run.sent
    behind = [bytes.fromhex(sent) for sent in run.sent[run.sent.index(STOP) + 1 :]]
    assert not [sent for sent in behind if b"G" in sent or b"$" in sent], "no move follows it"
    *_, last = run.documents
    assert (last["doc"], last["status"]) == ("stop", "aborted")
    found = read_run(run.folder)
    assert (found.complete, state_of(found)) == (False, "aborted")
    if phase == "plan":
        assert (last["stopped_while"], last["indentor"]["left"], run.sent) == ("planning", "not moved", [STOP])
        assert "where   not moved" in err
    else:
        assert f"\nrig: {AT_ONCE}\n" in f"\n{err}"
        assert (run.folder / "report.html").exists(), "what is on disk is worth a report"
    assert first_owner(bench.ports.values()) is None
    with raises(ControlError, "ended"):
        run.ask("status")


def _stopped_as_soon_as_announced(run: Elsewhere) -> None:
    """Everything that has a run announces it before it can be interrupted."""
    assert run.ask("stop") == {"ok": True, "stopped": True}
    code, _, err = run.end()
    assert code == 130, err
    assert f"the run folder {run.folder} records the stop\n" in err
    *_, last = run.documents
    assert (last["status"], last["stopped_while"], last["indentor"]["left"]) == ("aborted", "planning", "not moved")
    assert state_of(read_run(run.folder)) == "aborted"


@pytest.mark.parametrize("command", ["run", "identify"])
def test_a_stop_as_soon_as_a_run_is_announced_is_on_record(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], tmp_path: Path, command: str
) -> None:
    to = ["--to", tmp_path / "finger.toml"] if command == "identify" else []
    run = elsewhere(decides(), command, "--yes", "--config", whole[1], *to)
    _stopped_as_soon_as_announced(run)
    assert run.sent == [STOP]


@pytest.mark.parametrize("command", ["dry-run", "identify"])
def test_a_stop_as_soon_as_a_rehearsal_is_announced_is_on_record(
    elsewhere: Callable[..., Elsewhere], tmp_path: Path, command: str
) -> None:
    dry = ["--dry-run", "--to", tmp_path / "finger.toml"] if command == "identify" else []
    _stopped_as_soon_as_announced(elsewhere(decides(), command, *dry))


def test_a_stop_while_the_report_is_made_leaves_the_data_what_they_are(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], finger: Fingertip, rig: Program
) -> None:
    _, config = whole
    run = elsewhere(decides(), "run", "--yes", "--json", "--config", config)
    run.comes_to(lambda: run.is_at("reporting")() and any(one["doc"] == "stop" for one in run.documents))
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
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], finger: Fingertip, rig: Program
) -> None:
    """Without a terminal: whoever asked for the pause ends it. `rig stop` needs no signal where a socket answers."""
    _, config = whole
    run = elsewhere(decides(times=40), "run", "--yes", "--config", config)
    run.comes_to(lambda: _in("hold")(run))
    assert run.ask("pause")["ok"]
    run.comes_to(run.is_at("paused"))
    assert run.ask("status")["run"] == str(run.folder)
    assert run.ask("go_on")["state"] == "running"
    count = len(run.documents)
    run.comes_to(lambda: any(one.get("stream") == "sample" for one in run.documents[count:]))
    stopped = rig("stop", "--config", config, "--json")
    assert (stopped.code, stopped.json["owner"]) == (0, run.process.pid), stopped.err
    code, _, err = run.end()
    assert code == 130
    assert "as the panel requested; press Ctrl-C" in err
    assert "continuing, as the panel requested" in err
    assert run.documents[-1]["status"] == "aborted"


def test_a_run_whose_finger_is_lost_is_lifted_and_says_so(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], finger: Fingertip
) -> None:
    _, config = whole
    run = elsewhere(decides(hold_s=1.0, times=3), "run", "--yes", "--config", config)
    run.comes_to(lambda: _in("hold")(run))
    (child,) = _children(run.process.pid)
    os.kill(child, signal.SIGKILL)
    code, _, err = run.end()
    assert code == 1, err
    assert "rig: stopped: the process of the finger model ended (SIGKILL)" in err
    *_, last = run.documents
    assert (last["status"], last["indentor"]["left"]) == ("failed", "lifted")
    assert (run.folder / "report.html").exists(), "another process has made it"


def test_the_finger_ends_with_its_run(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], finger: Fingertip
) -> None:
    _, config = whole
    run = elsewhere(decides(hold_s=60.0), "run", "--yes", "--config", config)
    run.comes_to(lambda: _in("hold")(run))
    (child,) = _children(run.process.pid)
    run.process.kill()
    run.process.communicate()
    until(lambda: not Path(f"/proc/{child}").exists())


def test_a_dry_run_answers_too(elsewhere: Callable[..., Elsewhere], finger: Fingertip) -> None:
    run = elsewhere(decides(hold_s=60.0), "dry-run", "--speed", "10")
    assert (run.one.virtual, run.one.ports, run.one.kind) == (True, (), "run")
    run.comes_to(lambda: _in("hold")(run))
    assert run.ask("status") == {"ok": True, "state": "running", "run": str(run.folder), "stopped": False}
    assert run.ask("stop")["stopped"]
    assert run.end()[0] == 130
    assert STOP in run.sent[-1]
    assert run.documents[-1]["status"] == "aborted"


def _children(pid: int) -> list[int]:
    """Processes of the finger that a process has begun."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = (stat.parent / "cmdline").read_text()
            if int(stat.read_text().rpartition(")")[2].split()[1]) == pid and "spawn_main" in words:
                found.append(int(stat.parent.name))
        except OSError:
            continue  # it has just ended
    return found
