"""A forked program is what a Python begun anew would be."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from tests import preloaded
from tests.preloaded import Popen
from tests.waiting import DEADLINE_S, until

if not preloaded.POSSIBLE:
    pytest.skip("programs are forked on Linux only", allow_module_level=True)

SAID = f"""
import os, signal, sys, threading
print(sys.argv, sys.path[0], __name__, os.getcwd(), os.environ.get("MINE"), os.getppid(), sys.stdin.read())
print(os.getpgrp() == os.getpid(), os.getsid(0) == os.getpid(), threading.active_count(), sys.stdout.line_buffering)
print([str(signal.getsignal(int(n))) for n in {[int(n) for n in preloaded.LEFT_TO_PROGRAMS]}])
print(sorted(map(int, signal.pthread_sigmask(signal.SIG_BLOCK, []))), sys.stdout.encoding, sys.flags)
print("error", file=sys.stderr)
"""
ENDS = ("", "raise ValueError", "os.kill(os.getpid(), signal.SIGTERM)")
HOW: tuple[dict[str, Any], ...] = (
    {},
    {"env": {**os.environ, "MINE": "1"}},
    {"start_new_session": True},
)


def _ended(begin: type[subprocess.Popen[Any]], words: list[str], **how: Any) -> tuple[int, str, str | None]:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with begin([sys.executable, *words], **pipes | how, text=True) as process:
        out, err = process.communicate("typed", timeout=DEADLINE_S)
    return process.returncode, out, err and err.splitlines()[-1]


@pytest.mark.parametrize("how", HOW, ids=lambda how: "-".join(how) or "plain")
def test_a_forked_program_begins_as_a_new_python(how: dict[str, Any]) -> None:
    assert _ended(Popen, ["-c", SAID, "a", "b"], **how) == _ended(subprocess.Popen, ["-c", SAID, "a", "b"], **how)


def test_a_forked_program_runs_a_file_or_a_module_as_a_new_python(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(SAID, encoding="utf-8")
    for words in ([str(tmp_path / "mine.py"), "a"], ["-m", "mine", "a"]):
        ends = [_ended(begin, words, cwd=tmp_path) for begin in (Popen, subprocess.Popen)]
        assert ends[0][0] == 0
        assert ends[0] == ends[1]


@pytest.mark.parametrize("end", ENDS)
def test_a_forked_program_ends_as_a_new_python(end: str) -> None:
    words = ["-c", f"import os, signal, sys\nprint(1)\nsys.stdout.flush()\n{end}"]
    assert _ended(Popen, words) == _ended(subprocess.Popen, words)


@pytest.mark.parametrize("number", [signal.SIGINT])
def test_a_forked_program_inherits_ignored_and_blocked_signals(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_IGN)
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
    try:
        assert _ended(Popen, ["-c", SAID]) == _ended(subprocess.Popen, ["-c", SAID])
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(number, before)


def test_a_killed_forked_program_leaves_no_process() -> None:
    with Popen(
        [sys.executable, "-c", "import time; print(1, flush=True); time.sleep(1000)"], stdout=subprocess.PIPE
    ) as one:
        assert one.stdout is not None
        assert one.stdout.readline() == b"1\n"
        below = [int(pid) for pid in Path(f"/proc/{one.pid}/task/{one.pid}/children").read_text().split()]
        assert len(below) == 1
        one.kill()
        assert one.wait(DEADLINE_S) == -signal.SIGKILL
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in below))


def test_several_threads_can_fork_programs_at_once() -> None:
    ended: list[int] = []
    threads = [
        threading.Thread(target=lambda n=n: ended.append(_ended(Popen, ["-c", f"import sys; sys.exit({n})"])[0]))
        for n in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(ended) == [0, 1, 2, 3]
