"""Modbus master over any transport: pymodbus encodes the frames, and this module waits on the rig's clock.

This makes one code serve the virtual and the wall clock; the clients of pymodbus sleep on the wall clock. Sources:
Modbus application protocol V1.1b3; Modbus over serial line V1.02, §2.5.1.1 (silence of 3.5 characters).
"""

import threading
from collections import defaultdict
from collections.abc import Callable, Sequence

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from rig.clock import Clock
from rig.errors import RigError
from rig.settings import Framing
from rig.transport.ownership import SCHEME
from rig.transport.wire import Transport, arrived, in_turn

REPLY_S = 0.2
READ_TRIES = 3
# A request that is answered by "not now" is repeated at this interval, for so long: a look makes several reads.
ASK_AGAIN_S, BUSY_S = 0.02, 0.1
BROADCAST = 0
# Replies on a serial line have no number. For LATE_S after an unanswered request, its reply may still arrive and be
# taken for that to a later one. A device replies in turn: once it has replied to a read of a length that no
# unanswered request had, nothing earlier can follow.
LATE_S, LONGEST_READ = 3.0, 125
# If TCP loses a byte, a device takes the first byte of the next frame for the last byte of a register. No trigger,
# control word or path has a low byte of 80 hex or more there, so all transaction numbers begin with one.
FIRST_TRANSACTION, TRANSACTIONS = 0x8000, 0x8000
# A character has 11 bits on a serial line; above 19200 baud the silence is fixed.
SILENT_BITS, FIXED_SILENCE_S, FAST_BAUD = 38.5, 1.75e-3, 19200

_READ, _REFUSED = 3, 0x80
_FUNCTIONS = {_READ: "read", 6: "write", 16: "write"}
_EXCEPTIONS = {
    1: "illegal function", 2: "illegal data address", 3: "illegal data value", 4: "device failure",
    5: "acknowledged, not done yet", 6: "device busy", 8: "memory parity error",
    10: "gateway path unavailable", 11: "the device behind the gateway does not answer",
}  # fmt: skip
_NOT_NOW = (5, 6, 10, 11)
_NOT_DONE = (6, 10)  # a device that acknowledges, or whose answer does not reach its gateway, may obey


class ModbusError(RigError):
    """Error of an exchange; it names port, device, function and register."""

    default_code = "modbus_failed"


class ModbusTimeout(ModbusError):  # noqa: N818
    """Error of a missing or incomplete reply."""

    default_code = "timeout"


class ModbusGarbled(ModbusError):  # noqa: N818
    """Error of a reply that does not belong to the request: bad CRC, another device, too short."""

    default_code = "garbled"


class ModbusRefused(ModbusError):  # noqa: N818
    """Error of a request that the device refused with a Modbus exception number."""

    default_code = "refused"


class ModbusBusy(ModbusRefused):
    """Error of a request that the device, or its gateway, cannot answer now."""

    default_code = "busy"


class ModbusNotDone(ModbusBusy):
    """Error of a request that was not carried out, since the device, or its gateway, is busy."""


