"""The suite gives the same in the background, under nohup and at a terminal: no signal's fate is inherited."""

import signal
import subprocess
import sys

import pytest

from tests.conftest import INHERITED

if not hasattr(signal, "pthread_sigmask"):
    pytest.skip("this platform blocks no signals", allow_module_level=True)

NUMBERS = [signal.Signals[name] for name in INHERITED]
DEFAULT = dict.fromkeys(NUMBERS, signal.SIG_DFL) | {signal.SIGINT: signal.default_int_handler}
SAID = "import signal; print([signal.getsignal(n) == signal.SIG_IGN for n in {}], signal.pthread_sigmask(0, []))"


def test_the_test_suite_and_its_programs_have_default_signal_handlers() -> None:
    """Here, and in a program that is begun here."""
    assert {number: signal.getsignal(number) for number in NUMBERS} == DEFAULT
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, []) & set(NUMBERS)
    begun = [sys.executable, "-c", SAID.format([int(number) for number in NUMBERS])]
    said = subprocess.run(begun, capture_output=True, text=True, check=True).stdout
    assert said == f"{[False] * len(NUMBERS)} set()\n"
