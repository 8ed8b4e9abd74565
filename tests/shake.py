"""`make shake`: the suite twice and its real-time tests many times, beside as many busy processes as cores.

Then, beside nothing else, the whole fault campaign (studies/faults/campaign) and a thousand fingers that move on each
stage (tests/rig/test_moving_finger_machine.py), which are on the virtual clock, and two hundred times as many hostile
files and replies as the suite has (tests/fuzz).
Tests that measure a study are left out unless they are named: the Makefile runs them afterwards (test-studies).
"""

import argparse
import multiprocessing
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--whole", type=int, default=2, help="times the whole suite")
    parser.add_argument("--real-time", type=int, default=20, help="times what is marked real_time")
    parser.add_argument("--busy", type=int, default=os.cpu_count() or 1, help="others that never rest, beside it")
    parser.add_argument("--no-campaign", action="store_true", help="not the fault campaign")
    parser.add_argument("--hostile", type=int, default=200, help="times as many hostile files and replies")
    parser.add_argument(
        "--fingers", type=int, default=1000, help="fingers that move, of ten steps and more, on each stage"
    )
    parser.add_argument("tests", nargs="*", help="files, folders or single tests instead of all of them")
    asked = parser.parse_args()
    failed: Counter[str] = Counter()
    whole = () if asked.tests else ("-m", "not study")
    with busy(asked.busy):
        for options, times in ((whole, asked.whole), (("-m", "real_time"), asked.real_time)):
            for n in range(times):
                print(f"{' '.join(options) or 'all that is named'}, {n + 1} of {times}", flush=True)
                failed.update(failures([*options, *asked.tests]))
    if not (asked.no_campaign or asked.tests):
        failed.update(campaign())
        failed.update(moving_fingers(asked.fingers))
        failed.update(hostile(asked.hostile))
    for name, times in failed.most_common():
        print(f"{times} × {name}")
    print(f"{failed.total()} failures")
    sys.exit(bool(failed))


def failures(words: list[str]) -> Iterator[str]:
    """The tests of one run that failed, as they do; or the run itself, where there was none."""
    how = ["-n", "3", "--dist", "loadfile", "--no-loadscope-reorder", "-q", "-rfE"]
    command = [sys.executable, "-m", "pytest", *how, *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        named = 0
        for line in run.stdout:
            kind, _, name = line.strip().partition(" ")
            if kind in ("FAILED", "ERROR"):
                named += 1
                print(line, end="", flush=True)
                yield name.partition(" - ")[0]
    if run.returncode and not named:
        yield f"pytest ended with {run.returncode}"


def campaign() -> Iterator[str]:
    """The whole fault campaign, which says itself what it has found; added to where it was interrupted."""
    out = Path("build") / "campaign.jsonl"
    out.parent.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "studies.faults.campaign", "--processes", str(os.cpu_count() or 1)]
    if subprocess.run([*command, "--out", str(out)], check=False).returncode:
        yield f"the fault campaign, {out}"


def moving_fingers(examples: int) -> Iterator[str]:
    """Fingers that move during whatever a program does, from a new seed each time."""
    seed = str(int(time.time()))
    print(f"moving fingers, FINGER_SEED={seed}", flush=True)
    command = [sys.executable, "-m", "pytest", "-n", "2", "-q", "tests/rig/test_moving_finger_machine.py"]
    if subprocess.run(
        command, env=os.environ | {"FINGERS": str(examples), "FINGER_SEED": seed}, check=False
    ).returncode:
        yield f"a finger that moves, FINGER_SEED={seed}"


def hostile(times: int) -> Iterator[str]:
    """Hostile files of every kind that the program reads, and replies of devices, from a new seed each time."""
    command = [sys.executable, "-m", "pytest", "-n", "2", "-q", "tests/fuzz"]
    if subprocess.run(command, env=os.environ | {"HOSTILE": str(times)}, check=False).returncode:
        yield "a hostile file or reply"


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """So many others that never rest."""
    others = [multiprocessing.Process(target=_never_rest, daemon=True) for _ in range(processes)]
    for other in others:
        other.start()
    try:
        yield
    finally:
        for other in others:
            other.terminate()
            other.join()


def _never_rest() -> None:
    while True:
        pass


if __name__ == "__main__":
    main()
