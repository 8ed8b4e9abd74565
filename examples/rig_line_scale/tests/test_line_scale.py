"""Tests of the driver by requests and replies, and of the twin by its bytes."""

from collections import deque
from typing import Any

import pytest

from rig.devices.base import ForceError, ForceOverload, ForceTimeout, ForceUnderload
from rig.transport import LoopbackTransport
from rig.units import GWT_N
from rig_line_scale.driver import LineScaleForce
from rig_line_scale.twin import line_scale_twin
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, SerialLine, VirtualForceSpec


class Pairs:
    """Transport with a fixed reply to each request, which fails for any other request."""

    name = "wire"

    def __init__(self, clock: VirtualClock, pairs: list[tuple[bytes, bytes]]) -> None:
        self.clock, self.pairs, self.waiting, self.closed = clock, deque(pairs), b"", False

    def write(self, data: bytes) -> None:
        asked, self.waiting = self.pairs.popleft()
        assert data == asked

    def read(self, timeout_s: float) -> bytes:
        data, self.waiting = self.waiting, b""
        if not data:
            self.clock.wait_s(timeout_s)
        return data

    def close(self) -> None:
        self.closed = True


def _driver(wire: Any, clock: VirtualClock, scale: float = 1.0) -> LineScaleForce:
    return LineScaleForce(wire, clock, 7, sample_period_s=0.05, resolution_gwt=0.01, scale=scale)


def _asked(*pairs: tuple[bytes, bytes], scale: float = 1.0) -> LineScaleForce:
    clock = VirtualClock()
    return _driver(Pairs(clock, list(pairs)), clock, scale)


def test_it_says_who_it_is() -> None:
    assert _asked((b"#07I\r", b"=07 LS-100 4711\r\n")).connect() == "line scale LS-100 4711"


@pytest.mark.parametrize(
    ("answer", "gwt", "stable"),
    [(b"=07S+0001.97\r\n", 1.97, True), (b"=07D-0012.30\r\n", -12.3, False), (b"=07S+0000.00\r\n", 0.0, True)],
)
def test_a_weight_is_a_force(answer: bytes, gwt: float, stable: bool) -> None:
    found = _asked((b"#07W\r", answer), scale=2.0).read()
    assert found.force_n == pytest.approx(2.0 * gwt * GWT_N)
    assert found.stable is stable


@pytest.mark.parametrize(
    ("answer", "error", "told"),
    [
        (b"=07H\r\n", ForceOverload, "overloaded"),
        (b"=07L\r\n", ForceUnderload, "underloaded"),
        (b"=07?\r\n", ForceError, "garbled answer '[?]'"),
        (b"=07S+1.97\r\n", ForceError, "garbled"),
        (b"=08S+0001.97\r\n", ForceError, "garbled answer '=08"),
        (b"", ForceTimeout, "no answer to W in 0.5 s"),
        (b"=07S+00", ForceTimeout, "no answer to W"),
    ],
)
def test_what_is_no_force_is_an_error(answer: bytes, error: type[ForceError], told: str) -> None:
    with pytest.raises(error, match=f"^wire: .*{told}"):
        _asked((b"#07W\r", answer)).read()


def test_zero_is_acknowledged() -> None:
    _asked((b"#07Z\r", b"=07OK\r\n")).zero()
    with pytest.raises(ForceError, match=r"garbled answer '[?]'"):
        _asked((b"#07Z\r", b"=07?\r\n")).zero()


@pytest.mark.parametrize(
    ("load_g", "question", "answer"),
    [
        (0.0, b"#07I\r", b"=07 LS-100 4711\r\n"),
        (1.974, b"#07W\r", b"=07S+0001.97\r\n"),
        (-1.974, b"#07W\r", b"=07S-0001.97\r\n"),
        (200.1, b"#07W\r", b"=07H\r\n"),
        (-20.1, b"#07W\r", b"=07L\r\n"),
        (5.0, b"#07Z\r#07W\r", b"=07OK\r\n=07S+0000.00\r\n"),
        (0.0, b"#07X\r", b"=07?\r\n"),
        (0.0, b"#08W\r", b""),
    ],
)
def test_the_twin_speaks_the_same(load_g: float, question: bytes, answer: bytes) -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 9600)
    line_scale_twin(clock, line, VirtualForceSpec(0.05, 0.01, own={"address": 7}), Load(lambda t_s: load_g * GWT_N))
    wire = LoopbackTransport(line, clock, "wire")
    wire.write(question)
    heard = b""
    while data := wire.read(0.1):
        heard += data
    assert heard == answer


def test_driver_and_twin_understand_each_other() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 9600)
    line_scale_twin(
        clock, line, VirtualForceSpec(0.05, 0.01, own={"address": 7}), Load(lambda t_s: (5 + 10 * t_s) * GWT_N)
    )
    force = _driver(LoopbackTransport(line, clock, "wire"), clock)
    force.connect()
    force.zero()
    clock.wait_s(1.0)
    found = force.read()
    assert found.force_n == pytest.approx(10 * GWT_N, abs=0.6 * GWT_N)
    assert not found.stable
