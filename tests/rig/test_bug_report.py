"""`rig doctor --bundle`: what is in the one file for a bug report, and that it tells of nobody and no machine."""

import getpass
import json
import platform
import shutil
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.data.bug_report import GONE, LEFT_OUT, Scrubber
from tests.program import Program

OLD = Path(__file__).parents[1] / "data" / "runs"
HOLDER = "Ada Byron"
SCRIPT = '''\
"""Presses for Ada B."""
METADATA = {"title": "Ada's finger"}  # she came late
NOTE = f"subject {METADATA} is tired"

def run(rig):
    """Of two
    lines."""
    rig.mount("bar:3.0")
    rig.note('Ada is cold', "1.5", rig.x)
'''


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One that was stopped, in a folder of somebody's, who wrote a name wherever one can be written."""
    folder = tmp_path / HOLDER / "runs" / "20260301T101500-of_S07-1a2b3c"
    shutil.copytree(OLD / "stopped", folder)
    monkeypatch.chdir(tmp_path)
    lines = (folder / "events.jsonl").read_text(encoding="utf-8").splitlines()[:60]
    start = json.loads(lines[0])
    start |= {"title": "Ada's finger", "source": "Ada's notebook"}
    start["parameters"] |= {"who": "Ada", "shape": "bar:3.0", "many": ["Ada", 2.0], "order": None, "empty": ""}
    events = [
        ("note", {"text": "Ada says it tickles"}),
        ("checkpoint", {"name": "Ada rests"}),
        ("mount", {"indentor": f"profile:{tmp_path}/{HOLDER}/ridge.csv"}),
        ("mount", {"indentor": "bar:1.5"}),
        ("alarm", {"reason": "Ada says it tickles: S07 moved"}),
        ("indentation_start", {"index": 9, "indentor": "bar:1.5", "condition": "Ada, left", "block": 1}),
        ("indentation_start", {"index": 9, "indentor": "bar:1.5", "condition": "-0.5", "block": 1}),
    ]
    told = [{"doc": "event", "t_s": 80.0, "stream": stream, "data": data} for stream, data in events]
    reason = f"{folder}/bytes.jsonl: cannot be written, see tcp://10.0.0.7:502 and C:\\Users\\Ada\\x.py, line 3 mm/s"
    told += [{"doc": "resume", "t_s": 81.0, "missing": 3, "after": "Ada rests"}]
    told += [{"doc": "stop", "t_s": 90.0, "status": "failed", "reason": reason}]
    text = "\n".join([json.dumps(start), *lines[1:], *map(json.dumps, told), '{"doc": "event", "text": "Ad'])
    (folder / "events.jsonl").write_text(text, encoding="utf-8")
    made = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))
    made["command"] = ["rig", "dry-run", f"/home/{HOLDER}/mine.py", "--out", f"{HOLDER}/runs", "--subject", "S07"]
    (folder / "provenance.json").write_text(json.dumps(made), encoding="utf-8")
    port = f'[stage]\nport = "{tmp_path}/{HOLDER}/tty0"\n[force]\nport = "tcp://balance.ada.org:4001"\n'
    (folder / "config.toml").write_text(port, encoding="utf-8")
    wire = {"t_s": 0.0, "port": "/dev/serial/by-id/usb-x", "dir": "tx", "hex": "24490a"}
    (folder / "bytes.jsonl").write_text(json.dumps(wire) + "\n", encoding="utf-8")
    (folder / "timeline.json").write_text(json.dumps({"passes": [["mount", 1, 0, 0.0, "mount x"]]}), encoding="utf-8")
    (folder / "protocol.py").write_text(SCRIPT, encoding="utf-8")
    (folder / "report.html").write_text("Ada", encoding="utf-8")
    return folder


def members(path: Path) -> dict[str, str]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name).decode("utf-8") for name in archive.namelist()}


def held(told: Mapping[str, Any]) -> set[str]:
    return {one["name"] for one in told["holds"]}


