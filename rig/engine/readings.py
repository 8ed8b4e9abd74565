"""One reading of the force sensor that can be relied on, and what it shows in the air."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rig.devices.force.base import ForceError, ForceReading, ForceSensor
from rig.devices.units import GWT_N
from rig.transport.base import TransportError
from rig.transport.clock import Clock


class NoReadingError(Exception):
    """There is no reading, or none to rely on; the message says why."""


def read(sensor: ForceSensor, clock: Clock, wait_s: float) -> ForceReading:
    """A reading made after the wait. Raises NoReadingError where it is none, no number, or an old one."""
    clock.wait_s(wait_s)
    asked_s = clock.monotonic_s()
    try:
        reading = sensor.read()
    except (ForceError, TransportError) as error:
        raise NoReadingError(f"no force reading: {error}") from error
    if not math.isfinite(reading.force_n):
        raise NoReadingError(f"the force reading is {reading.force_n}, not a number")
    if reading.t_s < asked_s:
        raise NoReadingError(f"the force reading is stale, {asked_s - reading.t_s:.3f} s older than the question")
    return reading


@dataclass(frozen=True)
class Zero:
    """What a zeroed sensor still shows with nothing touched: an offset, and the sd of single readings."""

    offset_n: float = 0.0
    noise_gwt: float = 0.0

    @classmethod
    def of(cls, readings_gwt: Sequence[float]) -> "Zero":
        """Measured."""
        return cls(statistics.fmean(readings_gwt) * GWT_N, statistics.pstdev(readings_gwt))

    def taken_off(self, reading: ForceReading) -> ForceReading:
        """The reading without the offset."""
        return replace(reading, force_n=reading.force_n - self.offset_n)
