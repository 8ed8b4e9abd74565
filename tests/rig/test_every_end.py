"""Every way in which a run ends before its end: where the indentor is, what to do next, how it goes on."""

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import pytest

import rig.session.session as sessions
from rig.data.journal import Journal, read_journal
from rig.devices.base import ForceReading
from rig.engine.contact import KnownContact
from rig.engine.contact_words import DOES_NOT_TOUCH, FREE_THE_FINGER, MAY_TOUCH
from rig.session import early_ending
from sim.models.fingertip import Fingertip
from tests.preloaded import Popen
from tests.program import FRAME_NEAR_HOME, Ended, Program, text_of_page
from tests.waiting import DEADLINE_S, journal_says, until

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
import sys

passes = vars(sys).setdefault(__file__, [])  # a pass begins without what an earlier one left in the script

def run(rig):
    passes.append(1)
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (-0.5, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=1.0)
        if FAILS and len(passes) > 1:  # not while it is planned
            1 / 0
"""
Bench = Any
Strike = Callable[[Bench, pytest.MonkeyPatch], object]


def _trip(bench: Bench, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(bench.force, "read", lambda: ForceReading(10.0, True, bench.clock.monotonic_s()))


def _full(fd: int, *line: object) -> int:
    raise OSError(28, "No space left on device")


def _nothing(bench: Bench, patch: pytest.MonkeyPatch) -> None:
    """It comes by itself."""


def _signal(name: str) -> Strike:
    return lambda bench, patch: signal.raise_signal(getattr(signal, name))


def _hang_up(bench: Bench, patch: pytest.MonkeyPatch) -> None:
    """The program then writes to nothing; this process gets its own standard streams back."""
    kept = [os.dup(stream) for stream in (0, 1, 2)]
    signal.raise_signal(signal.SIGHUP)
    for stream, was in enumerate(kept):
        os.dup2(was, stream)
        os.close(was)


@dataclass(frozen=True)
class End:
    """A way to end: what strikes in the press, and what is said then."""

    code: int
    says: str  # the line on standard error
    left: str
    may_touch: bool
    next: str
    strike: Strike = _nothing
    limits: Mapping[str, Any] | None = None
    fails: bool = False
    again: bool = True  # taken up, it comes to its end


FREE, WELL = FREE_THE_FINGER, "check that the finger is unharmed"
LOOK = KnownContact("disagreement").to_do or ""  # the sensor goes on reading 10 N
ENDS = {
    "a trip that lifts": End(1, "exceeds the hard trip", "raised", True, LOOK, _trip),
    "a trip that stops": End(1, "exceeds the hard trip", "held", True, FREE, _trip, {"on_trip": "stop"}, again=False),
    "the stage fails": End(
        1, "stage is closed", "held", True, FREE,
        lambda bench, patch: bench.stage._transport.close(),
    ),
    "the sensor fails": End(
        1, "no force reading: port force is closed", "raised", True, KnownContact("raised").to_do or "",
        lambda bench, patch: bench.force._transport.close(),
    ),
    "the journal cannot be written": End(
        1, "events.jsonl: cannot be written: No space left on device, ", "lifted", False,
        "free disk space, then resume",
        lambda bench, patch: [patch.setattr(f"os.{call}", _full) for call in ("write", "fsync")],
    ),
    "Ctrl-C": End(130, "stopped by the operator at a safe point", "lifted", False, WELL, _signal("SIGINT")),
    "SIGHUP": End(130, "stopped by the operator at a safe point", "lifted", False, WELL, _hang_up),
    "rig stop, or Ctrl-C twice": End(130, "stopped at once by the operator", "held", True, FREE, _signal("SIGUSR1")),
    "a limit": End(
        1, "the finger has been touched for", "lifted", False, "change the protocol or the limit",
        limits={"max_contact_s": 2.5}, again=False,
    ),
    "the script fails": End(
        1, "ZeroDivisionError", "lifted", False, "correct the protocol, then start a new run", fails=True, again=False
    ),
}  # fmt: skip


@pytest.fixture
def rig(finger: Fingertip, program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Ended]:
    """Run the program in this process, in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    return program


