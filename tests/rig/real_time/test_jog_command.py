"""`rig jog`: by a distance, by held keys, and when the process goes."""

import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.preloaded import Popen
from tests.waiting import DEADLINE_S, repeated, until

pytest.importorskip("pty", reason="needs pseudo-terminals")

Rig = Callable[..., Any]
FreeStage = Any  # of conftest.py


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
        for said in (b"without the force sensor", b"hold d"):  # beside progress
            assert any(said in line for line in iter(jog.stderr.readline, b""))
        yield jog
    finally:
        jog.kill()
        jog.communicate()


def hold_key(jog: subprocess.Popen[bytes], key: bytes, until_this: Callable[[], bool]) -> None:
    """As a keyboard repeats it."""
    assert jog.stdin is not None
    for _ in repeated(0.03):
        jog.stdin.write(key)
        jog.stdin.flush()
        if until_this():
            return


def test_a_held_key_moves_and_a_released_one_stops(free_stage: FreeStage) -> None:
    """After the release 0.15 s go by, with two slices of 0.1 s ahead of the stage at either end, all at 2 mm/s."""
    with jogging(free_stage.config, 2.0) as jog:
        hold_key(jog, b"a", lambda: free_stage.x_mm() < -0.5)
        released_mm = free_stage.x_mm()
        until(at_rest(free_stage))
        out, err = jog.communicate(b"q", timeout=DEADLINE_S)
    assert jog.returncode == 0, err
    assert b"state       Idle" in out
    assert released_mm - 2.0 * (0.15 + 4 * 0.1) < free_stage.x_mm() <= released_mm


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_the_stage_stops_when_the_process_goes(free_stage: FreeStage, number: signal.Signals) -> None:
    """Even when it is killed: no more than two slices, 2 · 4 mm/s · 0.1 s, lay ahead of where the stage was."""
    with jogging(free_stage.config, 4.0) as jog:
        hold_key(jog, b"a", lambda: free_stage.x_mm() < -0.5)
        jog.send_signal(number)
        jog.communicate(timeout=DEADLINE_S)
    at_death_mm = free_stage.x_mm()
    until(lambda: free_stage.state() == "Idle")
    assert at_death_mm - 0.8 - 0.01 < free_stage.x_mm() <= at_death_mm


def at_rest(stage: FreeStage) -> Callable[[], bool]:
    """Whether it has been where it is for a second, longer than its slices last."""
    seen: deque[float] = deque(maxlen=100)  # one every 10 ms

    def still() -> bool:
        seen.append(stage.x_mm())
        return len(seen) == seen.maxlen and len(set(seen)) == 1

    return still
