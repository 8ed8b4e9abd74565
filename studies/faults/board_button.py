"""How long a stop button on the stage's controller takes: to the stop's bytes, and to the carriage at rest.

    .venv/bin/python -m studies.faults.board_button --presses 50

On the virtual clock, at drawn instants of approaches, presses and holds. The controller stops by itself; the program
hears of it at its next look and sends the stop besides.
"""

import argparse
import contextlib
import io
import json
import random
from statistics import median
from typing import Any

from rig.bench.virtual import VirtualBench, bench_around
from rig.data.journal import NoJournal
from rig.engine import Engine, PressId, RunAborted, verbs
from rig.plan.config import Config
from rig.session.hardware_stop import stop_inputs_heeded
from rig.units import GWT_N
from sim.carriage import Carriage, TruePose
from sim.devices.clock import VirtualClock

BUTTONS = {"door": "grbl", "hold": "grbl", "di1": "leadshine"}
STOP = {"grbl": "2118", "leadshine": "6002"}
_K_GWT, _CONTACT_MM, _FORCE_GWT = 6.0, -0.3, 5.0
_READY_S, _LASTS_S = 30.0, 12.0


class SpringFinger:
    """A finger that costs nothing: F = k d^1.5."""

    def __init__(self, carriage: Carriage) -> None:
        self._carriage = carriage

    def mount(self, indentor: str) -> None:
        """It presses alike."""

    def pose_at(self, t_s: float) -> TruePose:
        """Of no use here."""
        raise NotImplementedError

    def force_n(self, t_s: float) -> float:
        """Of the spring."""
        depth_mm = _CONTACT_MM - self._carriage.pose_at(t_s).above_apex_mm
        return float(_K_GWT * max(depth_mm, 0.0) ** 1.5 * GWT_N)


def pressed(name: str, after_s: float) -> tuple[float, float]:
    """Press so long after the indentor begins to go down; s to the stop's bytes, and to the carriage at rest."""
    kind = BUTTONS[name]
    force = {"kind": "laumas", "baud": 115200} if kind == "leadshine" else {"kind": "mtsics"}
    stop = {"kind": "board", "input": name}
    config = Config.model_validate({"stage": {"kind": kind}, "force": force, "stop": stop})
    clock, wire = VirtualClock(1.7e9), io.StringIO()
    bench = bench_around(SpringFinger, config, clock, wire)
    board: Any = bench.board
    at_s = 0.0

    def press() -> None:
        nonlocal at_s
        at_s = clock.monotonic_s()
        board.press(name)

    with contextlib.suppress(RunAborted):
        _work(config, bench, lambda: clock.call_at(clock.monotonic_s() + after_s, press))
    lines = map(json.loads, wire.getvalue().splitlines())
    sent_s = min(
        line["t_s"] for line in lines if line["dir"] == "tx" and STOP[kind] in line["hex"] and line["t_s"] >= at_s
    )
    stands = board.carriage_steps_at(clock.monotonic_s() + 1.0)
    rest_s = 0.0
    while board.carriage_steps_at(at_s + rest_s) != stands:
        rest_s += 0.001
    return sent_s - at_s, rest_s


def _work(config: Config, bench: VirtualBench, begun: Any) -> None:
    """Down, to a force, and on holding it."""
    engine = Engine(config, bench, NoJournal())
    with stop_inputs_heeded(config, engine, None):
        verbs.mount(engine, "bar:3.0")
        verbs.home(engine)
        verbs.zero(engine)
        verbs.move_to(engine, 0.0)
        begun()
        press = PressId(0)
        while True:
            force_gwt = engine.read_force_gwt(press, "press")
            if force_gwt < _FORCE_GWT:
                engine.go_to_height(engine.height_mm - 0.05, 0.5)


def main() -> None:
    """Press, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presses", type=int, default=50)
    options = parser.parse_args()
    print(
        "| button | presses | press to byte, ms: median, worst | press to rest, ms: median, worst |\n"
        "|---|---|---|---|"
    )
    for name in BUTTONS:
        chance = random.Random(0)
        found = [pressed(name, chance.uniform(0.0, _LASTS_S)) for _ in range(options.presses)]
        bytes_ms, rest_ms = ([1e3 * value for value in column] for column in zip(*found, strict=True))
        print(
            f"| {name} ({BUTTONS[name]}) | {len(found)} | {median(bytes_ms):.0f}, {max(bytes_ms):.0f} "
            f"| {median(rest_ms):.0f}, {max(rest_ms):.0f} |"
        )


if __name__ == "__main__":
    main()
