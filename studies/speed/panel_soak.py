"""A long run looked at through the panel: readings lost, delays to the page and of STOP, memory of the server.

    .venv/bin/python -m studies.speed.panel_soak [MINUTES]

For half an hour, if nothing else is said, a journal is written as a run writes it, fifty readings a second and a
press every twelve seconds, one page looks on, and STOP is asked for every few seconds of an owner that only notes
when it came. What else runs on the machine is in the delays.
"""

import http.client
import json
import os
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from rig.clock import WallClock
from rig.control.client import Announcement
from rig.control.owner_socket import ControlSocket
from rig.data.journal import Journal
from rig.data.schema import STREAMS
from rig.plan.config import Config

PER_S, PRESS_S = 50, 12.0
_SETTLED_S, _EACH_S, _TOLD_S = 120.0, 5.0, 180.0
_AFTER_S, _STOPS_S = 3.0, 3.0


@dataclass
class SoakObservation:
    """What the page was told, and how large the server was meanwhile."""

    places: list[float] = field(default_factory=list)  # t_s of each reading
    delays_s: list[float] = field(default_factory=list)
    dropped: int = 0
    states: int = 0
    states_apart_s: float = 0.0  # the longest
    kinds: dict[str, int] = field(default_factory=dict)
    stops_s: list[float] = field(default_factory=list)  # from the request to the owner's own thread
    memory_mb: list[tuple[float, float]] = field(default_factory=list)  # seconds, MB
    drawing_mb: list[tuple[float, float]] = field(default_factory=list)  # of the process that draws
    _state_s: float = 0.0

    def event(self, kind: str, told: dict[str, object]) -> None:
        """One that came just now."""
        now_s = time.time()
        self.kinds[kind] = self.kinds.get(kind, 0) + 1
        if kind == "state":
            self.states_apart_s = max(self.states_apart_s, now_s - self._state_s) if self._state_s else 0.0
            self._state_s = now_s
        if kind == "readings":
            rows, columns = told["rows"], told["columns"]
            assert isinstance(rows, list)
            assert isinstance(columns, list)
            self.dropped += int(str(told["dropped"]))
            for row in rows:
                named = dict(zip(columns, row, strict=True))
                self.places.append(named["t_s"])
                self.delays_s.append(now_s - named["unix_s"])


def main(minutes: float = 30.0) -> None:
    """Print what came of it."""
    seen = SoakObservation()
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "runs" / "20260101T000000-soak-000000"
        run.mkdir(parents=True)
        (run / "config.toml").write_text(Config().as_toml(), encoding="utf-8")
        os.environ["RIG_RUNTIME_DIR"] = str(Path(folder) / "runtime")
        words = [sys.executable, "-m", "rig", "panel", "--no-browser", "--json", "--out", str(run.parent)]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            url = json.loads(server.stdout.readline())["url"]
            port = int(url.partition("/#")[0].rpartition(":")[2])
            written: list[float] = []
            came_s: list[float] = []
            stopping = threading.Thread(target=lambda: seen.stops_s.extend(_stops(url, came_s, writing)))
            writing = threading.Thread(target=lambda: written.extend(_write(run, 60.0 * minutes)))
            with _owner(run, came_s) as _, socket.create_connection(("127.0.0.1", port)) as page:
                writing.start()
                stopping.start()
                for kind, told in _events(page, port, url.rpartition("=")[2]):
                    seen.event(kind, told)
                    _weigh(server.pid, seen)
                    if not writing.is_alive() and time.time() - _last_s(run) > _AFTER_S:
                        break
            writing.join()
            stopping.join()
            server.terminate()
    _tell(seen, written)


def _write(run: Path, seconds: float) -> Iterator[float]:
    """The journal; gives the instant of each reading on the run's clock."""
    clock = WallClock()
    with Journal(run / "events.jsonl", clock, STREAMS) as journal:
        journal.start({"protocol": "soak", "title": "", "planned_indentations": 9999, "soft_trip_n": 1.0})
        journal.event("mount", {"indentor": "bar:3.0"})
        began_s, n = clock.monotonic_s(), 0
        while (gone_s := n / PER_S) < seconds:
            clock.wait_until(lambda: False, began_s + gone_s)
            index, into_s = divmod(gone_s, PRESS_S)
            if n % round(PER_S * PRESS_S) == 0:
                press = {"index": int(index), "indentor": "bar:3.0", "x_mm": 0.01 * index}
                journal.event("indentation_start", {**press, "target": "doi_mm", "value": 1.0, "increments": 1})
            about = {"index": int(index), "phase": "press", "x_mm": 0.01 * index, "height_mm": -0.1 * into_s}
            journal.event("sample", {**about, "doi_mm": 0.1 * into_s, "force_gwt": 0.5 * into_s, "stable": True})
            yield gone_s
            n += 1
        journal.stop("done")


