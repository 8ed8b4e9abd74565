"""A wire whose bytes come at given times, for tests of drivers and links."""

import math

from sim.devices.clock import VirtualClock


class TimedWire:
    """Its bytes come in the order of `coming`: when each is due (s), and what it is."""

    name = "wire"

    def __init__(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.coming: list[tuple[float, bytes]] = []

    def read(self, timeout_s: float) -> bytes:
        left_s = self.coming[0][0] - self.clock.monotonic_s() if self.coming else math.inf
        self.clock.wait_s(min(max(left_s, 0.0), timeout_s))
        return self.coming.pop(0)[1] if left_s <= timeout_s else b""

    def close(self) -> None:
        """There is nothing to close."""
