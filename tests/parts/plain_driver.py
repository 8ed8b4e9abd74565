"""A force sensor that is not there: a scale that answers in plain numbers. Source: this file."""

from pydantic import Field

from rig.clock import Clock
from rig.devices.base import ForceError, ForceReading, ForceSensor, ForceTimeout
from rig.devices.registry import ForceKind, Opener
from rig.settings import BenchSettings, Settings
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


class PlainSettings(Settings):
    """What is set on the scale."""

    decimals: int = Field(2, ge=0, le=4, description="of a weight")


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    force, scale = settings.force, settings.calibration.value("force_scale", 1.0)
    period_s, step_gwt = force.sample_period_s, 10.0 ** -force.own(PlainSettings).decimals
    port = opener(force.port)
    return PlainForce(port, clock, sample_period_s=period_s, resolution_gwt=step_gwt, scale=scale)


DEVICE = ForceKind(
    name="plain",
    device="scale in plain numbers",
    driver=_driver,
    settings=PlainSettings,
    twin="sim.devices.plain:plain_twin",
    tests=("tests/test_plain.py",),
)
