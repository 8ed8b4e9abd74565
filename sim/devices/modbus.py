"""Modbus slaves behind a virtual line: RTU and TCP frames, register files and exceptions.

Sources: Modbus application protocol V1.1b3; Modbus over serial line V1.02. Frames are cut and sealed by pymodbus.
Behind a TCP gateway the line's baud is that of the gateway's serial side.
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

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_BUSY = 1, 2, 3, 6
BROADCAST = 0
# Half a frame that is not continued is forgotten; a host process may be held up for longer than 3.5 characters.
FORGET_S = 0.05


class RegisterFault(Exception):  # noqa: N818
    """A register cannot be read or written; code is the Modbus exception."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class Registers(Protocol):
    """A device's holding registers, 16 bits each."""

    functions: frozenset[int]

    def read(self, address: int, count: int) -> list[int]:
        """`count` registers from `address` on. Raises RegisterFault."""
        ...

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write from `address` on. Raises RegisterFault."""
        ...


class ModbusBus:
    """Devices by id on one line; each answers turnaround_s after the last byte of a question to it.

    Devices whose id is in `mute` hear nothing, as if unplugged.
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
        self._heard = b""
        self._last_s = 0.0
        self.mute: set[int] = set()
        line.connect(self._on_bytes)

    def _on_bytes(self, data: bytes) -> None:
        now_s = self._scheduler.monotonic_s()
        if now_s - self._last_s > FORGET_S:
            self._heard = b""
        self._last_s = now_s
        self._heard += data
        while self._heard:
            try:
                used, request = self._framer.handleFrame(self._heard, 0, 0)
            except ModbusException:
                self._refuse_nonsense()
                return
            if not used:
                return
            self._heard = self._heard[used:]
            if request is not None:
                self._serve(request)

    def _refuse_nonsense(self) -> None:
        """A whole frame whose content makes no sense, such as a count of zero."""
        start = 0 if self._rtu else 6
        device_id, function = self._heard[start], self._heard[start + 1]
        if self._device(device_id) is not None:
            transaction = 0 if self._rtu else int.from_bytes(self._heard[:2], "big")
            self._answer(ExceptionResponse(function, ILLEGAL_VALUE, device_id, transaction))
        self._heard = b""

    def _serve(self, request: ModbusPDU) -> None:
        if self._rtu and request.dev_id == BROADCAST:
            for device_id in sorted(self._devices.keys() - self.mute):
                _obey(self._devices[device_id], request)
            return
        device = self._device(request.dev_id)
        if device is not None:
            answer = _obey(device, request)
            answer.dev_id, answer.transaction_id = request.dev_id, request.transaction_id
            self._answer(answer)

    def _device(self, device_id: int) -> Registers | None:
        return None if device_id in self.mute else self._devices.get(device_id)

    def _answer(self, answer: ModbusPDU) -> None:
        frame = self._framer.buildFrame(answer)
        at_s = self._scheduler.monotonic_s() + self._turnaround_s
        self._scheduler.call_at(at_s, lambda: self._line.device_write(frame))


def _obey(device: Registers, request: ModbusPDU) -> ModbusPDU:
    """Carry out a request; the answer, or an exception response."""
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
        return ExceptionResponse(code, fault.code)


def words(value: int) -> list[int]:
    """A 32-bit number, two's complement, as two registers, high word first."""
    return [value >> 16 & 0xFFFF, value & 0xFFFF]


def signed(high: int, low: int) -> int:
    """Two registers, high word first, as a 32-bit number in two's complement."""
    value = high << 16 | low
    return value - (1 << 32) if high & 0x8000 else value