def _owner(run: Path, came_s: list[float]) -> ControlSocket:
    """Announces the run as its own; a stop is noted."""
    about = {"kind": "run", "virtual": False, "ports": (), "run": str(run), "began_unix_s": time.time()}
    answers = {"status": lambda _: {"state": "running", "stopped": False}, "stop": lambda _: _noted(came_s)}
    return ControlSocket(Announcement.model_validate({"pid": os.getpid(), **about}), answers)


def _noted(came_s: list[float]) -> dict[str, object]:
    came_s.append(time.monotonic())
    return {}


def _stops(url: str, came_s: list[float], writing: threading.Thread) -> Iterator[float]:
    """Seconds from each request until the owner was told."""
    here, _, token = url.partition("/#token=")
    headers = {"Origin": here, "X-Rig-Token": token, "X-Rig-Tab": "soak", "Content-Type": "application/json"}
    while writing.is_alive():
        time.sleep(_STOPS_S)
        began_s, before = time.monotonic(), len(came_s)
        with closing(http.client.HTTPConnection(here.removeprefix("http://"))) as wire:
            wire.request("POST", "/stop", "{}", headers)
            wire.getresponse().read()
        while len(came_s) == before:
            time.sleep(0.001)
        yield came_s[before] - began_s


def _events(page: socket.socket, port: int, token: str) -> Iterator[tuple[str, dict[str, object]]]:
    """Each event as it comes, chunks put together."""
    head = f"GET /events?tab=soak HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nX-Rig-Token: {token}\r\n\r\n"
    page.sendall(head.encode())
    heard = page.makefile("rb")
    while heard.readline().strip():
        pass  # of the head
    text = b""
    while size := int(heard.readline(), 16):
        text += heard.read(size)
        heard.readline()
        *whole, text = text.split(b"\n\n")
        for one in whole:
            found = re.fullmatch(rb"event: (\w+)\ndata: (.*)", one)
            if found:
                yield found[1].decode(), json.loads(found[2])


def _weigh(pid: int, seen: SoakObservation) -> None:
    """Its memory, and that of its largest child, now and then."""
    now_s = time.monotonic()
    if not seen.memory_mb or now_s - seen.memory_mb[-1][0] >= _EACH_S:
        seen.memory_mb.append((now_s, _mb(pid)))
        tasks = Path(f"/proc/{pid}/task").iterdir()
        children = [child for task in tasks for child in (task / "children").read_text(encoding="ascii").split()]
        seen.drawing_mb.append((now_s, max(map(_mb, children), default=0.0)))


def _mb(pid: int | str) -> float:
    found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text(encoding="ascii"))
    return 0.0 if found is None else int(found[1]) / 1024


def _last_s(run: Path) -> float:
    return (run / "events.jsonl").stat().st_mtime


def _tell(seen: SoakObservation, written: list[float]) -> None:
    began_s = seen.memory_mb[0][0]
    print(f"written {len(written)} readings in {len(written) / PER_S / 60:.1f} min")
    once = len(set(seen.places)) == len(seen.places)
    print(f"told    {len(seen.places)} readings, each once: {once}; dropped {seen.dropped}")
    print(f"delay   {_spread(seen.delays_s)}")
    print(f"stops   {len(seen.stops_s)}: {_spread(seen.stops_s)}")
    print(f"states  {seen.kinds.get('state', 0)}, at most {seen.states_apart_s:.2f} s apart; {seen.kinds}")
    for name, weighed in (("memory", seen.memory_mb), ("drawing", seen.drawing_mb)):
        every = round(_TOLD_S / _EACH_S)
        print(f"{name:<7} MB each {_TOLD_S / 60:g} min: {' '.join(f'{mb:.1f}' for _, mb in weighed[::every])}")
        settled = [(s - began_s, mb) for s, mb in weighed if s - began_s >= _SETTLED_S]
        if len(settled) > 1:
            slope, _ = statistics.linear_regression(*zip(*settled, strict=True))
            print(
                f"        {settled[0][1]:.1f} MB after {_SETTLED_S:g} s; from there on {3600 * slope:+.2f} MB an hour"
            )


def _spread(seconds: list[float]) -> str:
    found = sorted(1e3 * one for one in seconds) or [0.0]
    median_ms, p99_ms = found[len(found) // 2], found[int(0.99 * len(found))]
    return f"median {median_ms:.0f} ms, p99 {p99_ms:.0f} ms, worst {found[-1]:.0f} ms"


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
