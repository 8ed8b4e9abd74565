"""Long runs at 100 readings/s: dry run, kill, resume, export and report; duration, peak memory and size of each.

    .venv/bin/python -m studies.faults.long_run --hours 2

A run of an eighth of the time is measured beside it: memory that grows with the run shows.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rig.data import read_run

_RIG = (sys.executable, "-m", "rig")
_HOLD_S, _PRESS_S = 600.0, 640.0
_CONFIG = """\
[force]
kind = "net_ft"
port = "udp://127.0.0.1:49152"
sample_period_s = 0.01
latency_s = 0.002

[limits]
max_contact_s = 36000.0
"""
_SCRIPT = """\
\"\"\"Long holds.\"\"\"


def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for n in range({presses}):
        rig.move_to(x_mm=0.1 * (n % 5))
        rig.indent(doi_mm=0.5, hold_s={hold_s})
"""


class Cost(NamedTuple):
    """Cost of a command: duration (s), peak memory (MB) and exit code."""

    seconds: float
    peak_mb: float
    code: int


def measured(words: list[str], killed_at: tuple[Path, int] | None = None) -> Cost:
    """Run a command; kill it once the only journal in a folder has a size (bytes)."""
    began_s = time.monotonic()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen([*_RIG, *words], stdout=said, stderr=said)
        if killed_at is not None:
            out, size = killed_at
            while not any(path.stat().st_size > size for path in out.glob("*/events.jsonl")):
                time.sleep(0.1)
            process.send_signal(signal.SIGKILL)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode > 0:
            said.seek(0)
            sys.stderr.write(said.read().decode())
    return Cost(time.monotonic() - began_s, used.ru_maxrss / 1024, process.returncode)


def costs(hours: float, folder: Path) -> Iterator[tuple[str, Cost, str]]:
    """Yield each command with its cost, and what it left."""
    script, config = folder / "long.py", folder / "rig.toml"
    config.write_text(_CONFIG, encoding="utf-8")
    presses = round(hours * 3600 / _PRESS_S)
    script.write_text(_SCRIPT.format(presses=presses, hold_s=_HOLD_S), encoding="utf-8")
    out = folder / f"runs_{presses}"
    words = ["dry-run", str(script), "--config", str(config), "--out", str(out), "--json"]
    cost = measured(words)
    (run,) = out.iterdir()
    size = (run / "events.jsonl").stat().st_size
    yield f"dry run of {hours:g} h", cost, _left(run)
    yield "export", measured(["export", str(run), "--csv", "--json"]), ""
    yield "report", measured(["export", str(run), "--report", "--json"]), ""
    killed = folder / f"killed_{presses}"
    words[words.index(str(out))] = str(killed)
    yield "dry run, killed half-way", measured(words, (killed, size // 2)), ""
    (run,) = killed.iterdir()
    yield "resume", measured(["resume", str(run), "--json"]), _left(run)


def _left(run: Path) -> str:
    found = read_run(run)
    readings = len(found.stream("sample"))
    return (
        f"{found.duration_s / 3600:.2f} h, {readings} readings, {readings / found.duration_s:.0f}/s, "
        f"{found.folder.events.stat().st_size / 1e6:.0f} MB of journal, missing {found.missing}, "
        f"repeated {found.repeated}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=2.0, help="bench time of the longer run, in h")
    hours = parser.parse_args().hours
    with tempfile.TemporaryDirectory() as folder:
        for each in (hours / 8, hours):
            for what, cost, left in costs(each, Path(folder)):
                print(f"{what:<26}{cost.seconds:8.1f} s{cost.peak_mb:8.0f} MB  exit {cost.code}  {left}", flush=True)


if __name__ == "__main__":
    main()
