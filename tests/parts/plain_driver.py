"""A force sensor that is not there: a scale that answers in plain numbers. Source: this file."""

from rig.clock import Clock
from rig.devices.base import ForceError, ForceReading, ForceTimeout
from rig.transport import LineReader, Transport
from rig.units import GWT_N

REPLY_S = 0.5


class PlainForce:
    """ForceSensor over a scale that answers W with grams and Z with OK."""

    def __init__(
        self, transport: Transport, clock: Clock, *, sample_period_s: float, resolution_gwt: float, scale: float
    ) -> None:
        self.sample_period_s, self.resolution_gwt = sample_period_s, scale * resolution_gwt
        self._transport, self._clock, self._scale = transport, clock, scale
        self._reader = LineReader(transport, clock)

    def connect(self) -> str:
        """Ask for a weight. Raises ForceError."""
        return self.identify()

    def identify(self) -> str:
        """Ask for a weight. Raises ForceError."""
        self.read()
        return "plain scale"

    def read(self) -> ForceReading:
        """The weight. Raises ForceError."""
        answer = self._ask("W")
        try:
            force_n = float(answer) * GWT_N * self._scale
        except ValueError:
            raise ForceError(f"{self._transport.name}: garbled answer {answer!r}") from None
        return ForceReading(force_n, True, self._clock.monotonic_s())

    def zero(self) -> None:
        """Zero now. Raises ForceError."""
        if (answer := self._ask("Z")) != "OK":
            raise ForceError(f"{self._transport.name}: garbled answer {answer!r}")

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()

    def _ask(self, command: str) -> str:
        self._reader.discard()
        self._transport.write(f"{command}\n".encode("ascii"))
        answer = self._reader.read_line(self._clock.monotonic_s() + REPLY_S)
        if answer is None:
            raise ForceTimeout(f"{self._transport.name}: no answer to {command} in {REPLY_S:g} s")
        return answer
