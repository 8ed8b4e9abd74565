"""How old readings and positions are, and how fast stages stop: every kind of device, in real time.

    .venv/bin/python -m studies.devices.latencies [--stops 50] [--seconds 20]
    .venv/bin/python -m studies.devices.latencies --kind force.text_cell     # the other rows as they are stored

The virtual devices are in a process of their own, behind a pseudo-terminal and behind TCP.

- A force sensor weighs a force that tells the time. Its age is the time from the sample to the moment at which the
  engine has the reading and decides about a trip; of a filtered reading, from the middle of its samples.
- The age of a position is at most the time from its question to its value.
- A stop strikes a move at 5 mm/s at a chance instant. Measured from its call: the written bytes, and the last motion
  of the virtual stage, which the other process sees every 2 ms.
"""

import argparse
import math
import multiprocessing
import random
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from rig.bench.served import ServedBench
from rig.bench.virtual import true_carriage
from rig.clock import WallClock
from rig.devices.make_drivers import open_force, open_stage
from rig.devices.measured import COLUMNS
from rig.devices.registry import DEFAULTS, KINDS, ForceKind, StageKind, find, names
from rig.engine.sensing import read
from rig.plan.config import Config
from rig.transport import Transport
from rig.units import GWT_N
from sim.devices.line import Load, VirtualStage
from studies.posix import os
from studies.registry import read_table, show

RAMP_S, GWT_PER_S, WITHIN_S = 2.0, 50.0, 0.5
"""The force rises for so long at this rate, then it begins anew; a reading is at most so old."""
MOVES_MM, SPEED_MM_S, LOOK_S = -20.0, 5.0, 0.02
TICK_S, AT_REST_S = 0.002, 0.4
WIRES = (None, 0)
"""The number of the TCP port: none is a pseudo-terminal, 0 any free one."""


class TimedBench(ServedBench):
    """Devices whose force tells the time, and whose stage leaves the time of its last motion in `moved`."""

    def __init__(self, config: Config, moved: Any, **kinds: Any) -> None:
        self._moved = moved
        super().__init__(config, **kinds)

    def _finger(self, config: Config, board: VirtualStage, complain: Callable[[str], object]) -> Load:
        origin_s = time.monotonic() - self.scheduler.monotonic_s()
        carriage, before = true_carriage(board, config), [(math.nan, math.nan)]

        def look() -> None:
            now_s = self.scheduler.monotonic_s()
            pose = carriage.pose_at(now_s)
            at = pose.x_mm, pose.above_apex_mm
            if at != before[0]:
                before[0], self._moved.value = at, now_s + origin_s
            self.scheduler.call_at(now_s + TICK_S, look)

        look()
        return Load(lambda t_s: GWT_PER_S * GWT_N * ((t_s + origin_s) % RAMP_S))


class TimedWire:
    """A transport that notes when it first writes after `begin`."""

    def __init__(self, inner: Transport) -> None:
        self.name, self._inner, self.wrote_s = inner.name, inner, 0.0

    def write(self, data: bytes) -> None:
        self._inner.write(data)
        self.wrote_s = self.wrote_s or time.monotonic()

    def read(self, timeout_s: float) -> bytes:
        return self._inner.read(timeout_s)

    def close(self) -> None:
        self._inner.close()


def _serve(tables: dict[str, Any], kinds: Mapping[str, str], tcp: int | None, moved: Any, told: Connection) -> None:
    with TimedBench(Config.model_validate(tables), moved, tcp=tcp, **kinds) as bench:
        told.send(bench.ports)
        bench.run()


@contextmanager
def served(room: str, name: str, tcp: int | None) -> Iterator[tuple[Config, Any]]:
    """The configuration of a device that is served, beside the usual one, and the time of the last motion."""
    spawning = multiprocessing.get_context("spawn")
    kinds = {one: name if one == room else usual for one, usual in DEFAULTS.items()}
    tables = {one: {"kind": kind} for one, kind in kinds.items()}
    moved, (here, there) = spawning.Value("d", 0.0), spawning.Pipe()
    process = spawning.Process(target=_serve, args=(tables, kinds, tcp, moved, there), daemon=True)
    process.start()
    try:
        if not here.poll(60.0):
            raise SystemExit(f"{room}.{name}: not served within 60 s")
        ports = here.recv()
        found: dict[str, dict[str, Any]] = {one: {"kind": kind, "port": ports[one]} for one, kind in kinds.items()}
        if further := find(StageKind, kinds["stage"]).further_ports:
            found["stage"][kinds["stage"]] = {key: ports[key] for key in further}
        if find(ForceKind, kinds["force"]).datagrams:  # its page is at the TCP port of the same number
            found["force"][kinds["force"]] = {"http_port": int(ports["force"].rpartition(":")[2])}
        yield Config.model_validate(found), moved
    finally:
        process.terminate()
        process.join()


