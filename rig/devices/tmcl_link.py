"""Binary TMCL of Trinamic modules: frames of nine bytes, their checksum, replies.

Sources: Trinamic TMCL firmware manuals (reading of the TMCM-1161); the maker's client, pytrinamic 0.2.26, and bytes
exchanged with it.

A reply repeats the command, but neither the parameter nor the motor, so a reply too many would shift every later one.
Each group of questions therefore ends with a question of another command: a reply too many comes before its reply,
and the group is asked again.
"""

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from rig.clock import Clock
from rig.devices.base import StageError, StageRejected
from rig.devices.drive_link import READ_TRIES, REPLY_S, DriveLink
from rig.transport import Transport

# A module drops an incomplete frame after a pause, which must be shorter than this.
QUIET_S = 0.03
LENGTH, FILLER = 9, b"\0"
MST, MVP, SAP, GAP, RFS, VERSION = 3, 4, 5, 6, 13, 136
ABSOLUTE, SEARCH, END_SEARCH, SEARCH_STATUS, AS_TEXT = 0, 0, 1, 2, 0
DONE, BAD_CHECKSUM = 100, 1

NAMES = {MST: "MST", MVP: "MVP", SAP: "SAP", GAP: "GAP", RFS: "RFS", VERSION: "GetVersion"}
MEANINGS = {
    BAD_CHECKSUM: "wrong checksum",
    2: "unknown command",
    3: "unknown type or parameter",
    4: "value out of range",
    5: "the EEPROM is locked",
    6: "command not available",
}
_STATUSES = frozenset((DONE, *MEANINGS))
_FRAME = struct.Struct(">BBBBi")


@dataclass(frozen=True, slots=True)
class Motor:
    """Motor of a module on the line."""

    address: int
    number: int


@dataclass(frozen=True, slots=True)
class TmclRequest:
    """Command to a motor."""

    motor: Motor
    command: int
    kind: int = 0
    value: int = 0

    def __str__(self) -> str:
        words = [NAMES[self.command], str(self.kind)]
        return " ".join([*words, str(self.value)] if self.command in (MVP, SAP) else words)

    def frame(self) -> bytes:
        """Return the nine bytes."""
        return sealed(_FRAME.pack(self.motor.address, self.command, self.kind, self.motor.number, self.value))


@dataclass(frozen=True, slots=True)
class TmclReply:
    """Reply of a module."""

    address: int
    status: int
    command: int
    value: int


def sealed(body: bytes) -> bytes:
    """Return eight bytes with their checksum, the low byte of their sum."""
    return body + bytes([sum(body) & 0xFF])


def parse_reply(data: bytes, host: int) -> TmclReply | None:
    """Return the reply in nine bytes, or None if they are something else."""
    if data[0] != host or sealed(data[:-1]) != data:
        return None
    _, address, status, command, value = _FRAME.unpack(data[:-1])
    return TmclReply(address, status, command, value) if status in _STATUSES else None


