"""Every command says what it does before it does it, tells how long such work took before, and breaks its silence.

A command that only a program starts, and help, say nothing of it.

Work is replaced by a function that looks at standard error when it is first called; no test waits or asserts seconds.
"""

import importlib
import io
import itertools
import logging
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, NoReturn

import pytest
from rich.console import Console

from rig.cli import main, output
from rig.cli.json_schemas import OUTPUTS
from rig.cli.output import THE_FINGER, Activity, busy, resting, starting, working
from rig.cli.program import COMMANDS
from rig.cli.progress import counted, progress
from rig.control.stop import OwnedStage
from rig.plan.config import load_config
from rig.session.resume import StoppedRun, read_stopped
from sim.models.fingertip import Fingertip

OLD_RUNS = Path(__file__).parents[1] / "data" / "runs"
LOAD = "sim.models.fingertip.Fingertip.load"
SCRIPT = 'def run(rig):\n    rig.mount("bar:3.0")\n    rig.home()\n    rig.zero()\n    rig.move_to(x_mm=0.0)\n'
SCRIPT += "    rig.indent(doi_mm=0.2, hold_s=0.1)\n"
STUDY = '[finger.tissue]\nepidermis_mm = [0.3, 0.5]\n\n[[press]]\nshape = "bar:3.0"\ndoi_mm = 0.1\n'


class Walked(NamedTuple):
    """Arguments of a command, the function that does its first work, and whether it says what that is.

    What takes no longer than to read a file says only that the command works.
    """

    words: str
    work: str
    own: bool = True


WALK = {
    "dry-run": Walked("mine.py", LOAD),
    "run": Walked("mine.py --config rig.toml --yes", LOAD),
    "identify": Walked("--dry-run --to finger.toml", LOAD),
    "check": Walked("mine.py", LOAD),
    "design": Walked("--quick --minutes 5", LOAD),
    "resume": Walked("run", "rig.cli.run.read_stopped"),
    "nerve": Walked("run", LOAD),
    "compare": Walked("run", LOAD),
    "runs": Walked(".", "rig.cli.runs.listed"),
    "show": Walked("run", "rig.cli.recorded_run.read_run"),
    "watch": Walked("run", "rig.cli.watch.RunScreen", own=False),
    "stream": Walked("--out .", "rig.cli.stream.open_streams", own=False),
    "take-orders": Walked("--indentor bar:3.0 --doi-mm 0.2 --virtual", "rig.cli.take_orders.load_config", own=False),
    "panel": Walked("--no-browser", "rig.cli.panel._panel", own=False),
    "export": Walked("run --csv", "rig.data.export.export_run"),
    "study": Walked("study.toml", "rig.study.parallel.in_processes"),
    "indent": Walked("--shape bar:3.0 --x-mm 0 --doi-mm 0.2 --model finger", LOAD),
    "impulse": Walked("", "rig.cli.encode._found"),
    "shift-invariance": Walked("", "rig.cli.encode.cached_sites"),
    "encode": Walked("--pressure 1,2", "rig.cli.encode.encode_task"),
    "decode": Walked("--pressure 1,2", "rig.cli.decode.decode_task"),
    "finger": Walked("", "rig.cli.finger.build_mesh"),
    "find": Walked("run", LOAD),
    "export-deck": Walked("--shape bar:3.0 --x-mm 0 --doi-mm 0.2 --out deck.inp", LOAD),
    "serve": Walked("", "rig.cli.serve.ServedBench"),
    "home": Walked("--config rig.toml", "rig.cli.bench._home"),
    "zero": Walked("--config rig.toml", "rig.cli.bench.open_force"),
    "status": Walked("--config rig.toml", "rig.cli.bench.look_and_contact"),
    "stop": Walked("--config rig.toml", "rig.cli.stop.send_stop", own=False),
    "jog": Walked("--config rig.toml --axis x --by-mm 1", "rig.cli.jog.by_hand"),
    "by-hand": Walked("--config rig.toml", "rig.cli.panel.ManualLog", own=False),
    "calibrate": Walked("force --config rig.toml --mass-g 5", "rig.cli.calibrate.open_force", own=False),
    "bench": Walked("--quick", "sim.benchmark.in_processes"),
    "cache": Walked("", "rig.cli.installation.entries", own=False),
    "config": Walked("", "rig.cli.installation.keys", own=False),
    "doctor": Walked("", "rig.cli.installation._examine"),
    "init": Walked("--yes --to new.toml --port tcp://127.0.0.1:9", "rig.cli.init.find_devices"),
}


