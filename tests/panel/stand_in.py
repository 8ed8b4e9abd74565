"""A server that says what a test tells it to, for states of the page that are hard to bring about with a true one."""

import json
import queue
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from rig.clock import WallClock
from tests.panel.scenes import COLUMNS

STATIC = Path(__file__).parents[2] / "rig" / "panel" / "static"
KINDS = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "worker-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
TOKEN = "a-token"


@dataclass(frozen=True)
class Asked:
    """A POST that came: when, and with what."""

    unix_s: float
    path: str
    tab: str
    body: Mapping[str, Any]


@dataclass
class StandIn:
    """What it says of itself, what it answers, and what it was asked."""

    state: dict[str, Any]
    runs: list[dict[str, Any]] = field(default_factory=list)
    answers: dict[str, tuple[int, dict[str, Any]]] = field(default_factory=dict)
    asked: list[Asked] = field(default_factory=list)
    answering: threading.Event = field(default_factory=threading.Event)
    talking: threading.Event = field(default_factory=threading.Event)
    kept: list[tuple[str, Mapping[str, Any]]] = field(default_factory=list)
    streams: list["queue.Queue[str | None]"] = field(default_factory=list)
    port: int = 0
    before_s: float = 0.0  # how far its clock is behind
    now = WallClock().unix_s

    @property
    def address(self) -> str:
        """What `rig panel` would print."""
        return f"http://127.0.0.1:{self.port}/#token={TOKEN}"

    def say(self, kind: str, told: Mapping[str, Any], *, keep: bool = False) -> None:
        """To all pages; kept for those that come, too."""
        if keep:
            self.kept = [(name, one) for name, one in self.kept if name != kind] + [(kind, told)]
        for stream in self.streams:
            stream.put(self._event(kind, told))

    def read(self, rows: Sequence[Sequence[Any]], *, reset: bool = False, run: str | None = None) -> None:
        """Readings, in the order of COLUMNS."""
        name = run or (self.state["run"] or {}).get("name")
        told = {"run": name, "hand": name is None, "columns": COLUMNS, "rows": rows, "reset": reset, "dropped": 0}
        self.say("readings", told)

    def paths(self) -> list[str]:
        """Of what it was asked, in order."""
        return [one.path for one in self.asked]

    def opening(self) -> str:
        """What a page that comes is told."""
        return "".join(self._event(kind, told) for kind, told in [("state", self.state), *self.kept])

    def _event(self, kind: str, told: Mapping[str, Any]) -> str:
        return f"event: {kind}\ndata: {json.dumps({'unix_s': self.now() - self.before_s, **told})}\n\n"


@contextmanager
def stand_in(state: dict[str, Any], port: int = 0) -> Iterator[StandIn]:
    """One that listens, and says its state twice a second."""
    one = StandIn(state)
    one.answering.set()
    one.talking.set()
    server = ThreadingHTTPServer(("127.0.0.1", port), _handler(one))
    server.daemon_threads = True
    one.port = server.server_address[1]
    over = threading.Event()
    threads = [
        threading.Thread(target=server.serve_forever, daemon=True),
        threading.Thread(target=_beat, args=(one, over), daemon=True),
    ]
    for thread in threads:
        thread.start()
    try:
        yield one
    finally:
        over.set()
        one.answering.set()
        for stream in list(one.streams):
            stream.put(None)
        server.shutdown()
        server.server_close()


BEAT_S = 0.25


def _beat(one: StandIn, over: threading.Event) -> None:
    while not over.wait(BEAT_S):
        if one.talking.is_set():
            one.say("state", one.state)


def _handler(one: StandIn) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            path, _, query = self.path.partition("?")
            if path == "/events" and self.headers["X-Rig-Token"] != TOKEN:
                self._send(403, "application/json", b"{}")
            elif path == "/events":
                self._stream()
            elif path == "/runs.json":
                wanted = {name: values[0] for name, values in parse_qs(query).items() if name != "limit"}
                found = [run for run in one.runs if wanted.items() <= run.items()]
                self._send(200, "application/json", json.dumps({"runs": found, "unreadable": []}).encode())
            else:
                file = STATIC / ("index.html" if path == "/" else path.removeprefix("/static/"))
                if not file.is_file():
                    self._send(404, "text/plain", b"")
                    return
                data = file.read_bytes().replace(
                    b"{STOP PORT}", str(one.port).encode()
                )  # its own port takes STOP, too
                self._send(200, KINDS[file.suffix], data)

        def do_HEAD(self) -> None:
            self.send_response(200)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            one.asked.append(Asked(one.now(), self.path, self.headers["X-Rig-Tab"], body))
            one.answering.wait()
            if self.headers["X-Rig-Token"] != TOKEN:
                status, told = (
                    403,
                    {
                        "ok": False,
                        "problem": "token: must be the one that rig panel printed; open the address that it printed",
                        "code": "wrong_token",
                    },
                )
            else:
                status, told = one.answers.get(self.path, (200, {"ok": True, "words": "understood"}))
            if self.path == "/take" and status == 200:
                one.state["controls"] = self.headers["X-Rig-Tab"]
                one.say("state", one.state)
            self._send(status, "application/json", json.dumps(told).encode())

        def _stream(self) -> None:
            mine: queue.Queue[str | None] = queue.Queue()
            mine.put(one.opening())
            one.streams.append(mine)
            self.send_response(200)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Connection", "close")
            self.end_headers()
            try:
                while (event := mine.get()) is not None:
                    self.wfile.write(event.encode())
                    self.wfile.flush()
            except OSError:
                pass
            one.streams.remove(mine)
            self.close_connection = True

        def _send(self, status: int, kind: str, body: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", POLICY)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    return Handler
