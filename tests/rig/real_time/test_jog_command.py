"""`rig jog`: by a distance, by held keys, and when the process goes."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pty", reason="needs pseudo-terminals")

Rig = Callable[..., Any]


def test_jog_by_a_distance(rig: Rig, free_stage: tuple[Callable[[], float], Path]) -> None:
    x_mm, config = free_stage
    ended = rig("jog", "--config", config, "--axis", "x", "--by-mm", "-1.23", "--speed-mm-s", "5", "--json")
    assert ended.code == 0, ended.err
    assert ended.json["x_mm"] == pytest.approx(-1.23, abs=0.0026)
    assert x_mm() == pytest.approx(-1.23, abs=0.0026)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--axis", "q", "--by-mm", "1"), "--axis q: expected x, y or z"),
        (("--axis", "x"), "--axis and --by-mm: expected both of them, or neither to jog by keys"),
        (("--axis", "x", "--by-mm", "0"), "--by-mm 0: expected up to 1000 mm either way, not zero"),
        (("--axis", "x", "--by-mm", "1", "--speed-mm-s", "99"), "--speed-mm-s 99: expected 0.017 … 10"),
    ],
)
def test_what_jog_refuses(rig: Rig, tmp_path: Path, options: tuple[str, ...], complaint: str) -> None:
    config = tmp_path / "rig.toml"
    config.write_text("", encoding="utf-8")
    ended = rig("jog", "--config", config, *options)
    assert (ended.code, ended.err) == (2, f"rig: {complaint}\n")


def test_jog_beyond_the_travel_says_so(rig: Rig, free_stage: tuple[Callable[[], float], Path]) -> None:
    ended = rig("jog", "--config", free_stage[1], "--axis", "x", "--by-mm", "5")
    assert ended.code == 1
    assert "the jog target lies outside the travel" in ended.err


def start_jog(config: Path, speed_mm_s: float) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", "from rig.cli import main; main()", "jog", "--config", str(config)]
    return subprocess.Popen(
        [*command, "--speed-mm-s", str(speed_mm_s)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def hold_key(jog: subprocess.Popen[bytes], key: bytes, seconds: float) -> None:
    """As a keyboard repeats it."""
    assert jog.stdin is not None
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        jog.stdin.write(key)
        jog.stdin.flush()
        time.sleep(0.03)


def test_a_held_key_moves_and_a_released_one_stops(free_stage: tuple[Callable[[], float], Path]) -> None:
    x_mm, config = free_stage
    jog = start_jog(config, 2.0)
    try:
        assert jog.stderr is not None
        jog.stderr.readline()  # ready
        hold_key(jog, b"a", 1.0)
        time.sleep(0.7)
        out, err = jog.communicate(b"q", timeout=20)
    finally:
        jog.kill()
        jog.communicate()
    assert jog.returncode == 0, err
    assert b"state       Idle" in out
    # Held for 1 s, released after 0.15 s more; the rest is slack for a busy machine, not for a runaway.
    assert -3.2 < x_mm() < -0.5


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_the_stage_stops_when_the_process_goes(
    free_stage: tuple[Callable[[], float], Path], number: signal.Signals
) -> None:
    """Even when it is killed: no more than two slices, 2 · 4 mm/s · 0.1 s, lay ahead of where the stage was."""
    x_mm, config = free_stage
    jog = start_jog(config, 4.0)
    try:
        assert jog.stderr is not None
        jog.stderr.readline()
        hold_key(jog, b"a", 1.0)
        jog.send_signal(number)
        jog.communicate(timeout=20)
    finally:
        jog.kill()
        jog.communicate()
    at_death_mm = x_mm()
    time.sleep(0.6)
    assert at_death_mm < -0.5, "it had moved"
    assert x_mm() > at_death_mm - 0.8 - 0.01
    rest_mm = x_mm()
    time.sleep(0.3)
    assert x_mm() == rest_mm
