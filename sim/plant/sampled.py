"""What hangs on its past is sampled on a fixed grid of instants, whether anybody asks or not."""

from collections.abc import Callable

from sim.devices.clock import Scheduler, sample_at

_KEPT = 256


class SampledForce:
    """force_n(t) of what moves on from sample to sample."""

    def __init__(self, scheduler: Scheduler, moved: Callable[[float, float], float], period_s: float) -> None:
        """moved(t_s, step_s) is called once for each instant, in their order, and gives the force then, N."""
        self._scheduler, self._moved, self._period_s = scheduler, moved, period_s
        self._index = self._index_at(scheduler.monotonic_s())
        self._forces = {self._index: 0.0}
        self._tick()

    def force_n(self, t_s: float) -> float:
        """Force at the last sample instant by t_s, N; 0 before the first."""
        index = self._index_at(t_s)
        while self._index < index:
            self._index += 1
            self._forces[self._index] = self._moved(self._index * self._period_s, self._period_s)
            self._forces.pop(self._index - _KEPT, None)
        return self._forces.get(index, 0.0)

    def _tick(self) -> None:
        self.force_n(self._scheduler.monotonic_s())
        self._scheduler.call_at((self._index + 1) * self._period_s, self._tick)

    def _index_at(self, t_s: float) -> int:
        return sample_at(t_s, self._period_s)
