"""How far a GRBL board goes on after a jog cancel and after a feed hold, by where it says it is.

`?` and the stop go out in one write: the report is of the instant at which the firmware takes both, and the host's
own slowness is not measured.
"""

import math

from rig.clock import Clock
from rig.devices.grbl_link import StatusFields, parse_status
from rig.transport import LineReader, Transport
from studies.firmware.conversation import ANSWER_S, JOG_CANCEL, RESET, listen

SPEEDS_MM_S = (0.5, 1.0, 2.0, 5.0, 10.0)
TIMES = 7
STOPS = {"jog cancel": ("$J=G91G21X{mm}F{feed}", JOG_CANCEL), "hold": ("G91G21G1X{mm}F{feed}", b"!")}
ACCEL_MM_S2 = 50.0
CRUISE_S = 0.3
REST_S = 0.3
# Stops come at any phase of a segment, of which some are prepared.
SEGMENT_S = 0.01
ASK_S, ASK_TIMES = 1.0, 10


class Stopwatch:
    """Moves a board along x, back and forth, and stops it on its way."""

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self._transport, self._clock = transport, clock
        self._reader = LineReader(transport, clock)

    def distances_mm(self, how: str, speed_mm_s: float) -> list[float]:
        found = [self._stopped(how, speed_mm_s, -1 if i % 2 else 1, i * SEGMENT_S / TIMES) for i in range(TIMES)]
        return [mm for mm in found if math.isfinite(mm)]

    def _stopped(self, how: str, speed_mm_s: float, sign: int, phase_s: float) -> float:
        line, stop = STOPS[how]
        from_mm = self._x_mm()
        self._command(line.format(mm=sign * 20 * max(speed_mm_s, 1.0), feed=60 * speed_mm_s))
        cruising_mm = speed_mm_s**2 / (2 * ACCEL_MM_S2) + CRUISE_S * speed_mm_s
        while abs(self._x_mm() - from_mm) < cruising_mm:
            pass
        self._clock.wait_s(phase_s)
        self._transport.write(b"?" + stop)
        told_mm = _x(self._report(ANSWER_S))
        rest_mm = self._at_rest_mm()
        self._transport.write(RESET)
        listen(self._reader, self._clock, until_answered=False)
        return round(abs(rest_mm - told_mm), 4)

    def _at_rest_mm(self) -> float:
        before_mm, now_mm = math.nan, self._x_mm()
        while now_mm != before_mm:
            self._clock.wait_s(REST_S)
            before_mm, now_mm = now_mm, self._x_mm()
        return now_mm

    def _x_mm(self) -> float:
        """Asked again where a question went lost, as it may in a firmware that runs as two threads."""
        for _ in range(ASK_TIMES):
            self._transport.write(b"?")
            if fields := self._report(ASK_S):
                return _x(fields)
        raise TimeoutError("no status report")

    def _report(self, timeout_s: float) -> StatusFields | None:
        deadline_s = self._clock.monotonic_s() + timeout_s
        while (line := self._reader.read_line(deadline_s)) is not None:
            if fields := parse_status(line):
                return fields
        return None

    def _command(self, line: str) -> None:
        self._transport.write(line.encode("ascii") + b"\n")
        deadline_s = self._clock.monotonic_s() + ANSWER_S
        while (heard := self._reader.read_line(deadline_s)) != "ok":
            if heard is None or heard.startswith("error"):
                raise RuntimeError(f"{line!r} was answered by {heard}")


def _x(fields: StatusFields | None) -> float:
    if fields is None or fields.machine is None:
        return math.nan
    return fields.machine[0]
