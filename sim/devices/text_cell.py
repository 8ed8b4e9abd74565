"""Virtual load cell whose board sends each reading as a line of text, by itself or on request."""

import math

from sim.devices.clock import Scheduler
from sim.devices.line import Load, Samples, SerialLine, VirtualForceSpec

_GRAMS = {"g": 1.0, "kg": 1e3, "lb": 453.59237, "N": 1e3 / 9.80665, "mN": 1 / 9.80665}
_FINER = {"g": 0, "kg": 3, "lb": 3, "N": 2, "mN": 0}  # further decimals of the unit, at most as coarse as grams


class VirtualTextCell:
    """Board with a load, at the end of a serial line; keys are those of the table [force.text_cell]."""

    def __init__(self, scheduler: Scheduler, line: SerialLine, load: Load, spec: VirtualForceSpec) -> None:
        self._scheduler, self._wire, self._own = scheduler, line, spec.own
        self._samples = Samples(scheduler, load, spec.sample_period_s)
        self._resolution_g = spec.resolution_g
        self._zero_g, self._heard, self.mute = 0.0, b"", False
        self._poll, self._zero = (str(self._own[key]).encode("utf-8") for key in ("poll", "zero"))
        line.connect(self._on_bytes)
        if not self._poll:
            self._send_next()

    def _send_next(self) -> None:
        self._scheduler.call_at(self._samples.next_s(), self._send_and_reschedule)

    def _send_and_reschedule(self) -> None:
        self._send_reading()
        self._send_next()

    def _on_bytes(self, data: bytes) -> None:
        self._heard = (self._heard + data)[-80:]
        if self._poll and self._heard.endswith(self._poll):
            self._send_reading()
        elif self._zero and self._heard.endswith(self._zero):
            self._zero_g = self._samples.grams(self._samples.newest())
            self._send(str(self._own["zero_done"]))

    def _send_reading(self) -> None:
        grams = self._samples.grams(self._samples.newest()) - self._zero_g
        unit = str(self._own["unit"])
        if not math.isnan(grams):
            grams = round(grams / self._resolution_g) * self._resolution_g
        value = f"{grams / _GRAMS[unit]:.{3 + _FINER[unit]}f}"
        self._send(str(self._own["line"]).replace("{value}", value).replace("{skip}", "0"))

    def _send(self, line: str) -> None:
        if not self.mute:
            self._wire.device_write(f"{line}\r\n".encode())


def text_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualForceSpec, load: Load) -> VirtualTextCell:
    """Return a board with a load."""
    return VirtualTextCell(scheduler, line, load, spec)
