"""Virtual serial cable between a host and a device, load cell, and description of virtual twins."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from sim.devices.clock import Scheduler, sample_at
from sim.errors import ArgumentError, SimError
from sim.units import GWT_N

BITS_PER_BYTE = 10


def _nothing() -> None:
    """Ignore a new host, as most devices do."""


class _OneWay:
    """One direction: chunks arrive in sequence, none before its last bit."""

    def __init__(self, scheduler: Scheduler, baud: float) -> None:
        self._scheduler = scheduler
        self._byte_s = BITS_PER_BYTE / baud
        self._busy_until_s = 0.0

    def full_until_s(self, buffered: int) -> float:
        """Return when at most `buffered` bytes are still to be sent."""
        return self._busy_until_s - buffered * self._byte_s

    def send(self, data: bytes, deliver: Callable[[bytes], None]) -> None:
        start_s = max(self._scheduler.monotonic_s(), self._busy_until_s)
        self._busy_until_s = start_s + len(data) * self._byte_s
        self._scheduler.call_at(self._busy_until_s, lambda: deliver(data))


class SerialLine:
    """Full-duplex 8N1 line: each chunk arrives, whole, after its last byte."""

    def __init__(self, scheduler: Scheduler, baud: float) -> None:
        if not baud > 0:
            raise ArgumentError(f"baud {baud}: must be positive", "bad_baud")
        self._to_device = _OneWay(scheduler, baud)
        self._to_host = _OneWay(scheduler, baud)
        self._arrived = bytearray()
        self._on_bytes: Callable[[bytes], None] = _drop
        self.renewed: Callable[[], None] = _nothing
        self._on_host_bytes: Callable[[bytes], object] = self._arrived.extend
        self.echoes = False  # as an RS-485 adapter that receives what the host writes
        self.further: tuple[SerialLine, ...] = ()
        """Lines of the further ports of the same device."""

    def host_write(self, data: bytes) -> None:
        if data:
            self._to_device.send(data, self._deliver)

    def host_read(self) -> bytes:
        """Return and clear the bytes that have arrived at the host."""
        data = bytes(self._arrived)
        self._arrived.clear()
        return data

    def host_pending(self) -> bool:
        return bool(self._arrived)

    def forward(self, on_host_bytes: Callable[[bytes], object]) -> None:
        """Forward bytes to a callback as they arrive at the host."""
        self._on_host_bytes = on_host_bytes

    def connect(self, on_bytes: Callable[[bytes], None], on_renewed: Callable[[], None] = _nothing) -> None:
        """Attach the device: on_bytes gets each chunk on arrival; on_renewed is called for a new host."""
        self._on_bytes, self.renewed = on_bytes, on_renewed

    def device_write(self, data: bytes) -> None:
        if data:
            self._to_host.send(data, self._deliver_to_host)

    def device_blocked_until_s(self, buffered: int) -> float:
        """Return when all written bytes are sent, or fit into a transmit buffer of a size."""
        return self._to_host.full_until_s(buffered)

    def _deliver_to_host(self, data: bytes) -> None:
        self._on_host_bytes(data)

    def _deliver(self, data: bytes) -> None:
        if self.echoes:
            self._deliver_to_host(data)
        self._on_bytes(data)


def _drop(_data: bytes) -> None:
    """Drop bytes to a line without a device."""


# --- cell ---
#
# A load is a force; an instrument takes samples of the cell's signal.

_SAMPLES_KEPT = 256


def _always(_t_s: float) -> bool:
    return True


@dataclass(frozen=True)
class Load:
    """Load on a force sensor: N at a time in s, and whether that force is fresh or the last one."""

    force_n: Callable[[float], float]
    fresh: Callable[[float], bool] = _always


class Samples:
    """Load in grams on a fixed time grid, sampled on request only."""

    def __init__(self, scheduler: Scheduler, load: Load, period_s: float) -> None:
        self._scheduler, self._load, self._period_s = scheduler, load, period_s
        self._grams: dict[int, float] = {}

    def newest(self) -> int:
        """Return the number of the latest sample."""
        return sample_at(self._scheduler.monotonic_s(), self._period_s)

    def next_s(self) -> float:
        """Return the time of the next sample."""
        return (self.newest() + 1) * self._period_s

    def grams(self, number: int) -> float:
        """Return one sample; NaN with a dead cell. A force that is not fresh is not stored, because it may be solved
        later.
        """
        grams = self._grams.get(number)
        if grams is None:
            instant_s = self._instant_s(number)
            grams = self._load.force_n(instant_s) / GWT_N
            if self._load.fresh(instant_s):
                if len(self._grams) >= _SAMPLES_KEPT:
                    self._grams.clear()
                self._grams[number] = grams
        return grams

    def steady(self, number: int, count: int, band_g: float) -> bool:
        """Return whether the `count` samples up to a number are fresh and lie within a band."""
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
    """Return the cell's signal: N at a time in s, delayed by latency_s, with drift and Gaussian noise.

    Noise depends on the seed and the sample time alone, and so not on the number or order of reads. noise_n is its
    standard deviation.
    """

    def read_n(t_s: float) -> float:
        force = force_n(max(t_s - latency_s, 0.0)) + drift_n_per_s * t_s
        return force + noise_n * _standard_normal(seed, sample_at(t_s, sample_period_s))

    return read_n if noise_n or latency_s or drift_n_per_s else force_n


def _standard_normal(seed: int, index: int) -> float:
    return float(np.random.default_rng((seed, max(index, 0))).standard_normal())


# --- twins ---
#
# A twin is a function that puts a virtual device on a line: `twin(scheduler, line, spec)` for a stage, and
# `twin(scheduler, line, spec, load)` for a force sensor.

PerAxis = tuple[float, float, float]
Framing = Literal["rtu", "tcp"]


class TwinError(SimError, ValueError):
    """Error of a twin that cannot be built; begins with the configuration key."""

    default_code = "bad_twin"


class VirtualStage(Protocol):
    """Stage as a bench uses it: positions of the nuts, in steps."""

    def nut_steps_at(self, t_s: float) -> tuple[int, int, int]:
        """Return steps from machine zero (x, y, z) at a time."""
        ...


@dataclass(frozen=True)
class VirtualStageSpec:
    """Specification of a virtual stage, with values along x, y and z.

    steps_per_mm: as configured, negative where the motor runs against the axis. play_steps: lost motion of the true
    screws. own: the configuration table of its kind; sync: that of the amplifier's pulse. inputs_register: of a
    drive's digital inputs. acceleration_mm_s2: as configured.
    """

    travel_mm: PerAxis
    steps_per_mm: PerAxis
    play_steps: PerAxis = (0.0, 0.0, 0.0)
    framing: Framing = "rtu"
    own: Mapping[str, Any] = field(default_factory=dict)
    sync: Mapping[str, Any] = field(default_factory=dict)
    inputs_register: int = 0x0179
    acceleration_mm_s2: float = 50.0


@dataclass(frozen=True)
class VirtualForceSpec:
    """Specification of a virtual force sensor.

    resolution_g: the true resolution. own: the configuration table of its kind. set_point_g: set-point of its relay,
    None without a relay.
    """

    sample_period_s: float
    resolution_g: float
    framing: Framing = "rtu"
    own: Mapping[str, Any] = field(default_factory=dict)
    set_point_g: float | None = None


@runtime_checkable
class StopPins(Protocol):
    """Virtual stage with inputs that stop it without its host."""

    def press(self, name: str) -> None:
        """Press a button wired to an input."""
        ...

    def release(self, name: str) -> None:
        """Release the button."""
        ...


@runtime_checkable
class Relay(Protocol):
    """Virtual sensor with a relay that switches at its set-point."""

    def wire(self, switch: Callable[[bool], None]) -> None:
        """Connect the relay, which from now on switches at samples."""
        ...


StageTwin = Callable[[Scheduler, SerialLine, VirtualStageSpec], VirtualStage]
ForceTwin = Callable[[Scheduler, SerialLine, VirtualForceSpec, Load], object]
