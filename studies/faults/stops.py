"""Measure the time from the request of a stop to its byte, and whether the run is recorded as stopped.

    .venv/bin/python -m studies.faults.stops --stops 50
    .venv/bin/python -m studies.faults.stops --stops 50 --click    # of STOP in the panel's page

`rig run`, behind `rig serve` in processes of their own, is stopped over its control socket, in turn in each of five
phases: while it is planned, in an approach, while the model solves for a script that decides as it goes, in a hold,
and while the report is made. The request is timed here by the wall clock. The byte log times the byte by the time of
the run, whose beginning the journal records by the same wall clock.

With `--click`, STOP is clicked, touched or pressed as a key in Chromium (`make panel-test` installs what that needs),
whose page then does nothing for a second and a half. The browser times the click.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from statistics import median
from types import MappingProxyType
from typing import Any

from rig.control.client import Announced, ControlError, announced
from rig.devices import leadshine_drive as reg
from rig.plan.config import Config
from rig.transport import open_port
from studies.pictures.chromium import MISSING, chromium
from studies.pictures.panel_page import browser, panel

PHASES = ("plan", "approach", "solve", "hold", "report")
NEAR: dict[str, Any] = {
    "frame": {"pad_centre_x_mm": -3.0, "pad_y_mm": -2.0, "apex_z_mm": -4.0},
    "force": {"baud": 115200, "sample_period_s": 0.02},
    "habits": {"clearance_mm": 0.4, "approach_speed_mm_s": 2.0, "press_speed_mm_s": 2.0, "settle_readings": 5},
}
FAST = ("$110=3000", "$111=3000", "$112=3000", "$120=500", "$121=500", "$122=500", "$24=600", "$25=3000", "$26=10")
_DECIDES = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    force_gwt = rig.indent(doi_mm=0.3, hold_s=HOLD).holds[-1].force_gwt
    for n in range(1, TIMES):
        rig.move_to(x_mm=0.02 * n + 1e-4 * force_gwt)
        rig.indent(force_gwt=1.0 + 1e-4 * force_gwt, hold_s=0.1)
"""
STOP = {"grbl": "2118", "leadshine": f"06{reg.TRIGGER:04x}{reg.QUICK_STOP:04x}"}
_STATES = {"plan": "planning", "report": "reporting"}
_STOPPED = 130
_LOOK_S, _DEADLINE_S, _WORST_S = 0.002, 240.0, 0.1

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


@dataclass(frozen=True)
class Stop:
    """Stop of one run: the time from its request to its byte (nan without a byte), and how the run ended."""

    phase: str
    latency_s: float
    recorded: str  # the journal's status, and the state in which it was stopped after its end
    code: int


def decides(hold_s: float = 0.1, times: int = 1) -> str:
    """A script whose presses hang on what the first one felt: all but that one are solved while it runs."""
    return _DECIDES.replace("HOLD", str(hold_s)).replace("TIMES", str(times))


def by_socket(owner: Announced) -> float:
    """Request a stop over the socket of the process that owns the ports, and return when (Unix time, s)."""
    asked_s = time.time()
    with suppress(ControlError):
        owner.ask("stop", within_s=10.0)
    return asked_s


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


