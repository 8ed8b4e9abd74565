"""Attacks on the panel's server by other programs of the same machine, each in a process of its own.

    .venv/bin/python -m tests.faults.panel_attacks half_requests --port 8000 --connections 1200

The process prints a line once the attack is in place, and goes on until its input ends.
"""

import argparse
import os
import select
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from rig.clock import WallClock
from studies.posix import resource

_HERE = "Host: 127.0.0.1:{port}\r\n"
_OWN = _HERE + "Origin: http://127.0.0.1:{port}\r\nX-Rig-Tab: a\r\nX-Rig-Token: {token}\r\n"
_JSON = "Content-Type: application/json\r\n"
_ELSEWHERE = "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: navigate\r\nReferer: http://evil.example/\r\n"
_HELLO = "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"
_LONG = 1 << 16
_PIECE = 1 << 18
_PAUSE_S = 0.02
_RESET = struct.pack("ii", 1, 0)


@dataclass(frozen=True)
class Attack:
    """What each connection sends first and then again and again, and what becomes of it.

    few: number of connections, 0 for as many as there can be. addresses: number of addresses they come from. anew:
    each is closed and opened anew all the time. reset: it is reset when it is closed. reads: it reads the answers.
    takes_descriptors: the panel's own process opens files until none is left. known: the attacker has the token.
    """

    first: str
    again: str = ""
    few: int = 0
    addresses: int = 1
    anew: bool = False
    reset: bool = False
    reads: bool = False
    takes_descriptors: bool = False
    known: bool = False


BIG = "report.html"
"""File of the run `a` below the panel's folder, which slow readers ask for."""
ATTACKS = {
    "half_requests": Attack("GET / HTTP/1.1\r\n" + _HERE),
    "half_requests_anew": Attack("GET / HTTP/1.1\r\n" + _HERE, anew=True),
    "half_requests_of_many_addresses": Attack("GET / HTTP/1.1\r\n" + _HERE, addresses=200),
    "no_bytes": Attack(""),
    "slow_headers": Attack("GET / HTTP/1.1\r\n" + _HERE, again="X: y\r\n"),
    "foreign_streams": Attack("GET /events?tab=z HTTP/1.1\r\n" + _HERE + _ELSEWHERE + "\r\n"),
    "streams_without_token": Attack("GET /events?tab=z HTTP/1.1\r\n" + _HERE + "\r\n"),
    "streams_with_token": Attack("GET /events?tab=z HTTP/1.1\r\n" + _OWN + "\r\n", few=4, known=True),
    "many_streams_with_token": Attack("GET /events?tab=z HTTP/1.1\r\n" + _OWN + "\r\n", few=200, known=True),
    "slow_bodies": Attack("POST /stop HTTP/1.1\r\n" + _HERE + _JSON + "Content-Length: 100000\r\n\r\n", again=" "),
    "slow_bodies_with_token": Attack(
        "POST /pause HTTP/1.1\r\n" + _OWN + _JSON + "Content-Length: 4000\r\n\r\n", again=" ", few=200, known=True
    ),
    "slow_readers": Attack(f"GET /runs/a/{BIG} HTTP/1.1\r\n" + _HERE + "\r\n"),
    "requests": Attack("GET /runs.json HTTP/1.1\r\n" + _HERE + "\r\n", few=32, anew=True, reads=True),
    "pages": Attack("GET / HTTP/1.1\r\n" + _HERE + "\r\n", again="GET / HTTP/1.1\r\n" + _HERE + "\r\n", few=32,
                    reads=True),
    "changes_without_token": Attack("POST /stop HTTP/1.1\r\n" + _HERE + _JSON + "Content-Length: 2\r\n\r\n{{}}",
                                    few=32, anew=True),
    "long_headers": Attack("GET / HTTP/1.1\r\n" + _HERE + "X: " + "a" * _LONG, again="a" * _LONG, few=32),
    "long_addresses": Attack("GET /" + "a" * _LONG + " HTTP/1.1\r\n" + _HERE + "\r\n", few=32, anew=True),
    "long_bodies": Attack("POST /stop HTTP/1.1\r\n" + _HERE + _JSON + "Content-Length: 10000000000\r\n\r\n",
                          again=" " * _PIECE, few=32),
    "upgrades": Attack("GET /events HTTP/1.1\r\n" + _HERE + "Connection: Upgrade\r\nUpgrade: websocket\r\n"
                       "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n",
                       few=32, anew=True),
    "pipelines": Attack(("GET / HTTP/1.1\r\n" + _HERE + "\r\n") * 200, again="GET / HTTP/1.1\r\n" + _HERE + "\r\n",
                        few=32),
    "resets": Attack("", anew=True, reset=True),
    "hellos": Attack(_HELLO, anew=True),
    "no_requests": Attack("nonsense\r\n\r\n", anew=True),
    "no_descriptors": Attack("GET / HTTP/1.1\r\n" + _HERE, takes_descriptors=True),
}  # fmt: skip


class _Connections:
    """Connections of an attack; each one that the server closed is opened anew."""

    def __init__(self, attack: Attack, port: int, token: str, connections: int) -> None:
        self._attack, self._port = attack, port
        self._first, self._again = (
            text.format(port=port, token=token).encode("latin-1") for text in (attack.first, attack.again)
        )
        self._ends: list[socket.socket | None] = [None] * (attack.few or connections)

    def turn(self) -> None:
        """Let each connection do what it does."""
        for place, end in enumerate(self._ends):
            if end is not None and not self._attack.anew and self._lives(end):
                if self._again:
                    with suppress(OSError):
                        end.send(self._again)
                continue
            if end is not None:
                end.close()
            self._ends[place] = self._opened(place)

    def _lives(self, end: socket.socket) -> bool:
        try:
            return bool(end.recv(1 << 16) if self._attack.reads else end.recv(1, socket.MSG_PEEK))
        except BlockingIOError:
            return True
        except OSError:
            return False

    def _opened(self, place: int) -> socket.socket | None:
        try:
            end = socket.socket()
        except OSError:
            return None
        try:
            if self._attack.reset:
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            end.settimeout(1.0)
            if self._attack.addresses > 1:
                end.bind((f"127.0.0.{2 + place % self._attack.addresses}", 0))
            end.connect(("127.0.0.1", self._port))
            end.setblocking(False)
            end.send(self._first)
        except OSError:
            end.close()
            return None
        return end


@contextmanager
def under(name: str, port: int, token: str, connections: int) -> Iterator[None]:
    """Carry out an attack, from when it is in place."""
    words = [sys.executable, "-m", "tests.faults.panel_attacks", name, "--port", str(port)]
    words += ["--connections", str(connections)]
    environment = {**os.environ, "PANEL_TOKEN": token if ATTACKS[name].known else "none"}
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == b"in place\n"
            yield
        finally:
            process.kill()


def main() -> None:
    """Attack."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=sorted(ATTACKS))
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--connections", type=int, default=1200)
    options = parser.parse_args()
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    attack, clock = ATTACKS[options.name], WallClock()
    connections = _Connections(attack, options.port, os.environ.get("PANEL_TOKEN", ""), options.connections)
    connections.turn()
    print("in place", flush=True)
    while not select.select([sys.stdin], [], [], 0)[0]:
        connections.turn()
        if not attack.anew:
            clock.wait_s(_PAUSE_S)


if __name__ == "__main__":
    main()
