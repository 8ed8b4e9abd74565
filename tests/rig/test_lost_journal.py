"""Every way to lose a run's journal or byte log in a press: it is lifted, and what was recorded is saved."""

import errno
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

import rig.session.session as sessions
from rig.bench.virtual import virtual_bench
from rig.control.owned_stage import OwnedStage
from rig.data import read_run
from rig.engine import Journal
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip
from tests.program import NEAR_HOME, Ended, Program, press_script

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = press_script("force_gwt=1.0, hold_s=0.1", "force_gwt=1.0, hold_s=0.1")


def _replaced(path: Path) -> None:
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(content)


def _moved_away(path: Path) -> None:
    path.rename(path.with_suffix(".old"))


def _shortened(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def _folder_replaced(path: Path) -> None:
    folder = path.parent
    moved = folder.with_name("elsewhere")
    folder.rename(moved)
    shutil.copytree(moved, folder)


@dataclass(frozen=True)
class Way:
    """What somebody does to a file of the run, what the one line says of it, and whether all can be saved."""

    do: Callable[[Path], object]
    says: str
    whole: bool = True
    lost: bool = True  # otherwise the folder is still the right one


FILE = {
    "deleted": Way(Path.unlink, "was deleted"),
    "moved": Way(_moved_away, "was moved"),
    "replaced": Way(_replaced, "was replaced"),
    "shortened": Way(_shortened, "was shortened", whole=False),
    "emptied": Way(lambda path: os.truncate(path, 0), "was shortened", whole=False),
}
FOLDER = {
    "folder deleted": Way(lambda path: shutil.rmtree(path.parent), "was deleted"),
    "folder moved": Way(lambda path: path.parent.rename(path.parent.with_name("elsewhere")), "was moved"),
    "folder replaced": Way(_folder_replaced, "was replaced"),
    "all runs deleted": Way(lambda path: shutil.rmtree(path.parents[1]), "was deleted"),
}
WRITES = {
    "the disk is full": Way(lambda path: errno.ENOSPC, "cannot be written", lost=False),
    "the disk fails": Way(lambda path: errno.EIO, "cannot be written", lost=False),
}


@dataclass
class Bench:
    """The program beside a script, and the moment at which something is done to the run's file."""

    program: Program
    command: str
    runs: Path
    path: Path = Path()
    done_after: int = -1
    recorded: list[tuple[str, dict[str, Any]]] = field(default_factory=list)

    def run(self) -> Ended:
        options = ["--yes"] if self.command == "run" else []
        return self.program(self.command, "mine.py", "--config", "rig.toml", *options, "--json")

    def resume(self, line: str) -> Ended:
        return self.program(*line.split()[1:], *(["--yes"] if self.command == "run" else []), "--json")


@pytest.fixture
def bench(
    request: pytest.FixtureRequest,
    finger: Fingertip,
    program: Program,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Bench:
    def open_bench(config: Any, clock: Any, log: Any, ask: Any, pause: Any, stage: Any) -> Any:
        found = virtual_bench(config, finger, log, VirtualClock(0.0, clock.monotonic_s()), pause)
        return replace(found, virtual=False)  # type: ignore[arg-type]

    monkeypatch.setattr(sessions, "open_bench", open_bench)
    monkeypatch.setattr(OwnedStage, "open", lambda stage: stage)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    for port in ("stage", "force"):
        (tmp_path / port).touch()
    ports = f"[stage]\nport = '{tmp_path / 'stage'}'\n[force]\nport = '{tmp_path / 'force'}'\n"
    (tmp_path / "rig.toml").write_text(NEAR_HOME + ports, encoding="utf-8")
    return Bench(program, getattr(request, "param", "run"), tmp_path / "runs")


@pytest.fixture
def in_contact(bench: Bench) -> Iterator[Callable[[Callable[[Path], object]], None]]:
    """Do something, once, to the run's folder when the second press is held."""
    patch, event = pytest.MonkeyPatch(), Journal.event

    def at(deed: Callable[[Path], object]) -> None:
        def seen(journal: Journal, stream: str, data: Mapping[str, Any]) -> None:
            if bench.done_after < 0 and stream == "hold_start" and data["index"] == 1:
                journal.settle()
                bench.path = journal.path.parent.absolute()
                deed(bench.path)
                bench.done_after = len(bench.recorded)
            event(journal, stream, data)
            if bench.done_after >= 0:  # as by a disk that answers before the next event
                journal.settle()
            bench.recorded.append((stream, dict(data)))

        patch.setattr(Journal, "event", seen)

    yield at
    patch.undo()


def _rescued(ended: Ended) -> Path:
    return Path(json.loads(ended.out)["run"])


def _lifted_at_once(bench: Bench, folder: Path) -> None:
    """After the deed no event was recorded, and nothing was told to go down."""
    assert len(bench.recorded) == bench.done_after, "the record that found it is not shown as recorded"
    last = read_run(folder).events["sample"][-1]["t_s"]
    wire = [json.loads(line) for line in (folder / "bytes.jsonl").read_text(encoding="ascii").splitlines()]
    sent = [bytes.fromhex(chunk["hex"]) for chunk in wire if chunk["dir"] == "tx" and chunk["t_s"] > last - 1e-5]
    assert [line for line in sent if line.startswith((b"G1", b"$J"))] == [b"G1Z0\n"], sent


NAMES = ("events.jsonl", "bytes.jsonl")
# The byte log is looked at as the journal is, and both are the same in a dry-run: of these, one of each kind.
# What is saved is the same whichever way a file is lost: one of each kind goes on.
LOST = [(f"{NAMES[0]}: {what}", NAMES[0], way) for what, way in FILE.items()]
LOST += [(f"{NAMES[1]}: {what}", NAMES[1], FILE[what]) for what in ("deleted", "replaced", "shortened")]
LOST += [(what, NAMES[0], way) for what, way in FOLDER.items()]
UNWRITTEN = [(f"{name}: {what}", name, way) for name in NAMES for what, way in WRITES.items()]
GOES_ON = ("run-events.jsonl: deleted", "run-bytes.jsonl: shortened", "run-all runs deleted",
           "run-events.jsonl: the disk fails")  # fmt: skip
TRIED_DRY = ("events.jsonl: deleted", "bytes.jsonl: the disk is full")


def _in_a_run(ways: list[tuple[str, str, Way]]) -> Any:
    """Every way in a run, some in a dry-run."""
    return pytest.mark.parametrize(
        ("bench", "name", "way"),
        [
            pytest.param(command, name, way, id=f"{command}-{what}")
            for command in ("run", "dry-run")
            for what, name, way in ways
            if command == "run" or what in TRIED_DRY
        ],
        indirect=["bench"],
    )


@_in_a_run(LOST)
def test_a_run_whose_files_are_lost_lifts_and_is_resumed_from_the_rescued_copy(
    name: str, way: Way, bench: Bench, in_contact: Callable[..., None], request: pytest.FixtureRequest
) -> None:
    in_contact(lambda folder: way.do(folder / name))
    ended = bench.run()
    assert bench.done_after > 0
    assert ended.code == 1, ended.err
    (line,) = [line for line in ended.err.splitlines() if line.startswith("rig: ")]
    assert way.says in line
    assert name in line
    if not way.whole and name == "events.jsonl":  # what somebody cut off is gone
        assert "lifted" in line or json.loads(ended.out)["ending"]["indentor"]["left"] == "lifted"
        (left,) = [path for path in bench.runs.iterdir() if "-rescued-" in path.name]
        assert str(left) in line
        assert (left / "bytes.jsonl").read_bytes() == (bench.path / "bytes.jsonl").read_bytes()
        return
    rescued = _rescued(ended)
    assert "-rescued-" in rescued.name
    assert str(rescued) in line
    said = json.loads(ended.out)
    assert said["ending"]["indentor"]["left"] == "lifted"
    assert (said["complete"], said["indentations"]) == (False, 1)
    if way.whole:
        _lifted_at_once(bench, rescued)
    assert list(read_run(rescued).done) == [0]
    if request.node.callspec.id not in GOES_ON:
        return
    again = bench.resume(said["ending"]["resume"])
    assert again.code == 0, again.err
    run = read_run(rescued)
    assert (run.complete, run.missing, run.repeated) == (True, 0, 0)


@_in_a_run(UNWRITTEN)
def test_a_run_that_cannot_write_lifts_at_the_next_record_and_stays_in_its_folder(
    name: str, way: Way, bench: Bench, in_contact: Callable[..., None], request: pytest.FixtureRequest
) -> None:
    write, failing = os.write, pytest.MonkeyPatch()

    def fails(folder: Path) -> None:
        number, there = int(str(way.do(folder))), os.stat(folder / name)

        def refused(fd: int, data: Any, /) -> int:
            if os.path.samestat(os.fstat(fd), there):
                raise OSError(number, os.strerror(number))
            return write(fd, data)

        failing.setattr(os, "write", refused)

    in_contact(fails)
    ended = bench.run()
    failing.undo()
    assert ended.code == 1, ended.err
    (line,) = [line for line in ended.err.splitlines() if line.startswith("rig: ")]
    assert way.says in line
    said = json.loads(ended.out)
    assert said["ending"]["indentor"]["left"] == "lifted"
    assert Path(said["run"]).resolve() == bench.path
    if request.node.callspec.id in GOES_ON:
        again = bench.resume(said["ending"]["resume"])
        assert again.code == 0, again.err


def test_a_run_whose_folder_is_gone_is_rescued_into_the_state_folder(
    bench: Bench, in_contact: Callable[..., None], tmp_path: Path
) -> None:
    def gone_and_in_the_way(folder: Path) -> None:
        shutil.rmtree(folder.parent)
        folder.parent.write_text("a file where the folder of runs was", encoding="utf-8")

    in_contact(gone_and_in_the_way)
    ended = bench.run()
    assert ended.code == 1, ended.err
    assert _rescued(ended).parent == tmp_path / "state" / "rescued"
    assert read_run(_rescued(ended)).done


def test_a_script_that_changes_the_working_folder_loses_no_file_of_its_run(bench: Bench) -> None:
    script = SCRIPT.replace(
        "    rig.home()", "    import os\n    here = os.getcwd()\n    os.chdir('/')\n    rig.home()"
    )
    (bench.runs.parent / "mine.py").write_text(f"{script}    os.chdir(here)\n", encoding="utf-8")
    assert bench.run().code == 0
