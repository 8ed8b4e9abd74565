"""`rig home`, `rig jog`, `rig zero` and `rig calibrate steps` feel what they do, one process after the other."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.engine.bench_memory import BenchMemory
from rig.plan.config import load_config
from rig.units import GWT_N
from tests.waiting import read_too_late, repeated

pytest.importorskip("pty", reason="needs pseudo-terminals")

Rig = Callable[..., Any]


@pytest.fixture
def bench(whole: tuple[ServedBench, Path]) -> Path:
    """The configuration of a board and a balance with the finger between them, its apex at z = −4 mm."""
    return whole[1]


def jog(rig: Rig, config: Path, by_mm: float, *more: str) -> Any:
    return rig("jog", "--config", config, "--axis", "z", "--by-mm", by_mm, "--speed-mm-s", 5, "--json", *more)


def down_to_the_finger(rig: Rig, config: Path) -> Any:
    """As a person would: where a busy machine solves the finger too late for the balance, press again."""
    for _ in repeated(0.0):
        ended = jog(rig, config, -2.0 if ended_at(rig, config) > -2.5 else -0.5)
        if ended.code and not read_too_late(ended.err):
            return ended
    raise AssertionError


def ended_at(rig: Rig, config: Path) -> float:
    return float(rig("status", "--config", config, "--json").json["stage"]["z_mm"])


@pytest.mark.study
def test_down_to_the_finger_by_hand(rig: Rig, bench: Path) -> None:
    """What the one process has left, homed and zeroed, the next one knows; at the finger every one of them stops."""
    assert rig("home", "--config", bench, "--json").code == 0
    assert rig("zero", "--config", bench, "--json").code == 0
    refused = jog(rig, bench, -20)
    assert (refused.code, refused.json["code"]) == (2, "outside_range")
    refused = jog(rig, bench, -5)
    assert refused.code == 1
    assert "limits.max_doi_mm = 1.5" in refused.json["error_text"]
    assert refused.json["code"] == "too_deep"
    assert rig("jog", "--config", bench, "--axis", "x", "--by-mm", -2, "--speed-mm-s", 5).code == 0
    touched = down_to_the_finger(rig, bench)
    assert touched.code == 1
    found = touched.json
    assert found["ended_by_text"] in touched.err
    assert 0.05 <= found["force_gwt"] < load_config(bench).limits.soft_trip_n / GWT_N
    assert -4.5 < found["z_mm"] < -3.5
    contact = rig("zero", "--config", bench, "--json")
    assert contact.code == 1
    assert contact.json["code"]
    assert "--anyway" in contact.json["error_text"]
    assert rig("zero", "--config", bench, "--anyway").code == 0
    assert BenchMemory(load_config(bench)).read().zero is not None
    lifted = rig("zero", "--config", bench, "--json")
    assert (lifted.code, lifted.json["code"]) == (1, "zero_in_contact"), "the lift shows what the zero hides"
    assert BenchMemory(load_config(bench)).read().zero is None
    assert jog(rig, bench, 2).code == 0
    sideways = ("jog", "--config", bench, "--axis", "x", "--by-mm", -2, "--json")
    assert rig(*sideways).json["code"] == "not_zeroed"
    assert rig("zero", "--config", bench).code == 0
    at_mm = ended_at(rig, bench)
    status = rig("status", "--config", bench, "--json").json["contact"]
    assert (status["contact"], status["may_touch"]) == ("lifted", False)
    assert rig(*sideways).json["contact"] == "lifted"
    assert ended_at(rig, bench) == at_mm


@pytest.mark.parametrize(
    "command",
    [
        ("home",),
        ("jog", "--axis", "x", "--by-mm", "-1"),
        ("jog", "--axis", "z", "--by-mm", "-1"),
        ("calibrate", "steps", "--axis", "z"),
    ],
    ids=" ".join,
)
def test_without_a_sensor_nothing_moves(rig: Rig, free_stage: Any, command: tuple[str, ...]) -> None:
    """Every command that moves by hand; --without-force is the one way to move."""
    verb = command[:2] if command[0] == "calibrate" else command[:1]
    before = free_stage.x_mm()
    ended = rig(*verb, "--config", free_stage.config, *command[len(verb) :])
    assert ended.code in (1, 2)
    assert "/dev/ttyNOWHERE7" in ended.err
    assert "without-force" in ended.err
    assert free_stage.x_mm() == before
    assert "--without-force" in rig(*verb, "--help").out
