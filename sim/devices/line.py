"""The virtual serial cable between a host and a device."""

from collections.abc import Callable

from sim.devices.clock import Scheduler
from sim.errors import ArgumentError

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
            raise ArgumentError("baud must be positive, got {baud}", code="bad_baud", baud=baud)
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
