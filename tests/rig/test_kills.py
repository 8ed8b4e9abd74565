"""A few of the kills of studies/faults: every run is taken up, nothing is lost, done twice or mixed."""

import csv
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.data import read_run
from rig.transport.wire import LoopbackTransport
from sim.devices.clock import VirtualClock
from sim.devices.line import SerialLine
from sim.models.fingertip import Fingertip
from tests.faults.attempts import mixed
from tests.faults.strikes import CABLES, CutWire

KILLS = 8
ROOT = Path(__file__).parents[2]
needs_fork = pytest.mark.skipif(sys.platform == "win32", reason="needs fork and SIGKILL")


def _found(*options: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "tests.faults.kills", *options, "--seed", "11", "--json"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=170, check=False, cwd=ROOT)
    assert ended.returncode == 0, ended.stderr
    found: dict[str, Any] = json.loads(ended.stdout)
    assert [found[key] for key in ("lost", "missing", "repeated", "mixed", "touching")] == [0] * 5
    return found


@needs_fork
def test_killed_runs_are_taken_up(finger: Fingertip) -> None:
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
def test_runs_whose_cables_were_pulled_are_taken_up(finger: Fingertip) -> None:
    found = _found("--kills", "0", "--cables", "4")
    assert (found["cables"], found["complete"]) == (4, 4)
    assert [result["how"] for result in found["results"]] == list(CABLES)
    assert all(result["left"] in ("held", "raised") for result in found["results"])
    assert [result["left"] for result in found["results"] if result["how"].startswith("stage")] == ["held"] * 2


# --- what the study sees, and does ---

ATTEMPT = [
    ("indentation_start", {"index": 0, "indentor": "bar:3.0", "x_mm": 0.5, "value": 1.0, "increments": 2}),
    ("sample", {"index": 0, "phase": "press", "x_mm": 0.5}),
    ("touch", {"index": 0}),
    *((name, {"index": 0, "hold": hold, "x_mm": 0.5}) for hold in (1, 2) for name in ("hold_start", "hold_end")),
    ("indentation_end", {"index": 0}),
]
Told = list[tuple[str, dict[str, Any]]]


@pytest.fixture
def mixed_of(tmp_path: Path) -> Callable[..., int]:
    """How many indentations of a run with these events in its journal are mixed; `holds` is its exported table."""

    def make(told: Told, holds: tuple[int, ...] = (1, 2)) -> int:
        documents: list[dict[str, Any]] = [{"doc": "start", "planned_indentations": 1}]
        for stream, data in told:
            documents.append({"doc": "event", "stream": stream, "data": data} if data else {"doc": stream})
        lines = [json.dumps({**document, "t_s": float(n)}) + "\n" for n, document in enumerate(documents)]
        (tmp_path / "events.jsonl").write_text("".join(lines), encoding="utf-8")
        with (tmp_path / "hold_end.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([("index", "hold"), *((0, hold) for hold in holds)])
        return mixed(read_run(tmp_path))

    return make


def test_one_whole_attempt_is_not_mixed_however_many_there_were_before(mixed_of: Callable[..., int]) -> None:
    assert mixed_of(ATTEMPT) == 0
    assert mixed_of(ATTEMPT[:-1]) == 0, "killed between its last hold and its end"
    assert mixed_of([*ATTEMPT[:4], ("resume", {}), *ATTEMPT]) == 0
    assert mixed_of([*ATTEMPT[:4], ("resume", {}), *ATTEMPT[:5], ("resume", {}), *ATTEMPT]) == 0


@pytest.mark.parametrize(
    "told",
    {
        "half of it before the program was killed": [*ATTEMPT[:4], ("resume", {}), *ATTEMPT[4:]],
        "touched twice": [*ATTEMPT[:3], ATTEMPT[2], *ATTEMPT[3:]],
        "not touched": [*ATTEMPT[:2], *ATTEMPT[3:]],
        "a hold twice": [*ATTEMPT[:5], *ATTEMPT[3:]],
        "a hold that did not begin": [*ATTEMPT[:3], *ATTEMPT[4:]],
        "elsewhere": [ATTEMPT[0], ("sample", {"index": 0, "phase": "press", "x_mm": 0.52}), *ATTEMPT[2:]],
    }.items(),
    ids=lambda item: item[0],
)
def test_what_is_not_one_whole_attempt_is_mixed(mixed_of: Callable[..., int], told: tuple[str, Told]) -> None:
    assert mixed_of(told[1]) == 1


@pytest.mark.parametrize("holds", [(1, 2, 2), (1,), (1, 1, 2)])
def test_a_table_that_has_a_hold_twice_or_not_at_all_is_mixed(
    mixed_of: Callable[..., int], holds: tuple[int, ...]
) -> None:
    assert mixed_of(ATTEMPT, holds) == 1


@pytest.mark.parametrize("silent", [False, True])
def test_a_cable_is_cut_in_the_middle_of_what_goes_over_it(silent: bool) -> None:
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
