"""`rig study` over a real dask cluster on the loopback: scheduler, workers and program are processes of their own."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from rig.study.exceptions import WorkersError
from rig.study.parallel import spread
from tests.error_codes import raises
from tests.preloaded import Popen
from tests.program import Program, beside_progress
from tests.waiting import DEADLINE_S, until

# distributed is imported by the tests alone, since every worker collects this file; a client's sockets are closed by
# the garbage collector
pytestmark = [
    pytest.mark.skipif(
        find_spec("distributed") is None, reason="needs dask.distributed: pip install 'indentation-rig[cluster]'"
    ),
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.timeout(5 * DEADLINE_S),
]

MANY_PLACES = """\
[[press]]
shape = "bar:3.0"
x_mm = [{places}]
doi_mm = [0.1, 0.2, 0.3, 0.4]
""".format(places=", ".join(f"{0.25 * k - 0.5:.2f}" for k in range(5)))
CASES = 2 * 4

SCHEDULER = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
WORKER = "from distributed.cli.dask_worker import main; main()"
WORKER_HELD_AT_A_CASE = f"""\
import os, pathlib, time
from rig.study import parameter_study as cases

solve = cases.solve

def held(case):
    if pathlib.Path("solved").exists():
        pathlib.Path(f"{{os.getpid()}}.held").touch()
        while not pathlib.Path("let go").exists():
            time.sleep(0.01)
    rows = solve(case)
    pathlib.Path("solved").touch()
    return rows

cases.solve = held
{WORKER}
"""
"""After another case is done, until the test lets it go."""
WORKER_OF_ANOTHER_VERSION = f"""\
import importlib.metadata as metadata
known = metadata.version
metadata.version = lambda name: "0.0.1" if name == "indentation-rig" else known(name)
{WORKER}
"""
RIG = [sys.executable, "-c", "from rig.cli import main; main()"]


@dataclass
class Cluster:
    """A scheduler and its workers, each in a process that a test may kill."""

    folder: Path
    scheduler: subprocess.Popen[bytes] = field(init=False)
    address: str = field(init=False)
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        told = self.folder / "scheduler.json"
        self.scheduler = self._start([*SCHEDULER, "--no-dashboard", "--scheduler-file", str(told)])
        self.address = until(lambda: _address(told), self._log)

    def add_worker(self, code: str = WORKER) -> None:
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
        self.workers.append(self._start([sys.executable, "-c", code, self.address, *options]))

    def client(self) -> Any:
        from distributed import Client

        client = Client(self.address, timeout=DEADLINE_S)
        client.wait_for_workers(len(self.workers), timeout=DEADLINE_S)
        return client

    def worker_at_a_case(self) -> subprocess.Popen[bytes]:
        """The process of one that is inside solve() until it is let go, after another case is done."""
        (held, *_) = until(lambda: list(self.folder.glob("*.held")), self._log)
        return next(process for process in self.workers if process.pid == int(held.stem))

    def let_go(self) -> None:
        (self.folder / "let go").touch()

    def stop(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait(DEADLINE_S)

    def _start(self, words: Sequence[str]) -> subprocess.Popen[bytes]:
        with (self.folder / "log.txt").open("ab") as log:
            return Popen(words, stdout=log, stderr=log, cwd=self.folder)

    def _log(self) -> str:
        return (self.folder / "log.txt").read_text()


def _address(told: Path) -> str | None:
    """From the scheduler's file, which is there before it is written."""
    try:
        return str(json.loads(told.read_text())["address"])
    except (FileNotFoundError, json.JSONDecodeError):
        return None


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler without workers."""
    running = Cluster(tmp_path)
    yield running
    running.stop()


def start_study(folder: Path, *options: str) -> subprocess.Popen[str]:
    words = [*RIG, "study", "study.toml", "--json", *options]
    return Popen(words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def study(tmp_path: Path, coarse_fingers: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a study of eight cases, with a cache of its own that all processes share."""
    (tmp_path / "study.toml").write_text(coarse_fingers + MANY_PLACES, encoding="utf-8")
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path


def test_a_worker_killed_at_a_case_changes_no_byte(
    study: Path, cluster: Cluster, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster.add_worker(WORKER_HELD_AT_A_CASE)
    cluster.add_worker(WORKER_HELD_AT_A_CASE)
    monkeypatch.setattr("rig.cli.study.spread", lambda function, items, *_: map(function, items))
    expected = program("study", study / "study.toml", "--json", "--out", study / "here.csv").json
    with cluster.client() as client:
        running = start_study(study, "--scheduler", cluster.address, "--out", "cluster.csv")
        killed = cluster.worker_at_a_case()
        killed.send_signal(signal.SIGKILL)
        assert killed.wait(DEADLINE_S) == -signal.SIGKILL
        cluster.let_go()
        out, err = running.communicate(timeout=2 * DEADLINE_S)
        assert len(client.nthreads()) == 1
    assert (running.returncode, beside_progress(err)) == (0, "")
    assert (study / "cluster.csv").read_bytes() == (study / "here.csv").read_bytes()
    answer = json.loads(out)
    assert (answer["cases"], answer["problems"]) == (CASES, 0)
    same = ("cases", "rows", "problems")
    assert [answer[key] for key in same] == [expected[key] for key in same]


def test_a_scheduler_that_dies_midway_leaves_one_line_and_no_file(study: Path, cluster: Cluster) -> None:
    cluster.add_worker(WORKER_HELD_AT_A_CASE)
    program = start_study(study, "--scheduler", cluster.address)
    cluster.worker_at_a_case()
    cluster.scheduler.kill()
    out, err = program.communicate(timeout=2 * DEADLINE_S)
    told = json.loads(out)
    assert (program.returncode, told["code"]) == (2, "scheduler_gone")
    assert told["error_text"].startswith(f"--scheduler {cluster.address}: ")
    assert err.splitlines()[-1] == f"rig: {told['error_text']}"
    assert not list(study.glob("study.csv*"))


def test_a_worker_with_another_program_is_named(study: Path, cluster: Cluster) -> None:
    from rig.study import dask_cluster

    cluster.add_worker(WORKER_OF_ANOTHER_VERSION)
    out, err = (program := start_study(study, "--scheduler", cluster.address)).communicate(timeout=2 * DEADLINE_S)
    told = json.loads(out)
    assert (program.returncode, told["code"]) == (2, "other_program")
    for named in (
        f"--scheduler {cluster.address}: ",
        "tcp://127.0.0.1:",
        "indentation-rig 0.0.1 (",
        dask_cluster.program(),
    ):
        assert named in told["error_text"]
    assert beside_progress(err) == f"rig: {told['error_text']}\n"
    assert not list(study.glob("study.csv*"))


def test_workers_that_have_all_gone_are_not_waited_for(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.study.dask_cluster._PATIENCE_S", 0.5)
    cluster.add_worker()
    cluster.client().close()
    with raises(WorkersError, "no_workers", scheduler=cluster.address):
        list(spread(os._exit, [1], scheduler=cluster.address))  # whoever does it dies of it


def test_a_cluster_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.study.dask_cluster._CONNECT_S", 0.5)
    with raises(WorkersError, "no_answer", scheduler="tcp://127.0.0.1:9"):
        list(spread(abs, [1], scheduler="tcp://127.0.0.1:9"))
