"""What the Modbus master promises on the wire: silence, whole messages, and who answers."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.transport.modbus import ModbusMaster, ModbusRefused, silence_s
from sim.devices.clock import VirtualClock

READ_2 = bytes.fromhex("01 03 00 07 00 02 75 CA")
Rtu = Callable[[str], bytes]
Script = Callable[[list[Any]], Any]


@pytest.mark.parametrize(
    ("baud", "expected_s"),
    [(9600, 38.5 / 9600), (19200, 38.5 / 19200), (19201, 1.75e-3), (38400, 1.75e-3), (115200, 1.75e-3)],
)
def test_silence_is_fixed_above_19200_baud(baud: int, expected_s: float) -> None:
    """V1.02 of Modbus over serial line, §2.5.1.1: 3.5 characters of 11 bits, or 1.75 ms."""
    assert silence_s(baud) == pytest.approx(expected_s)


def _next_frame_s(scripted: Script, rtu: Rtu, **options: Any) -> float:
    """When a frame begins after one that nobody answers."""
    clock, question = VirtualClock(), rtu("01 06 00 07 00 01")
    wire = scripted([(rtu("00 06 60 02 00 40"), b""), (question, question)])
    wire.clock = clock
    bus = ModbusMaster(wire, clock, **options)
    bus.send_now([1, 2], 0x6002, 0x40)
    bus.write_one(1, 7, 1)
    return clock.monotonic_s()


def test_a_bus_of_which_nothing_is_said_has_115200_baud(scripted: Script, rtu: Rtu) -> None:
    """Eight characters of ten bits, and the silence."""
    assert _next_frame_s(scripted, rtu) == _next_frame_s(scripted, rtu, baud=115200)
    assert _next_frame_s(scripted, rtu) == pytest.approx(8 * 10 / 115200 + 1.75e-3)


def test_a_refusal_reads_as_one_sentence(clock: VirtualClock, scripted: Script, rtu: Rtu) -> None:
    bus = ModbusMaster(scripted([(READ_2, rtu("01 83 02"))]), clock)
    with pytest.raises(ModbusRefused) as refused:
        bus.read(1, 7, 2)
    assert str(refused.value) == (
        "scripted: device 1, read (function 3) of 2 registers at 0x0007: "
        "refused with exception 2, illegal data address"
    )
