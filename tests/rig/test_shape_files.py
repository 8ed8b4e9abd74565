"""Files that a shape names: copied and hashed when a run begins, and read from the copy ever after."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.data import RunFolder, read_run
from rig.plan.finger_model import copy_name, responses
from sim.models.fingertip import Fingertip
from tests.program import Program

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
def run(rig):
    rig.mount("profile:parts/mine.csv")
    rig.home()
    rig.zero()
    for x_mm in (-0.3, 0.3):
        rig.move_to(x_mm=x_mm)
        rig.indent(force_gwt=1.0, hold_s=0.1)
"""
BLUNT = "x_mm,height_mm\n-3,1.2\n-1,0.1\n0,0\n1,0.1\n3,1.2\n"
SHARP = "x_mm,height_mm\n-1,1.2\n-0.2,0.5\n0,0\n0.2,0.5\n1,1.2\n"
COPY = copy_name("parts/mine.csv")
Rig = Callable[..., dict[str, Any]]
MadeOnce = Callable[[str, Callable[[], object]], Path]


@pytest.fixture
def rig(finger: Fingertip, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:
    """Run the program with --json beside a script and the profile it names."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "mine.csv").write_text(BLUNT, encoding="utf-8")

    def run(*arguments: str) -> dict[str, Any]:
        ended = program(*arguments, "--json")
        return {"code": ended.code, "err": ended.err, **ended.json}

    return run


def _cut(run: Path) -> None:
    """As a kill between the two indentations leaves it."""
    lines = (run / "events.jsonl").read_bytes().splitlines(keepends=True)
    ends = [n for n, line in enumerate(lines) if b'"indentation_end"' in line and b'"event"' in line]
    (run / "events.jsonl").write_bytes(b"".join(lines[: ends[0] + 1]))


@pytest.mark.quick(rows=lambda what: what == "edited")
@pytest.mark.parametrize("what", ["edited", "gone"])
def test_a_resumed_run_presses_its_copy_of_an_edited_or_deleted_shape_file(
    rig: Rig, made_once: MadeOnce, finger: Fingertip, tmp_path: Path, what: str
) -> None:
    """One indentation before, one after: the same indentor in both, in their forces and in what the model says."""
    run = made_once("blunt", lambda: rig("dry-run", "mine.py"))
    assert (run / COPY).read_text(encoding="utf-8") == BLUNT
    whole = read_run(run).stream("hold_end")
    _cut(run)
    original = tmp_path / "parts" / "mine.csv"
    original.write_text(SHARP, encoding="utf-8") if what == "edited" else original.unlink()
    again = rig("resume", str(run))
    assert (again["code"], again["complete"]) == (0, True), again["err"]
    now = read_run(run)
    assert [e["indentor"] for e in now.stream("mount")] == ["profile:parts/mine.csv"] * 2
    assert [e["doi_mm"] for e in now.stream("hold_end")] == pytest.approx([e["doi_mm"] for e in whole], abs=0.01)
    found = responses(now, finger)
    assert [r.result.force_gwt for r in found] == pytest.approx([1.0, 1.0], abs=0.05)
    sums = (run / "SHA256SUMS").read_text(encoding="utf-8")
    assert f"  {COPY}\n" in sums


def test_resuming_with_a_changed_shape_copy_is_refused(rig: Rig, made_once: MadeOnce) -> None:
    run = made_once("blunt", lambda: rig("dry-run", "mine.py"))
    _cut(run)
    (run / COPY).write_text(SHARP, encoding="utf-8")
    again = rig("resume", str(run))
    assert (again["exit_code"], again["code"]) == (2, "changed_since")
    assert COPY in again["error_text"]


# --- resume of a complete run ---


def _state(run: Path) -> dict[str, tuple[int, bytes]]:
    return {p.name: (p.stat().st_mtime_ns, p.read_bytes()) for p in run.iterdir() if p.name != ".lock"}


@pytest.mark.parametrize(
    "missing",
    [(), ("data.h5", "sample.csv"), ("hold_end.csv", "report.html")],
)
def test_resuming_a_complete_run_makes_missing_files_and_rewrites_no_other(
    rig: Rig, made_once: MadeOnce, tmp_path: Path, missing: tuple[str, ...]
) -> None:
    run = made_once("blunt", lambda: rig("dry-run", "mine.py"))
    (tmp_path / "parts" / "mine.csv").unlink()
    before = _state(run)
    for name in missing:
        (run / name).unlink()
    again = rig("resume", str(run))
    assert (again["code"], again["complete"], again["missing"], again["repeated"]) == (0, True, 0, 0)
    after = _state(run)
    assert set(after) == set(before)
    touched = {name for name in after if after[name] != before[name]}
    assert touched == {*missing, *(["SHA256SUMS"] if missing else [])}
    assert RunFolder(run).changed() == []
    listed = dict(reversed(line.split("  ", 1)) for line in (run / "SHA256SUMS").read_text().splitlines())
    assert set(listed) == set(after) - {"SHA256SUMS"}


def test_an_edited_report_keeps_its_old_checksum(rig: Rig, made_once: MadeOnce) -> None:
    """Its line among the checksums stays what it was."""
    run = made_once("blunt", lambda: rig("dry-run", "mine.py"))
    shutil.copy(run / "SHA256SUMS", run.parent / "sums")
    (run / "report.html").write_text("mine", encoding="utf-8")
    (run / "data.h5").unlink()
    assert rig("resume", str(run))["code"] == 0
    line = next(line for line in (run.parent / "sums").read_text().splitlines() if line.endswith("report.html"))
    assert line in (run / "SHA256SUMS").read_text().splitlines()
    assert (run / "report.html").read_text(encoding="utf-8") == "mine"