@pytest.fixture(autouse=True)
def _not_under_nohup() -> Iterator[None]:
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def striking() -> Iterator[Callable[[Strike], pytest.MonkeyPatch]]:
    """Have something strike once, at the first reading of a press; undone by hand or at the end."""
    patch = pytest.MonkeyPatch()

    def make(strike: Strike) -> pytest.MonkeyPatch:
        benches: list[Bench] = []
        make_bench, event = sessions.virtual_bench, Journal.event

        def kept(*arguments: Any) -> Bench:
            benches.append(make_bench(*arguments))
            return benches[0]

        def struck(journal: Journal, stream: str, data: Mapping[str, Any]) -> None:
            event(journal, stream, data)
            if benches and stream == "sample" and data["phase"] == "press":
                strike(benches.pop(), patch)

        patch.setattr(sessions, "virtual_bench", kept)
        patch.setattr(Journal, "event", struck)
        return patch

    yield make
    patch.undo()


def _written(folder: Path, end: End) -> list[str]:
    (folder / "mine.py").write_text(SCRIPT.replace("FAILS", str(end.fails)), encoding="utf-8")
    tables = "".join(f"{name} = {json.dumps(value)}\n" for name, value in (end.limits or {}).items())
    (folder / "rig.toml").write_text(f"{FRAME_NEAR_HOME}[limits]\n{tables}", encoding="utf-8")
    return ["dry-run", "mine.py", "--config", "rig.toml"]


@pytest.mark.parametrize(("name", "as_json"), [*((name, True) for name in ENDS), ("the stage fails", False)])
def test_every_early_ending_tells_position_and_resume_command(
    rig: Callable[..., Ended],
    striking: Callable[[Strike], pytest.MonkeyPatch],
    tmp_path: Path,
    name: str,
    as_json: bool,
) -> None:
    end = ENDS[name]
    command = _written(tmp_path, end)
    patch = striking(end.strike)
    free_mb = count(1000)
    patch.setattr(early_ending, "free_space", lambda folder: f"{next(free_mb)} MB free")
    ended = rig(*command, *(["--json"] if as_json else []))
    patch.undo()
    assert ended.code == end.code, ended.err
    (line,) = [line for line in ended.err.splitlines() if line.startswith("rig: ")]
    assert end.says in line
    (folder,) = (tmp_path / "runs").iterdir()
    resume = f"rig resume {shlex.quote(str(folder))}"
    if as_json:
        said = json.loads(ended.out)["ending"]
        assert said["reason_text"] in line
        assert (said["indentor"]["left"], said["indentor"]["may_touch"]) == (end.left, end.may_touch)
        assert said["indentor"]["trusted"] is (end.left != "held")
        assert said["indentor"]["x_mm"] == pytest.approx(-0.5, abs=0.01)
        lifted = said["indentor"]["height_mm"] > 1.9
        assert lifted is (end.left != "held")
        assert said["next_text"].startswith(end.next)
        assert said["resume"] == resume
        words = said["where_text"]
    else:
        lines = dict(line.split(maxsplit=1) for line in ended.out.splitlines()[-3:])
        words = lines["where"]
        assert lines["next"].startswith(end.next)
        assert lines["resume"] == resume
    assert words.startswith(f"{end.left}, at x = -0.50 mm, ")
    assert (MAY_TOUCH if end.may_touch else DOES_NOT_TOUCH) in words
    if (folder / "report.html").exists():
        report = text_of_page((folder / "report.html").read_text(encoding="utf-8"))
        assert words in report
        assert resume in report
        last = list(read_journal(folder / "events.jsonl"))[-1]
        assert last["indentor"]["left"] == end.left
    else:
        assert name == "the journal cannot be written"
    if not as_json:
        return
    again = rig(*shlex.split(resume)[1:], "--json")
    complete = json.loads(again.out).get("complete", False)  # a script that fails is refused before it moves
    assert (complete, again.code) == ((True, 0) if end.again else (again.code == 0, again.code))


