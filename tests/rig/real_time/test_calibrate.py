"""`rig calibrate`: a caliper, a known mass, and the lines for the configuration."""

import io
import threading
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.protocol.config import Config
from sim.devices import SerialLine, VirtualBalance
from sim.serve.ports import PtyPort
from sim.wall_clock import WallScheduler

pytest.importorskip("pty", reason="needs pseudo-terminals")

Rig = Callable[..., Any]


def test_steps_per_mm_with_a_caliper(rig: Rig, free_stage: tuple[Callable[[], float], Path]) -> None:
    """The board says 2 mm, the caliper 1.96: it takes 2 % more steps for a millimetre than it believes."""
    steps = ("calibrate", "steps", "--config", free_stage[1], "--axis", "x", "--by-mm", "-2", "--speed-mm-s", "5")
    ended = rig(*steps, "--json", typed="1.96\n")
    assert ended.code == 0, ended.err
    assert "the board says 2.000 mm; how many did you measure" in ended.err
    assert ended.json["name"] == "x_steps_per_mm"
    assert ended.json["value"] == pytest.approx(400 * 2 / 1.96, rel=1e-6)
    table = tomllib.loads(ended.json["toml"])["calibration"]["x_steps_per_mm"]
    assert (table["expires"] - table["date"]).days == 365
    assert Config.model_validate({"calibration": {"x_steps_per_mm": table}})
    for typed, complaint in (
        ("0.2\n", "expected a difference of 20 % at most"),
        ("two\n", "expected a number"),
        ("", "nobody"),
    ):
        ended = rig(*steps, typed=typed)
        assert (ended.code, ended.out) == (2, "")
        assert complaint in ended.err


def test_force_scale_with_a_known_mass(rig: Rig, tmp_path: Path) -> None:
    """50 g that the sensor takes for 49 g; then nothing on it, which is missed and said."""
    load_n, scheduler = [0.0], WallScheduler()
    line = SerialLine(scheduler, 115200)
    VirtualBalance(scheduler, line, lambda t_s: load_n[0])
    port = PtyPort(scheduler, line)
    loop = threading.Thread(target=scheduler.run)
    loop.start()
    config = tmp_path / "rig.toml"
    config.write_text(f'[force]\nport = "{port.name}"\nbaud = 115200\n', encoding="utf-8")

    class Hand(io.StringIO):
        def readline(self, _size: int | None = -1, /) -> str:
            load_n[0] = 49 * 9.80665e-3
            return "\n"

    weigh = ("calibrate", "force", "--config", config, "--mass-g", "50", "--json")
    try:
        weighed, missed = rig(*weigh, typed=Hand()), rig(*weigh, typed="\n")
    finally:
        scheduler.stop()
        loop.join(5.0)
        port.close()
        scheduler.close()
    assert (weighed.code, weighed.json["name"]) == (0, "force_scale")
    assert weighed.json["value"] == pytest.approx(50 / 49, rel=1e-3)
    assert missed.code == 2
    assert "expected a difference of 20 % at most" in missed.err
