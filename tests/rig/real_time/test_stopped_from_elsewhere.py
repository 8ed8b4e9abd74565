"""Runs stopped over their own sockets, as they move, as they solve, and as soon as they are announced."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rig.bench.served import ServedBench
from rig.control.client import ControlError
from rig.data import read_run
from rig.data.tables import state_of
from rig.session.script_run import AT_ONCE
from rig.transport import first_owner
from studies.faults.stops import decides
from tests.error_codes import raises
from tests.rig.real_time.elsewhere import STOP, Elsewhere, at_phase

pytest.importorskip("pty", reason="needs pseudo-terminals")


def _solves(run: Elsewhere) -> bool:
    """It has moved on after its first press, to a place that was not planned."""
    events = [one.get("stream") for one in run.documents]
    return "indentation_end" in events and events[-1] == "move"


PHASES: dict[str, tuple[str, Callable[[Elsewhere], bool]]] = {
    "approach": (decides(), at_phase("approach")),
    "solve": (decides(times=12), _solves),
}


@pytest.mark.parametrize("phase", PHASES)
def test_a_stop_is_on_the_wire_and_on_record_whatever_the_run_is_at(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], phase: str
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
    assert f"\nrig: {AT_ONCE}\n" in f"\n{err}"
    assert (run.folder / "report.html").exists(), "what is on disk is worth a report"
    assert first_owner(bench.ports.values()) is None
    with raises(ControlError, "ended"):
        run.ask("status")


def _stopped_as_soon_as_announced(run: Elsewhere) -> str:
    """Everything that has a run announces it before it can be interrupted; what it said then."""
    assert run.ask("stop") == {"ok": True, "stopped": True}
    code, _, err = run.end()
    assert code == 130, err
    assert f"the run folder {run.folder} records the stop\n" in err
    *_, last = run.documents
    assert (last["status"], last["stopped_while"], last["indentor"]["left"]) == ("aborted", "planning", "not moved")
    assert state_of(read_run(run.folder)) == "aborted"
    return err


@pytest.mark.parametrize("command", ["run", "identify"])
def test_a_stop_as_soon_as_a_run_is_announced_is_on_record(
    elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path], tmp_path: Path, command: str
) -> None:
    to = ["--to", tmp_path / "finger.toml"] if command == "identify" else []
    run = elsewhere(decides(), command, "--yes", "--config", whole[1], *to)
    said = _stopped_as_soon_as_announced(run)
    assert command != "run" or "where   not moved" in said
    assert run.sent == [STOP]


def test_a_stop_as_soon_as_a_rehearsal_is_announced_is_on_record(elsewhere: Callable[..., Elsewhere]) -> None:
    _stopped_as_soon_as_announced(elsewhere(decides(), "dry-run"))
