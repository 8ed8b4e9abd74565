"""The same conversation with the virtual board and, where RIG_GRBL_PORT names one, with real firmware."""

import os
from collections.abc import Iterator

import pytest

from rig.clock import Clock, WallClock
from rig.stage import GrblStage
from rig.transport import LineReader, LoopbackTransport, SerialTransport, Transport
from sim.clock import VirtualClock
from sim.devices import SerialLine, VirtualGrbl

PORT = os.environ.get("RIG_GRBL_PORT")
Wire = tuple[Transport, Clock]


@pytest.fixture(
    params=["virtual", pytest.param("real", marks=pytest.mark.skipif(not PORT, reason="no RIG_GRBL_PORT"))]
)
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    if request.param == "real":
        transport: Transport = SerialTransport(str(PORT))
        yield transport, WallClock()
        transport.close()
    else:
        clock = VirtualClock()
        line = SerialLine(clock, 115200)
        VirtualGrbl(clock, line)
        yield LoopbackTransport(line, clock), clock


def test_the_driver_finds_its_way_in(wire: Wire) -> None:
    stage = GrblStage(*wire)
    assert "[VER:1.1" in stage.connect()
    assert {100, 101, 102, 110, 111, 112, 120, 121, 122, 130, 131, 132} <= set(stage.settings())
    stage.unlock()
    assert stage.status().state == "Idle"


@pytest.mark.parametrize(
    ("sent", "answer"),
    [
        (b"G90\n", "ok"), (b"\n", "ok"), (b"G999\n", "error:20"), (b"$999=1\n", "error:3"),
        (b"G1X0F0\n", "error:22"), (b"$J=G91X1\n", "error:22"), (b"N1" + b"0" * 80 + b"\n", "error:11"),
    ],
)  # fmt: skip
def test_answers(wire: Wire, sent: bytes, answer: str) -> None:
    transport, clock = wire
    stage = GrblStage(transport, clock)
    stage.connect()
    stage.unlock()
    transport.write(sent)
    assert LineReader(transport, clock).read_line(clock.monotonic_s() + 2.0) == answer
