"""Virtual ATI Net F/T: RDT records over datagrams, and the page of its settings, on one line.

A request for a page begins with GET; anything else is an RDT request of eight bytes.
"""

import math
import re
import struct

from sim.devices.clock import Handle, Scheduler
from sim.devices.line import Load, Samples, SerialLine, VirtualForceSpec

RATE_HZ = 200
"""Records a second, unless the page sets another rate."""
COUNTS_PER_KGF = COUNTS_PER_NM = 1_000_000
"""In kgf, so that steps of a gram-weight are whole counts."""
HEADER, STOP, REAL_TIME, BUFFERED, RESET_LATCH, BIAS = 0x1234, 0, 2, 3, 0x41, 0x42
NO_CELL, SATURATED = 1 << 31 | 1 << 28, 1 << 31 | 1 << 17
_SET = re.compile(rb"GET /(?:comm|setting)\.cgi\?(comrdtrate|setuserfilter)=(\d{1,4}) ")
_MOST = (1 << 31) - 1


class VirtualNetFt:
    """Sensor under a load along one axis, at the end of a line; keys are those of the table [force.net_ft].

    status: sent with every record. mute: nothing is sent.
    """

    def __init__(
        self, scheduler: Scheduler, line: SerialLine, load: Load, spec: VirtualForceSpec, rate_hz: float = RATE_HZ
    ) -> None:
        self._scheduler, self._wire = scheduler, line
        self._samples = Samples(scheduler, load, spec.sample_period_s)
        self._resolution_g, self.rate_hz, self.filter = spec.resolution_g, rate_hz, 0
        press = str(spec.own.get("press", "-z"))
        self._axis, self._sign = "xyz".index(press[1]), -1 if press[0] == "-" else 1
        self._bias: int | None = 0
        self._number, self._sample, self._left, self._next_s = 0, 0, 0, 0.0
        self._timer: Handle | None = None
        self.status, self.mute = 0, False
        line.connect(self._on_bytes)

    # --- requests ---

    def _on_bytes(self, data: bytes) -> None:
        if data.startswith(b"GET "):
            self._show(data)
            return
        if len(data) != 8:
            return
        header, command, count = struct.unpack(">HHI", data)
        if header == HEADER:
            self._obey(command, count)

    def _obey(self, command: int, count: int) -> None:
        if command == BIAS:
            self._bias = self._counts()
        elif command in (STOP, REAL_TIME, BUFFERED):
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None
            if command != STOP:
                self._number, self._left = 0, count or -1
                self._next_s = self._scheduler.monotonic_s()
                self._wait()

    def _show(self, request: bytes) -> None:
        found = _SET.match(request)
        if found is not None and found[1] == b"comrdtrate":
            self.rate_hz = min(max(int(found[2]), 1), 7000)
        elif found is not None:
            self.filter = int(found[2])
        there = found is not None or request.startswith(b"GET /netftapi2.xml")
        body = self.page() if there else "not found"
        head = f"HTTP/1.0 {'200 OK' if there else '404 Not Found'}\r\nContent-Type: text/xml\r\n"
        self._send(f"{head}Content-Length: {len(body)}\r\nConnection: close\r\n\r\n{body}".encode("ascii"))

    def page(self) -> str:
        """Return netftapi2.xml."""
        values = {
            "prodname": "Virtual Net F/T", "cfgcpf": COUNTS_PER_KGF, "cfgcpt": COUNTS_PER_NM, "scfgfu": "kgf",
            "scfgtu": "Nm", "setuserfilter": self.filter, "comrdtrate": round(self.rate_hz),
            "runrate": round(self.rate_hz), "runstat": self.status,
        }  # fmt: skip
        lines = "".join(f"<{key}>{value}</{key}>\n" for key, value in values.items())
        return f'<?xml version="1.0"?>\n<netft>\n{lines}</netft>\n'

    # --- records ---

    def _wait(self) -> None:
        self._next_s += 1 / self.rate_hz
        self._timer = self._scheduler.call_at(self._next_s, self._tick)

    def _tick(self) -> None:
        self._number, self._sample = self._number + 1 & 0xFFFFFFFF, self._sample + 1 & 0xFFFFFFFF
        self._left -= 1
        if self._left:
            self._wait()
        self._send(self.record())

    def record(self) -> bytes:
        """Return the record of the newest sample."""
        counts, axes = self._counts(), [0] * 6
        status = NO_CELL if counts is None else self.status
        force = (counts or 0) - (self._bias or 0)
        axes[self._axis] = max(min(force, _MOST), -_MOST)
        status |= SATURATED if abs(force) > _MOST else 0
        return struct.pack(">III6i", self._number, self._sample, status, *axes)

    def _counts(self) -> int | None:
        grams = self._samples.grams(self._samples.newest())
        if math.isnan(grams):
            return None
        shown_g = round(grams / self._resolution_g) * self._resolution_g
        return round(self._sign * shown_g * 1e-3 * COUNTS_PER_KGF)

    def start_at(self, number: int) -> None:
        """Let the next record have the number after this one."""
        self._number = number & 0xFFFFFFFF

    def _send(self, data: bytes) -> None:
        if not self.mute:
            self._wire.device_write(data)


def net_ft_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualForceSpec, load: Load) -> VirtualNetFt:
    """Return a sensor with a load."""
    return VirtualNetFt(scheduler, line, load, spec)
