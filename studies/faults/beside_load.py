"""Meetings beside busy processes: how many come to their end, and how late the served fingers' forces are.

    .venv/bin/python -m studies.faults.beside_load [--meetings 6] [--busy 2] [--stranger 7]

All at once, in one session: `rig serve --random-finger` and `rig identify` for each, and the busy
processes from when the last port is said. Prints a row for each meeting; some four minutes.
"""

import argparse
import json
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from studies.posix import os

RIG = (sys.executable, "-c", "from rig.cli import main; main()")
NEVER_RESTS = (sys.executable, "-c", "while True: pass")
INDENTOR = "bar:3.0"
_LATE = re.compile(r"(\d+) forces asked for, (\d+) not ready.* at most (\S+) s old; (\d+) refused")


def serving(stranger: int) -> "subprocess.Popen[str]":
    command = (*RIG, "serve", "--random-finger", str(stranger), "--tcp", "0", "--indentor", INDENTOR)
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def meeting(folder: Path, ports: dict[str, str]) -> "subprocess.Popen[str]":
    """One that has been told to go on."""
    (folder / "rig.toml").write_text("".join(f'[{name}]\nport = "{port}"\n' for name, port in ports.items()))
    command = (
        *RIG,
        "identify",
        "--config",
        "rig.toml",
        "--shapes",
        INDENTOR,
        "--to",
        "finger.toml",
        "--yes",
        "--json",
    )
    pipe = subprocess.PIPE
    met = subprocess.Popen(command, cwd=folder, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    assert met.stdin is not None
    met.stdin.write("\n")
    met.stdin.flush()
    return met


def ended(met: "subprocess.Popen[str]", served: "subprocess.Popen[str]") -> Sequence[object]:
    """A row of the table."""
    said, problem = met.communicate()
    served.send_signal(signal.SIGINT)
    found = _LATE.search(served.communicate()[1])
    how = "came to its end" if met.returncode == 0 else problem.strip().splitlines()[-1]
    presses = json.loads(said)["presses"] if said else 0
    return how, presses, *(found.groups() if found else ["?"] * 4)


def main() -> None:
    """Serve, meet, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--meetings", type=int, default=6)
    parser.add_argument("--busy", type=int, default=2)
    parser.add_argument("--stranger", type=int, default=7)
    options = parser.parse_args()
    begun: list[subprocess.Popen[str]] = []
    with tempfile.TemporaryDirectory() as folder:
        try:
            begun += [serving(options.stranger) for _ in range(options.meetings)]
            served = list(begun)
            ports = [json.loads(one.stdout.readline()) for one in served if one.stdout is not None]
            begun += [subprocess.Popen(NEVER_RESTS, text=True) for _ in range(options.busy)]
            places = [Path(tempfile.mkdtemp(dir=folder)) for _ in ports]
            met = [meeting(place, these) for place, these in zip(places, ports, strict=True)]
            begun += met
            rows = [ended(*pair) for pair in zip(met, served, strict=True)]
        finally:
            for one in begun:
                one.kill()
                one.communicate()
    load = os.getloadavg()[0]
    print(f"{options.meetings} meetings beside {options.busy} busy processes, load {load:.1f} at the end\n")
    print("| meeting | presses | forces asked for | late | oldest, s | refused |\n|---|---|---|---|---|---|")
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |")


if __name__ == "__main__":
    main()
