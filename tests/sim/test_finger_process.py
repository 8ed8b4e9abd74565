"""A finger in a process of its own: it answers as the finger does, and ends with whoever began it."""

import logging
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.config import FingertipConfig
from sim.errors import ForceOutOfReachError, ModelRangeError, SimError
from sim.finger_process import FingerLostError, FingerProcess, asked
from sim.models.cache import CacheError
from sim.models.fingertip import Fingertip
from sim.models.pressing import RimError
from tests.error_codes import has_code, raises
from tests.preloaded import Popen
from tests.waiting import DEADLINE_S, until


@pytest.fixture(scope="module")
def process(finger: Fingertip) -> Iterator[FingerProcess]:
    """Of the default finger, which is in the cache."""
    with FingerProcess(finger.config) as process:
        yield process


def force_gwt(finger: Fingertip, shape: str, *, doi_mm: float) -> float:
    return finger.indent(shape, 0.3, doi_mm=doi_mm).force_gwt


def refused(finger: Fingertip, error: Exception) -> None:
    raise error


def told(finger: Fingertip) -> str:
    for level, words in ((logging.DEBUG, "building"), (logging.WARNING, "slowly, 3 %")):
        logging.getLogger("sim.models").log(level, words)
    return "built"


def about_itself(finger: Fingertip) -> dict[str, Any]:
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    handlers = {number.name: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGHUP, signal.SIGUSR1)}
    return {"pid": os.getpid(), "session": os.getsid(0), "blocked": len(blocked), "handlers": handlers}


def ends(finger: Fingertip, code: int) -> None:
    os._exit(code)


def never_ends(finger: Fingertip) -> None:
    signal.sigwait({signal.SIGALRM})


def test_a_finger_process_answers_bit_for_bit_as_the_finger(process: FingerProcess, finger: Fingertip) -> None:
    for shape, doi_mm in (("bar:3.0", 0.4), ("step:1", 0.7)):
        here = asked(finger, force_gwt, shape, doi_mm=doi_mm)
        assert (
            asked(process, force_gwt, shape, doi_mm=doi_mm)
            == here
            == finger.indent(shape, 0.3, doi_mm=doi_mm).force_gwt
        )


@pytest.mark.parametrize(
    "error",
    [
        ModelRangeError("2.5 mm deep", "deep"),
        ForceOutOfReachError("too soft"),
        RimError("wide", (1.0, 2.0), np.zeros((0, 2))),
        OSError(28, "No space left", "report.html"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_in_a_finger_process_is_raised_in_the_caller(process: FingerProcess, error: Exception) -> None:
    with pytest.raises(type(error)) as raised:
        process.ask(refused, error)
    assert raised.value.args == error.args
    if isinstance(error, SimError):
        has_code(raised.value, error.code)
    assert process.ask(force_gwt, "bar:3.0", doi_mm=0.4) > 0, "and it goes on"


def test_log_records_of_a_finger_process_are_logged_in_the_caller(
    process: FingerProcess, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.DEBUG, "sim"):
        assert process.ask(told) == "built"
    said = [(record.levelno, record.getMessage()) for record in caplog.records]
    assert said == [(logging.DEBUG, "building"), (logging.WARNING, "slowly, 3 %")]


def test_terminal_signals_do_not_reach_a_finger_process(process: FingerProcess) -> None:
    about = process.ask(about_itself)
    assert about["session"] == about["pid"] == process.pid != os.getsid(0)
    assert about["blocked"] == 0, "it can be terminated"
    assert set(about["handlers"].values()) == {signal.SIG_IGN}


def test_a_lost_finger_process_is_reported_and_started_again(finger: Fingertip) -> None:
    with FingerProcess(finger.config) as process:
        first = process.pid
        with raises(FingerLostError, "finger_lost", how="exit code 3"):
            process.ask(ends, 3)
        assert process.pid is None
        second = process.ask(about_itself)["pid"]
        assert second == process.pid != first
        os.kill(second, signal.SIGKILL)
        with raises(FingerLostError, "finger_lost", how="SIGKILL"):
            process.ask(about_itself)


def test_an_interrupted_request_to_a_finger_process_never_answers_the_next(finger: Fingertip) -> None:
    def ctrl_c(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, ctrl_c)
    try:
        with FingerProcess(finger.config) as process:
            first = process.ask(about_itself)["pid"]
            signal.setitimer(signal.ITIMER_REAL, 0.05)
            with pytest.raises(KeyboardInterrupt):
                process.ask(never_ends)
            assert process.pid is None
            assert process.ask(force_gwt, "bar:3.0", doi_mm=0.4) == force_gwt(finger, "bar:3.0", doi_mm=0.4)
            with pytest.raises(ProcessLookupError):
                os.kill(first, 0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def test_a_finger_that_cannot_be_loaded_is_an_error_at_every_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path / "file"))
    with FingerProcess(FingertipConfig()) as process:
        for _ in range(2):
            with raises(CacheError, "bad_folder", folder=str(tmp_path / "file")):
                process.ask(about_itself)


def test_a_closed_finger_process_is_gone(finger: Fingertip) -> None:
    process = FingerProcess(finger.config)
    pid = process.pid
    process.close()
    process.close()
    assert pid is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


OWNER = """
import signal, time
from sim.finger_process import FingerProcess
from sim.config import FingertipConfig
from tests.sim.test_finger_process import never_ends
if __name__ == "__main__":
    process = FingerProcess(FingertipConfig())
    print(process.pid, flush=True)
    process.ask(never_ends)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT], ids=lambda number: number.name)
def test_a_finger_process_ends_with_its_owner_during_a_request(number: signal.Signals) -> None:
    words = [sys.executable, "-c", OWNER]
    with Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as owner:
        assert owner.stdout is not None
        pid = int(owner.stdout.readline())
        owner.send_signal(number)
        owner.wait(DEADLINE_S)
    until(lambda: _gone(pid))


def _gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False
