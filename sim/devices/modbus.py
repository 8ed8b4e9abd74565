"""Modbus slaves behind a virtual line: RTU and TCP frames, register files and exceptions.

Sources: Modbus application protocol V1.1b3; Modbus over serial line V1.02. pymodbus splits and seals frames. Behind a
TCP gateway the line's baud is that of the gateway's serial side, and unit 0 is a broadcast there.
"""

from collections.abc import Mapping, Sequence
from typing import Literal, Protocol

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

from sim.devices.clock import Scheduler
from sim.devices.line import SerialLine
from sim.errors import SimError

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_BUSY = 1, 2, 3, 6
BROADCAST = 0
ALONE = (0, 255)
"""Unit ids on TCP that address the device behind the port, if it is a single device (guide V1.0b, 4.4.2)."""

# An incomplete RTU frame is dropped after this time, because a host process may pause for longer than 3.5 characters.
FORGET_S = 0.05
_HEADER, _SHORTEST, _LONGEST = 6, 2, 254  # of a TCP frame: header bytes, smallest and largest length


class RegisterFault(SimError):  # noqa: N818
    """Error of a register that cannot be read or written, with the number of the Modbus exception."""

    default_code = "register_fault"

    def __init__(self, number: int) -> None:
        super().__init__(f"Modbus exception {number}")
        self.number = number


class Registers(Protocol):
    """Holding registers of a device, 16 bits each."""

    functions: frozenset[int]

    def read(self, address: int, count: int) -> list[int]:
        """Return `count` registers from `address` on. Raises RegisterFault."""
        ...

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write registers from `address` on. Raises RegisterFault."""
        ...


class ModbusBus:
    """Devices by id on one line; each answers turnaround_s after the last byte of a request.

    Devices whose id is in `mute` do not respond, as if unplugged.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        line: SerialLine,
        devices: Mapping[int, Registers],
        *,
        framing: Literal["rtu", "tcp"] = "rtu",
        turnaround_s: float = 2e-3,
    ) -> None:
        self._scheduler, self._line, self._devices = scheduler, line, devices
        self._turnaround_s = turnaround_s
        self._rtu = framing == "rtu"
        decoder = DecodePDU(is_server=True)
        self._framer = FramerRTU(decoder) if self._rtu else FramerSocket(decoder)
        self._received = b""
        self._last_s = 0.0
        self.mute: set[int] = set()
        line.connect(self._on_bytes, self._renew)

    def _on_bytes(self, data: bytes) -> None:
        now_s = self._scheduler.monotonic_s()
        if self._rtu and now_s - self._last_s > FORGET_S:
            self._received = b""
        self._last_s = now_s
        self._received += data
        while (frame := self._received if self._rtu else self._whole_tcp()) and self._take(frame):
            pass
        if self._rtu and self._received:
            self._scheduler.call_at(now_s + FORGET_S, self._refuse_unknown)

    def _whole_tcp(self) -> bytes:
        """Return the first complete frame, or nothing; an incomplete one may take as long as the connection lasts."""
        if len(self._received) < _HEADER:
            return b""
        length = int.from_bytes(self._received[4:_HEADER], "big")
        if not _SHORTEST <= length <= _LONGEST:
            self._received = b""
        return self._received[: _HEADER + length] if len(self._received) >= _HEADER + length else b""

    def _take(self, frame: bytes) -> bool:
        """Serve a complete frame; return False where nothing is left to serve."""
        try:
            used, request = self._framer.handleFrame(frame, 0, 0)
        except ModbusException:
            self._refuse_nonsense(frame)
            return not self._rtu
        self._received = self._received[used:]
        if request is not None:
            self._serve(request)
        return used > 0

    def _refuse_nonsense(self, frame: bytes) -> None:
        """Answer a complete frame that is no valid request: an unknown function, or a count of zero."""
        start = 0 if self._rtu else _HEADER
        device_id, function = frame[start], frame[start + 1]
        device = self._device(device_id)
        if device is not None:
            code = ILLEGAL_VALUE if function in device.functions else ILLEGAL_FUNCTION
            transaction = 0 if self._rtu else int.from_bytes(frame[:2], "big")
            self._answer(ExceptionResponse(function, code, device_id, transaction))
        self._received = b"" if self._rtu else self._received[len(frame) :]

    def _refuse_unknown(self) -> None:
        """Answer an RTU frame whose length pymodbus cannot know, after silence, if its CRC is right."""
        quiet = self._scheduler.monotonic_s() - self._last_s >= FORGET_S * 0.999
        body, crc = self._received[:-2], self._received[-2:]
        if quiet and len(body) >= _SHORTEST and FramerRTU.compute_CRC(body).to_bytes(2, "big") == crc:
            self._refuse_nonsense(self._received)

    def _renew(self) -> None:
        """Drop the incomplete frame of the previous client."""
        self._received = b""

    def _serve(self, request: ModbusPDU) -> None:
        if request.dev_id == BROADCAST and (self._rtu or len(self._devices) > 1):
            for device_id in sorted(self._devices.keys() - self.mute):
                _obey(self._devices[device_id], request)
            return
        device = self._device(request.dev_id)
        if device is not None:
            answer = _obey(device, request)
            answer.dev_id, answer.transaction_id = request.dev_id, request.transaction_id
            self._answer(answer)

    def _device(self, device_id: int) -> Registers | None:
        if not self._rtu and device_id in ALONE and len(self._devices) == 1:
            device_id = next(iter(self._devices))
        return None if device_id in self.mute else self._devices.get(device_id)

    def _answer(self, answer: ModbusPDU) -> None:
        frame = self._framer.buildFrame(answer)
        at_s = self._scheduler.monotonic_s() + self._turnaround_s
        self._scheduler.call_at(at_s, lambda: self._line.device_write(frame))


def _obey(device: Registers, request: ModbusPDU) -> ModbusPDU:
    """Execute a request; return the answer or an exception response."""
    code = request.function_code
    try:
        if code not in device.functions:
            raise RegisterFault(ILLEGAL_FUNCTION)
        if isinstance(request, ReadHoldingRegistersRequest):
            return ReadHoldingRegistersResponse(registers=device.read(request.address, request.count))
        if isinstance(request, WriteMultipleRegistersRequest):
            if not request.count == len(request.registers) > 0:
                raise RegisterFault(ILLEGAL_VALUE)
            device.write(request.address, request.registers)
            return WriteMultipleRegistersResponse(address=request.address, count=request.count)
        assert isinstance(request, WriteSingleRegisterRequest)
        device.write(request.address, request.registers)
        return WriteSingleRegisterResponse(address=request.address, registers=request.registers)
    except RegisterFault as fault:
        return ExceptionResponse(code, fault.number)


def words(value: int) -> list[int]:
    """Return a 32-bit number, two's complement, as two registers, high word first."""
    return [value >> 16 & 0xFFFF, value & 0xFFFF]


def signed(high: int, low: int) -> int:
    """Return two registers, high word first, as a 32-bit number in two's complement."""
    value = high << 16 | low
    return value - (1 << 32) if high & 0x8000 else value
