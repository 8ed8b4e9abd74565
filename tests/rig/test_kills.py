"""A few of the kills of studies/faults: every run is taken up, nothing is lost, done twice or mixed."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from rig.transport.wire import LoopbackTransport
from sim.devices.clock import VirtualClock
from sim.devices.line import SerialLine
from sim.models.fingertip import Fingertip
from tests.faults.strikes import CABLES, CutWire
from tests.preloaded import Popen
from tests.waiting import DEADLINE_S

KILLS = 8
ROOT = Path(__file__).parents[2]
needs_fork = pytest.mark.skipif(sys.platform == "win32", reason="needs fork and SIGKILL")


def _found(*options: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "tests.faults.kills", *options, "--seed", "11", "--json"]
    with Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        out, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, err
    found: dict[str, Any] = json.loads(out)
    assert [found[key] for key in ("lost", "missing", "repeated", "mixed", "touching")] == [0] * 5
    return found


@needs_fork
def test_killed_runs_are_resumed_without_missing_or_repeated_presses(finger: Fingertip) -> None:
    """Four on writes of the journal, one at each stage of a write, four on instants; two are killed twice."""
    found = _found("--kills", str(KILLS))
    assert (found["kills"], found["complete"]) == (KILLS, KILLS)
    assert (found["missing"], found["repeated"]) == (0, 0)
    assert found["restarted"] > 0
    kinds = {result["kind"] for result in found["results"]}
    assert kinds == {
        "motion",
        *("journal, before the write", "journal, half written", "journal, before the flush", "journal, on disk"),
    }
    left = {(result["how"], result["left"]) for result in found["results"]}
    assert left == {("KILL", "nothing"), ("TERM", "lifted"), ("HUP", "lifted")}


@needs_fork
def test_runs_whose_cables_were_pulled_are_resumed_completely(finger: Fingertip) -> None:
    found = _found("--kills", "0", "--cables", "4")
    assert (found["cables"], found["complete"]) == (4, 4)
    assert [result["how"] for result in found["results"]] == list(CABLES)
    assert all(result["left"] in ("held", "raised") for result in found["results"])
    assert [result["left"] for result in found["results"] if result["how"].startswith("stage")] == ["held"] * 2


# --- what the study sees, and does ---


@pytest.mark.parametrize("silent", [False, True])
def test_the_cable_fault_cuts_a_message_in_the_middle(silent: bool) -> None:
    """Six bytes pass: four there, two of the answer's three."""
    clock = VirtualClock()
    line = SerialLine(clock, 115200)
    heard = bytearray()
    line.connect(heard.extend)
    wire: LoopbackTransport = CutWire(line, clock, "stage", left=6, silent=silent)
    wire.write(b"?abc")
    clock.wait_s(0.1)
    assert bytes(heard) == b"?abc"
    line.device_write(b"ok\n")
    clock.wait_s(0.1)
    assert wire.read(0.5) == b"ok"
    if not silent:
        with pytest.raises(Exception, match="stage is closed"):
            wire.write(b"?")
        return
    line.device_write(b"more")
    wire.write(b"?")
    before_s = clock.monotonic_s()
    assert wire.read(0.5) == b""
    assert clock.monotonic_s() - before_s == pytest.approx(0.5)
    assert bytes(heard) == b"?abc"