class Reached(BaseException):
    """The work has begun."""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a script, a study, a run and a configuration whose ports are there."""
    monkeypatch.chdir(tmp_path)
    for name, text in {"mine.py": SCRIPT, "study.toml": STUDY, "stage": "", "force": ""}.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    ports = f"[stage]\nport = '{tmp_path / 'stage'}'\n[force]\nport = '{tmp_path / 'force'}'\n"
    (tmp_path / "rig.toml").write_text(ports, encoding="utf-8")
    shutil.copytree(OLD_RUNS / "complete", tmp_path / "run")
    monkeypatch.setattr(OwnedStage, "open", lambda stage: stage)
    monkeypatch.setattr(output, "FIRST_S", 0.0)
    return tmp_path


def test_the_walk_has_every_command() -> None:
    assert WALK.keys() == COMMANDS.keys()


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("name", "as_json"), [*((name, False) for name in WALK), *((name, True) for name in WALK if name in OUTPUTS)]
)
def test_it_is_said_before_it_is_done(
    name: str, as_json: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On standard error alone; not at all where only a program starts the command."""
    words, work, own = WALK[name]
    what: list[Activity | None] = []

    def reached(*_: object, **__: object) -> NoReturn:
        what.append(output._activities.current)
        raise Reached

    module, _, attribute = work.rpartition(".")
    if work == LOAD:
        monkeypatch.setattr(Fingertip, "load", reached)
    else:
        monkeypatch.setattr(importlib.import_module(module), attribute, reached)
    monkeypatch.setattr("sys.argv", ["rig", name, *words.split(), *(["--json"] if as_json else [])])
    with pytest.raises(Reached):
        main()
    printed = capsys.readouterr()
    (now,) = what
    assert bool(printed.err) is not COMMANDS[name].by_program
    assert printed.out == ""
    if own:
        assert now is not None
        assert now.title in printed.err
        assert now.title != Activity(f"rig {name}: working …").title
    assert output._activities.current is None


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("name", ["run", "resume"])
def test_the_finger_is_named_where_mounts_are_checked_without_a_person(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before a port is opened; then the model may be built."""
    what: list[str] = []

    def reached(*_: object, **__: object) -> NoReturn:
        what.append(output._activities.current.what if output._activities.current else "nothing")
        raise Reached

    def real(path: Path) -> StoppedRun:
        return replace(read_stopped(path), virtual=False, config=load_config(Path("rig.toml")))

    shutil.copytree(OLD_RUNS / "stopped", "stopped")
    monkeypatch.setattr(Fingertip, "load", reached)
    monkeypatch.setattr("rig.cli.run.can_answer", lambda: False)
    monkeypatch.setattr("rig.cli.run.read_stopped", real)
    words = "mine.py --config rig.toml --yes" if name == "run" else "stopped --yes"
    monkeypatch.setattr("sys.argv", ["rig", name, *words.split()])
    with pytest.raises(Reached):
        main()
    assert what == [THE_FINGER]
    assert THE_FINGER in capsys.readouterr().err


@pytest.mark.parametrize("name", [name for name, command in COMMANDS.items() if command.by_program])
def test_what_a_program_starts_is_hidden(name: str) -> None:
    assert COMMANDS[name].hidden


@pytest.mark.parametrize("name", COMMANDS)
def test_help_starts_no_progress(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """However long the command's module takes to load."""
    activities = output._Activities()
    monkeypatch.setattr(output, "_activities", activities)
    monkeypatch.setattr(output, "FIRST_S", 0.0)
    monkeypatch.setattr("sys.argv", ["rig", name, "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code in (0, None)
    assert f"rig {name}" in printed.out
    assert printed.err == ""
    assert activities._printer is None


# --- estimates ---


class Clock:
    """Seconds, set by hand."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


PIECES = {  # finished pieces of 12 and when, and the time left at the last of them, in words
    "none": ([], ""),
    "two: the first may include what is done once": ([(1, 100.0), (2, 102.0)], ""),
    "three, of which the first built a model": ([(1, 100.0), (2, 102.0), (3, 104.0)], ", about 18 s left"),  # 9 × 2 s
    "several at once": ([(4, 8.0), (8, 16.0)], ", about 8 s left"),
    "the last": ([(6, 6.0), (12, 12.0)], ""),
}


@pytest.mark.parametrize("name", PIECES)
def test_the_time_left_is_that_of_the_pieces_of_this_time(name: str) -> None:
    clock = Clock()
    activity = Activity("cases", 12, clock)
    assert activity.title == "12 cases"
    pieces, left = PIECES[name]
    for done, at_s in pieces:
        clock.now_s = at_s
        activity.at(done, 12)
    assert activity.line.partition(" so far")[2] == left


def test_other_pieces_have_a_rate_of_their_own() -> None:
    """The presses of a run's places say nothing about the pieces of its spikes that follow."""
    clock = Clock()
    activity = Activity("spikes", now=clock)
    for done in range(5):
        activity.at(done, 5)
        clock.now_s += 30.0
    activity.at(0, 100)
    assert activity.line == "spikes, 2 min 30 s so far"
    for done in range(1, 5):
        clock.now_s += 1.0
        activity.at(done, 100)
    assert activity.line == "spikes, 2 min 34 s so far, about 1 min 36 s left"


def test_a_build_in_between_does_not_forget_the_pieces() -> None:
    clock = Clock()
    activity = Activity("cases", 12, clock)
    for done in range(1, 5):
        clock.now_s += 2.0
        activity.builds("building a mesh")
        assert activity.line.endswith(" so far")
        activity.at(done, 12)
    assert activity.line == "4 of 12 cases, 8 s so far, about 16 s left"


# --- silence ---


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """Standard error."""
    written = io.StringIO()
    monkeypatch.setattr(output, "err", Console(file=written, width=200))
    return written


@pytest.fixture
def after(pipe: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> Callable[[float], list[str]]:
    """Return what is printed once so many seconds have passed."""
    activities = output._Activities()
    monkeypatch.setattr(output, "_activities", activities)
    monkeypatch.setattr("rig.cli.progress.during", activities.during)
    monkeypatch.setattr(activities, "_printer", object())  # none: steps are by hand
    monkeypatch.setattr(output, "EVERY_S", 2.0)
    monkeypatch.setattr(output, "FIRST_S", 0.5)
    clock = Clock()
    clock.now_s = 100.0
    monkeypatch.setattr(output.time, "monotonic", clock)

    def lines(seconds: float) -> list[str]:
        clock.now_s += seconds
        pipe.seek(0)
        pipe.truncate()
        activities.look()
        return pipe.getvalue().splitlines()

    return lines


def test_silence_is_broken_by_what_is_in_progress(after: Callable[[float], list[str]]) -> None:
    """By the innermost activity, and by none while a person acts."""
    with starting("rig check"):
        assert after(0.4) == []
        assert after(0.2) == ["rig check: starting …"]
    with working():
        with busy("the finger"):
            assert after(1.9) == []
        assert after(0.2) == ["rig check: working …, 2 s so far"]
        with resting():
            assert after(100.0) == []
        with busy("steps", quick=True):
            assert after(1.9) == []
            assert after(0.2) == ["steps, 2 s so far"]
    assert after(100.0) == []


def test_a_line_is_printed_only_if_something_has_changed(after: Callable[[float], list[str]]) -> None:
    """The time so far alone is no change; a build within the work is one, and so is its end."""
    output.show_builds()
    builder = logging.getLogger("sim.models.condensed")
    with busy("fingers", total=2) as now:
        assert after(100.0) == []
        now.at(1, 2)
        assert after(0.1) == ["1 of 2 fingers, 1 min 40 s so far"]
        now.at(1, 2)
        assert after(100.0) == []
        builder.debug("building a mesh")
        assert after(0.1) == ["building a mesh, 3 min 20 s so far"]
        builder.info("building %d unknowns …", 1000)
        assert after(2.1) == ["building 1000 unknowns …, 3 min 22 s so far"]
        assert after(100.0) == []
        builder.debug("made", extra={"made": True})
        assert after(0.1) == ["1 of 2 fingers, 5 min 2 s so far"]
        assert after(100.0) == []
        output.say_now("the last one")
        assert after(100.0) == []


def test_a_build_ends_when_the_work_goes_on(after: Callable[[float], list[str]]) -> None:
    """Whether or not the build reports its end."""
    output.show_builds()
    with busy("places") as now:
        logging.getLogger("sim.models.condensed").info("building %d unknowns …", 1000)
        assert after(2.1) == ["building 1000 unknowns …, 2 s so far"]
        now.at(1, 3)
        assert after(2.1) == ["places, 4 s so far"]


def test_a_run_prints_its_step_once(after: Callable[[float], list[str]]) -> None:
    with progress(3, None, as_json=False) as watch:
        assert after(2.1) == ["0 of 3, starting, time left unknown"]
        assert after(100.0) == []
        watch("indentation_start", {"index": 0, "indentor": "bar:3.0", "x_mm": 0.5})
        assert after(2.1) == ["0 of 3, bar:3.0 at +0.50 mm, time left unknown"]
        assert after(100.0) == []


def test_counted_pieces_are_said_before_the_first(pipe: io.StringIO) -> None:
    pieces = counted(itertools.repeat("a", 2), 2, "fingers", quiet=False)
    assert next(pieces) == "a"
    assert pipe.getvalue() == "2 fingers\n"
    assert list(pieces) == ["a"]
