"""Processes that work for this one: in order, deaf to Ctrl-C, gone when it has no more use for them."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from sim.workers import here_and_in_processes, in_processes


def _blocked(_: int) -> bool:
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="needs masks of signals (POSIX)")
def test_worker_processes_ignore_ctrl_c() -> None:
    assert list(in_processes(_blocked, [0], 1)) == [True]
    assert not _blocked(0)


def test_worker_processes_end_when_their_results_are_closed() -> None:
    """One that sleeps for an hour is not waited for: this test would not end in time."""
    answers = in_processes(time.sleep, [0.0, 3600.0], 1)
    next(answers)
    answers.close()  # type: ignore[attr-defined]
    assert multiprocessing.active_children() == []


def _where(number: int) -> tuple[int, int]:
    return number, os.getpid()


def test_the_calling_process_works_beside_its_workers() -> None:
    """It begins with the last item, while the other one starts; every item is worked on once."""
    found = dict(here_and_in_processes(_where, range(400), 2))
    assert sorted(found) == list(range(400))
    assert found[399] == os.getpid()
    assert multiprocessing.active_children() == []


_USED_OFTEN = """
import resource
import numpy as np
from sim.workers import keep_freed_memory

def faults_after_use() -> int:
    held = [np.ones(1 << 16) for _ in range(40)]
    del held
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

keep_freed_memory()
first = faults_after_use()
for _ in range(20):
    last = faults_after_use()
print(last - first)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="mallopt is the GNU C library's")
def test_freed_memory_is_reused_without_page_faults() -> None:
    """40 arrays of half a megabyte, used and freed 20 times, are 100 000 pages without it."""
    ended = subprocess.run([sys.executable, "-c", _USED_OFTEN], capture_output=True, text=True, check=True)
    assert int(ended.stdout) < 1000
