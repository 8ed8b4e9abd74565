"""The scale as a force sensor. Source: README.md of this package, "What it speaks"."""

import re

from rig.clock import Clock
from rig.devices.base import ForceError, ForceOverload, ForceReading, ForceTimeout, ForceUnderload
from rig.transport import LineReader, Transport
from rig.units import GWT_N

REPLY_S = 0.5
_WEIGHT = re.compile(r"([SD])([+-]\d{4}\.\d\d)")


class LineScaleForce:
    """ForceSensor over the scale; scale is the true force over the one it shows."""

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
        """Model and serial number; there is nothing to set. Raises ForceError."""
        return self.identify()

    def identify(self) -> str:
        """Model and serial number. Raises ForceError."""
        return f"line scale{self._ask('I')}"

    def read(self) -> ForceReading:
        """The newest weight. Raises ForceError."""
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
        """The newest weight is zero. Raises ForceError."""
        answer = self._ask("Z")
        if answer != "OK":
            raise self._garbled(answer)

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()

    def _ask(self, letter: str) -> str:
        """What comes after the address."""
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
