"""`rig serve` in real time: does a client get the force at the promised rate, and how late are the answers?

    .venv/bin/python -m studies.speed.serve_latency [--minutes 10] [--tcp]

One client asks the balance for its weight at the rate at which it has new ones; another presses the finger again and
again and asks the board where it is. A force that takes longer to solve than it is foreseen is given as the last one
known: the last line says how many were.
"""

import argparse
import json
import math
import subprocess
import sys
import threading
import time

import numpy as np

from rig.clock import WallClock
from rig.devices.base import ForceBusy
from rig.devices.grbl import GrblStage
from rig.devices.mtsics import MtSicsForce
from rig.plan.config import Config
from rig.transport import open_port

DEEPEST_MM, INCREMENT_MM = 0.8, 0.05


def press_for_ever(port: str, config: Config, round_trips_s: list[float], over: threading.Event) -> None:
    """Home, go to the pad's centre, then down and up in increments; one status request every 20 ms meanwhile."""
    clock, frame = WallClock(), config.frame
    stage = GrblStage(open_port(port, config.stage.baud), clock)
    stage.connect()
    stage.home()
    stage.move_to(x_mm=frame.pad_centre_x_mm, y_mm=frame.pad_y_mm, speed_mm_s=10.0)
    stage.move_to(z_mm=frame.apex_z_mm, speed_mm_s=5.0)
    depth_mm, way = 0.0, INCREMENT_MM
    while not over.is_set():
        depth_mm += way
        way = -way if not 0 < depth_mm < DEEPEST_MM else way
        stage.move_to(z_mm=frame.apex_z_mm - depth_mm, speed_mm_s=1.0)
        for _ in range(3):
            began = time.perf_counter()
            stage.status()
            round_trips_s.append(time.perf_counter() - began)
            clock.wait_s(0.02)
    stage.move_to(z_mm=frame.apex_z_mm + 2.0, speed_mm_s=5.0)
    stage.close()


def poll(port: str, config: Config, seconds: float) -> tuple[list[float], list[float], float]:
    """Ask at the sensor's own rate; the delays (s), the forces (N, NaN where refused), and how long it took."""
    clock, period_s = WallClock(), config.force.sample_period_s
    force = MtSicsForce(open_port(port, config.force.baud), clock, sample_period_s=period_s)
    force.connect()
    delays_s, forces_n = [], []
    began_s = next_s = clock.monotonic_s()
    while next_s < began_s + seconds:
        clock.wait_s(next_s - clock.monotonic_s())
        asked_s = time.perf_counter()
        try:
            forces_n.append(force.read().force_n)
        except ForceBusy:
            forces_n.append(math.nan)
        delays_s.append(time.perf_counter() - asked_s)
        next_s += period_s
    took_s = clock.monotonic_s() - began_s
    force.close()
    return delays_s, forces_n, took_s


def told(name: str, seconds: list[float]) -> str:
    p50, p99, worst = 1e3 * np.percentile(seconds, [50, 99, 100])
    return f"| {name} | {len(seconds)} | {p50:.1f} | {p99:.1f} | {worst:.1f} |"


def main() -> None:
    """Print the rates, the delays, and what the server says of itself."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--tcp", action="store_true")
    options = parser.parse_args()
    config = Config()
    command = [sys.executable, "-c", "from rig.cli import main; main()", "serve", *(["--tcp", "0"] * options.tcp)]
    serve = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert serve.stdout is not None
        ports = json.loads(serve.stdout.readline())
        round_trips_s: list[float] = []
        over = threading.Event()
        presser = threading.Thread(target=press_for_ever, args=(ports["stage"], config, round_trips_s, over))
        presser.start()
        delays_s, forces_n, took_s = poll(ports["force"], config, 60 * options.minutes)
        over.set()
        presser.join(60.0)
    finally:
        serve.terminate()
        _, said = serve.communicate(timeout=30)
    promised, touching = 1 / config.force.sample_period_s, np.mean(np.array(forces_n) > 0)
    answered = np.count_nonzero(np.isfinite(forces_n))
    wire = "TCP" if options.tcp else "pseudo-terminals"
    print(f"{took_s:.0f} s over {wire}, in contact {touching:.0%} of the readings")
    print(
        f"promised {promised:.2f} readings/s, achieved {answered / took_s:.2f}, {len(forces_n) - answered} refused\n"
    )
    print("| answer | requests | p50 (ms) | p99 (ms) | max (ms) |\n|---|---|---|---|---|")
    print(told("`SI`, force", delays_s))
    print(told("`?`, status", round_trips_s))
    print(f"\nserver: {said.strip()}")


if __name__ == "__main__":
    main()