class TmclLink(DriveLink):
    """Modules on one port.

    baud: of a serial line, for the pause between two frames that nobody waits for. host: address to which modules
    reply.
    """

    IF_GARBLED = "the cable, stage.baud and host_address"

    def __init__(self, transport: Transport, clock: Clock, *, baud: int = 115200, host: int = 2) -> None:
        super().__init__(transport, clock)
        self._host = host
        self._version = re.compile(re.escape(bytes([host])) + rb"([ -~]{8})")
        self._exchange_s = 2 * LENGTH * 10 / baud + 2e-3
        self._heard = b""  # since `_quieten`
        self._lost = 0

    def ask(self, motor: Motor, parameters: Sequence[int], *, tries: int = READ_TRIES) -> tuple[list[int], int]:
        """Return axis parameters, and the status of the reference search (0: none is active).

        What is missing, garbled or refused is asked for again. Raises StageError, TransportError.
        """
        return self._repeated(lambda: self._group(motor, parameters), tries)

    def command(self, motor: Motor, command: int, kind: int = 0, value: int = 0) -> None:
        """Send a command once and wait for its reply. Raises StageError, TransportError."""
        with self._turn():
            self._quieten()
            self._exchanged(TmclRequest(motor, command, kind, value))

    def version(self, motor: Motor) -> str:
        """Return the name of a module and its firmware. Raises StageError, TransportError."""
        return self._repeated(lambda: self._version_of(motor))

    def send_now(self, motors: Sequence[Motor]) -> None:
        """Stop motors, without waiting for replies. Raises TransportError.

        On RS-485 a reply and the next command would collide, so there is a pause between two frames.
        """
        for number, motor in enumerate(motors):
            if number:
                self._clock.wait_s(self._exchange_s)
            self._transport.write(TmclRequest(motor, MST).frame())

    def _group(self, motor: Motor, parameters: Sequence[int]) -> tuple[list[int], int]:
        last = TmclRequest(motor, RFS, SEARCH_STATUS)
        with self._turn():
            self._quieten()
            values = [self._exchanged(TmclRequest(motor, GAP, parameter))[0].value for parameter in parameters]
            reply, others = self._exchanged(last)
        if GAP in others:
            raise StageError(f"{self._label(motor)}: more replies than questions; check the cable", "late_answer")
        return values, reply.value

    def _exchanged(self, request: TmclRequest) -> tuple[TmclReply, list[int]]:
        """Return the reply, and the commands of replies that came before it."""
        self._transport.write(request.frame())
        others, garbled = list[int](), b""
        deadline_s = self._clock.monotonic_s() + REPLY_S
        while (left_s := deadline_s - self._clock.monotonic_s()) > 0:
            if len(self._heard) < LENGTH:
                self._heard += self._transport.read(left_s)
            while len(self._heard) >= LENGTH:
                reply = parse_reply(self._heard[:LENGTH], self._host)
                if reply is None:
                    garbled += self._heard[:1]
                    self._heard = self._heard[1:]
                    continue
                self._heard = self._heard[LENGTH:]
                if reply.address == request.motor.address and reply.command == request.command:
                    self._lost = 0
                    return self._accepted(request, reply), others
                if reply.address == request.motor.address and reply.status == BAD_CHECKSUM:
                    self._accepted(request, reply)
                others.append(reply.command)
        self._lost += 1
        raise self._failure(request, garbled + self._heard)

    def _accepted(self, request: TmclRequest, reply: TmclReply) -> TmclReply:
        if reply.status != DONE:
            raise StageRejected(
                reply.status,
                str(request),
                MEANINGS[reply.status],
            )
        return reply

    def _version_of(self, motor: Motor) -> str:
        request = TmclRequest(motor, VERSION, AS_TEXT)
        with self._turn():
            self._quieten()
            self._transport.write(request.frame())
            deadline_s = self._clock.monotonic_s() + REPLY_S
            while (left_s := deadline_s - self._clock.monotonic_s()) > 0:
                self._heard += self._transport.read(left_s)
                found = self._version.search(self._heard)
                if found is not None:
                    self._lost, self._heard = 0, b""
                    return found[1].decode("ascii").strip()
            self._lost += 1
        raise self._failure(request, self._heard)

    def _quieten(self) -> None:
        """Discard bytes that still arrive.

        After two requests without a reply, the module may wait for the end of a frame that lost a byte: one byte
        ends it, and a module that drops incomplete frames drops this byte.
        """
        if self._lost >= 2:
            self._transport.write(FILLER)
        until_s = self._clock.monotonic_s() + REPLY_S
        while self._transport.read(QUIET_S if self._lost else 0.0) and self._clock.monotonic_s() < until_s:
            pass
        self._heard = b""

    def _failure(self, request: TmclRequest, heard: bytes) -> StageError:
        label = f"{self._label(request.motor)}, {request}"
        return self._garbled(label, heard[: 4 * LENGTH].hex(" ")) if heard else self._silent(label)

    def _label(self, motor: Motor) -> str:
        return f"{self.name}: TMCL module {motor.address}, motor {motor.number}"
