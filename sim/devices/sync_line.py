"""Virtual line of a serial adapter: it records when it rises and falls on the virtual clock."""

from collections import deque

from sim.devices.clock import VirtualClock

_EDGES_KEPT = 100_000
_REACHES_S, _CONFIRMED_S = 0.00025, 0.00075


class VirtualSyncLine:
    """Line that changes 0.25 ms after a request and is confirmed 0.75 ms later, a frame of USB in all.

    edges: times of all changes (s on the virtual clock), and the levels after them.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self.edges: deque[tuple[float, bool]] = deque(maxlen=_EDGES_KEPT)

    def switch(self, on: bool) -> tuple[float, float]:
        """Change the level; return when it was requested and when it was confirmed (s)."""
        requested_s = self._clock.monotonic_s()
        self._clock.wait_s(_REACHES_S)
        self.edges.append((self._clock.monotonic_s(), on))
        self._clock.wait_s(_CONFIRMED_S)
        return requested_s, self._clock.monotonic_s()
