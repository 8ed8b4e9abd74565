"""Standa's own client, libximc of the dev extra, against the virtual controller: pseudo-terminal and TCP.

And its emulator beside the virtual controller, and the driver against the latter in real time.
"""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.devices.make_drivers import open_stage
from rig.plan.config import Config
from tests.waiting import DEADLINE_S

CLIENT = Path(__file__).parents[1] / "standa_client.py"
CONFIG = Config.model_validate({"stage": {"kind": "standa"}})
WAYS = pytest.mark.parametrize("tcp", [None, 0], ids=["pty", "tcp"])
needs_libximc = pytest.mark.skipif(find_spec("libximc") is None, reason="libximc comes with the dev extra")
MOVES = {"speed": 2000, "absolute": [200, 128], "relative": [150, 64], "below zero": [-30, -200], "zero": [0, 0]}


@contextmanager
def _served(tcp: int | None) -> Iterator[dict[str, str]]:
    """The ports of the virtual controllers, served from a thread of this process."""
    with ServedBench(CONFIG, stage="standa", force=None, tcp=tcp) as bench:
        thread = threading.Thread(target=bench.run)
        thread.start()
        try:
            yield bench.ports
        finally:
            bench.stop()
            thread.join(DEADLINE_S)
            assert not thread.is_alive()


def _client(*words: str) -> Any:
    ended = subprocess.run(
        [sys.executable, str(CLIENT), *words], capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout.splitlines()[-1])


@needs_libximc
@WAYS
def test_standas_own_client_moves_homes_and_stops_a_virtual_controller(tcp: int | None) -> None:
    with _served(tcp) as ports:
        uris = {name: f"xi-{port}" if "://" in port else f"xi-com://{port}" for name, port in ports.items()}
        found = {name: _client(uri, "all") for name, uri in uris.items()}
    for name, serial in (("stage", 10003), ("x_port", 10001)):
        assert found[name] == {
            **MOVES,
            "serial": serial,
            "new": 0,
            "homed": [True, 0, 0],
            "runs": True,
            "soft stop": [8, True, True],
            "hard stop": [5, False],
            "too fast": "ValueError",
            "speed now": 100_000,
            "unknown": "RuntimeError",
            "still there": serial,
        }


@needs_libximc
def test_its_emulator_makes_the_same_moves(tmp_path: Path) -> None:
    assert _client(f"xi-emu://{tmp_path / 'controller.bin'}") == MOVES


def test_the_driver_does_the_same_over_a_real_wire() -> None:
    with _served(tcp=0) as ports:
        own = {"x_port": ports["x_port"]}
        config = Config.model_validate({"stage": {"kind": "standa", "port": ports["stage"], "standa": own}})
        with closing(open_stage(config, WallClock())) as stage:
            stage.connect()
            stage.home()
            stage.move_to(z_mm=-2.5, speed_mm_s=5.0)
            stage.move_to(x_mm=-1.0, speed_mm_s=5.0)
            assert (stage.status().x_mm, stage.status().z_mm) == (-1.0, -2.5)
            next(stage.moving(z_mm=-20.0, speed_mm_s=5.0))
            stage.stop()
            assert not stage.homed
            assert stage.status().state == "Idle"
