"""A resumed run is the same run: what the script asks for now is compared with what the journal has."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.data import read_run
from rig.data.folder import PLAN
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

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches."""
CONFIG = Config.model_validate(NEAR)
SCRIPT = """\
import os
import random

import numpy as np

DIFFERS = os.environ.get("DIFFERS")


def either(what, was, now):
    return now if DIFFERS == what else was


def indent(rig, **asked):
    try:
        rig.indent(**asked)
    except Exception:
        if "CATCHES" not in os.environ:
            raise


def run(rig):
    rig.mount(either("shape", "bar:3.0", "cylinder:d=9"))
    rig.home()
    rig.zero()
    rig.note(either("note", "a note", "another"))
    rig.reference(x_mm=either("reference", 0.0, 0.2), doi_mm=0.2, hold_s=0.1)
    rig.checkpoint(either("checkpoint", "a", "b"))
    rig.move_to(x_mm=either("touch", 0.0, 0.2))
    rig.touch()
    rig.move_to(x_mm=0.0)
    rig.precondition(presses=1, doi_mm=either("preconditioning", 0.2, 0.3), hold_s=0.1)
    rig.mark({"block": either("block", 1, 2)})
    found = rig.indent(
        doi_mm=either("depth", np.float64(0.2), 0.3), hold_s=either("hold", 0.1, 0.3),
        increments=either("increments", int(np.int64(1)), 2), speed_mm_s=either("own or usual speed", None, 0.2),
        rest_s=either("rest before", 0.5, 1.0),
    )
    rig.rest(either("rest", 0.5, 3.0))
    rig.mark(either("condition or none", {}, {"condition": "b"}))
    rig.move_to(x_mm=1e-4 * found.holds[-1].force_gwt)
    places = [-0.4, 0.4]
    random.Random(either("order of places", 7, 8)).shuffle(places)
    for x_mm in places:
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=0.1)
    rig.indent(**either("depth or force", {"doi_mm": 0.2}, {"force_gwt": 1.0}), hold_s=0.1)
    if DIFFERS == "verb":
        rig.ramp(doi_mm=0.2, speed_mm_s=0.2, hold_s=0.1)
    else:
        rig.indent(doi_mm=0.2, hold_s=0.1)
    rig.move_to(x_mm=either("x", 0.0, 0.3))
    indent(rig, doi_mm=0.2, hold_s=0.1)
    for _ in range(either("no later rest", 1, 0)):
        rig.rest(either("later rest", 0.5, 3.0))
    rig.note(either("later note", "the last", "another"))
    rig.checkpoint(either("later checkpoint", "c", "d"))
    rig.move_to(x_mm=either("later x", 0.5, 0.51))
    for _ in range(either("no later retract", 1, 0)):
        rig.retract()
    rig.mark({"block": 2, **either("later condition", {}, {"condition": "b"})})
    for _ in range(either("fewer presses", 1, 0)):
        indent(
            rig, doi_mm=float(os.environ.get("WALK", "0.2")), hold_s=either("later hold", 0.1, 0.3),
            speed_mm_s=either("later speed", None, 0.2), increments=either("later increments", 1, 2),
        )
    for _ in range(either("more presses", 0, 1)):
        rig.indent(doi_mm=0.2, hold_s=0.1)
"""
OTHER = (
    *(
        "x",
        "order of places",
        "shape",
        "depth",
        "depth or force",
        "own or usual speed",
        "increments",
        "hold",
        "rest before",
    ),
    *("verb", "block", "condition or none", "preconditioning", "reference", "touch"),
    "checkpoint",
)
"""What the script does otherwise in its second pass, in a press that the journal has."""
LATER = {
    "later x": ("data press index 6: ", "x_mm = 0.51, ", "x_mm = 0.5, "),
    "later condition": ("data press index 6: ", "condition = b, ", "condition = None, "),
    "later checkpoint": ("checkpoint(): ", "name = d, ", "name = c, "),
    "later hold": ("data press index 6: ", "hold_s = 0.3, ", "hold_s = 0.1, "),
    "later increments": ("data press index 6: ", "increments = 2, ", "increments = 1, "),
    "later speed": ("data press index 6: ", "speed_mm_s = 0.2, "),
    "no later retract": ("asks for data press index 6, ", "the run has retract()"),
    "fewer presses": ("next step: ", "asks for no further one, ", "the run has data press index 6"),
    "more presses": ("data press index 7: ", "x_mm = 0.5, ", "the run has no further step"),
}
"""What it does otherwise later, and words of the refusal."""


@pytest.fixture(autouse=True)
def _generator_of_numpy() -> Iterator[None]:
    """A script may set another one, in this process too."""
    before = np.random.get_bit_generator()
    yield
    np.random.set_bit_generator(before)


