"""A resumed run is the same run: what the script asks for now is compared with what the journal has."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.data import read_run
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.resume import read_stopped
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.program import Program

pytestmark = pytest.mark.usefixtures("empty_figures")

BEFORE = """\
import os
import random

from rig.protocol import Field, ProtocolParameters

SECOND = os.environ.get("PASS") == "second"


def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.note("first note")
    rig.move_to(x_mm=0.0)
"""
AFTER = """\
    rig.move_to(x_mm=0.5)
    rig.indent(doi_mm=0.2, hold_s=0.1)
"""

OTHER = {
    "x": "rig.move_to(x_mm=0.3 if SECOND else 0.0); rig.indent(doi_mm=0.2, hold_s=0.1)",
    "order of places": """for x in [0.4, -0.4] if SECOND else [-0.4, 0.4]:
        rig.move_to(x_mm=x); rig.indent(doi_mm=0.2, hold_s=0.1)""",
    "shape": 'rig.mount("cylinder:d=9" if SECOND else "bar:3.0"); rig.indent(doi_mm=0.2, hold_s=0.1)',
    "depth": "rig.indent(doi_mm=0.3 if SECOND else 0.2, hold_s=0.1)",
    "depth or force": """rig.indent(force_gwt=1.0, hold_s=0.1) if SECOND else rig.indent(doi_mm=0.2, hold_s=0.1)""",
    "own or usual speed": "rig.indent(doi_mm=0.2, hold_s=0.1, speed_mm_s=0.2 if SECOND else None)",
    "increments": "rig.indent(doi_mm=0.2, hold_s=0.1, increments=2 if SECOND else 1)",
    "hold": "rig.indent(doi_mm=0.2, hold_s=0.3 if SECOND else 0.1)",
    "verb": """rig.indent(doi_mm=0.2, hold_s=0.1)
    rig.ramp(doi_mm=0.2, speed_mm_s=0.2, hold_s=0.1) if SECOND else rig.indent(doi_mm=0.2, hold_s=0.1)""",
    "block": 'rig.mark({"block": 2 if SECOND else 1}); rig.indent(doi_mm=0.2, hold_s=0.1)',
    "condition or none": 'rig.mark({"condition": "b"} if SECOND else {}); rig.indent(doi_mm=0.2, hold_s=0.1)',
    "preconditioning": """rig.precondition(presses=1, doi_mm=0.3 if SECOND else 0.2, hold_s=0.1)
    rig.indent(doi_mm=0.2, hold_s=0.1)""",
    "reference": """rig.reference(x_mm=0.2 if SECOND else 0.0, doi_mm=0.2, hold_s=0.1)
    rig.indent(doi_mm=0.2, hold_s=0.1)""",
    "touch": """rig.move_to(x_mm=0.2 if SECOND else 0.0); rig.touch()
    rig.indent(doi_mm=0.2, hold_s=0.1)""",
}
"""What a script does otherwise in its second pass, in a press that the journal has."""
SAME = {
    "nothing": "rig.indent(doi_mm=0.2, hold_s=0.1)",
    "a number computed from an answer": """found = rig.indent(doi_mm=0.2, hold_s=0.1)
    rig.move_to(x_mm=1e-4 * found.holds[-1].force_gwt); rig.indent(doi_mm=0.2, hold_s=0.1)""",
    "numbers of numpy": """import numpy as np
    rig.move_to(x_mm=np.float64(0.1)); rig.indent(doi_mm=np.float64(0.2), hold_s=0.1, increments=int(np.int64(2)))""",
    "a seeded order": """places = [-0.4, 0.4]; random.Random(7).shuffle(places)
    for x in places:
        rig.move_to(x_mm=x); rig.indent(doi_mm=0.2, hold_s=0.1)""",
}


@pytest.fixture
def stopped(finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """A run of a script that was killed just before its last press."""

    def make(body: str, *, last: str = AFTER) -> Path:
        monkeypatch.delenv("PASS", raising=False)
        path = tmp_path / "script.py"
        path.write_text(f"{BEFORE}    {body}\n{last}", encoding="utf-8")
        script = load_script(str(path))
        plan = make_plan(script, Config(), finger)
        done = dry_run(Session(script, Config(), finger, plan, NewRun(tmp_path / "runs")))
        assert done.complete, done.problem
        events = done.folder.events
        lines = events.read_bytes().splitlines(keepends=True)
        starts = [
            n
            for n, line in enumerate(lines)
            if (one := json.loads(line))["doc"] == "event" and one["stream"] == "indentation_start"
        ]
        events.write_bytes(b"".join(lines[: starts[-1]]))
        monkeypatch.setenv("PASS", "second")
        return done.folder.path

    return make


@pytest.mark.parametrize("what", OTHER)
def test_a_script_that_asks_for_another_press_is_not_resumed(
    program: Program, stopped: Callable[[str], Path], what: str
) -> None:
    folder = stopped(OTHER[what])
    before = (folder / "events.jsonl").read_bytes()
    ended = program("resume", folder, "--json")
    assert ended.code == 2, ended.err
    assert ended.json["code"] == "another_press", ended.err
    assert "where the run has" in ended.err
    assert (folder / "events.jsonl").read_bytes() == before


@pytest.mark.parametrize("what", SAME)
def test_a_script_that_asks_for_the_same_presses_is_resumed(
    program: Program, stopped: Callable[[str], Path], what: str
) -> None:
    folder = stopped(SAME[what])
    ended = program("resume", folder)
    assert ended.code == 0, ended.err
    run = read_run(folder)
    assert (run.missing, run.repeated) == (0, 0)
    assert "differs" not in ended.err


@pytest.mark.parametrize(
    ("what", "body"),
    [
        ("note", 'rig.note("another" if SECOND else "second note"); rig.indent(doi_mm=0.2, hold_s=0.1)'),
        ("rest", "rig.rest(3.0 if SECOND else 1.0); rig.indent(doi_mm=0.2, hold_s=0.1)"),
    ],
)
def test_another_note_or_rest_is_reported_and_the_run_is_resumed(
    program: Program, stopped: Callable[[str], Path], what: str, body: str
) -> None:
    ended = program("resume", stopped(body))
    assert ended.code == 0, ended.err
    assert f"the script differs from the resumed run: {what}: " in ended.err


def test_a_run_of_0_2_is_compared_in_what_its_journal_has(finger: Fingertip, stopped: Callable[[str], Path]) -> None:
    new = ("crc32", "verb", "speed_mm_s", "hold_s")

    def older(line: bytes) -> dict[str, Any]:
        document = json.loads(line)
        document.pop("crc32")
        if document.get("stream") == "indentation_start" and document["doc"] == "event":
            document["data"] = {key: value for key, value in document["data"].items() if key not in new}
        return dict(document)

    for body, code in (
        (OTHER["order of places"], "another_press"),
        (OTHER["x"], "another_press"),
        (SAME["nothing"], None),
    ):
        folder = stopped(body)
        events = folder / "events.jsonl"
        lines = [json.dumps(older(line)) + "\n" for line in events.read_bytes().splitlines()]
        events.write_text("".join(lines), encoding="ascii")
        of = read_stopped(folder)
        if code is None:
            make_plan(of.script, of.config, finger, of.run, folder)
        else:
            with raises(BadInputError, code):
                make_plan(of.script, of.config, finger, of.run, folder)


UNSEEDED = {
    "an unseeded shuffle": "places = [i / 10 for i in range(-4, 5)]; random.shuffle(places)",
    "a loop over a set": 'places = [len(s) / 20 for s in {"a" * n for n in range(1, 9)}]',
    "the time": "import time; places = [time.time_ns() % 1000 / 1e4]",
    "the process": "places = [os.getpid() % 1000 / 1e4]",
}
SEEDED = {
    "a seeded shuffle": "places = [-0.4, 0.0, 0.4]; random.Random(7).shuffle(places)",
    "a sorted set": "places = sorted({0.1, 0.2, 0.3})",
    "an answer": "places = [0.1 + 1e-3 * rig.indent(doi_mm=0.2, hold_s=0.1).holds[-1].force_gwt]",
    "printed words": 'print("hello"); places = [0.1]',
}
LOOP = "\n    for x in places:\n        rig.move_to(x_mm=x); rig.indent(doi_mm=0.2, hold_s=0.1)\n"


@pytest.mark.parametrize("what", [*UNSEEDED, *SEEDED])
def test_check_warns_of_a_script_that_does_not_repeat_itself(program: Program, tmp_path: Path, what: str) -> None:
    path = tmp_path / "script.py"
    path.write_text(f"{BEFORE}    {(UNSEEDED | SEEDED)[what]}{LOOP}", encoding="utf-8")
    ended = program("check", path, "--json")
    assert ended.code == 0, ended.err
    assert ended.json["repeats"] is (what in SEEDED)
    assert ("does not repeat itself" in ended.err) is (what in UNSEEDED)


@pytest.mark.quick(rows=lambda what: what == "an unseeded shuffle")
@pytest.mark.parametrize("what", ["an unseeded shuffle", "a loop over a set"])
def test_an_unseeded_run_that_was_killed_never_mixes_conditions(tmp_path: Path, what: str) -> None:
    """Each process has another order; by chance it is the same."""
    path = tmp_path / "script.py"
    path.write_text(f"{BEFORE}    {UNSEEDED[what]}{LOOP}", encoding="utf-8")
    rig = [sys.executable, "-m", "rig"]
    subprocess.run([*rig, "dry-run", path, "--out", tmp_path / "runs"], check=True, capture_output=True)
    (folder,) = (tmp_path / "runs").iterdir()
    events = folder / "events.jsonl"
    lines = events.read_bytes().splitlines(keepends=True)
    ends = [n for n, line in enumerate(lines) if b'"stream": "indentation_end", "data"' in line]
    events.write_bytes(b"".join(lines[: ends[4] + 1]))
    asked = [event["x_mm"] for event in read_run(folder).stream("indentation_start")]
    env = {**os.environ, "PYTHONHASHSEED": "3"}
    ended = subprocess.run([*rig, "resume", folder], env=env, capture_output=True, text=True)
    assert ended.returncode in (0, 2), ended.stderr
    pressed = [event["x_mm"] for event in read_run(folder).stream("indentation_start")]
    if ended.returncode == 2:
        assert "where the run has" in ended.stderr
        assert pressed == asked
    else:
        assert len(set(pressed)) == len(pressed)
