"""How soon the panel answers STOP beside each attack on its server, by the number of its descriptors.

    .venv/bin/python -m studies.faults.panel_reserve --stops 10

Each STOP comes from another process, over a new connection and over one that the page already has. An answer counts
once the owner of the port has confirmed the stop. The attacks are those of `studies.faults.panel_attacks`.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from statistics import median

from rig.clock import WallClock
from studies.faults.panel_attacks import ATTACKS, BIG, under
from studies.faults.panel_under_attack import UnderAttack, panel_under_attack
from studies.posix import os
from studies.registry import show

DESCRIPTORS = (1024, 20_000)
_MORE = 176  # connections than descriptors
_BETWEEN_S, _BEFORE_S, _WITHIN_S = 0.05, 0.5, 10.0
_BYTES = 1 << 28
_STATUS = 200


@dataclass(frozen=True)
class Measured:
    """Times to the answer over new connections and over an open one (s)."""

    new_s: Sequence[float]
    open_s: Sequence[float]


def all_measured(names: Sequence[str | None], descriptors: int, stops: int, folder: Path) -> list[Measured]:
    """Measure STOP on one panel beside each attack in turn, or without one (None)."""
    (folder / "runs" / "a").mkdir(parents=True)
    with open(folder / "runs" / "a" / BIG, "wb") as big:
        big.truncate(_BYTES)
    with panel_under_attack(folder, descriptors) as panel:
        return [measured(panel, name, descriptors, stops) for name in names]


def measured(panel: UnderAttack, name: str | None, descriptors: int, stops: int) -> Measured:
    """Measure STOP beside an attack."""
    with panel.connected(_WITHIN_S) as wire:
        panel.status(wire, "POST", "/stop")
        attack = nullcontext() if name is None else under(name, panel.port, panel.token, descriptors + _MORE)
        with attack:
            if name is not None and ATTACKS[name].takes_descriptors:
                panel.use_up_descriptors()
            WallClock().wait_s(_BEFORE_S)
            new_s = [_timed(panel, lambda: panel.stop(_WITHIN_S)) for _ in range(stops)]
            open_s = [_timed(panel, lambda: _again_over(panel, wire)) for _ in range(stops)]
    found = Measured(new_s, open_s)
    print(descriptors, name, _ms(new_s), _ms(open_s), f"load {os.getloadavg()[0]:.0f}", file=sys.stderr, flush=True)
    return found


def _again_over(panel: UnderAttack, wire: HTTPConnection) -> int:
    """Stop over an open connection; where the server has closed it, over a new one, as a browser does."""
    try:
        return panel.status(wire, "POST", "/stop")
    except (OSError, HTTPException):
        wire.close()
        return panel.status(wire, "POST", "/stop")


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
    parser.add_argument("--descriptors", type=int, nargs="+", default=DESCRIPTORS)
    parser.add_argument("names", nargs="*", metavar="ATTACK")
    options = parser.parse_args()
    names, found = options.names or [None, *ATTACKS], []
    for descriptors in options.descriptors:
        with tempfile.TemporaryDirectory() as folder:
            os.environ["RIG_RUNTIME_DIR"] = str(Path(folder) / "runtime")
            found.append(all_measured(names, descriptors, options.stops, Path(folder)))
    rows = []
    for name, *those in zip(names, *found, strict=True):
        cells = [_ms(times_s) for one in those for times_s in (one.new_s, one.open_s)]
        rows.append([(name or "none").replace("_", " "), *cells])
    ways = ("a new connection", "an open one")
    header = [f"{one} descriptors, {way}, ms: median, worst" for one in options.descriptors for way in ways]
    show(["attack", *header], rows)


if __name__ == "__main__":
    main()
