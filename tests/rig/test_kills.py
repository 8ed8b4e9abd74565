"""A few of the kills of studies/faults: every journal readable, every run taken up, nothing missing or done twice."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sim.models.fingertip import Fingertip

KILLS = 8
ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork and SIGKILL")
def test_killed_runs_are_taken_up(finger: Fingertip) -> None:
    """Four on writes of the journal, one at each stage of a write, four on instants; two are killed twice."""
    command = [sys.executable, "-m", "studies.faults.kills", "--kills", str(KILLS), "--seed", "11", "--json"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=170, check=False, cwd=ROOT)
    assert ended.returncode == 0, ended.stderr
    found = json.loads(ended.stdout)
    assert (found["kills"], found["complete"]) == (KILLS, KILLS)
    assert (found["missing"], found["repeated"]) == (0, 0)
    assert found["restarted"] > 0
    kinds = {result["kind"] for result in found["results"]}
    assert kinds == {
        "motion",
        *("journal, before the write", "journal, half written", "journal, before the flush", "journal, on disk"),
    }
