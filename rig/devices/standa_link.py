"""Binary protocol of Standa 8SMC controllers: frames, CRC, error answers, resynchronization.

Sources: Standa 8SMC5-USB manual, communication protocol; protocol.xi of libximc, version 20.8.

A frame is four letters and, if there is a payload, a CRC-16 of the payload alone. Replies have no number: one request
is under way at a time, and after a lost or garbled reply zero bytes clear the line first.
"""

import struct
from dataclasses import dataclass
from typing import Any

from pymodbus.framer import FramerRTU

from rig.clock import Clock
from rig.devices.base import StageRejected
from rig.devices.drive_link import READ_TRIES, REPLY_S, DriveLink
from rig.transport import Transport
from rig.transport.wire import arrived

LETTERS, CRC_BYTES = 4, 2
ZEROS = bytes(64)
"""Zeros that complete any truncated frame; the controller returns each one that it does not need."""
SYNC_TRIES, SYNC_S, QUIET_S = 3, 0.1, 0.02
FORGETS_S = 0.45
"""The controller forgets the beginning of a command 0.4 s after its last byte."""
SHOWN = 16
ERRORS = {
    "errc": "unknown command",
    "errd": "wrong checksum",
    "errv": "value out of range, which it has replaced",
}

MOVE = struct.Struct("<ih6s")
SPEED = struct.Struct("<IBHHIBB9s")
RESERVED = b"\xcc"
"""Value that the maker's library writes to the reserved bytes."""
STATUS = struct.Struct("<5Bihqih5hIIB4x")
ENGINE = struct.Struct("<HHIBHhBH12x")
EDGES = struct.Struct("<BBihih6x")
HOMING = struct.Struct("<IBIBihH9x")
POWER = struct.Struct("<BHHHB6x")
SERIAL = struct.Struct("<I")
VERSION = struct.Struct("<BBH")

RUNNING, FAILED, COMMAND = 0x80, 0x40, 0x3F
MOVES, LEFT, RIGHT, HOMES = 1, 3, 4, 6
POWER_OFF = 1


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """Reply to `gets`: command state, power state, position in full steps and microsteps, flags, inputs."""

    command: int
    power: int
    steps: int
    microsteps: int
    moves: bool
    flags: int
    inputs: int

    @property
    def busy(self) -> bool:
        """Whether a command is running, or the motor turns."""
        return bool(self.command & RUNNING) or self.moves


def frame(letters: str, payload: bytes = b"") -> bytes:
    """Return a command or a reply; the CRC is that of Modbus."""
    seal = FramerRTU.compute_CRC(payload).to_bytes(CRC_BYTES, "big") if payload else b""
    return letters.encode("ascii") + payload + seal


class StandaLink(DriveLink):
    """Port of one controller."""

    IF_GARBLED, IF_SILENT = "the cable", "the power, the cable and the port"

    def __init__(self, transport: Transport, clock: Clock) -> None:
        super().__init__(transport, clock)
        self._clear = True

    def ask(self, letters: str, layout: struct.Struct, tries: int = READ_TRIES) -> tuple[Any, ...]:
        """Send a query without side effects; repeat it if the reply is missing or garbled.

        Raises StageError, TransportError.
        """
        return layout.unpack(self._repeated(lambda: self._exchange(letters, b"", layout.size), tries))

    def status(self, tries: int = READ_TRIES) -> AxisStatus:
        """Return position and state. Raises StageError, TransportError."""
        moving, command, power, _, _, steps, microsteps, _, speed, part, *_, flags, inputs, _ = self.ask(
            "gets", STATUS, tries
        )
        turns = bool(moving & 1 or speed or part)
        return AxisStatus(command, power, steps, microsteps, turns, flags, inputs)

    def command(self, letters: str, payload: bytes = b"") -> None:
        """Send a command once and wait until it is confirmed. Raises StageError, TransportError."""
        self._exchange(letters, payload, 0)

    def send_now(self, letters: str) -> None:
        """Send a command without waiting for its reply. Raises TransportError."""
        self._transport.write(frame(letters))

    def _exchange(self, letters: str, payload: bytes, size: int) -> bytes:
        with self._turn():
            if not self._clear:
                self._synchronize(letters)
            for _ in arrived(self._transport):
                pass
            self._clear = False
            self._transport.write(frame(letters, payload))
            reply = self._answer(letters, size)
            self._clear = True
            return reply

    def _synchronize(self, letters: str) -> None:
        """Send zero bytes until the controller returns them, which ends every frame that was cut short.

        Raises StageTimeout, TransportError.
        """
        for _ in range(SYNC_TRIES):
            self._transport.write(ZEROS)
            heard, deadline_s = b"", self._clock.monotonic_s() + SYNC_S
            while (left_s := deadline_s - self._clock.monotonic_s()) > 0:
                quiet = b"\0" in heard
                data = self._transport.read(QUIET_S if quiet else left_s)
                heard += data
                if heard.endswith(ZEROS) or (quiet and not data):
                    return
        raise self._silent(self._label(letters), SYNC_TRIES * SYNC_S)

    def _answer(self, letters: str, size: int) -> bytes:
        """Return the payload of the reply; skip zero bytes, and the reply to a stop from another thread."""
        name, deadline_s = letters.encode("ascii"), self._clock.monotonic_s() + REPLY_S
        whole = LETTERS + (size + CRC_BYTES if size else 0)
        heard, odd = b"", b""
        while True:
            heard = heard.lstrip(b"\0")
            head = heard[:LETTERS]
            if head == name and len(heard) >= whole:
                payload = heard[LETTERS : LETTERS + size]
                if heard[LETTERS:whole] == frame(letters, payload)[LETTERS:]:
                    return payload
                raise self._garbled(self._label(letters), heard[:SHOWN].hex(" "))
            if head.decode("latin-1") in ERRORS:
                word = head.decode("ascii")
                raise StageRejected(word, letters, ERRORS[word])
            if len(head) == LETTERS and head != name:
                odd = odd or heard
                heard = heard[LETTERS if head == b"stop" else 1 :]
                continue
            left_s = deadline_s - self._clock.monotonic_s()
            if left_s <= 0:
                break
            heard += self._transport.read(left_s)
        if odd or heard:
            raise self._garbled(self._label(letters), (odd or heard)[:SHOWN].hex(" "))
        raise self._silent(self._label(letters))

    def _label(self, letters: str) -> str:
        return f"{self.name}: Standa controller, command {letters}"
