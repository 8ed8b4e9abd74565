"""A real run in a process of its own, at each key of a terminal while it holds a press: it lifts, and then ends."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rig.bench.served import ServedBench
from rig.data import read_run
from tests.preloaded import Popen
from tests.program import WHOLE
from tests.waiting import DEADLINE_S, journal_says, until

pytest.importorskip("pty", reason="needs pseudo-terminals")


@contextmanager
def _in_the_background() -> Iterator[None]:
    """As a shell without job control begins a program with `&`: with these ignored."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGQUIT)}
    try:
        yield
    finally:
        for number, then in before.items():
            signal.signal(number, then)


@pytest.mark.quick(rows=lambda name: name == "SIGTSTP")  # the others: rig/test_every_signal.py
@pytest.mark.parametrize("name", ["SIGINT", "SIGTSTP", "SIGQUIT"])
def test_it_lifts_first(name: str, whole: tuple[ServedBench, Path], tmp_path: Path) -> None:
    _, config = whole
    command = [sys.executable, WHOLE, "run", "first_press"]
    with _in_the_background():
        run = Popen(
            [*command, "presses=1", "hold_s=30", "--yes", "--config", str(config), "--out", str(tmp_path / "runs")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    try:
        assert run.stdin is not None
        run.stdin.write("\n")
        run.stdin.flush()
        until(journal_says(tmp_path / "runs", '"hold_start"'))
        run.send_signal(signal.Signals[name])
        _, err = run.communicate(timeout=DEADLINE_S)
    finally:
        run.kill()
        run.communicate()
    assert run.returncode == 130, err
    (folder,) = (tmp_path / "runs").iterdir()
    found = read_run(folder)
    assert found.events["paused"]
    assert found.stop is not None
    assert (found.stop["status"], found.stop["indentor"]["left"]) == ("aborted", "lifted")
