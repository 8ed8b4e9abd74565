"""A command that cannot write its result says so before it works. `os.access` answers for root as for an account."""

import errno
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.cli.error_exit_codes import outcome
from rig.data.folder import UnwritableError
from rig.errors import RecordError
from rig.session.early_ending import Ending, FinalPosition
from sim.models.fingertip import Fingertip
from tests.program import Ended, Program

FROZEN = Path(__file__).parents[1] / "frozen" / "commands.txt"
RUN = FROZEN.parents[1] / "data" / "runs" / "complete"
NAMES = ("--out", "--to", "--table", "--picture")
READ = {"stream --out", "panel --out"}
"""Folders of runs that these commands only read."""

SCRIPT = "def run(rig):\n    rig.mount('bar:3.0')\n    rig.home()\n    rig.zero()\n    rig.indent(doi_mm=0.3)\n"
BENCH = '[stage]\nport = "tcp://127.0.0.1:1"\n[force]\nport = "tcp://127.0.0.1:2"\n'
STUDY = '[[press]]\nshape = "bar:3.0"\ndoi_mm = 0.5\n'
PRESS = ("--shape", "bar:3.0", "--doi-mm", "0.5")

WRITES: dict[str, tuple[object, ...]] = {
    "dry-run --out": ("mine.py", "--out", "shut/runs"),
    "run --out": ("mine.py", "--config", "rig.toml", "--yes", "--out", "shut/runs"),
    "identify --out": ("--config", "rig.toml", "--yes", "--out", "shut/runs"),
    "identify --to": ("--config", "rig.toml", "--yes", "--to", "shut/finger.toml"),
    "take-orders --out": (*PRESS[2:], "--indentor", "bar:3.0", "--config", "rig.toml", "--yes", "--out", "shut/runs"),
    "design --to": ("--to", "shut/designed.py"),
    "design --out": ("--out", "shut/designed.html"),
    "compare --out": ("shut", "--out", "shut/c.html"),
    "runs --table": ("shut", "--table", "shut/t.csv"),
    "study --out": ("study.toml", "--out", "shut/t.csv"),
    "indent --picture": (*PRESS, "--picture", "shut/p.svg"),
    "impulse --picture": ("--picture", "shut/p.svg"),
    "shift-invariance --picture": ("--picture", "shut/p.svg"),
    "encode --picture": ("--pressure", "20,14", "--picture", "shut/p.svg"),
    "decode --picture": ("--pressure", "20,14", "--picture", "shut/p.svg"),
    "export-deck --out": (*PRESS, "--x-mm", "0", "--out", "shut/deck.inp"),
    "init --to": ("--to", "shut/rig.toml"),
    "bench --out": ("--out", "shut/bench.html"),
}


def test_the_tests_of_unwritable_files_cover_every_output_option() -> None:
    lines = FROZEN.read_text(encoding="utf-8").splitlines()
    options = {line.partition("  ")[0] for line in lines if "  Path" in line}
    assert {one for one in options if one.split()[-1] in NAMES} == WRITES.keys() | READ


@pytest.fixture
def shut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that this account may not write to, beside files that commands read."""
    monkeypatch.chdir(tmp_path)
    for name, text in {"mine.py": SCRIPT, "rig.toml": BENCH, "study.toml": STUDY}.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    folder = tmp_path / "shut"
    folder.mkdir(mode=0o500)
    asked: Callable[..., bool] = os.access

    def access(path: object, mode: int, **more: bool) -> bool:
        inside = isinstance(path, str | Path) and Path(path).absolute().is_relative_to(folder)
        return not (inside and mode & os.W_OK) and asked(path, mode, **more)

    monkeypatch.setattr(os, "access", access)
    return folder


@pytest.mark.parametrize("written", WRITES)
def test_an_output_that_cannot_be_written_is_refused_before_the_work(
    program: Program, shut: Path, monkeypatch: pytest.MonkeyPatch, written: str
) -> None:
    def load(*_: object, **__: object) -> None:
        raise AssertionError("the finger was loaded first")

    monkeypatch.setattr(Fingertip, "load", load)
    command, option = written.split()
    always = {"export-deck": False, "take-orders": True}  # whether it prints JSON; the others do if asked to
    ended: Ended = program(command, *WRITES[written], *([] if command in always else ["--json"]))
    assert ended.code == 2, ended.err
    if always.get(command, True):
        assert json.loads(ended.out)["code"] == "not_writable"
    assert f"rig: {option} shut" in ended.err
    assert not list(shut.iterdir())


@pytest.mark.parametrize("command", ["compare", "nerve"])
def test_compare_and_nerve_refuse_a_read_only_run_before_the_work(
    program: Program, shut: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    shut.chmod(0o700)
    shutil.copytree(RUN, shut, dirs_exist_ok=True)
    before = sorted(path.name for path in shut.iterdir())
    shut.chmod(0o500)
    monkeypatch.setattr(Fingertip, "load", lambda *_, **__: pytest.fail("the finger was loaded first"))
    ended = program(command, "shut", "--json")
    assert (ended.code, json.loads(ended.out)["code"]) == (2, "not_writable")
    assert sorted(path.name for path in shut.iterdir()) == before


@pytest.mark.parametrize("number", [errno.EACCES, errno.ENOSPC])
def test_the_advice_for_an_unwritable_file_depends_on_permission_or_space(tmp_path: Path, number: int) -> None:
    """Of a run that ends early, of a file that a command writes, and of its lock."""
    full = number == errno.ENOSPC
    problem = OSError(number, os.strerror(number))
    record = RecordError("events.jsonl: cannot be written")
    record.__cause__ = problem
    unwritable = UnwritableError.of(tmp_path / "data.h5", problem)
    endings = [Ending.of(error, FinalPosition("not moved"), tmp_path) for error in (record, unwritable)]
    said = [*(one.next for one in endings), *(one.reason for one in endings), (outcome(unwritable) or ("",))[0]]
    assert ["free disk space" in sentence for sentence in said] == 5 * [full]
    assert ["MB free" in sentence for sentence in said[2:]] == 3 * [full]


OTHER_KINDS: dict[str, tuple[str, ...]] = {
    "a design's page": ("design", "--out", "mine.py"),
    "a design's script": ("design", "--to", "mine.html"),
    "a comparison's page": ("compare", "none", "--out", "mine.csv"),
    "the example's page": ("compare", "--example", "bar3", "--out", "mine.py"),
    "a benchmark's page": ("bench", "--out", "mine.toml"),
    "a configuration": ("init", "--to", "mine.py"),
    "a table of runs": ("runs", "--table", "mine.py"),
    "a study's table": ("study", "study.toml", "--out", "mine.toml"),
}


@pytest.mark.parametrize("what", OTHER_KINDS)
def test_an_output_file_with_another_suffix_is_refused_and_not_overwritten(
    what: str, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name = next(word for word in OTHER_KINDS[what] if word.startswith("mine."))
    Path(name).write_text("mine", encoding="utf-8")
    Path("study.toml").write_text('[[press]]\nshape = "bar:3"\ndoi_mm = [0.3]\n', encoding="utf-8")
    ended = program(*OTHER_KINDS[what])
    assert ended.code == 2
    assert f"{name}: must end in ." in ended.err
    assert Path(name).read_text("utf-8") == "mine"
