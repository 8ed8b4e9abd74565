"""ASCII protocol of Zaber X-series devices: frames, checksums, message ids, warnings.

Sources: Zaber ASCII protocol manual, firmware 6 and 7; transcripts of the maker's client, zaber-motion 10.3.0.
"""

import math
import re
from dataclasses import dataclass

from rig.clock import Clock
from rig.devices.base import StageError, StageRejected
from rig.devices.drive_link import REPLY_S, DriveLink
from rig.transport import LineReader, Transport

IDS = 100
# For so long after an unanswered command its id is not used, because its reply may still arrive.
LATE_S = 3.0
NO_WARNING = "--"

REASONS = {
    "AGAIN": "not possible now",
    "BADAXIS": "there is no such axis",
    "BADCOMMAND": "unknown command or setting",
    "BADDATA": "value out of range, or target outside limit.min … limit.max",
    "BADMESSAGEID": "wrong message id",
    "DEVICEONLY": "a command of the device, not of an axis",
    "DRIVERDISABLED": "the driver is disabled",
    "FULL": "no storage left",
    "LOCKSTEP": "the axis belongs to a lockstep group",
    "NOACCESS": "not available at this access level",
    "PARKED": "the axis is parked",
    "REMOTE": "not available in this mode",
    "STATUSBUSY": "the device is busy",
}

_REPLY = re.compile(r"@(\d\d) (\d) (?:(\d\d) )?(OK|RJ) (IDLE|BUSY) (--|[A-Z]{2}) (.+)")
_ALERT = re.compile(r"!(\d\d) (\d) (IDLE|BUSY) (--|[A-Z]{2})(?: .*)?")
_SEALED = re.compile(r"[@#!](.*):([0-9A-F]{2})")


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply of a device: state of its axis, highest warning, and data."""

    device: int
    axis: int
    number: int | None
    accepted: bool
    busy: bool
    warning: str
    data: str


def checksum(content: str) -> str:
    """Return the checksum: two's complement of the low byte of the sum, in capital hex."""
    return f"{-sum(content.encode('latin-1', 'replace')) & 0xFF:02X}"


def frame(device: int, axis: int, number: int, words: str) -> bytes:
    """Return a command with id and checksum; without words it requests the state."""
    content = f"{device} {axis} {number:02d} {words}".rstrip()
    return f"/{content}:{checksum(content)}\n".encode("ascii")


def unsealed(line: str) -> str | None:
    """Return a line without its checksum, or None if the checksum is missing or wrong.

    The end of an earlier line that was cut short may precede it.
    """
    line = line[max(line.rfind(mark) for mark in "@#!") :]
    found = _SEALED.fullmatch(line)
    if found is None or checksum(found[1]) != found[2]:
        return None
    return line[:-3]


def parse_reply(line: str) -> Reply | None:
    """Return the reply in a line without checksum, or None if it is something else."""
    found = _REPLY.fullmatch(line)
    if found is None:
        return None
    device, axis, number, flag, state, warning, data = found.groups()
    return Reply(
        int(device), int(axis), None if number is None else int(number), flag == "OK", state == "BUSY", warning, data
    )


class ZaberLink(DriveLink):
    """Chain of devices on one port; every command has an id and a checksum, and one command waits for its reply."""

    def __init__(self, transport: Transport, clock: Clock) -> None:
        super().__init__(transport, clock)
        self._lines = LineReader(transport, clock)
        self._number = IDS - 1
        self._lost_s: dict[int, float] = {}
        self.alerts: dict[tuple[int, int], str] = {}
        """Highest warning of each axis that an alert has reported; the reader clears it."""

    def ask(self, device: int, axis: int, words: str = "") -> Reply:
        """Send a query without side effects; repeat it if the reply is missing or garbled.

        Raises StageError, TransportError.
        """
        return self._repeated(lambda: self.command(device, axis, words), refused=False)

    def command(self, device: int, axis: int, words: str) -> Reply:
        """Send a command once and return its reply. Raises StageError, TransportError."""
        with self._turn():
            number = self._next()
            self._transport.write(frame(device, axis, number, words))
            reply = self._answer(device, axis, number, words)
        if not reply.accepted:
            raise StageRejected(
                reply.data,
                f"/{device} {axis} {words}",
                REASONS.get(reply.data, "see its manual"),
            )
        return reply

    def send_now(self, words: str) -> None:
        """Send a command to every device without waiting for replies. Raises TransportError."""
        self._transport.write(frame(0, 0, self._next(), words))

    def _next(self) -> int:
        now_s = self._clock.monotonic_s()
        for _ in range(IDS):
            self._number = (self._number + 1) % IDS
            if now_s - self._lost_s.get(self._number, -math.inf) >= LATE_S:
                break
        return self._number

    def _answer(self, device: int, axis: int, number: int, words: str) -> Reply:
        """Return the reply to this command; skip other devices' lines, info lines, and late replies."""
        deadline_s, garbled, open_line = self._clock.monotonic_s() + REPLY_S, "", ""
        while (line := self._lines.read_line(deadline_s)) is not None:
            content = unsealed(line)
            if content is None:
                garbled = line
                reply = parse_reply(line)
                if reply is not None and (reply.device, reply.axis, reply.number) == (device, axis, number):
                    open_line = line
            else:
                self._note_alert(content)
                reply = parse_reply(content)
                if reply is not None and (reply.device, reply.axis, reply.number) == (device, axis, number):
                    return reply
            if self._clock.monotonic_s() >= deadline_s:  # A device may never stop talking.
                break
        self._lost_s[number] = self._clock.monotonic_s()
        label = f"{self.name}: Zaber device {device}, axis {axis}, command {words!r}"
        if open_line:
            raise StageError(
                f"{label}: the reply has no checksum; set comm.checksum of the device to 1", "no_checksum"
            )
        if garbled:
            raise self._garbled(label, ascii(garbled))
        raise self._silent(label)

    def _note_alert(self, content: str) -> None:
        found = _ALERT.fullmatch(content)
        if found is not None and found[4] != NO_WARNING:
            self.alerts[int(found[1]), int(found[2])] = found[4]
