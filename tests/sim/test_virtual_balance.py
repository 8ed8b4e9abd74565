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


@pytest.fixture
def host() -> Host:
    """100 g at rest."""
    return Host(lambda t_s: 100 * GRAM_N)


def test_stable_and_immediate_value(host: Host) -> None:
    assert host.say(b"S\r\n") == b"S S     100.00 g\r\n"
    assert host.say(b"SI\r\n") == b"S S     100.00 g\r\n"


def test_a_moving_load_is_dynamic_and_of_the_last_sample() -> None:
    host = Host(lambda t_s: 10 * t_s * GRAM_N)
    host.clock.wait_s(1.03)
    # Samples at 0.95 and 1.00 s; the next would be at 1.05.
    assert host.say(b"SI\r\n", 0.01) == b""
    assert host.say(b"", 0.03) == b"S D      10.00 g\r\n"


def test_samples_are_taken_on_the_grid_and_only_when_asked() -> None:
    host = Host(lambda t_s: t_s * GRAM_N)
    host.clock.wait_s(100.0)
    assert host.asked == []
    host.say(b"SI\r\n")
    assert sorted(host.asked) == pytest.approx([99.9, 99.95, 100.0])
    host.say(b"SI\r\n")
    assert len(host.asked) <= 4


def test_s_waits_until_the_load_rests() -> None:
    host = Host(lambda t_s: min(t_s, 1.0) * 50 * GRAM_N)
    host.clock.wait_s(0.5)
    assert host.say(b"S\r\n", 0.5) == b""
    assert host.say(b"", 0.2) == b"S S      50.00 g\r\n"


def test_s_gives_up_after_a_bounded_time() -> None:
    host = Host(lambda t_s: 15 * t_s * GRAM_N)
    host.clock.wait_s(1.0)
    assert host.say(b"S\r\n", 2.9) == b""
    assert host.say(b"", 0.3) == b"S I\r\n"


def test_a_second_command_while_it_waits_is_refused_and_at_cancels() -> None:
    host = Host(lambda t_s: 20 * t_s * GRAM_N)
    host.clock.wait_s(1.0)
    host.say(b"S\r\n")
    assert host.say(b"SI\r\n") == b"S I\r\n"
    assert host.say(b"@\r\n") == b'I4 A "0123456789"\r\n'
    assert host.say(b"", 10.0) == b""


@pytest.mark.parametrize(("grams", "sign"), [(200.5, b"+"), (-25.0, b"-")])
def test_overload_and_underload(grams: float, sign: bytes) -> None:
    host = Host(lambda t_s: grams * GRAM_N)
    assert host.say(b"SI\r\n") == b"S " + sign + b"\r\n"
    assert host.say(b"S\r\n") == b"S " + sign + b"\r\n"
    assert host.say(b"Z\r\n") == b"Z " + sign + b"\r\n"
    assert host.say(b"TI\r\n") == b"TI " + sign + b"\r\n"


def test_a_broken_cell_has_no_value() -> None:
    host = Host(lambda t_s: math.nan)
    assert host.say(b"SI\r\n") == b"S I\r\n"
    assert host.say(b"S\r\n", 4.0) == b"S I\r\n"


def test_zero(host: Host) -> None:
    assert host.say(b"Z\r\n") == b"Z A\r\n"
    assert host.say(b"SI\r\n") == b"S S       0.00 g\r\n"


def test_zero_at_once_tells_whether_it_was_stable() -> None:
    host = Host(lambda t_s: 10 * t_s * GRAM_N)
    host.clock.wait_s(1.0)
    assert host.say(b"ZI\r\n") == b"ZI D\r\n"


def test_tare(host: Host) -> None:
    assert host.say(b"T\r\n") == b"T S     100.00 g\r\n"
    assert host.say(b"TA\r\n") == b"TA A     100.00 g\r\n"
    assert host.say(b"SI\r\n") == b"S S       0.00 g\r\n"
    assert host.say(b"TAC\r\n") == b"TAC A\r\n"
    assert host.say(b"SI\r\n") == b"S S     100.00 g\r\n"
    assert host.say(b"TA 25.5 g\r\n") == b"TA A      25.50 g\r\n"
    assert host.say(b"SI\r\n") == b"S S      74.50 g\r\n"
    assert host.say(b"TI\r\n") == b"TI S     100.00 g\r\n"


def test_sir_repeats_every_sample_until_at() -> None:
    host = Host(lambda t_s: 10 * t_s * GRAM_N)
    host.clock.wait_s(1.0)
    lines = host.say(b"SIR\r\n", 1.0).split(b"\r\n")[:-1]
    assert len(lines) in (19, 20, 21)
    grams = [float(line.split()[2]) for line in lines]
    assert [b - a for a, b in pairwise(grams[1:])] == pytest.approx([0.5] * (len(grams) - 2))
    assert host.say(b"@\r\n", 0.2).endswith(b'I4 A "0123456789"\r\n')
    assert host.say(b"", 1.0) == b""


def test_errors(host: Host) -> None:
    assert host.say(b"si\r\n") == b"ES\r\n"
    assert host.say(b"XYZ\r\n") == b"ES\r\n"
    assert host.say(b"\r\n") == b"ES\r\n"
    assert host.say(b"S\xb2\r\n") == b"ET\r\n"
    assert host.say(b"SI 3\r\n") == b"EL\r\n"
    assert host.say(b"TA x g\r\n") == b"EL\r\n"


def test_commands_may_come_in_pieces(host: Host) -> None:
    assert host.say(b"I") == b""
    assert host.say(b"4\r") == b""
    assert host.say(b"\n") == b'I4 A "0123456789"\r\n'


def test_a_mute_balance(host: Host) -> None:
    host.balance.mute = True
    assert host.say(b"SI\r\n", 1.0) == b""


def test_it_says_what_it_is_and_what_it_can(host: Host) -> None:
    """MT-SICS manual, level 0: I0 lists commands with their level, I1 levels and versions, I2 type, I3 software."""
    assert host.say(b"I1\r\n", 0.2) == b'I1 A "01" "2.30" "2.20" "" ""\r\n'
    assert host.say(b"I2\r\n", 0.2) == b'I2 A "virtual-balance 200.00 g"\r\n'
    assert host.say(b"I3\r\n", 0.2) == b'I3 A "1.00"\r\n'
    assert host.say(b"I4\r\n", 0.2) == b'I4 A "0123456789"\r\n'
    lines = host.say(b"I0\r\n", 1.0).decode().splitlines()
    assert lines[0] == 'I0 B 0 "@"'
    assert [line[3] for line in lines] == ["B"] * (len(lines) - 1) + ["A"]
    listed = {line.split('"')[1]: int(line[5]) for line in lines}
    assert listed == {
        "@": 0, "I0": 0, "I1": 0, "I2": 0, "I3": 0, "I4": 0, "S": 0, "SI": 0, "SIR": 0, "Z": 0, "ZI": 0,
        "T": 1, "TA": 1, "TAC": 1, "TI": 1,
    }  # fmt: skip
    for command in listed:
        assert host.say(command.encode() + b"\r\n", 5.0) not in (b"", b"ES\r\n"), command