@pytest.fixture
def stopped(
    finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made_once: Callable[..., Path]
) -> Callable[[str], Path]:
    """A run that was killed just before its last press, of a script that differs in something from now on."""

    def make() -> None:
        monkeypatch.delenv("DIFFERS", raising=False)
        path = tmp_path / "script.py"
        path.write_text(SCRIPT, encoding="utf-8")
        script = load_script(str(path))
        plan = make_plan(script, CONFIG, finger)
        done = dry_run(Session(script, CONFIG, finger, plan, NewRun(tmp_path / "runs")))
        assert done.complete, done.problem
        _cut_before_the_last_press(done.folder.events)

    def differs(what: str) -> Path:
        folder = made_once("stopped", make)
        monkeypatch.setenv("DIFFERS", what)
        return folder

    return differs


def _cut_before_the_last_press(events: Path) -> None:
    lines = events.read_bytes().splitlines(keepends=True)
    starts = [n for n, line in enumerate(lines) if b'"stream": "indentation_start", "data"' in line]
    events.write_bytes(b"".join(lines[: starts[-1]]))


# Every field of a press by itself: tests/rig/test_resume_handler.py.
@pytest.mark.quick(
    rows=lambda what: what in ("x", "shape", "verb", "preconditioning", "reference", "touch", "checkpoint")
)
@pytest.mark.parametrize("what", OTHER)
def test_a_script_that_asks_for_another_press_is_not_resumed(
    program: Program, stopped: Callable[[str], Path], what: str
) -> None:
    folder = stopped(what)
    before = (folder / "events.jsonl").read_bytes()
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, "another_press"), ended.err
    assert (folder / "events.jsonl").read_bytes() == before


@pytest.mark.quick(rows=lambda what: what not in ("later hold", "later increments", "later speed"))
@pytest.mark.parametrize("what", LATER)
def test_a_script_that_plans_another_press_later_is_not_resumed(
    program: Program, stopped: Callable[[str], Path], what: str
) -> None:
    """The journal has none of these presses yet; the run stored what it planned."""
    folder = stopped(what)
    before = (folder / "events.jsonl").read_bytes()
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, "another_press"), ended.err
    assert all(
        words in ended.json["error_text"] for words in (*LATER[what], "environment variables, files and modules")
    )
    assert (folder / "events.jsonl").read_bytes() == before


@pytest.mark.parametrize("what", ["x", "later hold"])
def test_a_script_that_catches_the_refusal_is_not_resumed(
    program: Program, stopped: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    folder = stopped(what)
    before = (folder / "events.jsonl").read_bytes()
    monkeypatch.setenv("CATCHES", "1")
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, "another_press"), ended.err
    assert (folder / "events.jsonl").read_bytes() == before


def test_a_run_is_resumed_once_its_environment_is_restored(
    program: Program, stopped: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = stopped("nothing")
    monkeypatch.setenv("WALK", "0.19")
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, "another_press"), ended.err
    assert "value = 0.19, where the run has value = 0.2" in ended.json["error_text"]
    monkeypatch.delenv("WALK")
    assert program("resume", folder).code == 0


def test_a_run_without_journaled_presses_is_resumed_only_with_its_stored_plan(
    program: Program, stopped: Callable[[str], Path]
) -> None:
    folder = stopped("later x")
    (folder / "events.jsonl").write_bytes(b"")
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, "another_press"), ended.err


def test_a_run_that_stored_no_plan_is_compared_with_its_journal_alone(
    program: Program, stopped: Callable[[str], Path]
) -> None:
    """Runs of 0.2 and earlier journals of 0.3 have none."""
    folder = stopped("later x")
    _without_plan(folder)
    assert program("resume", folder).code == 0


@pytest.mark.parametrize(("content", "code"), [(None, "no_run_folder"), (b"{}\n", "changed_since")])
def test_a_run_whose_stored_plan_is_lost_or_changed_is_not_resumed(
    program: Program, stopped: Callable[[str], Path], content: bytes | None, code: str
) -> None:
    folder = stopped("nothing")
    if content is None:
        (folder / PLAN).unlink()
    else:
        (folder / PLAN).write_bytes(content)
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, code), ended.err
    assert PLAN in ended.json["error_text"]


def _without_plan(folder: Path) -> None:
    (folder / PLAN).unlink()
    sums = folder / "SHA256SUMS"
    lines = sums.read_text("utf-8").splitlines(keepends=True)
    sums.write_text("".join(line for line in lines if PLAN not in line), encoding="utf-8")


