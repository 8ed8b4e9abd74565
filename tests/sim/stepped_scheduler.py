"""A loop over real pipes whose time stands still while there is something to do."""

import math

from sim.serve.real_time_loop import WallScheduler


class SteppedScheduler(WallScheduler):
    """Real pipes, on a time that goes on only once there is nothing left to do."""

    now_s = 0.0

    def monotonic_s(self) -> float:
        return self.now_s

    def run_once(self, until_s: float = math.inf) -> None:
        self._run_due()
        ready = self._selector.select(0)
        for key, _ in ready:
            key.data()
        if not ready:
            self.now_s = min(self._queue.next_s(), until_s)
