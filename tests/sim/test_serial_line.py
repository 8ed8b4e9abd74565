"""The virtual cable: 10 bits a byte, one chunk after another."""

import pytest

from sim.devices import SerialLine
from sim.devices.clock import VirtualClock
from sim.errors import ArgumentError
from tests.error_codes import raises


def test_a_chunk_arrives_when_its_last_bit_has() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 9600)
    line.device_write(b"hello")
    clock.wait_s(5 * 10 / 9600 - 1e-9)
    assert not line.host_pending()
    clock.wait_s(2e-9)
    assert line.host_pending()
    assert line.host_read() == b"hello"
    assert not line.host_pending()


def test_each_direction_serialises_its_chunks() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 1000)
    heard: list[tuple[float, bytes]] = []
    line.connect(lambda data: heard.append((clock.monotonic_s(), data)))
    line.host_write(b"ab")
    line.host_write(b"c")
    line.device_write(b"x")
    clock.wait_s(1.0)
    assert heard == [(pytest.approx(0.02), b"ab"), (pytest.approx(0.03), b"c")]
    line.host_write(b"d")
    clock.wait_s(1.0)
    assert heard[-1] == (pytest.approx(1.01), b"d")


def test_a_cable_that_ends_nowhere_swallows_bytes() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 9600)
    line.host_write(b"?")
    clock.wait_s(1.0)
    assert line.host_read() == b""


def test_baud_must_be_positive() -> None:
    with raises(ArgumentError, "bad_baud", baud=0):
        SerialLine(VirtualClock(), 0)
