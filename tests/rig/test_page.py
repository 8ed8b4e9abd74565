"""The page that a real run begins with: what it says, the one answer to it, and what it knows of the last run."""

import errno
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import rig.cli.confirm as confirming
import rig.cli.run as running
import rig.cli.script_execution as carrying_out
import rig.cli.script_execution as run_owner
import rig.session.session as sessions
from rig.bench.real import Request
from rig.bench.virtual import VirtualBench, virtual_bench
from rig.control.owned_stage import OwnedStage
from rig.devices.base import ForceTimeout
from rig.devices.mtsics import MtSicsForce
from rig.engine.contact_words import MAY_TOUCH
from rig.session.early_ending import FinalPosition
from rig.transport import TransportError
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from tests.program import FRAME_NEAR_HOME, Ended, Program

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
METADATA = {"title": "Two presses"}

def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=-0.5)
    rig.precondition(presses=1, doi_mm=0.2, hold_s=0.1)
    for x_mm in (-0.5, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=0.1)
"""
Run = Callable[..., Ended]
MadeOnce = Callable[[str, Callable[[], object]], Path]


@pytest.fixture
def opened(finger: Fingertip, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The ports of a real run lead to virtual devices; each time that they are opened is noted."""
    found: list[Any] = []

    def open_bench(config: Any, clock: Any, log: Any, ask: Any, pause: Any, stage: Any) -> VirtualBench:
        found.append(config.stage.port)
        return virtual_bench(config, finger, log, VirtualClock(0.0, clock.run_s()), pause)

    monkeypatch.setattr(sessions, "open_bench", open_bench)
    monkeypatch.setattr(OwnedStage, "open", lambda stage: stage)
    return found


