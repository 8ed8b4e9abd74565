"""Trinamic's own client, pytrinamic of `make clients`, against the virtual modules: pseudo-terminal and TCP.

And the driver against the same modules in real time.
"""

import json
import subprocess
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.devices.make_drivers import open_stage
from rig.plan.config import Config
from tests.clients import python_of
from tests.waiting import DEADLINE_S

CLIENT = Path(__file__).parents[1] / "tmcl_client.py"
CONFIG = Config.model_validate({"stage": {"kind": "tmcl"}})
WAYS = pytest.mark.parametrize("tcp", [None, 0], ids=["pty", "tcp"])


@contextmanager
def _served(tcp: int | None) -> Iterator[str]:
    """The port of the virtual modules, served from a thread of this process."""
    with ServedBench(CONFIG, stage="tmcl", force=None, tcp=tcp) as bench:
        thread = threading.Thread(target=bench.run)
        thread.start()
        try:
            yield next(iter(bench.ports.values()))
        finally:
            bench.stop()
            thread.join(DEADLINE_S)
            assert not thread.is_alive()


@WAYS
def test_trinamics_own_client_homes_moves_and_stops_the_virtual_modules(tcp: int | None) -> None:
    python = python_of("tmcl")
    with _served(tcp) as port:
        ended = subprocess.run(
            [str(python), str(CLIENT), port], capture_output=True, text=True, timeout=DEADLINE_S, check=False
        )
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout) == {
        "version": "1161V146",
        "searching": True,
        "homed": True,
        "home": [0, 1],
        "absolute": [True, 1000, 2000],
        "relative": [True, 744],
        "rotates": True,
        "stopped": True,
        "acceleration": 30000,
        "no parameter": 3,
        "no motor": 4,
        "no value": 4,
        "no command": 2,
        "other axis": 0,
    }


def test_the_driver_does_the_same_over_a_real_wire() -> None:
    with _served(tcp=None) as port:
        config = Config.model_validate({"stage": {"kind": "tmcl", "port": port}})
        with closing(open_stage(config, WallClock())) as stage:
            stage.connect()
            stage.home()
            stage.move_to(z_mm=-2.5, speed_mm_s=5.0)
            assert stage.status().z_mm == -2.5
            next(stage.moving(z_mm=-20.0, speed_mm_s=5.0))
            stage.stop()
            assert not stage.homed
            assert stage.status().state == "Idle"
