"""How soon the panel answers STOP beside each attack on its server, by the number of its descriptors.

    .venv/bin/python -m studies.faults.panel_reserve --stops 20

Each STOP comes from another process, over a new connection and over one that the page already has. An answer counts
once the owner of the port has confirmed the stop. The attacks are those of `studies.faults.panel_attacks`.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path
from statistics import median

from rig.clock import WallClock
from studies.faults.panel_attacks import ATTACKS, BIG, under
from studies.faults.panel_under_attack import UnderAttack, panel_under_attack
from studies.registry import show

DESCRIPTORS = (1024, 20_000)
_MORE = 176  # connections than descriptors
_BETWEEN_S, _BEFORE_S, _WITHIN_S = 0.05, 0.5, 10.0
_BYTES = 1 << 28
_STATUS = 200


@dataclass(frozen=True)
class Measured:
    """Times to the answer over new connections and over an open one (s), and the length of the log (bytes)."""

    new_s: Sequence[float]
    open_s: Sequence[float]
    log: int


def measured(name: str | None, descriptors: int, stops: int, folder: Path) -> Measured:
    """Measure STOP beside an attack, or without one."""
    (folder / "runs" / "a").mkdir(parents=True)
    with open(folder / "runs" / "a" / BIG, "wb") as big:
        big.truncate(_BYTES)
    with panel_under_attack(folder, descriptors) as panel, panel.connected(_WITHIN_S) as wire:
        panel.status(wire, "POST", "/stop")
        attack = nullcontext() if name is None else under(name, panel.port, panel.token, descriptors + _MORE)
        with attack:
            if name is not None and ATTACKS[name].takes_descriptors:
                panel.use_up_descriptors()
            WallClock().wait_s(_BEFORE_S)
            new_s = [_timed(panel, lambda: panel.stop(_WITHIN_S)) for _ in range(stops)]
            open_s = [_timed(panel, lambda: panel.status(wire, "POST", "/stop")) for _ in range(stops)]
        return Measured(new_s, open_s, panel.log.stat().st_size)


def _timed(panel: UnderAttack, ask: Callable[[], int]) -> float:
    """Return the time to the answer to a STOP (s), infinite without one."""
    WallClock().wait_s(_BETWEEN_S)
    before, began_s = len(panel.stops_s), time.monotonic()
    try:
        status = ask()
    except (OSError, HTTPException):
        return float("inf")
    answered_s = time.monotonic() - began_s
    return answered_s if status == _STATUS and len(panel.stops_s) > before else float("inf")


def _ms(times_s: Sequence[float]) -> str:
    return f"{1e3 * median(times_s):.0f}, {1e3 * max(times_s):.0f}"


def main() -> None:
    """Attack, stop, time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stops", type=int, default=20)
    parser.add_argument("names", nargs="*", metavar="ATTACK")
    options = parser.parse_args()
    rows = []
    for name in options.names or [None, *ATTACKS]:
        found = []
        for descriptors in DESCRIPTORS:
            with tempfile.TemporaryDirectory() as folder:
                os.environ["RIG_RUNTIME_DIR"] = str(Path(folder) / "runtime")
                found.append(measured(name, descriptors, options.stops, Path(folder)))
        cells = [_ms(times_s) for one in found for times_s in (one.new_s, one.open_s)]
        rows.append([(name or "none").replace("_", " "), *cells, str(max(one.log for one in found))])
        print(*rows[-1], f"load {os.getloadavg()[0]:.0f}", sep=" | ", file=sys.stderr, flush=True)
    ways = ("a new connection", "an open one")
    header = [f"{one} descriptors, {way}, ms: median, worst" for one in DESCRIPTORS for way in ways]
    show(["attack", *header, "log, bytes"], rows)


if __name__ == "__main__":
    main()
