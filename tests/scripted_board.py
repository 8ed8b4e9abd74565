"""A GRBL board at the far end of a wire, for tests of its driver: it says what a test wants it to say."""

import math
import re
from typing import Any

from rig.devices.grbl import GrblStage
from sim.devices.clock import VirtualClock

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
SETTINGS = b"$13=0\r\n$100=400.000\r\n$110=600.000\r\n$120=50.000\r\nok\r\n"
OVERRIDES = range(0x90, 0xA5)
At = tuple[float, bytes]


class Board:
    """Answers `ok` to a line, a banner to a reset and `status` to `?`; `answers` and `next` say otherwise.

    answers holds for good, next is used up; each answer is one chunk, or chunks that come so many seconds later. A
    target is confirmed as a board at rest does that stands where the last status said: `?` after G92, and `$G`.
    """

    name = "board"

    def __init__(self, clock: VirtualClock, status: bytes = b"<Idle|MPos:-1.000,-2.000,-3.000|FS:0,0>\r\n") -> None:
        self.clock, self.status = clock, status
        self.answers: dict[bytes, bytes | list[At]] = {
            b"$$\n": SETTINGS,
            b"\x18": BANNER,
            b"$H\n": [(0.11, at("Home")), (0.12, b"ok\r\n")],
        }
        self._place, self._feed, self._confirm = (-1.0, -2.0, -3.0), "0", b""
        self.next: dict[bytes, list[bytes | list[At]]] = {}
        self.heard: list[At] = []
        self._due: list[At] = []

    def write(self, data: bytes) -> None:
        now_s = self.clock.monotonic_s()
        data = bytes(byte for byte in data if byte not in OVERRIDES)
        if not data:
            return
        self.heard.append((now_s, data))
        answer = self._answer(data)
        chunks = [(0.0, answer)] if isinstance(answer, bytes) else answer
        self._due = sorted(self._due + [(now_s + after_s, chunk) for after_s, chunk in chunks if chunk])

    def says(self, data: bytes, after_s: float = 0.0) -> None:
        """Unasked."""
        self._due = sorted([*self._due, (self.clock.monotonic_s() + after_s, data)])

    def read(self, timeout_s: float) -> bytes:
        wait_s = self._due[0][0] - self.clock.monotonic_s() if self._due else math.inf
        self.clock.wait_s(min(max(wait_s, 0.0), timeout_s))
        return self._due.pop(0)[1] if wait_s <= timeout_s else b""

    def close(self) -> None:
        """Nothing to close."""

    def times(self, data: bytes) -> list[float]:
        """When this was heard."""
        return [t_s for t_s, heard in self.heard if heard == data]

    @property
    def said(self) -> list[bytes]:
        """What it was told, in order."""
        return [data for _, data in self.heard]

    def _answer(self, data: bytes) -> bytes | list[At]:
        if data.startswith(b"G92"):
            numbers = re.fullmatch(rb"G92X(.+)Y(.+)Z(.+)G90G21G94F(.+)\n", data)
            assert numbers, data
            *coordinates, feed = (float(number) for number in numbers.groups())
            zero = ",".join(f"{mm - to:.3f}" for mm, to in zip(self._place, coordinates, strict=True))
            self._confirm = at("Idle", *self._place).replace(b">", f"|WCO:{zero}>".encode())
            self._feed = f"{feed:.0f}"
        if data == b"$G\n" and data not in self.answers:
            return f"[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F{self._feed} S0]\r\nok\r\n".encode()
        if data == b"?" and self._confirm:
            confirm, self._confirm = self._confirm, b""
            return confirm
        if self.next.get(data):
            return self._placed(self.next[data].pop(0))
        if data == b"?":
            return self._placed(self.status)
        return self.answers.get(data, b"ok\r\n" if data.endswith(b"\n") else b"")

    def _placed(self, answer: bytes | list[At]) -> bytes | list[At]:
        said = answer if isinstance(answer, bytes) else b"".join(chunk for _, chunk in answer)
        found = re.search(rb"<[^<>]*MPos:([-\d.]+),([-\d.]+),([-\d.]+)[^<>]*>", said)
        if found:
            x, y, z = map(float, found.groups())
            self._place = (x, y, z)
        return answer

    def after(self, line: bytes) -> list[At]:
        """What it heard after the last time that it was told a line."""
        last = max(i for i, (_, data) in enumerate(self.heard) if data == line)
        return self.heard[last + 1 :]


def at(state: str, x_mm: float = -1.0, y_mm: float = -2.0, z_mm: float = -3.0) -> bytes:
    """A status at these places."""
    return f"<{state}|MPos:{x_mm:.3f},{y_mm:.3f},{z_mm:.3f}|FS:0,0>\r\n".encode()


def connected(board: Board, *, homed: bool = True, **options: Any) -> GrblStage:
    """A driver that has connected to the board and homed; what the board heard of that is forgotten."""
    stage = GrblStage(board, board.clock, **options)
    stage.connect()
    if homed:
        stage.home()
    board.heard.clear()
    return stage