def test_the_command_after_a_killed_run_warns_that_the_indentor_may_touch(
    rig: Callable[..., Ended], finger: Fingertip, tmp_path: Path
) -> None:
    """kill -9 in a press: where it was last known, and that it may be on the finger, which moves."""
    command = [sys.executable, "-c", "from rig.cli import main; main()", *_written(tmp_path, ENDS["Ctrl-C"])]
    script = tmp_path / "mine.py"
    script.write_text(script.read_text(encoding="utf-8").replace("hold_s=1.0", "hold_s=10.0"), encoding="utf-8")
    process = Popen([*command, "--speed", "40"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        until(journal_says(tmp_path / "runs", '"press"'))
        process.kill()
        process.communicate(timeout=DEADLINE_S)
    finally:
        process.kill()
        process.wait()
    (folder,) = (tmp_path / "runs").iterdir()
    again = rig("resume", str(folder))
    assert again.code == 0
    assert "the run has no end record" in again.err
    assert "last known" in again.err
    assert MAY_TOUCH in again.err


# --- a second Ctrl-C while it homes ---

LOOK_S = 0.05
DRIVES = "[stage]\nkind = 'leadshine'\n"


class CtrlC:
    """So many SIGINTs at once, when the carriage has moved for so long; sees whether it did."""

    def __init__(self, bench: Bench, into_s: float, times: int) -> None:
        self.bench, self.into_s, self.moved_s, self.struck = bench, into_s, -LOOK_S, False
        self.times = times
        self.at = self.pose()
        self._again()

    def pose(self) -> tuple[float, float]:
        """Where the carriage truly is, whatever is mounted on it."""
        true = self.bench.plant.pose_at(self.bench.clock.monotonic_s())
        return true.x_mm, true.height_mm

    def _again(self) -> None:
        self.bench.clock.call_at(self.bench.clock.monotonic_s() + LOOK_S, self._look)

    def _look(self) -> None:
        before, self.at = self.at, self.pose()
        self.moved_s += LOOK_S * (before != self.at)
        if self.moved_s < self.into_s:
            self._again()
            return
        self.struck = True
        for _ in range(self.times):
            signal.raise_signal(signal.SIGINT)


def _struck_while_homing(
    rig: Callable[..., Ended], patch: pytest.MonkeyPatch, command: list[str], into_s: float, times: int
) -> tuple[CtrlC, Ended]:
    make_bench, struck = sessions.virtual_bench, []

    def struck_bench(*arguments: Any) -> Bench:
        bench = make_bench(*arguments)
        struck.append(CtrlC(bench, into_s, times))
        return bench

    patch.setattr(sessions, "virtual_bench", struck_bench)
    ended = rig(*command, "--json")
    (it,) = struck
    return it, ended


def test_one_ctrl_c_during_homing_ends_the_run_lifted(
    rig: Callable[..., Ended], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    it, ended = _struck_while_homing(rig, monkeypatch, _written(tmp_path, ENDS["Ctrl-C"]), 1.0, times=1)
    assert it.struck
    assert ended.code == 130
    said = json.loads(ended.out)["ending"]
    assert (said["indentor"]["left"], said["indentor"]["may_touch"]) == ("lifted", False)
    assert said["indentor"]["height_mm"] > 1.9


@pytest.mark.parametrize(
    ("kind", "into_s", "resumed"),
    [
        ("grbl", 0.0, False),
        ("grbl", 3.0, False),
        ("grbl", 1.0, True),
        ("leadshine", 1.0, False),
        ("leadshine", 6.0, False),
        ("leadshine", 3.0, True),
    ],
)
def test_a_second_ctrl_c_during_homing_leaves_nothing_moving(
    rig: Callable[..., Ended],
    striking: Callable[[Strike], pytest.MonkeyPatch],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    kind: str,
    into_s: float,
    resumed: bool,
) -> None:
    command = _written(tmp_path, ENDS["Ctrl-C"])
    if kind == "leadshine":
        (tmp_path / "rig.toml").write_text(FRAME_NEAR_HOME + DRIVES, encoding="utf-8")
    if resumed:
        patch = striking(_signal("SIGINT"))
        assert rig(*command).code == 130
        patch.undo()
        command = ["resume", str(next((tmp_path / "runs").iterdir()))]
    it, ended = _struck_while_homing(rig, monkeypatch, command, into_s, times=2)
    assert it.struck
    assert ended.code == 130
    said = json.loads(ended.out)["ending"]
    assert said["reason_text"] == "stopped at once by the operator"
    assert (said["indentor"]["left"], said["indentor"]["trusted"]) == ("held", False)
    assert said["next_text"].startswith(FREE)
    it.bench.clock.wait_s(0.01)  # the bytes that stop it are on their way
    at = it.pose()
    it.bench.clock.wait_s(10.0)
    assert it.pose() == at
    (folder,) = (tmp_path / "runs").iterdir()
    told = list(read_journal(folder / "events.jsonl"))
    assert (told[-1]["doc"], told[-1]["status"]) == ("stop", "aborted")
    assert [d["stream"] for d in told if d["doc"] == "event"][-1] == ("paused" if resumed else "mount")