def test_a_bug_report_names_no_subject_user_or_machine(program: Program, run: Path) -> None:
    ended = program("doctor", "--bundle", run, "--json")
    told = ended.json
    assert told["bundle"] == "bug-report-20260301T101500-of_SUBJECT-1a2b3c.zip"
    found = members(Path(told["bundle"]))
    assert told["holds"] == [{"name": name, "bytes": len(text.encode("utf-8"))} for name, text in found.items()]
    assert set(found) == {
        *("README.txt", "installation.json", "provenance.json", "config.toml", "events.jsonl", "bytes.jsonl"),
        *("timeline.json", "protocol.py"),
    }
    assert told["left_out_text"] == list(LEFT_OUT)
    assert all(words in found["README.txt"] for words in (*LEFT_OUT, *set(found) - {"README.txt"}))
    secret = (
        "Ada",
        "Byron",
        "S07",
        "tickles",
        "10.0.0.7",
        "ada.org",
        str(Path.home()),
        str(run.parents[2]),
        "/home/",
        "/dev/",
    )
    for name, text in found.items():
        for words in (*secret, str(Path(sys.executable).parent)):
            assert words not in text, (name, words)
    if len(platform.node()) > 2:
        assert not [name for name, text in found.items() if platform.node() in text]
    if len(getpass.getuser()) > 3 and getpass.getuser() != "root":
        assert not [name for name, text in found.items() if getpass.getuser() in text]


def test_a_bug_report_contains_journal_bytes_configuration_and_versions(program: Program, run: Path) -> None:
    program("doctor", "--bundle", run)
    (bundle,) = Path().glob("bug-report-*.zip")
    found = members(bundle)
    assert "…/x.py, line 3" in found["events.jsonl"]  # to be read by people
    documents = [json.loads(line) for line in found["events.jsonl"].splitlines()]
    lines = (run / "events.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(documents) == len(lines)
    assert documents[-1] == {"unreadable": len(lines[-1])}
    assert documents[-2]["reason"] == (
        "…/20260301T101500-of_SUBJECT-1a2b3c/bytes.jsonl: cannot be written, see tcp://…:502 and …/x.py, line 3 mm/s"
    )
    assert documents[-3] == {"doc": "resume", "t_s": 81.0, "missing": 3, "after": GONE}
    events = [one["data"] for one in documents if one.get("t_s") == 80.0]
    assert events == [
        {"text": GONE}, {"name": GONE}, {"indentor": "profile:…/ridge.csv"}, {"indentor": "bar:1.5"},
        {"reason": f"{GONE}: SUBJECT moved"},
        {"index": 9, "indentor": "bar:1.5", "condition": GONE, "block": 1},
        {"index": 9, "indentor": "bar:1.5", "condition": "-0.5", "block": 1},
    ]  # fmt: skip
    start, was = documents[0], json.loads(lines[0])
    assert (start["subject"], start["title"], start["source"]) == (GONE, GONE, GONE)
    assert start["parameters"] == {
        **was["parameters"], "who": GONE, "many": [GONE, 2.0], "shape": "bar:3.0", "order": None, "empty": "",
    }  # fmt: skip
    assert start["unix_s"] == was["unix_s"]
    assert json.loads(found["bytes.jsonl"]) == {"t_s": 0.0, "port": "…/usb-x", "dir": "tx", "hex": "24490a"}
    assert found["config.toml"] == '[stage]\nport = "…/tty0"\n[force]\nport = "tcp://…:4001"\n'
    assert json.loads(found["provenance.json"])["versions"]["indentation-rig"] == "0.3.0"


def test_a_bug_report_keeps_the_code_of_a_user_script_without_its_texts_and_comments(
    run: Path, program: Program
) -> None:
    program("doctor", "--bundle", run)
    found = members(Path("bug-report-20260301T101500-of_SUBJECT-1a2b3c.zip"))["protocol.py"]
    lines = found.splitlines()
    assert len(lines) == len(SCRIPT.splitlines())
    compile(found, "protocol.py", "exec")
    assert lines[1].endswith("  #")
    assert lines[4] == "def run(rig):"
    assert lines[7] == '    rig.mount("bar:3.0")'
    assert lines[8] == f'    rig.note("""{GONE}""", "1.5", rig.x)'


@pytest.mark.parametrize("missing", ["events.jsonl", "provenance.json"])
def test_a_bug_report_contains_the_readable_parts_of_a_broken_run(run: Path, program: Program, missing: str) -> None:
    (run / missing).unlink()
    (run / "protocol.py").write_text("def run(rig:\n  '''", encoding="utf-8")
    told = program("doctor", "--bundle", run, "--json").json
    assert {missing, "protocol.py"}.isdisjoint(held(told))
    (run / "provenance.json").write_text("[1]", encoding="utf-8")
    (run / "events.jsonl").write_bytes(b"\xff\xfe\n[]\n")
    (run / "protocol.py").unlink()
    told = program("doctor", "--bundle", run, "--json").json
    assert {"provenance.json", "protocol.py"}.isdisjoint(held(told))
    assert members(Path(told["bundle"]))["events.jsonl"] == '{"unreadable": 2}\n[]\n'


@pytest.mark.parametrize(
    ("text", "scrubbed"),
    [
        ("Ada L/other.py", "…/other.py"),
        ("Ada N/20260301/events.jsonl", "…/20260301/events.jsonl"),
        ("dry-run/x", "dry-run/x"),
    ],
)
def test_a_bug_report_shortens_folders_given_on_the_command_line(
    tmp_path: Path, program: Program, monkeypatch: pytest.MonkeyPatch, text: str, scrubbed: str
) -> None:
    """However they were given; a run without a subject has none to take out."""
    command = ["rig", "dry-run", "Ada L/mine.py", "steps", "--out", "Ada N", "--config", "Ada M/K/x.toml", "--set"]
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path)
    made = {"command": command, "subject": None, "protocol": "mine.py"}
    (tmp_path / "run" / "provenance.json").write_text(json.dumps(made), encoding="utf-8")
    documents = [
        {"doc": "event", "t_s": 0.0, "stream": "other", "data": {"text": "steps"}},
        {"doc": "stop", "t_s": 0.0, "status": "failed", "reason": text},
    ]
    (tmp_path / "run" / "events.jsonl").write_text("\n".join(map(json.dumps, documents)), encoding="utf-8")
    found = members(Path(program("doctor", "--bundle", "run", "--json").json["bundle"]))
    assert json.loads(found["events.jsonl"].splitlines()[1])["reason"] == scrubbed
    assert found["provenance.json"] == '{\n  "protocol": "mine.py"\n}\n'


