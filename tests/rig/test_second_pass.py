"""What a script does when it is carried out need not be what it did when it was checked."""

import html
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.data import read_run
from rig.data.journal import read_journal
from rig.data.planned_presses import pressed_otherwise
from rig.devices.base import StageError
from rig.engine import RunAborted, ScriptError, TripError
from rig.engine.motion import Check, Motion
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import FinishedRun, NewRun, NoAttendant, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.error_codes import has_code
from tests.program import Program

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches."""
READY = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0)"


def carried_out(
    folder: Path, finger: Fingertip, live: str, attendant: NoAttendant | None = None, **tables: object
) -> FinishedRun:
    """A script that indents once when checked and does something else when carried out."""
    path = folder / "sly.py"
    path.write_text(
        "import os, sys, threading; passes = vars(sys).setdefault(__file__, [])\n"
        f"def run(rig):\n    passes.append(1); {READY}\n"
        "    if len(passes) > 1:\n"
        f"        {live}\n"
        "    else:\n        rig.indent(doi_mm=0.2)\n",
        encoding="utf-8",
    )
    script, config = load_script(str(path)), Config.model_validate({**NEAR, **tables})
    plan = make_plan(script, config, finger)
    return dry_run(Session(script, config, finger, plan, NewRun(folder / "runs"), attendant or NoAttendant()))


@pytest.mark.parametrize(
    ("live", "complaint"),
    [
        ("rig.indent(doi_mm=0.2, speed_mm_s=1000)", "speed_mm_s = 1000: expected 0.017 … 5 mm/s"),
        ("rig.indent(doi_mm=1.9)", "beyond limits.max_doi_mm = 1.5"),
        ("rig.move_to(x_mm=50)", "x_mm = 50 mm is outside limits.x_mm"),
        ("sys.exit(0)", "SystemExit: 0"),
    ],
)
def test_every_verb_is_checked_again_while_the_run_moves(
    tmp_path: Path, finger: Fingertip, live: str, complaint: str
) -> None:
    done = carried_out(tmp_path, finger, live)
    assert isinstance(done.problem, ScriptError)
    assert complaint in str(done.problem)
    assert "sly.py, line 5" in str(done.problem)
    run = read_run(done.folder.path)
    assert run.stop is not None
    assert run.stop["status"] == "failed"
    assert run.stream("indentation_start") == []
    assert done.folder.data.exists()


def test_a_run_whose_script_swallows_a_trip_ends_as_tripped(tmp_path: Path, finger: Fingertip) -> None:
    """The finger lies 1 mm lower than the rig believes: no contact where it is expected."""
    live = "\n        ".join(["try:", "    rig.indent(doi_mm=0.2)", "except Exception:", "    pass"])
    done = carried_out(tmp_path, finger, live, virtual={"finger_z_offset_mm": -1.0})
    assert isinstance(done.problem, TripError)
    run = read_run(done.folder.path)
    assert run.stop is not None
    assert run.stop["status"] == "tripped"
    assert not done.complete


OTHERWISE = {
    "as planned": ("rig.indent(doi_mm=0.2)", None),
    "another depth": ("rig.indent(doi_mm=0.3)", "1 of 1 press is not as planned, first at index 0: value = 0.3, "),
    "another force": ("rig.indent(force_gwt=2.0)", "target = force_gwt, planned doi_mm, value = 2, planned 0.2"),
    "another place": ("rig.move_to(x_mm=0.5); rig.indent(doi_mm=0.2)", "x_mm = 0.5, planned 0;"),
    "another speed": ("rig.indent(doi_mm=0.2, speed_mm_s=0.1)", "speed_mm_s = 0.1, planned"),
    "another verb": ("rig.ramp(doi_mm=0.2, speed_mm_s=1.0)", "verb = ramp, planned indent"),
    "another indentor": (
        "rig.retract(); rig.mount('step:1'); rig.zero(); rig.move_to(x_mm=0.0); rig.indent(doi_mm=0.2)",
        "indentor = step:1, planned bar:3.0",
    ),
    "one press more": (
        "rig.indent(doi_mm=0.2); rig.indent(doi_mm=0.2)",
        "1 of 2 presses is not as planned, first at index 1: a press that was not planned",
    ),
}  # fmt: skip
"""What a script that planned one press to 0.2 mm does, and the words of the warning."""


@pytest.mark.parametrize("how", OTHERWISE)
def test_a_run_that_pressed_otherwise_than_planned_carries_a_warning(
    tmp_path: Path, finger: Fingertip, how: str
) -> None:
    """As a script that draws without a seed: its answer, its page and every reader of the run have the warning."""
    live, words = OTHERWISE[how]
    run = carried_out(tmp_path, finger, live).run
    assert len(run.stream("indentation_start")) == 1 + (how == "one press more")
    if words is None:
        assert pressed_otherwise(run) is None
        return
    (warning,) = (one for one in run.warnings if "not as planned" in one)
    assert words in warning
    assert "seed what is random" in warning


def test_dry_run_reports_presses_that_differ_from_the_plan_in_json_and_page(program: Program, tmp_path: Path) -> None:
    path = tmp_path / "sly.py"
    path.write_text(
        "import sys; passes = vars(sys).setdefault(__file__, [])\n"
        f"def run(rig):\n    passes.append(1); {READY}\n    rig.indent(doi_mm=0.2 + 0.01 * len(passes))\n",
        encoding="utf-8",
    )
    told = program("dry-run", path, "--out", tmp_path / "runs", "--json")
    assert "1 of 1 press is not as planned" in told.json["otherwise_text"]
    assert told.json["otherwise_text"] in told.err
    page = (Path(told.json["run"]) / "report.html").read_text(encoding="utf-8")
    assert "not as planned, first at index 0: value = 0." in html.unescape(page)


def lines(*these: str) -> str:
    """Of a script, inside run(rig)."""
    return "\n        ".join(these)


PRESS, GO_ON = (
    "rig.indent(doi_mm=0.2)",
    ("rig.home()", "rig.zero()", "rig.move_to(x_mm=0.0)", "rig.indent(doi_mm=0.2)"),
)
SWALLOWING = {
    "swallows": ("try:", "    HERE", "except BaseException:", "    pass"),
    "swallows and goes on": ("try:", "    HERE", "except BaseException:", "    pass", *GO_ON),
    "swallows all and goes on": (
        "at, press = (lambda: rig.move_to(x_mm=0.0)), (lambda: rig.indent(doi_mm=0.2))",
        "for verb in (lambda: HERE, rig.home, rig.zero, at, press):",
        "    try:", "        verb()", "    except BaseException:", "        pass",
    ),
    "lifts in any case": ("try:", "    HERE", "finally:", "    rig.retract()"),
}  # fmt: skip


class Stopping(NoAttendant):
    """A second Ctrl-C in a press."""

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        if stream == "sample" and data["phase"] == "press":
            raise KeyboardInterrupt


class Pausing(NoAttendant):
    """A pause in a press, and no more."""

    presses = False

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        self.presses = self.presses or (stream == "sample" and data["phase"] == "press")

    def interrupted(self) -> bool:
        return self.presses


@pytest.mark.quick(rows=lambda what, how: what == "stopped at once" or how == "swallows and goes on")
@pytest.mark.parametrize("how", SWALLOWING)
@pytest.mark.parametrize("what", ["stopped at once", "ended in a pause", "the stage failed"])
def test_a_script_that_swallows_the_end_of_its_run_moves_nothing_more(
    tmp_path: Path, finger: Fingertip, monkeypatch: pytest.MonkeyPatch, what: str, how: str
) -> None:
    """Nothing moves after it, and it is what the run tells."""
    aside = Motion.aside

    def fails(motion: Motion, x_mm: float, along_mm: float, speed_mm_s: float, check: Check, look_s: float) -> None:
        if x_mm == 1.0:
            raise StageError("it failed", "it_failed")
        aside(motion, x_mm, along_mm, speed_mm_s, check, look_s)

    monkeypatch.setattr(Motion, "aside", fails)
    verb, attendant = {
        "stopped at once": (PRESS, Stopping()),
        "ended in a pause": (PRESS, Pausing()),
        "the stage failed": ("rig.move_to(x_mm=1.0)", NoAttendant()),
    }[what]
    done = carried_out(tmp_path, finger, lines(*SWALLOWING[how]).replace("HERE", verb), attendant)
    if what == "the stage failed":
        assert isinstance(done.problem, StageError)
        has_code(done.problem, "it_failed")
    else:
        assert isinstance(done.problem, RunAborted)
    assert done.at.left == ("lifted" if what == "ended in a pause" else "held")
    run = read_run(done.folder.path)
    assert run.stop is not None
    assert run.stop["status"] == ("failed" if what == "the stage failed" else "aborted")
    assert (len(run.stream("home")), len(run.stream("indentation_end"))) == (1, 0)
    assert len(run.stream("retract")) == (what == "ended in a pause")


ELSEWHERE = {
    "in another thread": lines(
        "def other():", "    try:", "        rig.move_to(x_mm=1.0)",
        "    except Exception as error:", "        sys.told.append(error)",
        "thread = threading.Thread(target=other)", "thread.start()", "thread.join()", PRESS,
    ),
    "within another verb": lines(
        "def other(*_):", "    try:", "        rig.move_to(x_mm=1.0)",
        "    except Exception as error:", "        sys.told.append(error)",
        "    sys.setprofile(None)", "def profile(frame, what, _):",
        "    if frame.f_code.co_name == 'touch_off':", "        other()", "sys.setprofile(profile)", PRESS,
    ),
    "after the end": lines("sys.told.append(rig)", PRESS),
}  # fmt: skip


@pytest.mark.parametrize("where", ELSEWHERE)
def test_a_verb_called_outside_the_running_script_moves_nothing(
    tmp_path: Path, finger: Fingertip, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    told: list[Any] = []
    monkeypatch.setattr(sys, "told", told, raising=False)
    done = carried_out(tmp_path, finger, ELSEWHERE[where])
    assert (done.problem, done.complete) == (None, True)
    (error,) = told
    if where == "after the end":
        with pytest.raises(BadInputError) as caught:
            error.move_to(x_mm=1.0)
        error = caught.value
    has_code(error, "out_of_turn", verb="move_to")
    assert {data["x_mm"] for data in read_run(done.folder.path).stream("move")} == {0.0}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork (POSIX)")
@pytest.mark.parametrize(("ends", "code"), [("sys.exit(3)", 1), ("pass", 0), (PRESS, 1)])
def test_a_process_forked_by_a_script_leaves_the_run_unchanged(
    tmp_path: Path, finger: Fingertip, ends: str, code: int
) -> None:
    ended = f"assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == {code}"
    live = lines("pid = os.fork()", "if pid == 0:", f"    {ends}", "    return", ended, PRESS)
    here = os.getpid()
    try:
        done = carried_out(tmp_path, finger, live)
    finally:
        if os.getpid() != here:
            os._exit(9)  # else the tests that follow run twice
    assert (done.problem, done.complete) == (None, True)
    assert [document["doc"] for document in read_journal(done.folder.events)].count("stop") == 1
