"""A full disk, at every file that a run writes: one line, no half file, and the run goes on when there is room."""

import errno
import io
import json
import os
import re
import shlex
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rig.data import read_run
from sim.models.fingertip import Fingertip
from tests.program import Ended, Program

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
def run(rig):
    rig.mount("profile:mine.csv")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    rig.indent(force_gwt=1.0, hold_s=0.1)
"""
PROFILE = "x_mm,height_mm\n-3,1.2\n-1,0.1\n0,0\n1,0.1\n3,1.2\n"

MadeOnce = Callable[[str, Callable[[], object]], Path]

BEGINNING = ("protocol.py", "config.toml", "provenance.json", "shape_", "SHA256SUMS", ".lock")
ENDING = ("data.h5", "sample.csv", "hold_end.csv", "report.html", "SHA256SUMS")
WHILE_IT_RUNS = ("events.jsonl", "bytes.jsonl")


class FullDisk:
    """Writes to a file whose name begins so fail from the nth on, when half of what was to be written has been."""

    def __init__(self, name: str, nth: int) -> None:
        self.name, self.left, self.struck = name, nth, False

    def strikes(self, name: str) -> bool:
        if not Path(name).name.startswith(self.name):
            return False
        self.left -= 1
        self.struck = self.struck or self.left <= 0
        return self.left <= 0


class FullFile(io.FileIO):
    """A file on such a disk."""

    disk: FullDisk

    def write(self, data: Any, /) -> int:
        content = bytes(data)
        if self.disk.strikes(str(self.name)):
            super().write(content[: len(content) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return int(super().write(content) or 0)


@pytest.fixture
def rig(finger: Fingertip, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Ended]:
    """Run the program beside a script and a profile."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    (tmp_path / "mine.csv").write_text(PROFILE, encoding="utf-8")

    return lambda *arguments: program(*arguments, "--json")


@pytest.fixture
def full_at() -> Iterator[Callable[[str, int], tuple[FullDisk, Callable[[], None]]]]:
    """Make the disk full at the nth write of a file, until the returned function makes room."""
    patch = pytest.MonkeyPatch()
    opened, opened_low, wrote_low = Path.open, os.open, os.write

    def make(name: str, nth: int) -> tuple[FullDisk, Callable[[], None]]:
        disk = FullDisk(name, nth)
        files: dict[int, FullFile] = {}

        def on_the_disk(path: Path, mode: str = "r", *arguments: Any, **more: Any) -> Any:
            if "b" not in mode or not set(mode) & set("wa"):
                return opened(path, mode, *arguments, **more)
            file = FullFile(path, mode.replace("b", ""))
            file.disk = disk
            files[file.fileno()] = file
            return file

        def on_its_number(fd: int, content: Any, /) -> int:
            file = files.get(fd)
            return wrote_low(fd, content) if file is None or file.closed else file.write(content)

        def no_new_file(path: Any, flags: int, *arguments: Any, **more: Any) -> int:
            if flags & os.O_CREAT and isinstance(path, str) and disk.strikes(path):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)
            return opened_low(path, flags, *arguments, **more)

        patch.setattr(Path, "open", on_the_disk)
        patch.setattr(os, "open", no_new_file)
        patch.setattr(os, "write", on_its_number)
        return disk, patch.undo

    yield make
    patch.undo()


def _carried_out(rig: Callable[..., Ended]) -> None:
    assert rig("dry-run", "mine.py").code == 0