# A difference that is done and one to come, a note and a rest: each once.
@pytest.mark.quick(rows=lambda what: what not in ("note", "later rest"))
@pytest.mark.parametrize("what", ["nothing", "note", "rest", "later note", "later rest", "no later rest"])
def test_a_script_with_the_same_presses_is_resumed_and_its_other_notes_or_rests_are_reported(
    program: Program, stopped: Callable[[str], Path], what: str
) -> None:
    """Also where a number is computed from an answer or by numpy, and where an order is seeded."""
    folder = stopped(what)
    ended = program("resume", folder)
    assert ended.code == 0, ended.err
    run = read_run(folder)
    assert (run.missing, run.repeated) == (0, 0)
    verb = what.removeprefix("no ").removeprefix("later ")
    assert ended.err.count(f"the script differs from the resumed run: {verb}: ") == (what != "nothing")
    assert ended.err.count("differs") == (what != "nothing")


@pytest.mark.parametrize(("what", "code"), [("order of places", "another_press"), ("nothing", None)])
def test_a_run_of_version_0_2_is_compared_by_the_columns_it_has(
    finger: Fingertip, stopped: Callable[[str], Path], what: str, code: str | None
) -> None:
    new = ("crc32", "verb", "speed_mm_s", "hold_s")

    def older(line: bytes) -> dict[str, Any]:
        document = json.loads(line)
        document.pop("crc32")
        if document.get("stream") == "indentation_start" and document["doc"] == "event":
            document["data"] = {key: value for key, value in document["data"].items() if key not in new}
        return dict(document)

    folder = stopped(what)
    _without_plan(folder)
    events = folder / "events.jsonl"
    lines = [json.dumps(older(line)) + "\n" for line in events.read_bytes().splitlines()]
    events.write_text("".join(lines), encoding="ascii")
    of = read_stopped(folder)
    with nullcontext() if code is None else raises(BadInputError, code):
        make_plan(of.script, of.config, finger, of.run, folder)


# --- scripts that do not repeat themselves ---

BEFORE = """\
import os
import random
import numpy as np

RNG = random.Random(7)


def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
"""
UNSEEDED = {
    "an unseeded shuffle": "places = [i / 10 for i in range(-2, 4)]; random.shuffle(places)",
    "a loop over a set": 'places = [len(s) / 20 for s in {"a" * n for n in range(1, 9)}]',
    "numpy's generator": "places = (np.random.rand(3) / 10).tolist()",
    "the process": "places = [os.getpid() % 1000 / 1e4]",
    "a count of its passes, where no other script counts": (
        "os.passes = getattr(os, 'passes', 0) + 1; places = [os.passes / 10]"
    ),
    "a seeded generator of an installed module": "places = [installed_lab.RNG.uniform(-0.4, 0.4)]",
}
SEEDED = {
    "a seeded shuffle": "places = [-0.4, 0.0, 0.4]; random.Random(7).shuffle(places)",
    "a seeded generator at its top": "places = [RNG.uniform(-0.4, 0.4)]",
    "an answer": "places = [0.1 + 1e-3 * rig.indent(doi_mm=0.2, hold_s=0.1).holds[-1].force_gwt]",
}
KEPT = ("a count of its passes, where no other script counts", "a seeded generator of an installed module")
"""Those that differ only in what outlasts a pass."""
LOOP = "\n    for x in places:\n        rig.move_to(x_mm=x); rig.indent(doi_mm=0.2, hold_s=0.1)\n"


@pytest.mark.quick(rows=lambda what: what in ("an unseeded shuffle", "a seeded shuffle", KEPT[0]))
@pytest.mark.parametrize("what", [*UNSEEDED, *SEEDED])
def test_check_warns_of_a_script_that_does_not_repeat_itself(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    """And says what to do: to seed and sort, or to keep nothing from one pass to the next."""
    path, elsewhere = tmp_path / "script.py", tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "installed_lab.py").write_text("import random\nRNG = random.Random(7)\n", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(elsewhere), *filter(None, [os.environ.get("PYTHONPATH")])]))
    monkeypatch.syspath_prepend(elsewhere)
    top = "import installed_lab\n" * ("installed" in what)
    path.write_text(f"{top}{BEFORE}    {(UNSEEDED | SEEDED)[what]}{LOOP}", encoding="utf-8")
    ended = program("check", path, "--json")
    assert ended.code == 0, ended.err
    assert ended.json["repeats"] is (what in SEEDED)
    assert ("does not repeat itself" in ended.err) is (what in UNSEEDED)
    assert ("beside the script keeps" in ended.err) is (what in KEPT)
    assert ("sort what is a set" in ended.err) is (what in UNSEEDED and what not in KEPT)


