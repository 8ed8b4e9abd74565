"""Bytes in, bytes out of the virtual balance, on loads that rest and loads that move."""

import math
from collections.abc import Callable
from itertools import pairwise

import pytest

from sim.devices import Load, SerialLine, VirtualBalance
from sim.devices.clock import VirtualClock

GRAM_N = 9.80665e-3


class Host:
    def __init__(self, force_n: Callable[[float], float]) -> None:
        self.clock = VirtualClock()
        self.line = SerialLine(self.clock, 9600)
        self.asked: list[float] = []

        def watched(t_s: float) -> float:
            self.asked.append(t_s)
            return force_n(t_s)

        self.balance = VirtualBalance(self.clock, self.line, Load(watched))

    def say(self, data: bytes, wait_s: float = 0.04) -> bytes:
        self.line.host_write(data)
        self.clock.wait_s(wait_s)
        return self.line.host_read()


def _bears(grams: Callable[[float], float], wait_s: float = 0.0) -> Callable[[], Host]:
    """A balance under a weight that may move, so long after it was switched on."""

    def begun() -> Host:
        host = Host(lambda t_s: grams(t_s) * GRAM_N)
        host.clock.wait_s(wait_s)
        return host

    return begun


_rests = _bears(lambda t_s: 100.0)


@pytest.fixture
def host() -> Host:
    """100 g at rest."""
    return _rests()


Said = tuple[bytes, bytes] | tuple[bytes, float, bytes]
"""A command, seconds of waiting if not 0.04, and the reply; lines end in CR LF but where a piece is sent."""

SERIAL = b'I4 A "0123456789"\r\n'
CONVERSATIONS: dict[str, tuple[Callable[[], Host], *tuple[Said, ...]]] = {
    "stable and immediate value": (_rests, (b"S\r\n", b"S S     100.00 g\r\n"), (b"SI\r\n", b"S S     100.00 g\r\n")),
    "a moving load is dynamic and of the last sample": (  # samples at 0.95 and 1.00 s; the next would be at 1.05
        _bears(lambda t_s: 10 * t_s, 1.03), (b"SI\r\n", 0.01, b""), (b"", 0.03, b"S D      10.00 g\r\n"),
    ),
    "S waits until the load rests": (
        _bears(lambda t_s: min(t_s, 1.0) * 50, 0.5), (b"S\r\n", 0.5, b""), (b"", 0.2, b"S S      50.00 g\r\n"),
    ),
    "S gives up after a bounded time": (
        _bears(lambda t_s: 15 * t_s, 1.0), (b"S\r\n", 2.9, b""), (b"", 0.3, b"S I\r\n"),
    ),
    "a second command while it waits is refused, and @ cancels": (
        _bears(lambda t_s: 20 * t_s, 1.0),
        (b"S\r\n", b""), (b"SI\r\n", b"S I\r\n"), (b"@\r\n", SERIAL), (b"", 10.0, b""),
    ),
    **{
        name: (
            _bears(lambda t_s, grams=grams: grams),  # type: ignore[misc]
            (b"SI\r\n", b"S " + sign), (b"S\r\n", b"S " + sign), (b"Z\r\n", b"Z " + sign), (b"TI\r\n", b"TI " + sign),
        )
        for name, grams, sign in (("overload", 200.5, b"+\r\n"), ("underload", -25.0, b"-\r\n"))
    },
    "a broken cell has no value": (
        _bears(lambda t_s: math.nan), (b"SI\r\n", b"S I\r\n"), (b"S\r\n", 4.0, b"S I\r\n"),
    ),
    "zero": (_rests, (b"Z\r\n", b"Z A\r\n"), (b"SI\r\n", b"S S       0.00 g\r\n")),
    "zero at once tells whether it was stable": (_bears(lambda t_s: 10 * t_s, 1.0), (b"ZI\r\n", b"ZI D\r\n")),
    "tare": (
        _rests,
        (b"T\r\n", b"T S     100.00 g\r\n"), (b"TA\r\n", b"TA A     100.00 g\r\n"),
        (b"SI\r\n", b"S S       0.00 g\r\n"), (b"TAC\r\n", b"TAC A\r\n"), (b"SI\r\n", b"S S     100.00 g\r\n"),
        (b"TA 25.5 g\r\n", b"TA A      25.50 g\r\n"), (b"SI\r\n", b"S S      74.50 g\r\n"),
        (b"TI\r\n", b"TI S     100.00 g\r\n"),
    ),
    "errors": (
        _rests,
        (b"si\r\n", b"ES\r\n"), (b"XYZ\r\n", b"ES\r\n"), (b"\r\n", b"ES\r\n"), (b"S\xb2\r\n", b"ET\r\n"),
        (b"SI 3\r\n", b"EL\r\n"), (b"TA x g\r\n", b"EL\r\n"),
    ),
    "commands may come in pieces": (_rests, (b"I", b""), (b"4\r", b""), (b"\n", SERIAL)),
}  # fmt: skip


@pytest.mark.parametrize("name", CONVERSATIONS)
def test_a_conversation(name: str) -> None:
    begun, *said = CONVERSATIONS[name]
    host = begun()
    for command, *wait_s, reply in said:
        assert host.say(command, *wait_s) == reply, command  # type: ignore[arg-type]


def test_sir_repeats_every_sample_until_at() -> None:
    host = Host(lambda t_s: 10 * t_s * GRAM_N)
    host.clock.wait_s(1.0)
    lines = host.say(b"SIR\r\n", 1.0).split(b"\r\n")[:-1]
    assert len(lines) in (19, 20, 21)
    grams = [float(line.split()[2]) for line in lines]
    assert [b - a for a, b in pairwise(grams[1:])] == pytest.approx([0.5] * (len(grams) - 2))
    assert host.say(b"@\r\n", 0.2).endswith(b'I4 A "0123456789"\r\n')
    assert host.say(b"", 1.0) == b""
