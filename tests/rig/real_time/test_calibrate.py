"""`rig calibrate`: a caliper, a known mass, and the lines for the configuration."""

import io
import tomllib
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest

from rig.engine.bench_memory import BenchMemory
from rig.engine.sensing import ForceZero
from rig.plan.config import Config, load_config
from sim.devices import Load, SerialLine, VirtualBalance
from sim.serve.ports import PtyPort
from sim.serve.real_time_loop import WallScheduler

pytest.importorskip("pty", reason="needs pseudo-terminals")

Rig = Callable[..., Any]
Running = Callable[..., AbstractContextManager[None]]


def test_steps_per_mm_with_a_caliper(rig: Rig, free_stage: Any) -> None:
    """The board says 2 mm, the caliper 1.96: it takes 2 % more steps for a millimetre than it believes."""
    steps = (
        "calibrate",
        "steps",
        "--config",
        free_stage.config,
        "--axis",
        "x",
        "--by-mm",
        "-2",
        "--speed-mm-s",
        "5",
        "--without-force",
    )
    ended = rig(*steps, "--json", typed="1.96\n")
    assert ended.code == 0, ended.err
    assert "2.000 mm" in ended.err
    assert ended.json["name"] == "x_steps_per_mm"
    assert ended.json["value"] == pytest.approx(400 * 2 / 1.96, rel=1e-6)
    table = tomllib.loads(ended.json["toml"])["calibration"]["x_steps_per_mm"]
    assert (table["expires"] - table["date"]).days == 365
    assert Config.model_validate({"calibration": {"x_steps_per_mm": table}})
    for typed, code in (("0.2\n", "correction_too_large"), ("two\n", "not_a_number"), ("", "nobody_answered")):
        ended = rig(*steps, "--json", typed=typed)
        assert (ended.code, ended.json["code"]) == (2, code)


def test_force_scale_with_a_known_mass(rig: Rig, running: Running, tmp_path: Path) -> None:
    """50 g that the sensor takes for 49 g; then nothing on it, which is missed and said."""
    load_n, scheduler = [0.0], WallScheduler()
    line = SerialLine(scheduler, 115200)
    VirtualBalance(scheduler, line, Load(lambda t_s: load_n[0]))
    port = PtyPort(scheduler, line)
    config = tmp_path / "rig.toml"
    config.write_text(f'[force]\nport = "{port.name}"\nbaud = 115200\n', encoding="utf-8")

    class Hand(io.StringIO):
        def readline(self, _size: int | None = -1, /) -> str:
            load_n[0] = 49 * 9.80665e-3
            return "\n"

    weigh = ("calibrate", "force", "--config", config, "--mass-g", "50", "--json")
    memory = BenchMemory(load_config(config))
    memory.record_zero(ForceZero(0.2, 0.0))
    with running(scheduler, port):
        weighed, missed = rig(*weigh, typed=Hand()), rig(*weigh, typed="\n")
    assert memory.read().zero is None, "the sensor was zeroed, and may since have been turned over"
    assert (weighed.code, weighed.json["name"]) == (0, "force_scale")
    assert weighed.json["value"] == pytest.approx(50 / 49, rel=1e-3)
    assert (missed.code, missed.json["code"]) == (2, "correction_too_large")


def test_compliance_on_a_block(rig: Rig, block: tuple[float, Callable[..., Path]]) -> None:
    """Within three standard deviations; a step of 2.5 µm (over √12) and twenty steps in 1 N make some 0.0005 mm/N."""
    mm_per_n, rig_toml = block
    press = ("calibrate", "compliance", "--config", rig_toml(search_mm=0.1), "--to-gwt", 100, "--valid-days", 30)
    ended = rig(*press, "--json", typed="\n\n")
    assert ended.code == 0, ended.err
    assert " 100 gwt" in ended.err
    found = ended.json
    assert found["name"] == "compliance_mm_per_n"
    assert 0 < found["sd"] < 0.1 * mm_per_n
    assert abs(found["value"] - mm_per_n) < 3 * found["sd"]
    table = tomllib.loads(found["toml"])["calibration"]["compliance_mm_per_n"]
    assert (table["expires"] - table["date"]).days == 30
    accepted = Config.model_validate({"calibration": {"compliance_mm_per_n": table}}).calibration
    assert accepted.value("compliance_mm_per_n", 0.0) == pytest.approx(found["value"], rel=1e-3)


def test_a_force_beyond_the_trip(rig: Rig, block: tuple[float, Callable[..., Path]]) -> None:
    """100 gwt are asked for and the rig may not go beyond 0.3 N: it trips, lifts and says so."""
    press = ("calibrate", "compliance", "--config", block[1](search_mm=0.1, soft_trip_n=0.3))
    ended = rig(*press, "--json", typed="\n\n")
    assert ended.code == 1
    assert ended.json["code"]
    assert "soft trip" in ended.json["error_text"]