def test_an_unseeded_run_that_was_killed_never_mixes_conditions(program: Program, tmp_path: Path) -> None:
    """Each time it has another order; by chance it is the same."""
    path = tmp_path / "script.py"
    path.write_text(f"{BEFORE}    {UNSEEDED['an unseeded shuffle']}{LOOP}", encoding="utf-8")
    assert program("dry-run", path, "--out", tmp_path / "runs").code == 0
    (folder,) = (tmp_path / "runs").iterdir()
    _cut_before_the_last_press(folder / "events.jsonl")
    asked = [event["x_mm"] for event in read_run(folder).stream("indentation_start")]
    ended = program("resume", folder, "--json")
    pressed = [event["x_mm"] for event in read_run(folder).stream("indentation_start")]
    if ended.code == 2:
        assert ended.json["code"] == "another_press"
        assert pressed == asked
    else:
        assert ended.code == 0, ended.err
        assert len(set(pressed)) == len(pressed) == len(asked) + 1


AT_THE_TOP = {
    "a seeded generator": (
        "RNG = random.Random(7)",
        "places = RNG.sample([-0.4, -0.2, 0.0, 0.2, 0.4], RNG.randint(2, 5))",
    ),
    "the module's seed": (
        "random.seed(7); PLACES = [-0.4, -0.2, 0.0, 0.2]",
        "random.shuffle(PLACES); places = PLACES",
    ),
    "a generator of numpy": (
        "RNG = np.random.default_rng(7)",
        "places = RNG.uniform(-0.4, 0.4, 3).round(2).tolist()",
    ),
    "a counter": ("CALLS = [0]", "CALLS[0] += 1; places = [0.1 * CALLS[0]]"),
    "a list that is emptied": ("PLACES = [-0.4, 0.0]", "places = [PLACES.pop(0) for _ in PLACES[:]]"),
    "a generator of a module beside": ("import lab_random", "places = lab_random.places()"),
    "a generator of the parameters": (
        "RNG = random.Random(7)\nclass Parameters(ProtocolParameters):\n"
        "    def places(self): return [RNG.uniform(-0.4, 0.4) for _ in range(3)]",
        "places = rig.parameters.places()",
    ),
    "a choice by name": (
        "class Side(Enum):\n    LEFT = -0.3\n    RIGHT = 0.3\n"
        "class Parameters(ProtocolParameters):\n    side: Side = Side.LEFT",
        "places = [0.1 if rig.parameters.side is Side.LEFT else 0.2, rig.parameters.side.value]",
    ),
}
"""What a script has at its top, and the places that it presses by it."""


@pytest.mark.parametrize("what", AT_THE_TOP)
def test_a_run_makes_the_planned_presses_whatever_an_earlier_pass_changed_in_the_script(
    program: Program, tmp_path: Path, what: str
) -> None:
    """Each pass begins as in a new process, whatever an earlier one left at the top of the script."""
    top, places = AT_THE_TOP[what]
    beside = "import random\nRNG = random.Random(7)\ndef places():\n    return [RNG.random(), RNG.random()]\n"
    (tmp_path / "lab_random.py").write_text(beside, encoding="utf-8")
    path = tmp_path / "script.py"
    head = "from enum import Enum\nimport numpy as np\nfrom rig.protocol import ProtocolParameters\n"
    path.write_text(
        f"{head}{BEFORE.replace('def run', top + chr(10) + 'def run')}    {places}{LOOP}", encoding="utf-8"
    )
    assert program("dry-run", path, "--out", tmp_path / "runs").code == 0
    (folder,) = (tmp_path / "runs").iterdir()
    steps = [json.loads(line) for line in (folder / PLAN).read_text("ascii").splitlines()]
    run = read_run(folder)
    pressed = [event["x_mm"] for event in run.stream("indentation_start")]
    assert pressed == pytest.approx([step["x_mm"] for step in steps if step.get("press") == "data"])
    assert (run.missing, run.complete) == (0, True)


@pytest.mark.parametrize(
    "draw",
    [
        "random.random()",
        "np.random.random()",
        "(np.random.random(), np.random.set_bit_generator(np.random.PCG64()))[0]",
    ],
)
def test_unseeded_random_numbers_are_the_same_in_every_pass_of_a_script(tmp_path: Path, draw: str) -> None:
    """So that the run makes the presses of its plan; another process draws others, and cannot resume it."""
    path = tmp_path / "mine.py"
    path.write_text(
        "import random\n"
        "import numpy as np\n"
        "from rig.protocol import Field, ProtocolParameters\n"
        "ORDER = random.sample(range(100), 5)\n"
        "class Parameters(ProtocolParameters):\n"
        "    at_mm: float = Field(default_factory=random.random)\n"
        "def run(rig):\n"
        f"    return [*ORDER, rig, {draw}]\n",
        encoding="utf-8",
    )
    script = load_script(str(path))
    drawn: list[Any] = []
    for _ in range(3):
        fresh = script.fresh()
        drawn.append(fresh.run(fresh.parameters.at_mm))
    assert drawn[0] == drawn[1] == drawn[2]
    assert drawn[0][-2] == script.parameters.at_mm
