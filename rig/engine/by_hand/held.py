"""A direction that somebody holds down, as long as they keep saying so."""

from rig.engine.by_hand.dead_man import Direction
from rig.transport.clock import Clock

FASTEST_MM_S = 10.0
"""By hand, in any direction; down a finger's own limit counts besides."""


class Held:
    """What was said last, for counts_s from when it was said."""

    def __init__(self, clock: Clock, counts_s: float) -> None:
        self._clock, self._counts_s = clock, counts_s
        self._said: tuple[Direction, float] | None = None  # and until when it counts

    def say(self, direction: Direction | None, ago_s: float = 0.0) -> None:
        """It is held, None: it is not; so it was ago_s ago. What was said later counts on."""
        until_s = self._clock.monotonic_s() + self._counts_s - ago_s
        if direction is not None and self._said is not None and self._said[0] == direction:
            until_s = max(until_s, self._said[1])
        self._said = None if direction is None else (direction, until_s)

    def __call__(self) -> Direction | None:
        if self._said is None:
            return None
        direction, until_s = self._said
        return direction if self._clock.monotonic_s() < until_s else None