def of_force(config: Config, seconds: float) -> list[str]:
    """Cells of a force sensor: samples, rate, age."""
    clock, ages_s, values = WallClock(), list[float](), list[float]()
    force = open_force(config, clock)
    force.connect()
    began_s = time.monotonic()
    while (now_s := time.monotonic()) < began_s + seconds:
        shown_gwt = read(force, clock, 0.0).force_n / GWT_N
        now_s = time.monotonic()
        if not values or shown_gwt != values[-1]:
            values.append(shown_gwt)
        begun_s = now_s - now_s % RAMP_S
        if now_s - begun_s > WITHIN_S:
            ages_s.append(now_s - begun_s - shown_gwt / GWT_PER_S)
    force.close()
    return [f"{len(ages_s)}", f"{len(values) / (now_s - began_s):.0f}", *spread(ages_s), *7 * [""]]


def of_stage(config: Config, moved: Any, stops: int) -> list[str]:
    """Cells of a stage: positions, rate, age; stops, to the bytes, to rest."""
    wires, chance = list[TimedWire](), random.Random(0)

    def timed(wire: Transport) -> TimedWire:
        wires.append(TimedWire(wire))
        return wires[-1]

    stage = open_stage(config, WallClock(), guarded=timed)
    stage.connect()
    ages_s, bytes_s, rest_s = list[float](), list[float](), list[float]()
    for _ in range(stops):
        stage.home()
        looks = stage.moving(z_mm=MOVES_MM, speed_mm_s=SPEED_MM_S, look_s=LOOK_S)
        for _ in range(chance.randrange(5, 25)):
            next(looks)
            asked_s = time.monotonic()
            stage.status()
            ages_s.append(time.monotonic() - asked_s)
        for wire in wires:
            wire.wrote_s = 0.0
        asked_s = time.monotonic()
        stage.stop()
        bytes_s.append(min(wire.wrote_s for wire in wires if wire.wrote_s) - asked_s)
        while time.monotonic() < moved.value + AT_REST_S:
            time.sleep(TICK_S)
        rest_s.append(max(moved.value - asked_s, 0.0))
    stage.close()
    rate = f"{len(ages_s) / sum(ages_s):.0f}"
    return [f"{len(ages_s)}", rate, *spread(ages_s), f"{stops}", *spread(bytes_s), *spread(rest_s)]


def spread(seconds: list[float]) -> list[str]:
    """Median, p99 and worst in ms."""
    median, p99 = np.percentile(seconds, (50, 99))
    return [f"{1e3 * one:.2f}" for one in (median, p99, max(seconds))]


def wire_of(port: str) -> str:
    """The name of a wire, by its port."""
    scheme, found, _ = port.partition("://")
    return scheme.upper() if found else "pseudo-terminal"


def rows_of(room: str, name: str, stops: int, seconds: float) -> Iterator[list[str]]:
    """One row for each wire that a kind has."""
    known = set[str]()
    for tcp in WIRES:
        with served(room, name, tcp) as (config, moved):
            wire = wire_of(config.stage.port if room == "stage" else config.force.port)
            if wire not in known:
                known.add(wire)
                cells = of_stage(config, moved, stops) if room == "stage" else of_force(config, seconds)
                yield [f"{room}.{name}", wire, *cells]


def main() -> None:
    """Print the table."""
    every = [f"{of.room}.{name}" for of in KINDS for name in names(of.room) if find(of, name).twin]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stops", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each force sensor")
    parser.add_argument("--kind", choices=every, action="append", help="measure this kind only")
    asked = parser.parse_args()
    stored = [] if asked.kind is None else read_table("devices/measured")[1:]
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors", file=sys.stderr)

    def rows() -> Iterator[list[str]]:
        for kind in every:
            if asked.kind is not None and kind not in asked.kind:
                yield from (row for row in stored if row[0] == kind)
            else:
                room, _, name = kind.partition(".")
                yield from rows_of(room, name, asked.stops, asked.seconds)

    show(COLUMNS, rows())
    print(f"load {os.getloadavg()[0]:.1f}", file=sys.stderr)


if __name__ == "__main__":
    main()
