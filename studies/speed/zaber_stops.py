"""How fast a virtual Zaber or Standa stage stops, and how old a position is when the program has it, in real time.

    .venv/bin/python -m studies.speed.zaber_stops [--stage standa] [--stops 200]

`rig serve` is a process of its own, behind a pseudo-terminal and behind TCP. Each stop strikes a move at 5 mm/s at a
chance instant. Measured from the call: the written bytes, the first reply, and known rest of both axes. The age of a
position is the time from its question to its value.
"""

import argparse
import json
import random
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence

import numpy as np

from rig.clock import WallClock
from rig.devices.make_drivers import stage_driver
from rig.plan.config import Config
from rig.transport import Transport, open_port

WAYS = {"pty": ["--pty"], "TCP": ["--tcp", "0"]}


class TimedWire:
    """A transport that notes when it first writes and first reads after `begin`."""

    def __init__(self, inner: Transport) -> None:
        self.name, self._inner = inner.name, inner
        self.begin()

    def begin(self) -> None:
        """From now on."""
        self.wrote_s = self.read_s = 0.0

    def write(self, data: bytes) -> None:
        self._inner.write(data)
        self.wrote_s = self.wrote_s or time.perf_counter()

    def read(self, timeout_s: float) -> bytes:
        data = self._inner.read(timeout_s)
        if data:
            self.read_s = self.read_s or time.perf_counter()
        return data

    def close(self) -> None:
        self._inner.close()


def measured(kind: str, ports: Mapping[str, str], stops: int) -> dict[str, list[float]]:
    """Seconds of each kind, of so many stops; of two ports those of z."""
    port = ports["stage"]
    own = {kind: {"x_port": ports["x_port"]}} if "x_port" in ports else {}
    config = Config.model_validate({"stage": {"kind": kind, "port": port, **own}})
    wire, clock, chance = TimedWire(open_port(port, config.stage.baud)), WallClock(), random.Random(0)
    stage = stage_driver(lambda name: wire if name == port else open_port(name, config.stage.baud), clock, config)
    stage.connect()
    found: dict[str, list[float]] = {"bytes": [], "reply": [], "rest": [], "age": []}
    for _ in range(stops):
        stage.home()
        looks = stage.moving(z_mm=-30.0, speed_mm_s=5.0, look_s=0.02)
        for _ in range(chance.randrange(2, 9)):
            next(looks)
            asked_s = time.perf_counter()
            stage.status()
            found["age"].append((time.perf_counter() - asked_s) / 2)  # two axes, one after the other
        wire.begin()
        asked_s = time.perf_counter()
        stage.stop()
        found["rest"].append(time.perf_counter() - asked_s)
        found["bytes"].append(wire.wrote_s - asked_s)
        found["reply"].append(wire.read_s - asked_s)
    stage.close()
    return found


def row(way: str, name: str, seconds: Sequence[float]) -> str:
    """Median, p99 and worst in ms."""
    median, p99 = np.percentile(seconds, (50, 99))
    return f"| {way} | {name} | {len(seconds)} | {1e3 * median:.2f} | {1e3 * p99:.2f} | {1e3 * max(seconds):.2f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stops", type=int, default=200)
    parser.add_argument("--stage", choices=("zaber", "standa"), default="zaber")
    parser.add_argument("--wire", choices=[*WAYS], action="append", help="this wire only")
    asked = parser.parse_args()
    stops = asked.stops
    print("| wire | ms from the call to | times | median | p99 | worst |\n|---|---|---|---|---|---|")
    for way, options in ((way, WAYS[way]) for way in asked.wire or WAYS):
        words = [sys.executable, "-m", "rig", "serve", "--stage", asked.stage, *options]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as serve:
            try:
                assert serve.stdout is not None
                found = measured(asked.stage, json.loads(serve.stdout.readline()), stops)
            finally:
                serve.terminate()
        for name, what in (("bytes", "written bytes"), ("reply", "first reply"), ("rest", "known rest")):
            print(row(way, what, found[name]))
        print(row(way, "a position (age)", found["age"]), flush=True)


if __name__ == "__main__":
    main()
