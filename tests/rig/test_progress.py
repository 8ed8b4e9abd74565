"""What every command that takes its time says meanwhile: at once, line by line in a pipe, nothing beside JSON."""

import re
import sys
from collections.abc import Callable, Iterator
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import rig.cli.output as output
import rig.cli.progress as shown
import rig.cli.study as study_command
import rig.session.session as sessions
from rig.bench.virtual import VirtualBench, virtual_bench
from rig.cli import main
from rig.cli.progress import counted, progress
from rig.cli.script_execution import time_left
from rig.control.owned_stage import OwnedStage
from rig.data.run_state import Course, TimeLeft
from rig.data.run_status import RunStatus, reason_of
from rig.engine import TripError
from rig.plan.config import Config
from rig.session.rehearsal_summary import Page
from rig.session.rehearse import Rehearsed
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip
from tests.sim.coarse_mesh import as_toml, coarse_mesh

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
from rig.protocol import ScheduledParameters

class Parameters(ScheduledParameters):
    pass

def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    for block in rig.parameters.schedule((-0.5, 0.5)).on(rig):
        for x_mm in block:
            rig.move_to(x_mm=x_mm)
            rig.indent(doi_mm=0.2, hold_s=0.1)
"""
STUDY = """\
[finger.tissue]
epidermis_mm = [0.3, 0.5]

[[press]]
shape = "bar:3.0"
doi_mm = [0.1, 0.15, 0.2, 0.25, 0.3, 0.35]
"""
COARSE = as_toml(coarse_mesh(0.3, 0.3, patch_x_mm=2.0, patch_z_mm=2.0, round_patch_mm=2.0))
FINGER = output.THE_FINGER
LINE = re.compile(
    r"\d of 2, block 1, condition -?0\.5, bar:3\.0 at [+-]0\.50 mm, peak \d+\.\d\d gwt, "
    r"(force \d+\.\d\d gwt|DOI \d+\.\d{3} mm), predicted \d+\.\d+ (gwt|mm), \d:\d\d:\d\d left"
)


class Said:
    """What was printed until something slow began, and in all."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys
        self.before: str | None = None
        self.out = self.err = ""

    def slow(self) -> None:
        if self.before is None:
            self.take()
            self.before = self.err

    def take(self) -> None:
        printed = self._capsys.readouterr()
        self.out, self.err = self.out + printed.out, self.err + printed.err


@pytest.fixture
def rig(
    finger: Fingertip, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., Said]:
    """Run a command in a pipe; the ports of a real run lead to virtual devices."""
    monkeypatch.chdir(tmp_path)
    for name, text in {"mine.py": SCRIPT, "study.toml": STUDY, "stage": "", "force": ""}.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    ports = f"[stage]\nport = '{tmp_path / 'stage'}'\n[force]\nport = '{tmp_path / 'force'}'\n"
    (tmp_path / "rig.toml").write_text(ports, encoding="utf-8")

    def open_bench(config: Config, clock: Any, log: Any, ask: Any, pause: Any, stage: Any) -> VirtualBench:
        return virtual_bench(config, finger, log, VirtualClock(0.0, clock.monotonic_s()), pause)

    monkeypatch.setattr(sessions, "open_bench", open_bench)
    monkeypatch.setattr(OwnedStage, "open", lambda stage: stage)
    said: list[Said] = []
    load = Fingertip.load

    def loaded(*arguments: Any, **options: Any) -> Fingertip:
        said[-1].slow()
        return load(*arguments, **options)

    def spread(solve: object, cases: list[object], *_: object) -> Iterator[list[dict[str, str]]]:
        for _ in cases:
            said[-1].slow()
            yield [{"problem": ""}]

    monkeypatch.setattr(Fingertip, "load", loaded)
    monkeypatch.setattr(study_command, "spread", spread)

    def run(*arguments: str) -> Said:
        said.append(Said(capsys))
        monkeypatch.setattr(sys, "argv", ["rig", *arguments])
        with pytest.raises(SystemExit) as caught:
            main()
        said[-1].take()
        assert not caught.value.code, said[-1].err
        return said[-1]

    return run


def _run(rig: Callable[..., Said], *options: str) -> str:
    rig("dry-run", "mine.py", *options, "--json")
    (folder,) = Path("runs").iterdir()
    return str(folder)


def _coarse_run(rig: Callable[..., Said]) -> str:
    """Of a finger that is factorised in no time, for the strain in its receptor plane."""
    Path("coarse.toml").write_text(COARSE, encoding="utf-8")
    return _run(rig, "--config", "coarse.toml")


def _stopped(rig: Callable[..., Said]) -> str:
    """As a kill after the first of the two indentations leaves it."""
    folder = _run(rig)
    journal = Path(folder) / "events.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    ended = next(n for n, line in enumerate(lines) if '"stream": "indentation_end", "data"' in line)
    journal.write_text("".join(lines[: ended + 1]), encoding="utf-8")
    return folder


COMMANDS: dict[str, tuple[tuple[str, ...], int]] = {
    "dry-run": (("dry-run", "mine.py"), 2),
    "run": (("run", "mine.py", "--config", "rig.toml", "--yes"), 2),
    "resume": (("resume",), 1),
    "check": (("check", "mine.py"), 0),
    "compare": (("compare", "--out", "c.html"), 0),
    "study": (("study", "study.toml"), 0),
}
NEEDS: dict[str, Callable[[Callable[..., Said]], str]] = {"resume": _stopped, "compare": _coarse_run}