def _no_half_file(folder: Path) -> None:
    assert not [path for path in folder.rglob("*") if ".part" in path.name]
    for path in folder.rglob("*.jsonl"):
        assert path.read_bytes() == b"" or path.read_bytes().endswith(b"\n")
        [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def _line(ended: Ended) -> str:
    (line,) = [line for line in ended.err.splitlines() if line.startswith("rig: ")]
    return line


@pytest.mark.parametrize("name", BEGINNING)
def test_a_disk_full_at_the_start_of_a_run_leaves_no_run_folder(
    rig: Callable[..., Ended], full_at: Callable[..., Any], tmp_path: Path, name: str
) -> None:
    disk, make_room = full_at(name, 1)
    ended = rig("dry-run", "mine.py")
    make_room()
    assert disk.struck
    assert ended.code == 2
    assert f"/{name}" in _line(ended)
    assert ": cannot be written: No space left on device, " in _line(ended)
    assert " MB free: free disk space, then repeat the command" in _line(ended)
    assert list((tmp_path / "runs").iterdir()) == []


@pytest.mark.quick(rows=lambda name, nth: not name.endswith(".csv") and (name, nth) != ("bytes.jsonl", 1))
@pytest.mark.parametrize(
    ("name", "nth"),
    [
        *((name, nth) for name in WHILE_IT_RUNS for nth in (1, 30)),
        *((name, 1) for name in ENDING[:-1]),
        (ENDING[-1], 2),
    ],
)
def test_a_run_interrupted_by_a_full_disk_is_completed_when_space_is_freed(
    rig: Callable[..., Ended], full_at: Callable[..., Any], tmp_path: Path, name: str, nth: int
) -> None:
    disk, make_room = full_at(name, nth)
    ended = rig("dry-run", "mine.py")
    make_room()
    assert disk.struck
    line = _line(ended)
    assert f"/{name}: cannot be written: No space left on device, " in line
    assert re.search(r"\s\d+ MB free[:;] free (disk )?space, then ", line)
    _no_half_file(tmp_path / "runs")
    folders = list((tmp_path / "runs").iterdir())
    if (name, nth) == ("events.jsonl", 1):  # nothing was journalled, nothing has moved
        assert (ended.code, folders) == (2, [])
        return
    (folder,) = folders
    assert ended.code == (1 if name in WHILE_IT_RUNS else 2)
    said = json.loads(ended.out)
    assert (said["run"], said["complete"]) == (str(folder.relative_to(tmp_path)), name not in WHILE_IT_RUNS)
    # the bytes end while it homes, before there is a zero that could confirm it
    assert said["ending"]["indentor"]["left"] == ("raised" if name == "bytes.jsonl" else "lifted")
    resume = line.partition("then resume with ")[2]
    assert said["ending"]["resume"] == resume == f"rig resume {folder}"
    again = rig(*shlex.split(resume)[1:])
    assert again.code == 0, again.err
    run = read_run(folder)
    assert (run.complete, run.missing, run.repeated) == (True, 0, 0)
    there = {path.name for path in folder.iterdir()}
    assert {"data.h5", "report.html", "sample.csv", "hold_end.csv", "SHA256SUMS"} <= there
    listed = {line.split("  ", 1)[1] for line in (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines()}
    assert listed == there - {"SHA256SUMS", ".lock"}


@pytest.mark.parametrize(
    ("as_what", "name"),
    [
        *(("--csv", name) for name in ("data.h5", "sample.csv", "SHA256SUMS")),
        *(("--nwb", name) for name in ("run.nwb", "SHA256SUMS")),
    ],
)
def test_an_export_on_a_full_disk_leaves_the_old_file_or_the_complete_new_one(
    rig: Callable[..., Ended], full_at: Callable[..., Any], made_once: MadeOnce, as_what: str, name: str
) -> None:
    """HDF5 that meets a full disk itself ends the program: a file is made in memory, and written by us."""
    if as_what == "--nwb":
        pytest.importorskip("pynwb", reason="needs pynwb: pip install 'indentation-rig[nwb]'")
    folder = made_once("whole", partial(_carried_out, rig))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    disk, make_room = full_at(name, 1)
    ended = rig("export", str(folder), as_what)
    make_room()
    assert disk.struck
    assert ended.code == 2
    assert f"/{name}: cannot be written: No space left on device, " in _line(ended)
    assert " MB free: free disk space, then repeat the command" in _line(ended)
    _no_half_file(folder)
    assert (folder / name).exists() is (name in before)
    assert name not in before or (folder / name).read_bytes() == before[name]
    assert rig("export", str(folder), as_what).code == 0
    assert (folder / name).stat().st_size > 0


def test_a_run_whose_lock_file_cannot_be_written_is_not_resumed(
    rig: Callable[..., Ended], full_at: Callable[..., Any], made_once: MadeOnce
) -> None:
    folder = made_once("whole", partial(_carried_out, rig))
    (folder / ".lock").unlink()
    _, make_room = full_at(".lock", 1)
    ended = rig("resume", str(folder))
    make_room()
    assert ended.code == 2
    assert "/.lock: cannot be written: No space left on device, " in _line(ended)
    assert " MB free: free disk space, then repeat the command" in _line(ended)
    assert rig("resume", str(folder)).code == 0
