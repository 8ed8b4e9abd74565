"""How long a finger has been touched."""

from rig.transport.clock import Clock


class ContactTime:
    """Seconds from first touch to lift, added up over all the parts of a run."""

    def __init__(self, clock: Clock, before_s: float = 0.0) -> None:
        """before_s: what the parts of the run before this one have used up."""
        self._clock, self._before_s = clock, before_s
        self._since_s: float | None = None

    @property
    def total_s(self) -> float:
        """Until now."""
        return self._before_s + (0.0 if self._since_s is None else self._clock.monotonic_s() - self._since_s)

    def begin(self) -> None:
        """Touched now, if not already before."""
        if self._since_s is None:
            self._since_s = self._clock.monotonic_s()

    def end(self) -> None:
        """Lifted."""
        self._before_s, self._since_s = self.total_s, None
