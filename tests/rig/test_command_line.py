"""The commands people script against: exit codes, one JSON object, one clear line."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from rig.cli.output import print_json
from rig.cli.signals import PAUSING
from rig.data.journal import read_journal
from sim.models.fingertip import Fingertip
from tests.preloaded import Popen
from tests.program import WHOLE, Ended, Program
from tests.waiting import DEADLINE_S, journal_says, until

pytestmark = pytest.mark.usefixtures("empty_figures")

DRY_RUN_KEYS = {"run", "complete", "indentations", "duration_s", "wall_s", "report"}

SCRIPT = """\
from rig.protocol import Field, ProtocolParameters, Rig

class Parameters(ProtocolParameters):
    depth_mm: float = Field(0.3, gt=0, le=1.5)
    times: int = Field(1, ge=1, le=50)

def run(rig: Rig) -> None:
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for n in range(rig.parameters.times):
        rig.move_to(x_mm=0.1 * n)
        rig.indent(doi_mm=rig.parameters.depth_mm, hold_s=0.5)
"""


Rig = Program


@pytest.fixture
def rig(finger: Fingertip, program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Rig:
    """Run the program in this process, in a folder of its own."""
    assert finger is not None  # in the cache from here on
    monkeypatch.chdir(tmp_path)

    return program


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(SCRIPT, encoding="utf-8")
    return path


# --- indent ---


def test_indent_json_has_force_depth_pressure_and_receptor_measures(rig: Rig, finger: Fingertip) -> None:
    ended = rig("indent", "--shape", "step:1", "--x-mm", "-0.5", "--force-gwt", "2.33", "--json")
    assert (ended.code, ended.err) == (0, "")
    answer = ended.json
    assert answer["force_gwt"] == pytest.approx(2.33, rel=1e-3)
    assert answer["force_n"] == pytest.approx(answer["force_gwt"] * 9.80665e-3, rel=1e-9)
    expected = finger.indent("step:1", -0.5, force_gwt=2.33)
    assert answer["doi_mm"] == pytest.approx(expected.doi_mm, rel=1e-9)
    assert answer["receptors"]["ep3"] == pytest.approx(expected.receptor_measures["ep3"].tolist())
    x = answer["pressure"]["x_mm"]
    assert x == sorted(x)
    assert (answer["solver"]["model"], answer["solver"]["converged"]) == ("finger", True)


def test_a_section_model_states_the_length_that_its_force_assumes(rig: Rig) -> None:
    arguments = ("indent", "--shape", "bar:3.0", "--x-mm", "0", "--doi-mm", "0.5", "--model", "section", "--json")
    plain, long = (json.loads(rig(*arguments, *more).out) for more in ((), ("--length-mm", "3.5")))
    assert (plain["force_n"], plain["force_gwt"], plain["effective_length_mm"]) == (None, None, None)
    assert long["effective_length_mm"] == 3.5
    assert long["force_n"] == pytest.approx(3.5 * plain["force_n_per_mm"], rel=1e-12)
    assert long["force_gwt"] == pytest.approx(long["force_n"] / 9.80665e-3, rel=1e-12)
    asked = json.loads(rig(*arguments[:5], "--force-gwt", "2", *arguments[7:], "--length-mm", "3.5").out)
    assert asked["force_gwt"] == pytest.approx(2.0, rel=1e-9)


@pytest.mark.quick(rows=lambda tolerance, model: model == "halfspace")  # of the finger: sim/test_choice.py
@pytest.mark.parametrize(("tolerance", "model"), [("60%", "halfspace"), ("0.05", "finger")])
def test_the_auto_model_reports_its_choice_error_and_cost(rig: Rig, tolerance: str, model: str) -> None:
    ended = rig("indent", "--shape", "bar:3.0", "--x-mm", "0", "--doi-mm", "0.5", "--model", "auto",
                "--tol", tolerance, "--json")  # fmt: skip
    answer = json.loads(ended.out)
    assert answer["solver"]["model"] == model
    assert 0 < answer["choice"]["promised_error"] <= (0.6 if model == "halfspace" else 0.05)
    assert answer["receptors"]["sed"] == []
    assert 0 < answer["choice"]["expected_cost"]["press_s"] < answer["choice"]["expected_cost"]["from_nothing_s"]


def test_a_refusal_is_printed_as_json_when_json_was_requested(rig: Rig) -> None:
    for arguments, code in (
        (("indent", "--shape", "bar:3.0", "--x-mm", 0, "--doi-mm", 1, "--tol", "2%"), "needs_option"),
        (("indent", "--x-mm", "left"), "usage"),
        (("dance",), "usage"),
    ):
        ended = rig(*arguments, "--json")
        assert ended.code == 2
        assert ended.json == {"error_text": ended.complaint, "code": code, "exit_code": 2}
        assert rig(*arguments) == Ended(2, "", ended.err)


# --- dry-run ---


def test_dry_run_json_names_the_folder_of_a_complete_run_with_all_its_files(rig: Rig, script: Path) -> None:
    ended = rig("dry-run", script, "--out", "here", "--json")
    assert ended.code == 0
    answer = ended.json
    assert set(answer) >= DRY_RUN_KEYS
    assert (answer["complete"], answer["indentations"]) == (True, 1)
    run = Path(answer["run"])
    assert run.parent == Path("here")
    assert Path(answer["report"]).parent == run
    assert {"events.jsonl", "bytes.jsonl", "data.h5", "report.html", "SHA256SUMS"} <= {p.name for p in run.iterdir()}
    assert 5 < answer["duration_s"] < 200
    assert answer["wall_s"] > 0
    sums = (run / "SHA256SUMS").read_text(encoding="utf-8")
    assert "  report.html\n" in sums


def test_set_options_may_be_joined_or_repeated(rig: Rig, script: Path) -> None:
    for form in (("--set", "depth_mm=0.2", "times=2"), ("--set", "depth_mm=0.2", "--set", "times=2")):
        assert [step["doi_mm"] for step in rig("check", script, *form, "--json").json["steps"]] == [0.2, 0.2]
    answer = rig("dry-run", script, "--set", "depth_mm=0.2", "--json", "--set", "times=2").json
    assert (answer["complete"], answer["indentations"]) == (True, 2)
    start = next(read_journal(Path(answer["run"]) / "events.jsonl"))
    assert start["parameters"] == {"depth_mm": 0.2, "times": 2}


def test_a_refused_dry_run_leaves_no_file(rig: Rig, script: Path) -> None:
    Path("shallow.toml").write_text("[limits]\nmax_doi_mm = 0.25\n", encoding="utf-8")
    there = sorted(Path().iterdir())
    for arguments in (
        ("mine.py", "--set", "depth_mm=9"),
        ("mine.py", "--speed", "0"),
        ("mine.py", "--config", "shallow.toml"),
        ("mine.py", "--out", "mine.py"),
    ):
        ended = rig("dry-run", *arguments)
        assert (ended.code, ended.out, bool(ended.complaint)) == (2, "", True)
    assert sorted(Path().iterdir()) == there
    assert script.read_text(encoding="utf-8") == SCRIPT


def test_a_dry_run_warns_of_an_expired_calibration(rig: Rig, script: Path) -> None:
    """`rig run` refuses it: nothing real may move by it."""
    Path("rig.toml").write_text(
        "[calibration.force_scale]\nvalue = 1.0\ndate = 2019-01-01\nexpires = 2020-01-01\n", encoding="utf-8"
    )
    ended = rig("dry-run", script, "--config", "rig.toml", "--json")
    assert ended.code == 0
    assert ended.json["complete"]
    (warning,) = ended.err.splitlines()
    assert warning.startswith("rig: warning: calibration.force_scale ")
    assert "2020-01-01" in warning


def test_a_dry_run_that_trips_exits_with_1_and_its_page_tells_how_to_continue(rig: Rig, script: Path) -> None:
    """A screw so wrong that the indentor does not get to the skin."""
    Path("rig.toml").write_text("[virtual]\nz_screw_steps_per_mm = 460\n", encoding="utf-8")
    ended = rig("dry-run", script, "--config", "rig.toml", "--json")
    assert ended.code == 1
    assert ended.complaint
    answer = ended.json
    assert set(answer) >= {*DRY_RUN_KEYS, "ending"}
    assert answer["code"] == "no_contact"
    assert (answer["complete"], answer["indentations"]) == (False, 0)
    assert list(read_journal(Path(answer["run"]) / "events.jsonl"))[-1]["status"] == "tripped"
    before = _ending_on_page(Path(answer["report"]))
    assert [about for about in ("where", "next", "resume") if f"<td>{about}</td>" in before] == [
        "where", "next", "resume",
    ]  # fmt: skip
    assert rig("export", answer["run"], "--report").code == 0
    assert _ending_on_page(Path(answer["report"])) == before


def _ending_on_page(report: Path) -> str:
    return report.read_text("utf-8").partition('<table id="ending">')[2].partition("</table>")[0]


def test_a_script_that_fails_during_the_run_exits_with_1_and_names_its_line(rig: Rig, script: Path) -> None:
    second = "(passes := vars(__import__('sys')).setdefault(__file__, [])) or passes.append(1)"
    script.write_text(SCRIPT + f"    if {second}:\n        1 / 0\n", encoding="utf-8")
    ended = rig("dry-run", script, "--json")
    assert ended.code == 1
    assert ended.complaint.endswith(f"{script}, line 15: ZeroDivisionError: division by zero")  # as Python words it
    assert ended.json["code"]
    assert ended.json["complete"] is False
    assert list(read_journal(Path(ended.json["run"]) / "events.jsonl"))[-1]["status"] == "failed"
    assert rig("export", ended.json["run"], "--report").code == 0
    page = _ending_on_page(Path(ended.json["run"]) / "report.html")
    assert all(words in page for words in ("<td>next</td>", "correct the problem, then", "rig resume"))


# --- Ctrl-C ---


class Running:
    """A dry-run at a limited speed in a process of its own."""

    def __init__(self, script: Path, out: Path, *options: str) -> None:
        self.out = out
        self.process = Popen(
            [sys.executable, WHOLE, "dry-run", str(script), "--out", str(out), "--json", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "COLUMNS": "200"},
        )

    def wait_for(self, needle: str) -> None:
        """Until the journal says so."""
        said = journal_says(self.out, needle)
        until(lambda: said() or self.process.poll() is not None)
        assert said(), f"{needle!r} never came: {self.process.communicate()}"

    def end(self) -> Ended:
        out, err = self.process.communicate(timeout=DEADLINE_S)
        return Ended(self.process.returncode, out, err, "dry-run")


@pytest.fixture
def running(script: Path, tmp_path: Path) -> Any:
    """At 40 times the pace of a bench; ten seconds, if nothing ends it."""
    script.write_text(SCRIPT.replace("hold_s=0.5", "hold_s=400.0"), encoding="utf-8")
    started: list[Running] = []

    def start() -> Running:
        started.append(Running(script, tmp_path / "out", "--speed", "40"))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.process.kill()
            one.process.communicate()


def test_ctrl_c_stops_a_run_at_a_safe_point(finger: Fingertip, running: Any) -> None:
    run = running()
    run.wait_for('"phase": "press"')
    run.process.send_signal(signal.SIGINT)
    ended = run.end()
    assert ended.code == 130
    assert PAUSING in ended.err.splitlines()
    answer = ended.json
    assert set(answer) >= DRY_RUN_KEYS
    assert answer["complete"] is False
    folder = Path(answer["run"])
    documents = list(read_journal(folder / "events.jsonl"))
    paused, stop = [d for d in documents if d["doc"] != "descriptor"][-2:]
    assert (paused["stream"], paused["data"]) == ("paused", {"reason": "operator"})
    assert (stop["doc"], stop["status"]) == ("stop", "aborted")
    heights = [d["data"]["height_mm"] for d in documents if d["doc"] == "event" and "height_mm" in d["data"]]
    assert heights[-1] == pytest.approx(2.0, abs=0.02)
    assert {"data.h5", "sample.csv", "report.html", "SHA256SUMS"} <= {p.name for p in folder.iterdir()}


def test_a_killed_run_leaves_a_readable_journal(finger: Fingertip, running: Any) -> None:
    run = running()
    run.wait_for('"phase": "press"')
    run.process.kill()
    assert run.end().code == -signal.SIGKILL
    (journal,) = run.out.glob("*/events.jsonl")
    documents = list(read_journal(journal))
    assert documents[0]["doc"] == "start"
    assert documents[-1]["doc"] == "event"


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -float("inf")])
def test_json_output_never_contains_nan_or_infinity(number: float, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        print_json({"force_gwt": [1.0, number]})
    assert capsys.readouterr().out == ""