@pytest.fixture
def told(rig: Callable[..., Said], made_once: Callable[..., Path]) -> Callable[..., Said]:
    """What a command says, of a run where it needs one."""

    def of(name: str, *options: str) -> Said:
        (verb, *arguments), _ = COMMANDS[name]
        run = [str(made_once(name, lambda: NEEDS[name](rig)))] if name in NEEDS else []
        return rig(verb, *run, *arguments, *options)

    return of


@pytest.mark.quick(rows=lambda name: name in ("run", "resume", "study"))
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_in_a_pipe_reports_progress_at_once_and_line_by_line(told: Callable[..., Said], name: str) -> None:
    said, indentations = told(name), COMMANDS[name][1]
    assert said.before, "nothing was said before something slow began"
    assert "\r" not in said.out + said.err
    assert "\x1b" not in said.out + said.err
    lines = [line for line in said.err.splitlines() if " gwt, " in line and " of " in line]
    assert len(lines) == indentations
    if indentations:
        total = re.sub("of 2", f"of {indentations}", LINE.pattern)
        assert all(re.fullmatch(total, line) for line in lines)
        counts = [line.split(" of ")[0] for line in lines]
        assert counts == [str(n) for n in range(1, indentations + 1)]
        before = said.err.splitlines()[said.err.splitlines().index(lines[0]) - 1]
        assert re.fullmatch(rf"{indentations} indentations?, \d:\d\d:\d\d left", before)


@pytest.mark.quick(rows=lambda name: name in ("dry-run", "study"))
@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "run"])
def test_a_command_with_json_reports_no_progress(told: Callable[..., Said], name: str) -> None:
    """`rig run` has its page, and a run that was killed its warning."""
    said = told(name, "--json")
    assert said.out.count("\n") == 1
    others = [
        line
        for line in said.err.splitlines()
        if not line.startswith(("resuming after", f"rig: {reason_of(RunStatus.KILLED)}"))
    ]
    assert others == []


def test_a_study_reports_the_number_of_cases_and_when_all_are_done(rig: Callable[..., Said]) -> None:
    lines = rig("study", "study.toml").err.splitlines()
    assert (lines[0], lines[-1]) == ("12 cases", "12 of 12 cases")
    assert all(re.fullmatch(r"\d+ of 12 cases, \d:\d\d:\d\d left", line) for line in lines[1:-1])


# --- what is counted ---


def test_counted_work_shows_a_progress_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = StringIO()
    monkeypatch.setattr(shown, "err", Console(file=screen, force_terminal=True, width=100))
    assert list(counted(iter("ab"), 2, "fingers")) == ["a", "b"]
    assert "fingers" in screen.getvalue()
    assert "100%" in screen.getvalue()


# --- what is known of it ---

BEGUN = {"index": 0, "indentor": "bar:3.0", "x_mm": -0.5, "increments": 1}


@pytest.mark.parametrize(("pace", "left_s"), [(1.0, 300.0), (0.5, 150.0), (None, 3.0)])
def test_the_time_left_of_a_run_follows_its_rehearsal_at_the_same_pace(pace: float | None, left_s: float) -> None:
    """As fast as it can: at first as long as the rehearsal took, then by what the run has taken."""
    now = [0.0]
    page = Page(None, Rehearsed(Course(300.0, {("home", 1, 0): 100.0}, {}), 0.0, 1), 3.0)  # type: ignore[arg-type]
    left = time_left(page, pace, lambda: now[0])
    assert left is not None
    assert left.left_s == pytest.approx(left_s)
    now[0] = 20.0
    left.event("home", {})
    assert left.left_s == pytest.approx({1.0: 200.0, 0.5: 100.0, None: 40.0}[pace])


def test_a_failed_rehearsal_gives_no_time_left() -> None:
    failed = Page(None, TripError("no"), 3.0)  # type: ignore[arg-type]
    assert time_left(failed, 1.0) is None
    empty = time_left(Page(None, Rehearsed(Course(0.0, {}, {}), 0.0, 0), 3.0), None, lambda: 0.0)  # type: ignore[arg-type]
    assert empty is not None
    assert empty.left_s == 0.0


def test_a_run_on_a_terminal_shows_elapsed_and_remaining_time_and_alarms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    screen = StringIO()
    console = Console(file=screen, force_terminal=True, width=200)
    monkeypatch.setattr(shown, "err", console)
    left = TimeLeft({("home", 1, 0): 10.0}, 3700.0, lambda: 0.0, pace=1.0)
    with progress(2, left) as watch:
        watch("home", {})
        watch("indentation_start", BEGUN)
        watch("hold_end", {"index": 0, "hold": BEGUN["increments"]})
        watch("indentation_end", {"index": 0})
        watch("alarm", {"reason": "the zero\nhas drifted"})
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())
    assert "starting" in drawn
    assert "1:01:40 left" in drawn
    assert re.search(r"bar:3\.0 at -0\.50 mm .* 1/2 0:00:00 1:01:30 left", drawn)
    assert "rig: alarm: the zero has drifted\n" in drawn