@pytest.mark.parametrize(
    ("text", "scrubbed"),
    [
        ("/a/b/c.py, line 3", "…/c.py, line 3"),
        ("at 3 mm/s and N/cm²", "at 3 mm/s and N/cm²"),
        ("'/home/Ada Byron/x y.py': no", "'…/x y.py': no"),
        (r"C:\\Users\\Ada\\x.py", "…/x.py"),
        ("tcp://host:502", "tcp://…:502"),
        ("given/to/x.py", "…/to/x.py"),
        ("given/to", "…/to"),
        ("x/y.py", "x/y.py"),
        ("ab/y.py", "…/y.py"),
        ("S0712 and S07", "SUBJECT12 and SUBJECT"),
        ("  ", "  "),
        ("a “quoted” note", GONE),
        (r"a \u201cquoted\u201d note", GONE),
    ],
)
def test_the_scrubber_removes_paths_and_names_from_a_text(text: str, scrubbed: str) -> None:
    assert Scrubber(["S07", ""], ["  ", "a “quoted” note"], ["given/", "x", "ab"]).text(text) == scrubbed


def test_doctor_names_an_expired_calibration_and_ports_that_do_not_answer(program: Program, tmp_path: Path) -> None:
    """With an expired calibration `rig run` refuses to begin."""
    expired = "value = 400, date = 2020-03-01, expires = 2021-03-01"
    ports = "".join(f'[{name}]\nport = "{tmp_path / name}"\n' for name in ("stage", "force"))
    (tmp_path / "rig.toml").write_text(f"{ports}[calibration]\nz_steps_per_mm = {{{expired}}}\n", encoding="utf-8")
    found = program("doctor", "--config", tmp_path / "rig.toml", "--json").json
    named = [problem.partition(" ")[0] for problem in found["problems_text"]]
    assert named == ["calibration.z_steps_per_mm", "stage:", "force:"]
