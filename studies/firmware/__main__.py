"""Records what a GRBL board answers and how far it goes on when it is stopped, or compares a board with a record.

    .venv/bin/python -m studies.firmware --port PORT --save FILE.json      # the board must be free to move along x
    .venv/bin/python -m studies.firmware --against tests/data/firmware/grbl_1_1h.json     # the virtual board with it
    .venv/bin/python -m studies.firmware --port PORT --against FILE.json   # any other board

PORT is a serial port or tcp://HOST:PORT. **It moves the stage**, up to 200 mm.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from statistics import mean
from typing import Any

from rig.clock import Clock, WallClock
from rig.transport import LoopbackTransport, Transport
from rig.transport.ports import open_port
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock
from studies.firmware.conversation import comparable, exchanges, reports_of_a_flood, set_up
from studies.firmware.stop_distances import SPEEDS_MM_S, STOPS, Stopwatch

Record = dict[str, Any]


def virtual_board() -> tuple[Transport, Clock]:
    clock = VirtualClock()
    line = SerialLine(clock, 115200)
    VirtualGrbl(clock, line, settings={20: 0, 22: 0})
    return LoopbackTransport(line, clock), clock


def record(transport: Transport, clock: Clock) -> Iterator[tuple[str, Any]]:
    """Part after part; some minutes on a real board."""
    yield "settings", set_up(transport, clock)
    yield "conversation", [[sent, heard] for sent, heard in exchanges(transport, clock)]
    set_up(transport, clock)
    yield "reports_of_a_flood", reports_of_a_flood(transport, clock)
    watch = Stopwatch(transport, clock)
    yield "stops_mm", {how: {f"{mm_s:g}": watch.distances_mm(how, mm_s) for mm_s in SPEEDS_MM_S} for how in STOPS}


def differences(ours: Record, theirs: Record) -> list[str]:
    """Where two conversations differ, as lines of a table: what was sent, what theirs and ours answered."""
    found = []
    for (sent, heard), (theirs_sent, theirs_heard) in zip(ours["conversation"], theirs["conversation"], strict=True):
        assert sent == theirs_sent, "recorded with another conversation"
        here, there = ([comparable(line) for line in lines] for lines in (heard, theirs_heard))
        if here != there:
            found.append(f"| `{sent}` | {' / '.join(there) or 'nothing'} | {' / '.join(here) or 'nothing'} |")
    return found


def _print_comparison(ours: Record, theirs: Record) -> None:
    print("| sent | recorded | here |\n|---|---|---|", *differences(ours, theirs), sep="\n")
    print(f"\nreports of a flood: {theirs['reports_of_a_flood']} recorded, {ours['reports_of_a_flood']} here\n")
    print("| stop | mm/s | recorded (mm, mean) | here | off by |\n|---|---|---|---|---|")
    for how, by_speed in theirs["stops_mm"].items():
        for mm_s, distances in by_speed.items():
            there, here = mean(distances), mean(ours["stops_mm"][how][mm_s])
            print(f"| {how} | {mm_s} | {there:.3f} | {here:.3f} | {here / there - 1:+.0%} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="absent: the virtual board")
    parser.add_argument("--baud", type=int, default=115200)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--against", type=Path)
    told = parser.parse_args()
    wire = (open_port(told.port, told.baud), WallClock()) if told.port else virtual_board()
    found: Record = {}
    for part, what in record(*wire):
        found[part] = what
        if told.save:
            parts = [f"{json.dumps(name)}: {json.dumps(part)}" for name, part in found.items()]
            told.save.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")
    if told.against:
        _print_comparison(found, json.loads(told.against.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
