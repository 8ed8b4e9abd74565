"""Makers' own clients against the virtual stages, on a pseudo-terminal and on TCP; and our drivers on such wires.

zaber-motion and libximc come with the dev extra, pytrinamic with `make clients`. What each client does is in
tests/NAME_client.py.
"""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.devices.make_drivers import open_stage
from rig.plan.config import Config
from tests.clients import python_of
from tests.waiting import DEADLINE_S

PACKAGES = {"zaber": "zaber_motion", "standa": "libximc"}
WAYS = {"zaber": None, "standa": 0, "tmcl": None}
STANDA_MOVES = {
    "speed": 2000, "absolute": [200, 128], "relative": [150, 64], "below zero": [-30, -200], "zero": [0, 0],
}  # fmt: skip
STANDA = {
    **STANDA_MOVES,
    "new": 0,
    "homed": [True, 0, 0],
    "runs": True,
    "soft stop": [8, True, True],
    "hard stop": [5, False],
    "too fast": "ValueError",
    "speed now": 100_000,
    "unknown": "RuntimeError",
}
EXPECTED: Mapping[str, Mapping[str, Any]] = {
    "zaber": {
        "stage": {
            "devices": [1, 2],
            "device_id": "50081",
            "new": ["WR"],
            "homed": [True, 0.0],
            "absolute": 1000.0,
            "with_speed": 2000.0,
            "relative": 1500.0,
            "at_a_speed": True,
            "stopped": True,
            "too_far": "BadDataException",
            "unknown": "BadCommandException",
            "interrupted": "MovementInterruptedException",
            "with_alerts": 800.0,
        }
    },
    "standa": {
        name: {**STANDA, "serial": serial, "still there": serial}
        for name, serial in (("stage", 10003), ("x_port", 10001))
    },
    "tmcl": {
        "stage": {
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
    },
}
"""What the client finds at each port of a stage."""


@contextmanager
def _served(kind: str, tcp: int | None) -> Iterator[dict[str, str]]:
    """The ports of a virtual stage, served from a thread of this process."""
    config = Config.model_validate({"stage": {"kind": kind}})
    with ServedBench(config, stage=kind, force=None, tcp=tcp) as bench:
        thread = threading.Thread(target=bench.run)
        thread.start()
        try:
            yield bench.ports
        finally:
            bench.stop()
            thread.join(DEADLINE_S)
            assert not thread.is_alive()


def _python_with(kind: str) -> str:
    if kind not in PACKAGES:
        return str(python_of(kind))
    if find_spec(PACKAGES[kind]) is None:
        pytest.skip(f"{PACKAGES[kind]} comes with the dev extra")
    return sys.executable


def _found(kind: str, *words: str) -> Any:
    client = Path(__file__).parents[1] / f"{kind}_client.py"
    command = [_python_with(kind), str(client), *words]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout.splitlines()[-1])


def _words(kind: str, port: str) -> list[str]:
    """A port as the client is told of it."""
    if kind != "standa":
        return [port]
    return [f"xi-{port}" if "://" in port else f"xi-com://{port}", "all"]


@pytest.mark.quick(rows=lambda kind, tcp: WAYS[kind] == tcp)
@pytest.mark.parametrize("tcp", [None, 0], ids=["pty", "tcp"])
@pytest.mark.parametrize("kind", EXPECTED)
def test_the_makers_client_homes_moves_and_stops_the_virtual_stage(kind: str, tcp: int | None) -> None:
    with _served(kind, tcp) as ports:
        assert {name: _found(kind, *_words(kind, port)) for name, port in ports.items()} == EXPECTED[kind]


def test_the_emulator_of_standa_makes_the_same_moves_as_the_virtual_stage(tmp_path: Path) -> None:
    assert _found("standa", f"xi-emu://{tmp_path / 'controller.bin'}") == STANDA_MOVES


@pytest.mark.quick(rows=lambda kind, tcp: kind == "standa")  # over two ports
@pytest.mark.parametrize(("kind", "tcp"), WAYS.items())
def test_the_driver_homes_moves_and_stops_the_virtual_stage_over_a_real_wire(kind: str, tcp: int | None) -> None:
    with _served(kind, tcp) as ports:
        further = {name: port for name, port in ports.items() if name != "stage"}
        own = {kind: further} if further else {}
        config = Config.model_validate({"stage": {"kind": kind, "port": ports["stage"], **own}})
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