@pytest.fixture
def rig(opened: list[Any], program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    """Run the program in a folder with a script and a configuration; typed=None: there is no terminal."""
    monkeypatch.chdir(tmp_path)
    for name in ("stage", "force"):
        (tmp_path / name).touch()
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    ports = f"[stage]\nport = '{tmp_path / 'stage'}'\n[force]\nport = '{tmp_path / 'force'}'\n"
    (tmp_path / "rig.toml").write_text(FRAME_NEAR_HOME + ports, encoding="utf-8")

    def run(*arguments: str, typed: str | None = None) -> Ended:
        monkeypatch.setattr(confirming, "_is_interactive", lambda: typed is not None)
        return program(*arguments, typed=typed or "")

    return run


RUN = ("run", "mine.py", "--config", "rig.toml")


def _page(ended: Ended) -> dict[str, str]:
    return dict(line.split(maxsplit=1) for line in ended.err.splitlines() if re.match(r"[a-z]+ {2,}\S", line))


def test_the_start_page_of_a_run_states_steps_forces_trips_and_speed(
    rig: Run, opened: list[Any], finger: Fingertip
) -> None:
    ended = rig(*RUN, "--subject", "S07", "--yes", "--json")
    assert ended.code == 0, ended.err
    page = _page(ended)
    assert page["subject"] == "S07"
    assert page["steps"] == "2 indentations, 1 preconditioning press"
    said_s = float(page["duration"].split()[1])
    assert said_s == pytest.approx(json.loads(ended.out)["duration_s"], rel=0.05)
    peak = max(finger.indent("bar:3.0", x, doi_mm=0.2).force_gwt for x in (-0.5, 0.5))
    peak_said, left_said = (float(text) for text in re.findall(r"\(([\d.]+) gwt\)", page["force"]))
    assert peak_said == pytest.approx(peak, rel=1e-3)
    soft, hard = (float(text) for text in re.findall(r"\(([\d.]+) gwt\)", page["trips"]))
    assert (soft, hard) == (pytest.approx(2 * peak, rel=1e-3), pytest.approx(5.0 / GWT_N, rel=1e-3))
    assert left_said == pytest.approx(soft - peak_said, rel=1e-3)
    assert [float(text) for text in re.findall(r"([\d.]+) N", page["trips"])][1] == 5.0
    speed_mm_s, age_s, rise_gwt = (float(text) for text in re.findall(r"([\d.]+) (?:mm/s|s old|gwt)", page["speed"]))
    assert (speed_mm_s, age_s) == (0.5, 0.05)
    assert 0 < rise_gwt < peak
    assert "bar:3.0" in page["first"]
    assert len(opened) == 1


@pytest.mark.parametrize("command", ["run", "resume"])
def test_run_and_resume_without_a_terminal_open_no_port_unless_confirmed_by_yes(
    rig: Run, opened: list[Any], command: str, tmp_path: Path, made_once: MadeOnce
) -> None:
    arguments: tuple[str, ...] = RUN
    if command == "resume":
        arguments = ("resume", str(_killed(rig, made_once)))
    opened.clear()
    ended = rig(*arguments)
    assert ended.code == 2
    assert ended.err.splitlines()[-1].startswith(f"rig: {command}: ")
    assert "--yes" in ended.err.splitlines()[-1]
    assert (opened, ended.out) == ([], "")
    assert len(list((tmp_path / "runs").iterdir())) == (0 if command == "run" else 1)


@pytest.mark.parametrize(("typed", "code"), [("\n", 0), ("n\n", 130), ("", 130)])
def test_the_start_page_of_a_run_is_confirmed_once(
    rig: Run, opened: list[Any], tmp_path: Path, typed: str, code: int
) -> None:
    ended = rig(*RUN, typed=typed)
    assert ended.code == code, ended.err
    assert ended.err.count("press Enter to start, Ctrl-C to cancel") == 1
    assert len(opened) == (1 if code == 0 else 0)
    assert len(list((tmp_path / "runs").iterdir())) == len(opened)
    assert ("not confirmed; nothing has moved" in ended.err) is (code != 0)


@pytest.mark.parametrize(("typed", "done"), [("\n", ["planned", "reported"]), ("n\n", ["planned"]), (None, None)])
@pytest.mark.parametrize("command", ["run", "resume"])
def test_the_stage_port_stays_open_from_before_planning_until_after_the_report(
    rig: Run,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    typed: str | None,
    done: list[str] | None,
    made_once: MadeOnce,
) -> None:
    """A stop is one write all that time; where nobody can be asked nothing is opened at all."""
    arguments = RUN if command == "run" else ("resume", str(_killed(rig, made_once)))
    found: list[str] = []

    def noted(name: str, act: Callable[..., Any]) -> Callable[..., Any]:
        def did(*words: Any, **more: Any) -> Any:
            found.append(name)
            return act(*words, **more)

        return did

    monkeypatch.setattr(OwnedStage, "open", noted("opened", lambda stage: stage))
    monkeypatch.setattr(OwnedStage, "close", noted("closed", lambda stage: None))
    for name, word in (("make_plan", "planned"), ("make_report", "reported")):
        monkeypatch.setattr(carrying_out, name, noted(word, getattr(carrying_out, name)))
    monkeypatch.setattr(run_owner, "ControlSocket", noted("announced", run_owner.ControlSocket))
    rig(*arguments, typed=typed)
    if done is None:
        assert set(found) <= {"closed"}
        return
    assert found == ["opened", "announced", *done, "closed"]


@pytest.mark.parametrize(
    ("mounted", "code"),
    [((), "mount_by_hand"), (("--mounted", "bar:2"), "mount_by_hand"), (("--mounted", "bar:3"), None)],
)
def test_a_run_that_needs_a_manual_mount_is_refused_when_nobody_can_answer(
    rig: Run, opened: list[Any], monkeypatch: pytest.MonkeyPatch, mounted: tuple[str, ...], code: str | None
) -> None:
    monkeypatch.setattr(confirming, "_text_waits", lambda: False)
    ended = rig(*RUN, "--yes", "--json", *mounted)
    assert (ended.code, bool(opened)) == ((0, True) if code is None else (2, False)), ended.err
    assert ended.json.get("code") == code


def test_a_sensor_that_does_not_answer_ends_the_run_before_anybody_mounts(
    rig: Run, opened: list[Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As with swapped ports: no prompt, no folder, no motion."""

    def silent(force: MtSicsForce) -> str:
        raise ForceTimeout("silent", "no_device")

    monkeypatch.setattr(MtSicsForce, "identify", silent)
    ended = rig(*RUN, "--json", typed="\n\n\n")
    assert (ended.code, ended.json["code"], bool(opened)) == (1, "no_device", True)
    assert ended.json["ending"]["where_text"]
    assert list((tmp_path / "runs").iterdir()) == []


@pytest.mark.parametrize(
    ("request_", "asked"),
    [
        (Request("any words", indentor="bar:3"), False),
        (Request("any words", indentor="bar:2"), True),
        (Request("mount bar:3.0"), True),  # the words alone ask for no indentor
    ],
)
def test_a_mounting_request_is_skipped_only_for_the_indentor_in_its_field(
    request_: Request, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "ask_at_the_bench", lambda request, asking: "typed")
    ask = running.prompt_for(SimpleNamespace(asking=None), "bar:3.0")  # type: ignore[arg-type]
    assert ask(request_) == ("typed" if asked else "")


def _carried_out(rig: Run) -> None:
    assert rig(*RUN, "--yes").code == 0


def _killed(rig: Run, made_once: MadeOnce) -> Path:
    """A real run as a kill in its second press leaves it."""
    run = made_once("whole", lambda: _carried_out(rig))
    lines = (run / "events.jsonl").read_bytes().splitlines(keepends=True)
    documents = [json.loads(line) for line in lines]
    readings = {n: d["data"] for n, d in enumerate(documents) if d["doc"] == "event" and d["stream"] == "sample"}
    last = max(n for n, data in readings.items() if data["phase"] == "press")
    (run / "events.jsonl").write_bytes(b"".join(lines[: last + 1]))
    return run


def test_every_command_after_a_killed_run_names_its_resume_command(
    rig: Run, opened: list[Any], tmp_path: Path
) -> None:
    """Until the run is taken up and has come to its end, doctor, run and resume say where the indentor was."""
    run = _killed(rig, lambda kind, make: (make(), *(tmp_path / "runs").iterdir())[1])
    line = f"rig resume {run}"
    doctor = json.loads(rig("doctor", "--config", "rig.toml", "--json").out)["last_run_text"]
    again = rig(*RUN, typed="n\n")
    resumed = rig("resume", str(run), typed="\n")
    for words in (doctor, _page(again)["careful"], _page(resumed)["careful"]):
        assert words.startswith("the run has no end record")
        assert re.search(
            r"held, at x = 0.50 mm, \d\.\d\d mm below the nominal apex \(last known and not trusted\)", words
        )
        assert MAY_TOUCH in words
        assert line in words
    assert resumed.code == 0, resumed.err
    assert _page(resumed)["steps"] == "1 indentation, 1 preconditioning press, the rest of 2 planned indentations"
    assert resumed.err.count("press Enter") == 1
    assert "careful" not in _page(rig(*RUN, typed="n\n"))
    assert "no run on record" in rig("doctor", "--config", "rig.toml").out


# --- what ends before it begins ---


def _raising(error: BaseException) -> Callable[..., Any]:
    def act(*_: Any, **__: Any) -> Any:
        raise error

    return act


def _no_port(folder: Path, patch: pytest.MonkeyPatch) -> None:
    (folder / "stage").unlink()


def _same_port(folder: Path, patch: pytest.MonkeyPatch) -> None:
    (folder / "rig.toml").write_text("[stage]\nport = 'one'\n[force]\nport = 'one'\n", encoding="utf-8")


def _bad_script(folder: Path, patch: pytest.MonkeyPatch) -> None:
    (folder / "mine.py").write_text(SCRIPT.replace("doi_mm=0.2", "doi_mm=20.0"), encoding="utf-8")


def _shut_port(folder: Path, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(sessions, "open_bench", _raising(TransportError("cannot open stage: it is busy")))


def _full_disk(folder: Path, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(os, "fsync", _raising(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))


def _ctrl_c(folder: Path, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(confirming, "_confirmed", _raising(KeyboardInterrupt()))


def _as_it_is(folder: Path, patch: pytest.MonkeyPatch) -> None:
    """What is typed refuses it."""


PUT_RIGHT, SAME = "correct the problem, then repeat the command", "repeat the command"
REFUSED: dict[str, tuple[Callable[[Path, pytest.MonkeyPatch], None], str | None, int, str]] = {
    "no port": (_no_port, "\n", 1, PUT_RIGHT),
    "stage and force on one port": (_same_port, "\n", 2, PUT_RIGHT),
    "a bad script": (_bad_script, "\n", 2, PUT_RIGHT),
    "a port that does not open": (_shut_port, "\n", 1, PUT_RIGHT),
    "a full disk": (_full_disk, "\n", 2, PUT_RIGHT),
    "nobody there": (_as_it_is, None, 2, PUT_RIGHT),
    "a no": (_as_it_is, "n\n", 130, SAME),
    "Ctrl-C at the page": (_ctrl_c, "\n", 130, SAME),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_run_that_is_refused_before_it_begins_reports_that_it_did_not_move(
    rig: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    prepare, typed, code, next_ = REFUSED[name]
    with monkeypatch.context() as patch:
        prepare(tmp_path, patch)
        ended = rig(*RUN, "--json", typed=typed)
    assert ended.code == code, ended.err
    (line,) = [line for line in ended.err.splitlines() if line.startswith("rig: ")]
    words = FinalPosition("not moved").words
    said = json.loads(ended.out)
    assert (said["error_text"], said["exit_code"]) == (line.removeprefix("rig: "), code)
    assert said["ending"]["indentor"]["left"] == "not moved"
    assert (said["ending"]["where_text"], said["ending"]["next_text"]) == (words, next_)


@pytest.mark.parametrize("command", ["resume", "dry-run"])
def test_a_refused_resume_or_dry_run_reports_that_it_did_not_move(rig: Run, tmp_path: Path, command: str) -> None:
    (tmp_path / "empty.py").touch()
    what = "empty.py" if command == "dry-run" else str(tmp_path)
    ended = rig(command, what, "--json")
    assert (ended.code, json.loads(ended.out)["ending"]["indentor"]["left"]) == (2, "not moved")
    assert ("where   not moved" in rig(command, what).err) is (command == "resume")


def test_a_run_that_fails_after_it_began_does_not_report_that_it_did_not_move(
    rig: Run, opened: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.cli.script_execution.make_report", _raising(ModelRangeError("no such force")))
    ended = rig(*RUN, "--yes", "--json")
    assert (ended.code, len(opened)) == (2, 1)
    told = json.loads(ended.out)
    assert (told["complete"], told["report"]) == (True, None)
    assert "no such force" in told["files_text"]
    assert "not moved" not in rig(*RUN, "--yes").err
