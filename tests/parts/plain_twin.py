"""The virtual twin of the scale that answers in plain numbers."""

from sim.devices.clock import Scheduler
from sim.devices.line import Load, Samples, SerialLine, VirtualForceSpec


class PlainScale:
    """A scale under a load, at the end of a serial line."""

    def __init__(self, scheduler: Scheduler, line: SerialLine, load: Load, period_s: float) -> None:
        self._line, self._samples = line, Samples(scheduler, load, period_s)
        self._zero_g = 0.0
        line.connect(self._on_bytes)

    def _on_bytes(self, data: bytes) -> None:
        for command in data.split():
            grams = self._samples.grams(self._samples.newest())
            if command == b"Z":
                self._zero_g = grams
            self._line.device_write(b"OK\n" if command == b"Z" else f"{grams - self._zero_g:+.2f}\n".encode("ascii"))


def plain_twin(scheduler: Scheduler, line: SerialLine, told: VirtualForceSpec, load: Load) -> PlainScale:
    """A scale under a load."""
    return PlainScale(scheduler, line, load, told.sample_period_s)
