"""How long STOP takes from a click in the panel's page to its byte, with the page hanging right after the click.

    .venv/bin/python -m studies.faults.panel_stops --stops 50

The same runs as of `studies.faults.stops`, in the same five phases; STOP is clicked at, touched or pressed as a key
in Chromium (`make panel-test` installs what that needs), whose page then does nothing for a second and a half. The
click is timed by the browser, the byte by the run's byte log: both by the wall clock.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from typing import Any

from rig.control.client import Announced
from studies.faults.stops import PHASES, STOP, Benches, table
from studies.pictures.chromium import MISSING, chromium
from studies.pictures.panel_page import browser, panel

WORST_S = 0.1
HANGS_MS = 1500
HANG = f"""() => {{
  const hang = (event) => {{
    window.pressed_ms = performance.timeOrigin + event.timeStamp;
    while (performance.timeOrigin + performance.now() < window.pressed_ms + {HANGS_MS});
  }};
  const once = {{ once: true }};
  window.pressed_ms = null;
  window.addEventListener(window.by === "key" ? "keydown" : "pointerdown", hang, once);
}}"""


def clicker(page: Any) -> Callable[[Announced], float]:
    """Asks for a stop by the mouse, a finger and the key in turn, while the page hangs; says when."""
    ways = cycle(("mouse", "touch", "key"))

    def click(_: Announced) -> float:
        by = next(ways)
        page.evaluate("(by) => { window.by = by; }", by)
        page.evaluate(HANG)
        if by == "key":
            page.keyboard.press("Escape")
        else:
            stop = page.locator("#stop")
            stop.click(no_wait_after=True) if by == "mouse" else stop.tap(no_wait_after=True)
        return float(page.evaluate("window.pressed_ms") / 1000)

    return click


def main() -> None:
    """Stop, count, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stops", type=int, default=50)
    parser.add_argument("--stage", choices=sorted(STOP), default="grbl")
    options = parser.parse_args()
    if chromium() is None:
        sys.exit(MISSING)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RIG_RUNTIME_DIR"] = str(Path(folder) / "runtime")
        with browser() as found, panel(Path(folder)) as (_, url):
            page = found.new_page(has_touch=True)
            page.goto(url)
            page.locator("#stop:enabled").wait_for()
            benches = Benches(Path(folder), options.stage, clicker(page))
            stops = []
            with benches.served():
                for number in range(options.stops):
                    stops.append(benches.stopped(number, PHASES[number % len(PHASES)]))
                    print(stops[-1], file=sys.stderr, flush=True)
    print(table(stops))
    sys.exit(1 if [stop for stop in stops if not stop.latency_s < WORST_S or stop.code != 130] else 0)


if __name__ == "__main__":
    main()
