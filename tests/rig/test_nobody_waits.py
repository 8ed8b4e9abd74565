"""Every command says what it does before it does it, tells how long such work took before, and breaks its silence.

A command that only a program starts, and help, say nothing of it.

Work is replaced by a function that looks at standard error when it is first called; no test waits or asserts seconds.
"""

import importlib
import io
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, NoReturn

import pytest
from rich.console import Console

from rig.cli import main, output
from rig.cli.output import Activity, busy, resting, starting, working
from rig.cli.program import COMMANDS
from rig.control.owned_stage import OwnedStage
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
    "panel": Walked("--no-browser", "rig.panel.app.Panel", own=False),
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
    "zero": Walked("--config rig.toml", "rig.cli.bench.open_bench"),
    "status": Walked("--config rig.toml", "rig.cli.bench.look_and_contact"),
    "stop": Walked("--config rig.toml", "rig.cli.stop.OutsideStop", own=False),
    "pulse": Walked("--config rig.toml", "rig.cli.pulse._opened"),
    "jog": Walked("--config rig.toml --axis x --by-mm 1", "rig.cli.jog.manual_session"),
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
    ports += "[sync]\noutput = 'coolant'\n"
    (tmp_path / "rig.toml").write_text(ports, encoding="utf-8")
    shutil.copytree(OLD_RUNS / "complete", tmp_path / "run")
    monkeypatch.setattr(OwnedStage, "open", lambda stage: stage)
    monkeypatch.setattr(output, "FIRST_S", 0.0)
    return tmp_path


def test_the_progress_tests_cover_every_command() -> None:
    assert WALK.keys() == COMMANDS.keys()


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("name", WALK)
def test_every_command_announces_its_work_on_stderr_before_it_begins(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
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
    monkeypatch.setattr("sys.argv", ["rig", name, *words.split()])
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
def test_the_time_left_follows_from_the_pieces_done_so_far(name: str) -> None:
    clock = Clock()
    activity = Activity("cases", 12, clock)
    assert activity.title == "12 cases"
    pieces, left = PIECES[name]
    for done, at_s in pieces:
        clock.now_s = at_s
        activity.at(done, 12)
    assert activity.line.partition(" so far")[2] == left


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


def test_a_long_silence_prints_the_activity_in_progress(after: Callable[[float], list[str]]) -> None:
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
