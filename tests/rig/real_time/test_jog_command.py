"""`rig jog`: by a distance, by keys, and when the process goes."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from rig.clock import WallClock
from tests.preloaded import Popen
from tests.waiting import DEADLINE_S, until

pytest.importorskip("pty", reason="needs pseudo-terminals")

Rig = Callable[..., Any]
FreeStage = Any  # of conftest.py
CLOCK = WallClock()


def test_jog_by_a_distance(rig: Rig, free_stage: FreeStage) -> None:
    by_hand = ("--axis", "x", "--by-mm", "-1.23", "--speed-mm-s", "5", "--without-force")
    ended = rig("jog", "--config", free_stage.config, *by_hand, "--json")
    assert ended.code == 0, ended.err
    assert ended.json["x_mm"] == pytest.approx(-1.23, abs=0.0026)
    assert free_stage.x_mm() == pytest.approx(-1.23, abs=0.0026)


def test_jog_beyond_the_travel_says_so(rig: Rig, free_stage: FreeStage) -> None:
    ended = rig("jog", "--config", free_stage.config, "--axis", "x", "--by-mm", "5", "--without-force", "--json")
    assert ended.code == 1
    assert ended.json["error_text"]
    assert ended.json["code"]
    assert free_stage.x_mm() == 0.0


@contextmanager
def jogging(config: Path, speed_mm_s: float) -> Iterator[subprocess.Popen[bytes]]:
    """`rig jog` in a process of its own, once it is ready for keys."""
    command = [sys.executable, "-c", "from rig.cli import main; main()", "jog", "--config", str(config)]
    jog = Popen(
        [*command, "--speed-mm-s", str(speed_mm_s), "--without-force"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert jog.stderr is not None
        for said in (b"without the force sensor", b"d/a steps"):  # beside progress
            assert any(said in line for line in iter(jog.stderr.readline, b""))
        yield jog
    finally:
        jog.kill()
        jog.communicate()


def press(jog: subprocess.Popen[bytes], keys: bytes) -> None:
    assert jog.stdin is not None
    jog.stdin.write(keys)
    jog.stdin.flush()


def test_each_key_makes_a_step_and_q_ends_it(free_stage: FreeStage) -> None:
    with jogging(free_stage.config, 2.0) as jog:
        press(jog, b"4")
        for to_mm in (-0.5, -1.0):
            CLOCK.wait_s(0.3)
            press(jog, b"a")
            until(lambda to_mm=to_mm: free_stage.x_mm() == pytest.approx(to_mm, abs=0.003))
        out, err = jog.communicate(b"q", timeout=DEADLINE_S)
    assert jog.returncode == 0, err
    assert b"state       Idle" in out
    assert free_stage.x_mm() == pytest.approx(-1.0, abs=0.003)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_a_process_that_goes_in_a_step_leaves_that_step(free_stage: FreeStage, number: signal.Signals) -> None:
    """Killed, it cannot end the step: the board does, after 5 mm at most."""
    with jogging(free_stage.config, 4.0) as jog:
        press(jog, b"6")
        CLOCK.wait_s(0.3)
        press(jog, b"a")
        until(lambda: free_stage.x_mm() < -0.5)
        jog.send_signal(number)
        jog.communicate(timeout=DEADLINE_S)
    until(lambda: free_stage.state() == "Idle")
    assert -5.003 < free_stage.x_mm() < -0.5
