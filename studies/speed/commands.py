"""What a second comparison and a status round trip cost, once all is in the cache: processor seconds.

    .venv/bin/python -m studies.speed.commands    # a minute

The tests count what is done instead of timing it: nothing is built or solved for a second comparison.
"""

import contextlib
import io
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rig.cli import main as rig
from rig.devices.stage.grbl.grbl_stage import GrblStage
from rig.transport import LoopbackTransport
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock

REPEATS, QUESTIONS = 3, 2000


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        _quietly("dry-run", "steps", "step=1", "--out", folder)
        (run,) = Path(folder).iterdir()
        compare = ("compare", str(run), "--out", str(Path(folder) / "page.html"))
        _quietly(*compare)
        seconds = [_cpu_s(lambda: _quietly(*compare)) for _ in range(REPEATS)]
    print(f"a comparison of 21 positions, everything in the cache: {min(seconds):.1f} … {max(seconds):.1f} s")
    print(f"a status round trip to the virtual board: {_cpu_s(_ask) / QUESTIONS * 1e6:.0f} µs")


def _ask() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 115200)
    VirtualGrbl(clock, line)
    stage = GrblStage(LoopbackTransport(line, clock, "board"), clock)
    stage.connect()
    for _ in range(QUESTIONS):
        stage.status()


def _quietly(*words: str) -> None:
    sys.argv = ["rig", *words]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            rig()
        except SystemExit as ended:
            if ended.code:
                raise


def _cpu_s(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


if __name__ == "__main__":
    main()
