"""Spikes of simulated afferents in real time: how late they arrive beside a press, and what they cost.

    .venv/bin/python -m studies.speed.live_spikes [--minutes 3]

`rig serve --afferents` runs in a process of its own. A second one presses and holds over the wire and asks the board
where it is every 20 ms; a third one listens on the port of the spikes and compares the time of each line, which is on
the monotonic clock of this computer, with the time at which it came. The round trips are measured once more without
afferents. At the end one process advances numbers of afferents as fast as it can.
"""

import argparse
import json
import socket
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np

from rig.bench.live_spikes import SAMPLE_S, IndentorPlace, LiveSpikes, PlaceTable
from rig.bench.served_spikes import LATE_S
from rig.clock import WallClock
from rig.devices.grbl import GrblStage
from rig.plan.config import Config
from rig.transport import open_port
from sim.measures.measures import MEASURES
from sim.nerve.models import BUILT_IN
from sim.nerve.population import AfferentPopulation, SimulatedAfferent, parse_afferents
from studies.posix import os
from studies.registry import show

FEW, MANY = "SA1@0,SA1@0.5,SA1@-0.5,RA@0,RA@0.5,RA@-0.5,RA@1,PC@0", "45xSA1,50xRA,5xPC"
DEEPEST_MM, INCREMENT_MM, ASKS_S = 0.8, 0.05, 0.02
HOLD_S, REST_S = 5.0, 1.0


def receive(port: int) -> None:
    """Print the time of each spike, and when it came; at the end, since a full pipe would wait."""
    heard = list[str]()
    with socket.create_connection(("127.0.0.1", port)) as client:
        for line in client.makefile(encoding="ascii"):
            came_s = time.monotonic()
            if ",spike," in line:
                heard.append(f"{line.partition(',')[0]} {came_s}")
    print(*heard, sep="\n")


def press(port: str, seconds: float) -> list[float]:
    """Press and hold again and again; return the round trips of the status (s)."""
    config, clock = Config(), WallClock()
    frame, stage, trips_s = config.frame, GrblStage(open_port(port, config.stage.baud), clock), list[float]()
    stage.connect()
    stage.home()
    stage.move_to(x_mm=frame.pad_centre_x_mm, y_mm=frame.pad_y_mm, speed_mm_s=5.0)
    stage.move_to(z_mm=frame.apex_z_mm + 1.0, speed_mm_s=5.0)
    clock.wait_s(20.0)  # until the finger is pressed for the table
    ends_s = clock.monotonic_s() + seconds

    def ask(until_s: float) -> None:
        while clock.monotonic_s() < until_s:
            began = time.perf_counter()
            stage.status()
            trips_s.append(time.perf_counter() - began)
            clock.wait_s(ASKS_S)

    while clock.monotonic_s() < ends_s:
        for depth_mm in np.arange(-0.2, DEEPEST_MM + 1e-9, INCREMENT_MM):
            stage.move_to(z_mm=frame.apex_z_mm - float(depth_mm), speed_mm_s=1.0)
            ask(clock.monotonic_s() + ASKS_S)
        ask(clock.monotonic_s() + HOLD_S)
        stage.move_to(z_mm=frame.apex_z_mm + 1.0, speed_mm_s=5.0)
        ask(clock.monotonic_s() + REST_S)
    stage.close()
    return trips_s


def served(seconds: float, afferents: str | None) -> tuple[list[float], list[tuple[float, float]], str]:
    """Return round trips (s), time and arrival of each spike (s), and what the server says of itself."""
    more = () if afferents is None else ("--afferents", afferents)
    command = [sys.executable, "-m", "rig", "serve", "--tcp", "0", "--indentor", "bar:3.0", *more]
    serve = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert serve.stdout is not None
    ports = json.loads(serve.stdout.readline())
    listener = None
    if afferents is not None:
        words = ["--receive", ports["spikes"].rpartition(":")[2]]
        command = [sys.executable, "-m", "studies.speed.live_spikes", *words]
        listener = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        trips_s = press(ports["stage"], seconds)
        time.sleep(1.0)
    finally:
        serve.terminate()
        _, said = serve.communicate(timeout=60)
    heard = "" if listener is None else listener.communicate(timeout=60)[0]
    rows = [line.split() for line in heard.splitlines()]
    return trips_s, [(float(due_s), float(came_s)) for due_s, came_s in rows], said.strip().splitlines()[-1]


