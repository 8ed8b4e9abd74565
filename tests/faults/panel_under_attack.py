"""`rig panel` in a process with a limit of descriptors, beside the owner of a port that notes the stops."""

import http.client
import json
import os
import re
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rig.control.client import Announcement
from rig.control.owner_socket import ControlSocket

_PANEL = """\
import os, resource, sys, threading
most = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
def take():
    sys.stdin.readline()
    try:
        while True:
            os.open(os.devnull, os.O_RDONLY)
    except OSError:
        print("taken", file=sys.__stdout__, flush=True)
threading.Thread(target=take, daemon=True).start()
from rig.cli import main
main()
"""


@dataclass
class UnderAttack:
    """The panel: its port and token, its process, and when the owner was stopped (monotonic, s)."""

    port: int
    stop_port: int
    token: str
    log: Path
    process: "subprocess.Popen[str]"
    stops_s: list[float] = field(default_factory=list)

    @contextmanager
    def connected(self, within_s: float, port: int = 0) -> Iterator[http.client.HTTPConnection]:
        """Open a new connection of the operator's page, to the port of STOP unless another is named."""
        with closing(http.client.HTTPConnection("127.0.0.1", port or self.stop_port, timeout=within_s)) as wire:
            yield wire

    def status(self, wire: http.client.HTTPConnection, method: str, path: str) -> int:
        """Return the status of the reply to the operator's page. Raises OSError, or HTTPException without one."""
        here = f"http://127.0.0.1:{self.port}"
        own = {"Origin": here, "X-Rig-Token": self.token, "X-Rig-Tab": "operator", "Content-Type": "application/json"}
        wire.request(method, path, "{}" if method == "POST" else None, own)
        with closing(wire.getresponse()) as answer:
            if path == "/stop":
                answer.read()  # The connection can then be used again.
            return answer.status

    def stop(self, within_s: float) -> int:
        """Return the status of the reply to a STOP over a new connection."""
        with self.connected(within_s) as wire:
            return self.status(wire, "POST", "/stop")

    def stream(self, within_s: float) -> int:
        """Return the status of the reply to the page that opens its stream."""
        with self.connected(within_s, self.port) as wire:
            return self.status(wire, "GET", "/events?tab=operator")

    def use_up_descriptors(self) -> None:
        """Let the panel's process open files until none is left."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write("take\n")
        self.process.stdin.flush()
        assert self.process.stdout.readline() == "taken\n"


@contextmanager
def panel_under_attack(folder: Path, most_descriptors: int) -> Iterator[UnderAttack]:
    """Serve the panel beside an owner; RIG_RUNTIME_DIR is the caller's."""
    log = folder / "panel.log"
    words = [sys.executable, "-c", _PANEL, str(most_descriptors)]
    words += ["panel", "--json", "--no-browser", "--out", str(folder / "runs")]
    about = Announcement(pid=os.getpid(), kind="run", virtual=False, ports=("a",), began_unix_s=time.time())
    stops_s: list[float] = []

    def stopped(request: object) -> dict[str, Any]:
        stops_s.append(time.monotonic())
        return {}

    answers = {"stop": stopped, "status": lambda request: {"state": "running"}}
    with (
        log.open("w", encoding="utf-8") as said,
        ControlSocket(about, answers),
        subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, text=True) as process,
    ):
        try:
            assert process.stdout is not None
            url = json.loads(process.stdout.readline())["url"]
            port, token = int(url.rpartition(":")[2].partition("/")[0]), url.rpartition("=")[2]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/") as page:
                found = re.search(rb'data-stop-port="(\d+)"', page.read())
            assert found is not None
            yield UnderAttack(port, int(found.group(1)), token, log, process, stops_s)
        finally:
            process.kill()
