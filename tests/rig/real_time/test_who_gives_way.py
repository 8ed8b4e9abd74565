"""Processes that solve or draw while a run has its stage in hand give way to whoever passes a stop on."""

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info

import sim.finger_process as finger_process
import sim.workers as workers
from sim.config import FingertipConfig
from sim.finger_process import FingerProcess
from sim.models.fingertip import Fingertip
from sim.serve.force_process import ForceProcess

REPOSITORY = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def _finger_in_this_process() -> None:
    """A real run's finger has its process here."""


@contextmanager
def _finger(folder: Path) -> Iterator[int]:
    with FingerProcess(FingertipConfig()) as process:
        process.ask(_loaded)
        assert process.pid is not None
        yield process.pid


def _loaded(finger: Fingertip) -> None:
    """It has begun."""


BEGUN = {
    "sim/finger_process.py": (_finger, finger_process._GIVES_WAY, 5),
}
NEITHER_SOLVES_NOR_DRAWS = {
    "rig/panel/owners.py": "owns the ports itself",
    "rig/session/resume.py": "asks git",
    "rig/bluesky.py": "begins the program that owns the ports",
}
ELSEWHERE = {"rig/design/chooser.py": "tests/rig/real_time/test_choose_on_wires.py"}
NOT_BESIDE_A_STAGE = {
    "rig/plan/fresh_passes.py": "rig check, which opens no port",
    "sim/workers.py": "many presses at once, for studies, comparisons and benches",
    "sim/serve/force_process.py": "a virtual finger in real time: what a real one is to a real stage",
    "sim/benchmark.py": "rig bench",
}


def test_every_process_that_is_begun_is_one_of_these() -> None:
    """A new one that solves or draws beside a stage belongs to those that give way."""
    begins = re.compile(r"\b(Popen|ProcessPoolExecutor|\w*context\.Process|subprocess\.run|os\.fork)\(")
    found = {
        str(path.relative_to(REPOSITORY))
        for room in ("rig", "sim", "rig_shared")
        for path in (REPOSITORY / room).rglob("*.py")
        if begins.search(path.read_text(encoding="utf-8"))
    }
    assert found == {*BEGUN, *ELSEWHERE, *NEITHER_SOLVES_NOR_DRAWS, *NOT_BESIDE_A_STAGE}


def _standing() -> Callable[[None], tuple[int, int, list[int]]]:
    return lambda _: (os.getpid(), os.getsid(0), [one["num_threads"] for one in threadpool_info()])


@pytest.mark.skipif(not hasattr(os, "getpriority"), reason="needs niceness (POSIX)")
def test_a_served_finger_gives_way_to_nobody_in_a_session_of_its_own_on_one_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A device has no processor to share; two threads of small sums wait for each other's turn at one."""
    monkeypatch.setenv("OMP_NUM_THREADS", "2")  # of the process: else it might have one anyway
    process: ForceProcess[None, tuple[int, int, list[int]]] = ForceProcess(_standing)
    try:
        process.ask(None)
        pid, session, threads = process.answer()
        assert os.getpriority(os.PRIO_PROCESS, pid) == os.getpriority(os.PRIO_PROCESS, 0)
        assert session == pid
        assert set(threads) == {1}
    finally:
        process.close()


@pytest.mark.skipif(not hasattr(os, "getpriority"), reason="needs niceness (POSIX)")
@pytest.mark.parametrize("file", BEGUN)
def test_each_gives_way_within_its_session_and_with_it(file: str, tmp_path: Path) -> None:
    """Where Linux shares processors between sessions, niceness alone counts for nothing towards another one."""
    begun, by, expected = BEGUN[file]
    assert by == expected
    own = os.getpriority(os.PRIO_PROCESS, 0)
    with begun(tmp_path) as pid:
        nice = os.getpriority(os.PRIO_PROCESS, pid)
        assert nice == min(own + by, 19)
        assert os.getsid(pid) == pid != os.getsid(0)
        session = Path(f"/proc/{pid}/autogroup")
        if sys.platform == "linux" and session.exists() and os.access(session, os.W_OK):
            assert session.read_text(encoding="ascii").split()[1:] == ["nice", str(nice)]


class Session:
    """A file of the system that is refused a few times."""

    def __init__(self, *answers: OSError | None) -> None:
        self.answers, self.written = list(answers), list[str]()

    def write_text(self, text: str, encoding: str) -> None:
        self.written.append(text)
        answer = self.answers.pop(0) if self.answers else None
        if answer is not None:
            raise answer


BUSY, NONE = BlockingIOError(11, "Resource temporarily unavailable"), FileNotFoundError(2, "No such file")


@pytest.mark.parametrize(
    ("session", "tries"),
    [
        (lambda: Session(BUSY, BUSY), 3),
        (lambda: Session(NONE), 1),
    ],
    ids=["others first", "no such thing"],
)
def test_a_session_s_niceness_is_said_until_it_is_taken_or_cannot_be(
    session: Callable[[], Session], tries: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system takes one change in a tenth of a second, whoever's it is."""
    there, left = session(), list[str]()
    monkeypatch.setattr(workers, "_SESSION", there)
    monkeypatch.setattr(workers, "_AGAIN_S", 0.0)
    monkeypatch.setattr(os, "setsid", lambda: left.append("session"))
    monkeypatch.setattr(os, "nice", lambda to: to + 1)
    workers.give_way(5)
    assert left == ["session"]
    assert there.written == ["6"] * tries
