"""A finger that relaxes, in real time: its force hangs on the way there, so that instants are solved in their order.

Sample instants that are past have been gone as they were; the next ones are solved by the stage's plan, and again
where it changes. Who is behind goes to now in longer steps of time.
"""

import contextlib
import math
from collections.abc import Callable
from itertools import pairwise

from sim.devices.clock import sample_at
from sim.plant.plant import Carriage, Pose
from sim.serve.ahead import Ahead
from sim.serve.wall_clock import WallScheduler
from sim.serve.way_process import Leg, Way, WayAnswer, WayProcess

_AHEAD = 2  # sample instants
_LONG_LEGS = 4  # to now, where more instants than that were missed
_KEPT = 512


class WayAhead(Ahead):
    """Forces by sample instant."""

    def __init__(
        self,
        scheduler: WallScheduler,
        carriage: Carriage,
        process: WayProcess,
        period_s: float,
        complain: Callable[[str], object],
    ) -> None:
        """period_s: of the samples; complain gets one line each time the finger begins to have no answer."""
        super().__init__(scheduler, process, period_s, complain)
        self._carriage, self._way_process = carriage, process
        self._asked: list[tuple[int, Pose]] | None = None
        self._forces: dict[int, tuple[Pose, float]] = {}
        self._gone = self._index()
        first = self._carriage.pose_at(self._gone * self._period_s)
        process.ask(Way((Leg(0.0, first),)))
        self._learn([(self._gone, first)], process.answer())
        self._begin()

    def _known_at(self, t_s: float) -> float | None:
        """At a sample instant, or between two of them, linear in time."""
        index = sample_at(t_s, self._period_s)
        share = max(t_s / self._period_s - index, 0.0)
        here = self._force_of(index)
        if here is None or share < 1e-6:
            return here
        there = self._force_of(index + 1)
        return None if there is None else (1 - share) * here + share * there

    def _force_of(self, index: int) -> float | None:
        pose, force_n = self._forces.get(index, (None, math.nan))
        return force_n if pose == self._pose_of(index) else None

    def _pose_of(self, index: int) -> Pose:
        return self._carriage.pose_at(index * self._period_s)

    def _ask_next(self) -> None:
        now = self._index()
        if self._asked is not None or self.ended or now <= self._gone:
            return
        each = max(math.ceil((now - self._gone) / _LONG_LEGS), 1)
        gone = list(range(now, self._gone, -each))[::-1]
        planned = range(now + 1, now + 1 + _AHEAD)
        starts = [self._gone, *gone, *planned]
        legs = [Leg((after - before) * self._period_s, self._pose_of(after)) for before, after in pairwise(starts)]
        self._asked = [(index, leg.pose) for index, leg in zip(starts[1:], legs, strict=True)]
        self._gone = now
        with contextlib.suppress(OSError):  # a process that has just died is noticed at its pipe
            self._way_process.ask(Way(tuple(legs[: len(gone)]), tuple(legs[len(gone) :])))

    def _take_answer(self) -> None:
        answer = self._way_process.answer()
        asked, self._asked = self._asked, None
        self._learn(asked or [], answer)
        self._note(self._index() * self._period_s)

    def _learn(self, asked: list[tuple[int, Pose]], answer: WayAnswer) -> None:
        self._forces.update({i: (pose, force) for (i, pose), force in zip(asked, answer.forces_n, strict=True)})
        for old in [index for index in self._forces if index < self._index() - _KEPT]:
            del self._forces[old]
        self._solved(answer.solve_s, answer.problem)
