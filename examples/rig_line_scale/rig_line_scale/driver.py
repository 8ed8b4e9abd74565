"""Force sensor: scale with a line protocol. Source: README.md of this package, "Protocol"."""

import re

from rig.clock import Clock
from rig.devices.base import ForceError, ForceOverload, ForceReading, ForceTimeout, ForceUnderload
from rig.transport import LineReader, Transport
from rig.units import GWT_N

REPLY_S = 0.5
_WEIGHT = re.compile(r"([SD])([+-]\d{4}\.\d\d)")


class LineScaleForce:
    """Force sensor with a line scale; `scale` is the true force divided by the displayed one."""

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        address: int,
        *,
        sample_period_s: float,
        resolution_gwt: float,
        scale: float,
    ) -> None:
        self.sample_period_s, self.resolution_gwt = sample_period_s, scale * resolution_gwt
        self._transport, self._clock = transport, clock
        self._address, self._scale = f"{address:02d}", scale
        self._reader = LineReader(transport, clock)

    def connect(self) -> str:
        """Return model and serial number; the scale has no settings. Raises ForceError."""
        return self.identify()

    def identify(self) -> str:
        """Return model and serial number. Raises ForceError."""
        return f"line scale{self._ask('I')}"

    def read(self) -> ForceReading:
        """Return the latest weight. Raises ForceError."""
        answer = self._ask("W")
        if answer == "H":
            raise ForceOverload(f"{self._transport.name}: the scale is overloaded")
        if answer == "L":
            raise ForceUnderload(f"{self._transport.name}: the scale is underloaded")
        found = _WEIGHT.fullmatch(answer)
        if found is None:
            raise self._garbled(answer)
        return ForceReading(float(found[2]) * GWT_N * self._scale, found[1] == "S", self._clock.monotonic_s())

    def zero(self) -> None:
        """Make the latest weight the zero. Raises ForceError."""
        answer = self._ask("Z")
        if answer != "OK":
            raise self._garbled(answer)

    def close(self) -> None:
        """Close the port."""
        self._transport.close()

    def _ask(self, letter: str) -> str:
        """Send a request and return its reply without the address. Raises ForceError."""
        self._reader.discard()
        self._transport.write(f"#{self._address}{letter}\r".encode("ascii"))
        answer = self._reader.read_line(self._clock.monotonic_s() + REPLY_S)
        if answer is None:
            raise ForceTimeout(f"{self._transport.name}: no answer to {letter} in {REPLY_S:g} s")
        if not answer.startswith(f"={self._address}"):
            raise self._garbled(answer)
        return answer[3:]

    def _garbled(self, answer: str) -> ForceError:
        return ForceError(f"{self._transport.name}: garbled answer {answer!r}")