class ModbusMaster:
    """Master of one bus (RTU) or one connection (TCP); devices have ids 1 … 247.

    baud determines the silence between RTU frames. reply_s bounds the wait for a reply. A read that times out or is
    garbled is repeated, up to read_tries in all; a write is not, since the device may have carried it out. A read
    that the device cannot answer now, or a write that it did not carry out because it is busy, is repeated for
    BUSY_S, or until send_now(). After an exchange on a serial line that failed, a device is read only once it is
    certain that no reply to an earlier request can follow.

    Many RS-485 adapters echo. The first read detects this, and the echo is then removed from every reply, so that
    the echo of a write, which equals the reply to function 06, does not count as one.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        *,
        framing: Framing = "rtu",
        baud: int = 115200,
        reply_s: float = REPLY_S,
        read_tries: int = READ_TRIES,
    ) -> None:
        self.name = transport.name
        self._transport, self._clock = transport, clock
        self._rtu = framing == "rtu"
        decoder = DecodePDU(is_server=False)
        self._framer = FramerRTU(decoder) if self._rtu else FramerSocket(decoder)
        self._byte_s = 10 / baud if self._rtu else 0.0
        self._silence_s = silence_s(baud) if self._rtu else 0.0
        self._free_s = 0.0
        self._reply_s, self._read_tries = reply_s, read_tries
        self._transaction = 0
        # until when (s) a device may still reply to an earlier request, by the number of its registers
        self._late_until_s: defaultdict[int, dict[int, float]] = defaultdict(dict)
        self._one = threading.Lock()
        self._times_sent_now = 0  # counted from any thread
        # whether the adapter echoes; None until the first read
        self.echoes: bool | None = None if self._rtu else False

    @classmethod
    def on_port(
        cls, transport: Transport, clock: Clock, port: str, *, framing: Framing | None, baud: int
    ) -> "ModbusMaster":
        """Create a master on an opened port; the default framing is tcp on tcp://, else rtu."""
        by_port: Framing = "tcp" if port.startswith(SCHEME) else "rtu"
        return cls(transport, clock, framing=framing or by_port, baud=baud)

    def read(self, device_id: int, address: int, count: int = 1) -> list[int]:
        """Read `count` registers of 16 bits from `address` on (function 03). Raises ModbusError, TransportError."""
        request = ReadHoldingRegistersRequest(dev_id=device_id, address=address, count=count)
        answer = self._repeated(ModbusBusy, lambda: self._read(request))
        return list(answer.registers)

    def _read(self, request: ReadHoldingRegistersRequest) -> ModbusPDU:
        failure: ModbusError | None = None
        for _ in range(self._read_tries):
            try:
                if self._late(request.dev_id):
                    self._resume(request)
                return self._read_once(request)
            except (ModbusTimeout, ModbusGarbled) as error:
                failure = failure or error
                with in_turn(self._one, 2 * self._reply_s):
                    self._drain()
        if failure is None:
            raise ValueError(f"read_tries must be positive, got {self._read_tries}")
        raise failure

    def _read_once(self, request: ReadHoldingRegistersRequest) -> ModbusPDU:
        return self._exchange(request, lambda answer: len(answer.registers) == request.count)

    def _resume(self, request: ReadHoldingRegistersRequest) -> None:
        """Wait until the device has replied to all earlier requests."""
        late = self._late(request.dev_id)
        count = next(count for count in range(1, LONGEST_READ) if count not in {*late, request.count})
        other = ReadHoldingRegistersRequest(dev_id=request.dev_id, address=request.address, count=count)
        try:
            try:
                self._read_once(other)
            except ModbusGarbled:
                self._read_once(other)
        except ModbusBusy:
            raise
        except ModbusRefused:  # It has no so many registers there, or had none for an earlier read of this kind.
            self._clock.wait_s(ASK_AGAIN_S)
        for answered in {*late, count}:
            self._late_until_s[request.dev_id].pop(answered, None)

    def write_one(self, device_id: int, address: int, value: int) -> None:
        """Write one register (function 06). Raises ModbusError, TransportError."""
        request = WriteSingleRegisterRequest(dev_id=device_id, address=address, registers=[value])
        self._write(request, lambda answer: (answer.address, list(answer.registers)) == (address, [value]))

    def write(self, device_id: int, address: int, values: Sequence[int]) -> None:
        """Write registers from `address` on in one frame (function 16). Raises ModbusError, TransportError."""
        request = WriteMultipleRegistersRequest(dev_id=device_id, address=address, registers=list(values))
        self._write(request, lambda answer: (answer.address, answer.count) == (address, len(values)))

    def _write(self, request: ModbusPDU, fits: Callable[[ModbusPDU], bool]) -> None:
        self._repeated(ModbusNotDone, lambda: self._exchange(request, fits))

    def _repeated(self, kind: type[ModbusBusy], exchange: Callable[[], ModbusPDU]) -> ModbusPDU:
        """Repeat an exchange while it ends in this error; a stop that was sent meanwhile must stay the last word."""
        until_s, times = self._clock.monotonic_s() + BUSY_S, self._times_sent_now
        while True:
            try:
                return exchange()
            except kind:
                if self._clock.monotonic_s() + ASK_AGAIN_S >= until_s:
                    raise
                self._clock.wait_s(ASK_AGAIN_S)
                if self._times_sent_now != times:
                    raise

    def send_now(self, device_ids: Sequence[int], address: int, value: int) -> None:
        """Write one register of several devices in one write, without waiting for replies.

        On a serial bus frames need silence between them, so several devices get one broadcast. Raises TransportError.
        """
        self._times_sent_now += 1
        if self._rtu and len(device_ids) > 1:
            device_ids = [BROADCAST]
        requests = [WriteSingleRegisterRequest(dev_id=n, address=address, registers=[value]) for n in device_ids]
        self._send(b"".join(self._frame(request) for request in requests))

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()

    def _exchange(self, request: ModbusPDU, fits: Callable[[ModbusPDU], bool]) -> ModbusPDU:
        with in_turn(self._one, 2 * self._reply_s):
            return self._exchanged(request, fits)

    def _exchanged(self, request: ModbusPDU, fits: Callable[[ModbusPDU], bool]) -> ModbusPDU:
        self._clock.wait_s(self._free_s - self._clock.monotonic_s())
        for _ in arrived(self._transport):
            pass
        frame = self._frame(request)
        self._send(frame)
        try:
            answer = self._answer(request, frame, fits)
            if answer.isError():
                raise self._refused(request, answer)
            if answer.function_code != request.function_code or not fits(answer):
                raise ModbusGarbled(
                    f"{self._label(request)}: the answer does not match the request ({answer})", "does_not_fit"
                )
        except ModbusRefused:
            raise
        except ModbusError:
            if self._rtu:
                self._late_until_s[request.dev_id][request.count] = self._clock.monotonic_s() + LATE_S
            raise
        return answer

    def _frame(self, request: ModbusPDU) -> bytes:
        self._transaction = (self._transaction + 1) % TRANSACTIONS
        request.transaction_id = FIRST_TRANSACTION + self._transaction
        return self._framer.buildFrame(request)

    def _send(self, frame: bytes) -> None:
        self._transport.write(frame)
        self._free_s = self._clock.monotonic_s() + len(frame) * self._byte_s + self._silence_s

    def _answer(self, request: ModbusPDU, sent: bytes, fits: Callable[[ModbusPDU], bool]) -> ModbusPDU:
        """Return the reply to this request; skip older ones where they are recognized."""
        deadline_s = self._clock.monotonic_s() + self._reply_s
        received, echo_due = b"", self.echoes is True or (self.echoes is None and request.function_code == _READ)
        while (left_s := deadline_s - self._clock.monotonic_s()) > 0:
            chunk = self._transport.read(left_s)
            if not chunk:
                continue
            self._free_s = self._clock.monotonic_s() + self._silence_s
            received += chunk
            if echo_due:
                if len(received) < len(sent) and sent.startswith(received):
                    continue
                received, echo_due = self._without_echo(request, received, sent), False
            received, answer = self._first_own(request, received, fits)
            if answer is None:
                continue
            if answer.dev_id != request.dev_id:
                raise ModbusGarbled(
                    f"{self._label(request)}: device {answer.dev_id} answered instead", "another_device"
                )
            return answer
        code, result = "no_reply", "no answer"
        if received:
            code, result = "incomplete", f"only {received.hex(' ')}"
        elif self.echoes:
            code, result = "only_echo", "only its own echo"
        raise ModbusTimeout(f"{self._label(request)}: {result} within {self._reply_s:g} s", code)

    def _without_echo(self, request: ModbusPDU, received: bytes, sent: bytes) -> bytes:
        """Return the data after the echo of the request; the first read shows whether the adapter echoes."""
        found = received.startswith(sent)
        if self.echoes and not found:
            raise ModbusGarbled(
                f"{self._label(request)}: the echo of the adapter is missing in {received.hex(' ')}", "no_echo"
            )
        self.echoes = found
        return received[len(sent) :] if found else received

    def _first_own(
        self, request: ModbusPDU, received: bytes, fits: Callable[[ModbusPDU], bool]
    ) -> tuple[bytes, ModbusPDU | None]:
        """Return the rest of the data and the first complete reply that is not known to be to an older request."""
        while received:
            left, answer = self._decoded(request, received)
            if answer is not None and not self._is_older(answer, request, fits):
                return left, answer
            if left == received:
                break
            received = left
        return received, None

    def _is_older(self, answer: ModbusPDU, request: ModbusPDU, fits: Callable[[ModbusPDU], bool]) -> bool:
        if not self._rtu:
            return bool(answer.transaction_id != request.transaction_id)
        asked = answer.dev_id, answer.function_code & ~_REFUSED
        own = asked == (request.dev_id, request.function_code) and (answer.isError() or fits(answer))
        return not own and bool(self._late(answer.dev_id))

    def _late(self, device_id: int) -> set[int]:
        """Return the numbers of registers of the requests that a device may still reply to."""
        now_s = self._clock.monotonic_s()
        return {count for count, until_s in self._late_until_s[device_id].copy().items() if now_s < until_s}

    def _decoded(self, request: ModbusPDU, received: bytes) -> tuple[bytes, ModbusPDU | None]:
        """Return the rest of the data, and its reply if it is complete."""
        try:
            used, answer = self._framer.handleFrame(received, 0, 0)
        except ModbusException:
            raise ModbusGarbled(
                f"{self._label(request)}: received {received.hex(' ')}, which is not a Modbus answer; check the baud "
                "rate and the framing",
                "no_modbus",
            ) from None
        if used and answer is None:
            raise ModbusGarbled(
                f"{self._label(request)}: wrong checksum (CRC) in {received.hex(' ')}; check the cable and the baud "
                "rate",
                "bad_crc",
            )
        if self._rtu and answer is not None:  # pymodbus calls all that arrived used, also a reply that follows
            frame = self._framer.buildFrame(answer)
            used = received.find(frame) + len(frame) if frame in received else used
        return received[used:], answer

    def _drain(self) -> None:
        """Discard a reply that arrives late or in pieces."""
        deadline_s = self._clock.monotonic_s() + self._reply_s
        quiet_s = max(self._silence_s, 10 * self._byte_s)
        while self._transport.read(quiet_s) and self._clock.monotonic_s() < deadline_s:
            pass

    def _refused(self, request: ModbusPDU, answer: ModbusPDU) -> ModbusRefused:
        number = answer.exception_code
        kind = ModbusNotDone if number in _NOT_DONE else ModbusBusy if number in _NOT_NOW else ModbusRefused
        meaning = _EXCEPTIONS.get(number, "see the device's manual")
        return kind(f"{self._label(request)}: refused with exception {number}, {meaning}")

    def _label(self, request: ModbusPDU) -> str:
        code = request.function_code
        what = f"{_FUNCTIONS[code]} (function {code}) of {request.count} registers at 0x{request.address:04X}"
        return f"{self.name}: device {request.dev_id}, {what}"


def silence_s(baud: int) -> float:
    """Return the silence between RTU frames (s): 3.5 characters, 1.75 ms above 19200 baud."""
    return FIXED_SILENCE_S if baud > FAST_BAUD else SILENT_BITS / baud