def count_of(afferents: str) -> int:
    """Return the number of afferents in a text."""
    return sum(one.count for one in parse_afferents(afferents))


def cost(count: int, seconds: float = 4.0) -> float:
    """Return the processor time per second of so many afferents under a press (s/s)."""
    kinds = ("SA1", "RA") * (count // 2) + ("SA1",) * (count % 2)
    afferents = AfferentPopulation(
        [
            SimulatedAfferent(name, k, 0.0, 0.0, 1.0 + k % 5, 50.0, 0.0015, k, BUILT_IN[name].organs * ((0.0, 0.0),))
            for k, name in enumerate(kinds)
        ]
    )
    organs = sum(map(len, afferents.organs))
    depths_mm = (0.1, 0.5, 1.0, 1.5)
    values = [afferents.measure(dict.fromkeys(MEASURES, np.full(organs, 150 * mm**2))) for mm in depths_mm]
    live = LiveSpikes(afferents, lambda place: None)
    live.take(PlaceTable(IndentorPlace(0.0, 0.0), 0.0, depths_mm, np.array(values)))
    times = SAMPLE_S * np.arange(round(seconds / SAMPLE_S))
    above = 1.0 - np.interp(times, [0.2, 1.0, seconds - 1.0, seconds], [0.0, 1.6, 1.6, 0.0])
    began_s = 0.0
    for k, (t_s, height_mm) in enumerate(zip(times.tolist(), above.tolist(), strict=True)):
        if k == 100:
            began_s = time.process_time()
        live.known(t_s, 0.0, height_mm, 0.0)
        if k % 4 == 3:
            live.advance()
    return (time.process_time() - began_s) / (seconds - 100 * SAMPLE_S)


def spread(seconds: Sequence[float]) -> dict[str, str]:
    """Return columns for a distribution (ms)."""
    names = {"median (ms)": 50, "99 % (ms)": 99, "99.9 % (ms)": 99.9, "worst (ms)": 100}
    return {name: f"{1e3 * np.percentile(seconds, share):.2f}" for name, share in names.items()}


def table(rows: Sequence[dict[str, str]]) -> None:
    """Print rows as a table."""
    show(list(rows[0]), [list(row.values()) for row in rows])
    print()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.speed.live_spikes")
    parser.add_argument("--minutes", type=float, default=3.0)
    parser.add_argument("--receive", type=int, metavar="PORT", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.receive is not None:
        receive(options.receive)
        return
    rows, trips = list[dict[str, str]](), dict[str, list[float]]()
    for afferents in (FEW, MANY):
        trips[f"with {count_of(afferents)}"], spikes, said = served(60 * options.minutes, afferents)
        load = os.getloadavg()[0]
        print(f"the server says: {said}")
        behind_s = [came_s - due_s for due_s, came_s in spikes]
        late = sum(one > LATE_S for one in behind_s)
        rows.append(
            {
                "afferents": str(count_of(afferents)),
                "processes that wait": f"{load:.1f}",
                "minutes": f"{options.minutes:g}",
                "spikes": str(len(spikes)),
                **spread(behind_s),
                f"later than {1000 * LATE_S:g} ms (%)": f"{100 * late / len(spikes):.2f}",
            }
        )
    trips["without"], _, _ = served(60 * options.minutes, None)
    table(rows)
    table(
        [
            {"afferents": name, "status requests": str(len(one)), **spread(one)}
            for name, one in sorted(trips.items(), reverse=True)
        ]
    )
    table([{"afferents": str(count), "processor time (s/s)": f"{cost(count):.2f}"} for count in (10, 100, 200, 400)])


if __name__ == "__main__":
    main()
