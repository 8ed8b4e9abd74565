"""Any bytes at all on the wire: an error in bounded time, never another exception, never a wrong device stirred."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.settings import Framing
from rig.transport import LoopbackTransport
from rig.transport.modbus import ModbusError, ModbusMaster
from sim.devices import SerialLine
from sim.devices.clock import VirtualClock
from tests.error_codes import has_code

FRAMINGS = pytest.mark.parametrize("framing", ["rtu", "tcp"])
# Mostly what looks like the beginning of an answer: pure noise hardly ever gets past the first byte.
BEGINNINGS = st.sampled_from(
    [
        b"", b"\x01\x03", b"\x01\x03\x02", b"\x01\x83", b"\x01\x90", b"\x01\x2b\x0e", b"\x01\x08", b"\x01\x14",
        b"\x00\x01\x00\x00\x00\x05\x01\x03", b"\x00\x01\x00\x00\x00\x03\x01\x83", b"\x00\x01\x00\x00\x00\x02\x01\x2b",
    ]
)  # fmt: skip
NOISE = st.builds(lambda first, rest: first + rest, BEGINNINGS, st.binary(max_size=40))
CODES = {
    *("no_reply", "incomplete", "bad_crc", "no_modbus", "does_not_fit", "another_device", "late_answer", "refused"),
}


class Noise:
    """A far end that answers each question with the next of these."""

    def __init__(self, clock: VirtualClock, answers: list[bytes]) -> None:
        self.line = SerialLine(clock, 115200)
        self._answers = iter(answers)
        self.line.connect(lambda data: self.line.device_write(next(self._answers, b"")))


@FRAMINGS
@given(answers=st.lists(NOISE, min_size=1, max_size=3))
@settings(max_examples=150, deadline=None)
def test_the_master_ends_with_an_error_in_bounded_time(framing: Framing, answers: list[bytes]) -> None:
    clock = VirtualClock()
    master = ModbusMaster(LoopbackTransport(Noise(clock, answers).line, clock), clock, framing=framing)
    came: ModbusError | None = None
    try:
        master.read(1, 0x1003, 1)
    except ModbusError as error:
        came = error
    if came is not None:
        assert "\n" not in str(came)
        assert came.code in CODES
        has_code(came, came.code, device=1, function="read", function_number=3, count=1, address=0x1003)
    assert clock.monotonic_s() < 2.0


@FRAMINGS
@given(answer=NOISE)
@settings(max_examples=100, deadline=None)
def test_a_write_sends_one_frame_whatever_comes_back(framing: Framing, answer: bytes) -> None:
    clock = VirtualClock()
    line, heard = SerialLine(clock, 115200), list[bytes]()
    line.connect(lambda data: (heard.append(data), line.device_write(answer)))
    with pytest.raises(ModbusError):
        ModbusMaster(LoopbackTransport(line, clock), clock, framing=framing).write(
            1, 0x6200, [1, 0, 0, 60, 1, 1, 0, 16]
        )
    assert len(heard) == 1
