"""A wire whose other end is a list of bytes: [(sent, reply), ...]."""

from collections import deque
from collections.abc import Callable, Iterator

import pytest

from sim.clock import VirtualClock

Pair = tuple[bytes, bytes | list[bytes]]


class ScriptedTransport:
    """Expects each `sent` in turn and then offers its reply, in one chunk or in the chunks of a list."""

    name = "scripted"

    def __init__(self, clock: VirtualClock, script: list[Pair]) -> None:
        self.clock = clock
        self.script = deque(script)
        self.sent = b""
        self.chunks: deque[bytes] = deque()
        self.closed = False
        self._offer_unasked()

    def write(self, data: bytes) -> None:
        assert self.script, f"{data!r} sent past the end of the script"
        self.sent += data
        expected, reply = self.script[0]
        assert expected.startswith(self.sent), f"sent {self.sent!r}, expected {expected!r}"
        if self.sent == expected:
            self.script.popleft()
            self.sent = b""
            self._offer(reply)
            self._offer_unasked()

    def read(self, timeout_s: float) -> bytes:
        if self.chunks:
            return self.chunks.popleft()
        self.clock.wait_s(timeout_s)
        return b""

    def close(self) -> None:
        self.closed = True

    def _offer_unasked(self) -> None:
        while self.script and not self.script[0][0]:
            self._offer(self.script.popleft()[1])

    def _offer(self, reply: bytes | list[bytes]) -> None:
        self.chunks.extend([reply] if isinstance(reply, bytes) else reply)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def scripted(clock: VirtualClock) -> Iterator[Callable[[list[Pair]], ScriptedTransport]]:
    """Make a scripted transport; at the end of the test its script must be used up."""
    made: list[ScriptedTransport] = []

    def make(script: list[Pair]) -> ScriptedTransport:
        made.append(ScriptedTransport(clock, script))
        return made[-1]

    yield make
    for transport in made:
        assert not transport.script, f"never sent: {transport.script[0][0]!r}"
