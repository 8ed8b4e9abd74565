"""A finger that relaxes, in real time: its force hangs on the way there, so that instants are solved in their order.

Sample instants that are past have been gone as they were; the next ones are solved by the stage's plan, and again
where it changes. Who is behind takes few steps, so as not to fall behind farther: to now by the last turn of the way,
since a step at rest is exact however long it is, and from now to where the answer will come.
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import astuple
from itertools import pairwise, takewhile

import numpy as np

from sim.devices.clock import sample_at
from sim.plant.plant import Carriage, Pose
from sim.serve.ahead import Ahead
from sim.serve.wall_clock import WallScheduler
from sim.serve.way_process import Leg, Way, WayAnswer, WayProcess

_AHEAD = 2  # samples
_TURNS = 1  # on the way to now
_LOOKED_AT = 64  # instants for turns of the way
_STRAIGHT_MM = 0.006  # two steps of a usual screw
_LONGEST_MM = 0.1  # a press goes on from a state no farther away
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
        self._planned: list[tuple[int, Pose]] = []
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
        gone, apart = self._gone_to(now), self._samples_ahead()
        planned = [now + 1, now + _AHEAD] if apart == 1 else [now + apart]
        starts = [self._gone, *gone, *planned]
        legs = [Leg((after - before) * self._period_s, self._pose_of(after)) for before, after in pairwise(starts)]
        self._asked = [(index, leg.pose) for index, leg in zip(starts[1:], legs, strict=True)]
        self._planned, self._gone = self._asked[len(gone) :], now
        with contextlib.suppress(OSError):  # a process that has just died is noticed at its pipe
            self._way_process.ask(Way(tuple(legs[: len(gone)]), tuple(legs[len(gone) :])))

    def _gone_to(self, now: int) -> list[int]:
        """Instants on the way to now: by those that were planned and came so, which are solved, then by its turns."""
        came = takewhile(lambda one: one[0] <= now and one[1] == self._pose_of(one[0]), self._planned)
        solved = [index for index, _ in came]
        start = solved[-1] if solved else self._gone
        return [*solved, *self._turns(start, now)] if start < now else solved

    def _turns(self, start: int, now: int) -> list[int]:
        each = max(math.ceil((now - start) / _LOOKED_AT), 1)
        looked_at = [start, *range(now, start, -each)[::-1]]
        turns, last = list[int](), self._pose_of(start)
        for before, at, after in zip(looked_at, looked_at[1:], looked_at[2:], strict=False):
            here, there = self._pose_of(at), self._pose_of(after)
            if not _straight(self._pose_of(before), here, there) or _apart_mm(last, there) > _LONGEST_MM:
                turns.append(at)
                last = here
        return [*turns[-_TURNS:], now]

    def _take_answer(self) -> None:
        answer = self._way_process.answer()
        asked, self._asked = self._asked, None
        self._learn(asked or [], answer)
        for index, _ in asked or []:  # it may have taken so long that they are past
            self._note(index * self._period_s)

    def _learn(self, asked: list[tuple[int, Pose]], answer: WayAnswer) -> None:
        self._forces.update({i: (pose, force) for (i, pose), force in zip(asked, answer.forces_n, strict=True)})
        for old in [index for index in self._forces if index < self._index() - _KEPT]:
            del self._forces[old]
        self._solved(answer.solve_s, answer.problem)


def _straight(before: Pose, here: Pose, after: Pose) -> bool:
    """Whether the indentor went on as it came."""
    first, second, third = (np.array(astuple(pose)) for pose in (before, here, after))
    return float(np.abs(first - 2 * second + third).max()) <= _STRAIGHT_MM


def _apart_mm(one: Pose, other: Pose) -> float:
    return float(np.abs(np.subtract(astuple(one), astuple(other))).max())
