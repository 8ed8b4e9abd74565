"""The suite gives the same in the background, under nohup and at a terminal: no signal's fate is inherited."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import INHERITED

if not hasattr(signal, "pthread_sigmask"):
    pytest.skip("this platform blocks no signals", allow_module_level=True)

NUMBERS = [signal.Signals[name] for name in INHERITED]
DEFAULT = dict.fromkeys(NUMBERS, signal.SIG_DFL) | {signal.SIGINT: signal.default_int_handler}
DEAF = f"""
import os, signal, sys
for number in {[int(number) for number in NUMBERS]}:
    signal.signal(number, signal.SIG_IGN)
signal.pthread_sigmask(signal.SIG_BLOCK, {[int(number) for number in NUMBERS]})
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""
SAID = "import signal; print([signal.getsignal(n) == signal.SIG_IGN for n in {}], signal.pthread_sigmask(0, []))"


def test_every_signal_is_as_at_a_terminal() -> None:
    """Here, and in a program that is begun here."""
    assert {number: signal.getsignal(number) for number in NUMBERS} == DEFAULT
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, []) & set(NUMBERS)
    begun = [sys.executable, "-c", SAID.format([int(number) for number in NUMBERS])]
    said = subprocess.run(begun, capture_output=True, text=True, check=True).stdout
    assert said == f"{[False] * len(NUMBERS)} set()\n"


def test_so_it_is_where_the_suite_is_begun_with_all_of_them_ignored_and_blocked() -> None:
    """In a worker of a suite that was begun so."""
    here = f"{__file__}::{test_every_signal_is_as_at_a_terminal.__name__}"
    suite = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "1", here]
    ended = subprocess.run(
        [sys.executable, "-c", DEAF, *suite],
        cwd=Path(__file__).parents[1],
        env={key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")},
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "1 passed" in ended.stdout
