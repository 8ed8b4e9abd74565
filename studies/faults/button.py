"""How long the participant's stop button takes from the press to the stop's bytes on the wire.

    .venv/bin/python -m studies.faults.button --presses 50

`rig run`, behind `rig serve` in processes of their own, is stopped by a key in approaches, solutions and holds. A
named pipe stands in for the key's device: from the write of the event to the byte in the run's byte log, both by the
wall clock. What the kernel and USB add, about 10 ms, is not in it. `--load N` adds N processes that compute.
"""

import argparse
import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

from rig.control.client import Announced
from studies.faults.stops import Benches, Stop
from studies.posix import os

PHASES = ("approach", "solve", "hold")
_EVENT, _KEY, _CODE = struct.Struct("llHHi"), 1, 30


@contextmanager
def loaded(processes: int) -> Iterator[None]:
    """Beside so many processes that compute."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for one in busy:
            one.kill()
            one.wait()


def pressed(presses: int, stage: str) -> list[Stop]:
    """So many runs, each stopped by one press."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RIG_RUNTIME_DIR"] = str(Path(folder) / "runtime")
        pipe = Path(folder) / "key"
        os.mkfifo(pipe)
        key = os.open(pipe, os.O_RDWR)

        def press(_: Announced) -> float:
            at_s = time.time()
            os.write(key, _EVENT.pack(0, 0, _KEY, _CODE, 1))
            os.write(key, _EVENT.pack(0, 0, _KEY, _CODE, 0))
            return at_s

        benches, found = Benches(Path(folder), stage, press, {"stop": {"kind": "key", "device": str(pipe)}}), []
        with benches.served():
            for number in range(presses):
                found.append(benches.stopped(number, PHASES[number % len(PHASES)]))
                print(found[-1], file=sys.stderr, flush=True)
        os.close(key)
        return found


def table(stops: list[Stop]) -> str:
    """For each phase: press to byte, and what the journals say."""
    lines = ["| pressed in | presses | press to byte, ms: median, worst | recorded |", "|---|---|---|---|"]
    for phase in (*PHASES, "all"):
        those = [stop for stop in stops if phase in (stop.phase, "all")]
        if those:
            ms = [1e3 * stop.latency_s for stop in those]
            said = ", ".join(sorted({stop.recorded for stop in those}))
            lines.append(f"| {phase} | {len(those)} | {median(ms):.1f}, {max(ms):.1f} | {said} |")
    return "\n".join(lines)


def main() -> None:
    """Press, count, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presses", type=int, default=50)
    parser.add_argument("--stage", choices=("grbl", "leadshine"), default="grbl")
    parser.add_argument("--load", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with loaded(options.load):
        stops = pressed(options.presses, options.stage)
    print(json.dumps([vars(stop) for stop in stops]) if options.json else table(stops))
    sys.exit(0 if all(stop.latency_s < 0.1 for stop in stops) else 1)


if __name__ == "__main__":
    main()
