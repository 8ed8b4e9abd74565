"""Virtual twin of the scale. Source: README.md of this package, "Protocol"."""

from sim.devices.clock import Scheduler
from sim.devices.line import Load, Samples, SerialLine, VirtualForceSpec

MOST_G, LEAST_G = 200.0, -20.0
_STABLE_SAMPLES, _STABLE_BAND_G = 3, 0.02


class VirtualLineScale:
    """Virtual scale under a load on a serial line, which replies when a request arrives."""

    def __init__(self, scheduler: Scheduler, line: SerialLine, load: Load, spec: VirtualForceSpec) -> None:
        self._line, self._samples = line, Samples(scheduler, load, spec.sample_period_s)
        self._address, self._step_g = f"{spec.own['address']:02d}".encode(), spec.resolution_g
        self._zero_g = 0.0
        self._received = b""
        line.connect(self._on_bytes)

    def _on_bytes(self, data: bytes) -> None:
        *requests, self._received = (self._received + data).split(b"\r")
        for request in requests:
            if request.startswith(b"#" + self._address):
                self._line.device_write(b"=" + self._address + self._answer(request[3:]) + b"\r\n")

    def _answer(self, letter: bytes) -> bytes:
        if letter == b"I":
            return b" LS-100 4711"
        if letter == b"W":
            return self._weight()
        if letter == b"Z":
            self._zero_g = self._samples.grams(self._samples.newest())
            return b"OK"
        return b"?"

    def _weight(self) -> bytes:
        newest = self._samples.newest()
        grams = self._samples.grams(newest)
        if not LEAST_G <= grams <= MOST_G:
            return b"H" if grams > MOST_G else b"L"
        stable = self._samples.steady(newest, _STABLE_SAMPLES, _STABLE_BAND_G)
        shown = round((grams - self._zero_g) / self._step_g) * self._step_g
        return f"{'S' if stable else 'D'}{shown:+08.2f}".encode()


def line_scale_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualForceSpec, load: Load) -> VirtualLineScale:
    """Return a virtual scale under a load."""
    return VirtualLineScale(scheduler, line, load, spec)