class Benches:
    """`rig serve`, and a run on its ports for each stop."""

    def __init__(
        self,
        folder: Path,
        stage: str,
        ask: Callable[[Announced], float] = by_socket,
        more: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """ask: requests a stop and returns when (Unix time, s). more: tables of the configuration."""
        self._more = more
        self._folder, self._stage, self._ask = folder, stage, ask
        self._chance = random.Random(0)
        self.config = folder / "rig.toml"

    @contextmanager
    def served(self) -> Iterator[None]:
        """The devices, until the end."""
        tables = NEAR | {"stage": {"kind": self._stage}, "virtual": {"indentor": "bar:3.0"}} | dict(self._more)
        self.config.write_text(Config.model_validate(tables).as_toml(), encoding="utf-8")
        words = [sys.executable, "-m", "rig", "serve", "--tcp", "0", "--config", str(self.config)]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as serve:
            try:
                assert serve.stdout is not None
                ports = json.loads(serve.stdout.readline())
                tables["stage"] |= {"port": ports["stage"]}
                tables["force"] = {**NEAR["force"], "port": ports["force"]}
                self.config.write_text(Config.model_validate(tables).as_toml(), encoding="utf-8")
                if self._stage == "grbl":
                    _make_fast(ports["stage"])
                self._port = ports["stage"]
                yield
            finally:
                serve.terminate()

    def stopped(self, number: int, phase: str) -> Stop:
        """One run, stopped in a phase."""
        out, said = self._folder / f"{number:03}", self._folder / f"{number:03}.log"
        script = self._folder / "decides.py"
        script.write_text(decides(0.1 if phase == "report" else 2.0, times=4), encoding="utf-8")
        words = [sys.executable, "-m", "rig", "run", str(script), "--yes", "--config", str(self.config)]
        with (
            said.open("w") as errors,
            subprocess.Popen(
                [*words, "--out", str(out)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                text=True,
            ) as run,
        ):
            try:
                assert run.stdin is not None
                run.stdin.write("\n" * 9)
                run.stdin.flush()
                owner = _until(lambda: run.poll() or next((one for one in announced() if one.pid == run.pid), None))
                if not isinstance(owner, Announced):
                    return Stop(phase, float("nan"), "it never began", owner)
                _until(lambda: run.poll() is not None or self._is_at(phase, owner, out))
                time.sleep(self._chance.uniform(0.0, 0.2))
                asked_s = self._ask(owner)
                code = run.wait(_DEADLINE_S)
            finally:
                run.kill()
        if code != _STOPPED:
            return Stop(phase, float("nan"), said.read_text().strip().rpartition("\n")[2], code)
        return self._read(out, phase, asked_s, code)

    def _is_at(self, phase: str, owner: Announced, out: Path) -> bool:
        if phase in _STATES:
            with suppress(ControlError):  # it has just ended
                return bool(owner.ask("status")["state"] == _STATES[phase])
            return False
        journal = "".join(path.read_text(encoding="utf-8") for path in out.glob("*/events.jsonl"))
        if phase == "solve":
            *_, last = [{}, *(json.loads(line) for line in journal.splitlines()[:-1])]
            return last.get("stream") == "move" and journal.count('"indentation_end"') > 1
        return f'"phase": "{phase}"' in journal

    def _read(self, out: Path, phase: str, asked_s: float, code: int) -> Stop:
        folder = (
            next((path for path in out.iterdir() if not path.name.startswith(".")), None) if out.is_dir() else None
        )
        if folder is None:
            return Stop(phase, float("nan"), "no folder", code)
        wire = [json.loads(line) for line in (folder / "bytes.jsonl").read_text(encoding="ascii").splitlines()]
        start, *_, last = map(json.loads, (folder / "events.jsonl").read_text(encoding="utf-8").splitlines())
        sent_s = [
            start["unix_s"] - start["t_s"] + line["t_s"]
            for line in wire
            if line["dir"] == "tx" and STOP[self._stage] in line["hex"]
        ]
        found = [at_s for at_s in sent_s if at_s >= asked_s]
        recorded = f"{last.get('status')} {last.get('stopped_while', '')}".strip()
        return Stop(phase, min(found, default=float("nan")) - asked_s, recorded, code)


def _make_fast(port: str) -> None:
    """A board that homes in a second, so that a run takes some."""
    wire = open_port(port, 115200)
    for line in FAST:
        wire.write(f"{line}\n".encode("ascii"))
        heard = b""
        while b"ok" not in heard:
            heard += wire.read(0.1)
    wire.close()


def _until(look: Callable[[], Any]) -> Any:
    deadline_s = time.monotonic() + _DEADLINE_S
    while not (found := look()):
        if time.monotonic() > deadline_s:
            raise SystemExit("a run never came so far")
        time.sleep(_LOOK_S)
    return found


def table(stops: Sequence[Stop], request: str) -> str:
    """Return the time from request to byte in each phase, and what the journals say."""
    lines = [f"| stopped in | stops | {request} to byte, ms: median, worst | recorded |", "|---|---|---|---|"]
    for phase in PHASES:
        those = [stop for stop in stops if stop.phase == phase]
        if those:
            ms = [1e3 * stop.latency_s for stop in those]
            said = ", ".join(sorted({stop.recorded for stop in those}))
            lines.append(f"| {phase} | {len(those)} | {median(ms):.1f}, {max(ms):.1f} | {said} |")
    return "\n".join(lines)


@contextmanager
def clicked(folder: Path) -> Iterator[Callable[[Announced], float]]:
    """Open the panel in Chromium; yield what clicks STOP there."""
    with browser() as found, panel(folder) as (_, url):
        page = found.new_page(has_touch=True)
        page.goto(url)
        page.locator("#stop:enabled").wait_for()
        yield clicker(page)


def main() -> None:
    """Stop runs and print the table; exit with 1 if a stop took too long."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stops", type=int, default=50)
    parser.add_argument("--stage", choices=sorted(STOP), default="grbl")
    parser.add_argument("--click", action="store_true", help="click STOP in the panel's page")
    options = parser.parse_args()
    if options.click and chromium() is None:
        sys.exit(MISSING)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["RIG_RUNTIME_DIR"] = str(folder / "runtime")
        with clicked(folder) if options.click else nullcontext(by_socket) as ask:
            benches, stops = Benches(folder, options.stage, ask), list[Stop]()
            with benches.served():
                for number in range(options.stops):
                    stops.append(benches.stopped(number, PHASES[number % len(PHASES)]))
                    print(stops[-1], file=sys.stderr, flush=True)
    print(table(stops, "click" if options.click else "request"))
    sys.exit(any(not stop.latency_s < _WORST_S or stop.code != _STOPPED for stop in stops))


if __name__ == "__main__":
    main()
