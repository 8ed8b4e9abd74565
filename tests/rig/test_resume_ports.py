"""A run goes on after a device was plugged into another port; what decides a press may not change."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.data import read_run
from rig.plan.config import Config, load_config
from rig.session.resume import read_stopped, with_ports
from tests.program import Program

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (0.0, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=0.1)
"""
STANDA = {
    "frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0},
    "sync": {"output": "rts:/dev/ttyA2"},
    "stage": {"kind": "standa", "port": "/dev/ttyA0", "standa": {"x_port": "/dev/ttyA1"}},
}


@pytest.fixture
def stopped(program: Program, tmp_path: Path, made_once: Callable[..., Path]) -> Path:
    """A dry run with its configuration, killed before its second press."""
    (tmp_path / "rig.toml").write_text(Config.model_validate(STANDA).as_toml(), encoding="utf-8")

    def make() -> None:
        (tmp_path / "two.py").write_text(SCRIPT, encoding="utf-8")
        words = ("dry-run", tmp_path / "two.py", "--config", tmp_path / "rig.toml", "--out", tmp_path / "runs")
        assert program(*words).code == 0
        (folder,) = (tmp_path / "runs").iterdir()
        lines = (folder / "events.jsonl").read_bytes().splitlines(keepends=True)
        ends = [n for n, line in enumerate(lines) if json.loads(line).get("stream") == "indentation_end"]
        (folder / "events.jsonl").write_bytes(b"".join(lines[: ends[1] + 1]))

    return made_once("stopped", make)


def _with(path: Path, old: str, new: str) -> Path:
    text = path.read_text(encoding="utf-8")
    assert old in text
    other = path.with_name("other.toml")
    other.write_text(text.replace(old, new, 1), encoding="utf-8")
    return other


PORTS = {
    "stage": 'port = "/dev/ttyA0"',
    "second axis": 'x_port = "/dev/ttyA1"',
    "force": 'port = "/dev/ttyUSB1"',
    "sync line": 'output = "rts:/dev/ttyA2"',
}


@pytest.mark.parametrize("device", PORTS)
def test_a_run_resumes_with_another_port(program: Program, stopped: Path, tmp_path: Path, device: str) -> None:
    other = _with(tmp_path / "rig.toml", PORTS[device], PORTS[device].replace("/dev/tty", "/dev/ttyX"))
    assert with_ports(read_stopped(stopped), other).config == load_config(other)
    ended = program("resume", stopped, "--config", other)
    assert ended.code == 0, ended.err
    run = read_run(stopped)
    assert (run.missing, run.repeated) == (0, 0)
    assert program("resume", stopped).code == 0, "its own copies are unchanged"


OTHERS = {
    "sync.output": ('output = "rts:/dev/ttyA2"', 'output = "off"'),
    "limits.max_doi_mm": ("max_doi_mm = 1.5", "max_doi_mm = 1.2"),
    "habits.press_speed_mm_s": ("press_speed_mm_s = 1.0", "press_speed_mm_s = 0.4"),
    "force.kind": ('kind = "mtsics"', 'kind = "laumas"'),
    "force.sample_period_s": ("sample_period_s = 0.05", "sample_period_s = 0.06"),
    "finger.tissue.stiffness": ("stiffness = 1.0", "stiffness = 2.0"),
}


@pytest.mark.parametrize("key", OTHERS)
def test_a_run_does_not_resume_with_another_setting(
    program: Program, stopped: Path, tmp_path: Path, key: str
) -> None:
    other = _with(tmp_path / "rig.toml", *OTHERS[key])
    before = (stopped / "events.jsonl").read_bytes()
    ended = program("resume", stopped, "--config", other, "--json")
    assert (ended.code, ended.json["code"]) == (2, "other_settings")
    assert f"{key} = " in ended.err
    assert (stopped / "events.jsonl").read_bytes() == before


def test_resuming_with_a_missing_port_names_the_config_option(program: Program, stopped: Path) -> None:
    provenance = json.loads((stopped / "provenance.json").read_text(encoding="utf-8"))
    (stopped / "provenance.json").write_text(json.dumps({**provenance, "virtual": False}), encoding="utf-8")
    (stopped / "SHA256SUMS").unlink()
    read_run(stopped).folder.write_checksums(new=True)
    ended = program("resume", stopped, "--yes", "--json")
    assert ended.json["code"] == "no_port", ended.err
    assert "--config=TOML --yes" in ended.json["error_text"]
