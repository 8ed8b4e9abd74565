"""Zaber's own client, zaber-motion of the dev extra, against the virtual chain: pseudo-terminal and TCP.

And the driver against the same chain in real time.
"""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.devices.make_drivers import open_stage
from rig.plan.config import Config
from tests.waiting import DEADLINE_S

CLIENT = Path(__file__).parents[1] / "zaber_client.py"
CONFIG = Config.model_validate({"stage": {"kind": "zaber"}})
WAYS = pytest.mark.parametrize("tcp", [None, 0], ids=["pty", "tcp"])


@contextmanager
def _served(tcp: int | None) -> Iterator[str]:
    """The port of the virtual chain, served from a thread of this process."""
    with ServedBench(CONFIG, stage="zaber", force=None, tcp=tcp) as bench:
        thread = threading.Thread(target=bench.run)
        thread.start()
        try:
            yield next(iter(bench.ports.values()))
        finally:
            bench.stop()
            thread.join(DEADLINE_S)
            assert not thread.is_alive()


@pytest.mark.skipif(find_spec("zaber_motion") is None, reason="zaber-motion comes with the dev extra")
@WAYS
def test_zabers_own_client_homes_moves_and_stops_the_virtual_chain(tcp: int | None) -> None:
    with _served(tcp) as port:
        ended = subprocess.run(
            [sys.executable, str(CLIENT), port], capture_output=True, text=True, timeout=DEADLINE_S, check=False
        )
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout) == {
        "devices": [1, 2],
        "device_id": "50081",
        "new": ["WR"],
        "homed": [True, 0.0],
        "absolute": 1000.0,
        "with_speed": 2000.0,
        "relative": 1500.0,
        "at_a_speed": True,
        "stopped": True,
        "after_two_cycles": 1500.0,
        "after_half_a_cycle": 1540.0,
        "for_ever": True,
        "after_its_cycle": 1540.0,
        "no_sine": "CommandFailedException",
        "too_large": "BadDataException",
        "pre_empted": "MovementInterruptedException",
        "too_far": "BadDataException",
        "unknown": "BadCommandException",
        "interrupted": "MovementInterruptedException",
        "with_alerts": 800.0,
    }


def test_the_driver_does_the_same_over_a_real_wire() -> None:
    with _served(tcp=None) as port:
        config = Config.model_validate({"stage": {"kind": "zaber", "port": port}})
        with closing(open_stage(config, WallClock())) as stage:
            stage.connect()
            stage.home()
            stage.move_to(z_mm=-2.5, speed_mm_s=5.0)
            assert stage.status().z_mm == -2.5
            next(stage.moving(z_mm=-20.0, speed_mm_s=5.0))
            stage.stop()
            assert not stage.homed
            assert stage.status().state == "Idle"
