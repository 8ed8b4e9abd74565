"""The virtual serial cable between a host and a device."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from sim.devices.clock import Scheduler, sample_at
from sim.errors import ArgumentError, SimError
from sim.units import GWT_N

BITS_PER_BYTE = 10


def _nothing() -> None:
    """Most devices do not notice who is at the other end."""


class _OneWay:
    """One direction: chunks follow each other, none arrives before its last bit."""

    def __init__(self, scheduler: Scheduler, baud: float) -> None:
        self._scheduler = scheduler
        self._byte_s = BITS_PER_BYTE / baud
        self._busy_until_s = 0.0

    def full_until_s(self, buffered: int) -> float:
        """When no more than so many bytes are still to be sent."""
        return self._busy_until_s - buffered * self._byte_s

    def send(self, data: bytes, deliver: Callable[[bytes], None]) -> None:
        start_s = max(self._scheduler.monotonic_s(), self._busy_until_s)
        self._busy_until_s = start_s + len(data) * self._byte_s
        self._scheduler.call_at(self._busy_until_s, lambda: deliver(data))


class SerialLine:
    """A full-duplex 8N1 line: each chunk arrives, whole, when its last byte has been clocked over."""

    def __init__(self, scheduler: Scheduler, baud: float) -> None:
        if not baud > 0:
            raise ArgumentError("baud {baud}: must be positive", code="bad_baud", baud=baud)
        self._to_device = _OneWay(scheduler, baud)
        self._to_host = _OneWay(scheduler, baud)
        self._arrived = bytearray()
        self._on_bytes: Callable[[bytes], None] = _nobody
        self.renewed: Callable[[], None] = _nothing
        self._on_host_bytes: Callable[[bytes], object] = self._arrived.extend
        self.echoes = False  # as an RS-485 adapter that hears itself: what the host writes comes back, as it goes out

    def host_write(self, data: bytes) -> None:
        if data:
            self._to_device.send(data, self._hand_over)

    def host_read(self) -> bytes:
        """Return and forget what has arrived at the host."""
        data = bytes(self._arrived)
        self._arrived.clear()
        return data

    def host_pending(self) -> bool:
        return bool(self._arrived)

    def forward(self, on_host_bytes: Callable[[bytes], object]) -> None:
        """From now on on_host_bytes gets what arrives at the host, at the instant it arrives."""
        self._on_host_bytes = on_host_bytes

    def connect(self, on_bytes: Callable[[bytes], None], on_renewed: Callable[[], None] = _nothing) -> None:
        """Attach the device: on_bytes gets each chunk at the instant it arrives; on_renewed is told of a new host."""
        self._on_bytes, self.renewed = on_bytes, on_renewed

    def device_write(self, data: bytes) -> None:
        if data:
            self._to_host.send(data, self._hand_to_host)

    def device_blocked_until_s(self, buffered: int) -> float:
        """When a device with a transmit buffer of so many bytes has all that it wrote in it, or sent."""
        return self._to_host.full_until_s(buffered)

    def _hand_to_host(self, data: bytes) -> None:
        self._on_host_bytes(data)

    def _hand_over(self, data: bytes) -> None:
        if self.echoes:
            self._hand_to_host(data)
        self._on_bytes(data)


def _nobody(_data: bytes) -> None:
    """Bytes sent to a line without a device are lost, as on a cable that ends nowhere."""


# --- cell ---
#
# What stands on a load cell: a force, what the cell makes of it, and the samples that an instrument takes.

_SAMPLES_KEPT = 256


def _always(_t_s: float) -> bool:
    return True


@dataclass(frozen=True)
class Load:
    """What stands on a force sensor: N at an instant in s, and whether that is known or the last one before."""

    force_n: Callable[[float], float]
    fresh: Callable[[float], bool] = _always


class Samples:
    """A load in grams on a fixed grid of instants; only those are taken that somebody asks about."""

    def __init__(self, scheduler: Scheduler, load: Load, period_s: float) -> None:
        self._scheduler, self._load, self._period_s = scheduler, load, period_s
        self._grams: dict[int, float] = {}

    def newest(self) -> int:
        """The number of the last sample by now."""
        return sample_at(self._scheduler.monotonic_s(), self._period_s)

    def next_s(self) -> float:
        """The instant of the sample after the newest."""
        return (self.newest() + 1) * self._period_s

    def grams(self, number: int) -> float:
        """One sample; not a number from a dead cell."""
        grams = self._grams.get(number)
        if grams is None:
            if len(self._grams) >= _SAMPLES_KEPT:
                self._grams.clear()
            grams = self._grams[number] = self._load.force_n(self._instant_s(number)) / GWT_N
        return grams

    def steady(self, number: int, count: int, band_g: float) -> bool:
        """Whether `count` samples up to this one are fresh and lie within a band."""
        numbers = range(number - count + 1, number + 1)
        if not all(self._load.fresh(self._instant_s(k)) for k in numbers):
            return False
        recent = [self.grams(k) for k in numbers]
        return max(recent) - min(recent) <= band_g

    def _instant_s(self, number: int) -> float:
        return max(number, 0) * self._period_s


def load_cell(
    force_n: Callable[[float], float],
    *,
    sample_period_s: float,
    noise_n: float = 0.0,
    latency_s: float = 0.0,
    drift_n_per_s: float = 0.0,
    seed: int = 0,
) -> Callable[[float], float]:
    """The force as the cell gives it, N at a time in s: late by latency_s, drifting, with Gaussian noise.

    Noise depends on the seed and the sample instant alone, so that it is the same however often, and in whatever
    order, samples are asked for. noise_n is its standard deviation.
    """

    def read_n(t_s: float) -> float:
        force = force_n(max(t_s - latency_s, 0.0)) + drift_n_per_s * t_s
        return force + noise_n * _standard_normal(seed, sample_at(t_s, sample_period_s))

    return read_n if noise_n or latency_s or drift_n_per_s else force_n


def _standard_normal(seed: int, index: int) -> float:
    return float(np.random.default_rng((seed, max(index, 0))).standard_normal())


# --- told ---
#
# What a bench tells the virtual twin of a device, and what a twin is: a function that puts a device on a line.
#
# `twin(scheduler, line, told)` for a stage, and `twin(scheduler, line, told, load)` for a force sensor.

PerAxis = tuple[float, float, float]
Framing = Literal["rtu", "tcp"]


class TwinError(SimError, ValueError):
    """A twin cannot be as it is told; begins with the key that says so."""

    default_code = "bad_twin"


class VirtualStage(Protocol):
    """What a bench needs to know of a stage: where what hangs on its screws is, in steps."""

    def nut_steps_at(self, t_s: float) -> tuple[int, int, int]:
        """Steps from machine zero (x, y, z) at an instant."""
        ...


@dataclass(frozen=True)
class StageTold:
    """Of a stage, each along x, y and z.

    steps_per_mm: as the rig believes, negative where the motor runs against the axis. play_steps: what the true
    screws lose. own: the table of its kind; sync: what the configuration says of the amplifier's pulse.
    inputs_register: of a drive's digital inputs.
    """

    travel_mm: PerAxis
    steps_per_mm: PerAxis
    play_steps: PerAxis = (0.0, 0.0, 0.0)
    framing: Framing = "rtu"
    own: Mapping[str, Any] = field(default_factory=dict)
    sync: Mapping[str, Any] = field(default_factory=dict)
    inputs_register: int = 0x0179


@dataclass(frozen=True)
class ForceTold:
    """Of a force sensor; resolution_g is what it truly shows, own the table of its kind.

    set_point_g: where its relay switches; None: it has none.
    """

    sample_period_s: float
    resolution_g: float
    framing: Framing = "rtu"
    own: Mapping[str, Any] = field(default_factory=dict)
    set_point_g: float | None = None


@runtime_checkable
class StopPins(Protocol):
    """A virtual stage with inputs that stop it, whatever its host does."""

    def press(self, name: str) -> None:
        """Somebody presses what is wired to it."""
        ...

    def release(self, name: str) -> None:
        """They let it go."""
        ...


@runtime_checkable
class Relay(Protocol):
    """A virtual sensor with a relay that switches at its set-point."""

    def wire(self, switch: Callable[[bool], None]) -> None:
        """Have it switched, from now on, at every sample."""
        ...


StageTwin = Callable[[Scheduler, SerialLine, StageTold], VirtualStage]
ForceTwin = Callable[[Scheduler, SerialLine, ForceTold, Load], object]
