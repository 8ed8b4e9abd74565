"""What a second comparison, a list of many runs and a status round trip cost: processor seconds.

    .venv/bin/python -m studies.speed.commands    # a minute

The tests count what is done instead of timing it: nothing is built or solved for a second comparison.
"""

import contextlib
import io
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rig.cli import main as rig
from rig.data.index import INDEX
from rig.devices.grbl import GrblStage
from rig.transport import LoopbackTransport
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock
from studies.posix import resource

REPEATS, QUESTIONS, RUNS = 3, 2000, 200


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        _quietly("dry-run", "steps", "step=1", "--out", folder)
        (run,) = Path(folder).iterdir()
        compare = ("compare", str(run), "--out", str(Path(folder) / "page.html"))
        _quietly(*compare)
        seconds = [_cpu_s(lambda: _quietly(*compare)) for _ in range(REPEATS)]
        for number in range(1, RUNS):
            shutil.copytree(run, run.with_name(f"{run.name}-{number}"))
        anew = [_anew_s(Path(folder)) for _ in range(REPEATS)]
        listing = [_process_s("runs", folder) for _ in range(REPEATS)]
        read_s = min(
            _cpu_s(lambda: [journal.read_bytes() for journal in Path(folder).glob("*/events.jsonl")])
            for _ in range(REPEATS)
        )
        table_s = min(_process_s("runs", folder, "--table", f"{folder}/all.csv") for _ in range(REPEATS))
    print(f"a comparison of 21 positions, everything in the cache: {min(seconds):.1f} … {max(seconds):.1f} s")
    print(f"a list of {RUNS} runs, from its index: {min(listing):.2f} s; as one table: {table_s:.2f} s")
    print(f"    the first, which looks at every line of every journal: {min(anew):.2f} s; read alone {read_s:.2f} s")
    print(f"a status round trip to the virtual board: {_cpu_s(_ask) / QUESTIONS * 1e6:.0f} µs")


def _anew_s(runs: Path) -> float:
    """Of a list without its index."""
    (runs / INDEX).unlink(missing_ok=True)
    return _process_s("runs", str(runs))


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


def _process_s(*words: str) -> float:
    """Of a process of its own, which imports what it needs."""
    spent_s = [sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])]
    program = [sys.executable, "-c", "from rig.cli import main; main()", *words]
    subprocess.run(program, check=True, stdout=subprocess.DEVNULL)
    spent_s.append(sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]))
    return spent_s[1] - spent_s[0]


def _cpu_s(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


if __name__ == "__main__":
    main()
