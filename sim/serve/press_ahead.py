"""An elastic finger in real time: the poses of the coming sample instants are solved before anybody asks for them.

A stage under way has its path planned, so where the indentor will be at the next sample instants is known before it
is there. A cell that is sampled faster than contact is solved gets forces in between, linear in the height. A plan
that changes (a stop, a hold) makes an answer late for a sample or two.
"""

import contextlib
import math
from collections import OrderedDict
from collections.abc import Callable

from sim.plant.plant import Carriage, Pose
from sim.serve.ahead import Ahead
from sim.serve.press_process import PressAnswer, PressProcess
from sim.serve.wall_clock import WallScheduler

_BETWEEN_MM = 0.02  # farther apart, two forces say too little of those between them
_AHEAD = 4  # periods
_KEPT = 512


class PressAhead(Ahead):
    """Forces by pose."""

    def __init__(
        self,
        scheduler: WallScheduler,
        carriage: Carriage,
        press: PressProcess,
        period_s: float,
        complain: Callable[[str], object],
    ) -> None:
        """period_s: of the samples; complain gets one line each time the finger begins to have no answer."""
        super().__init__(scheduler, press, period_s, complain)
        self._carriage, self._press = carriage, press
        self._forces: OrderedDict[Pose, float] = OrderedDict()
        self._asked: tuple[float, Pose] | None = None
        self._press.ask(carriage.pose_at(scheduler.monotonic_s()))
        self._learn(self._press.answer())
        self._begin()

    def _known_at(self, t_s: float) -> float | None:
        pose = self._carriage.pose_at(t_s)
        if pose in self._forces:
            return self._forces[pose]
        index = math.floor(t_s / self._period_s)
        before, after = (self._carriage.pose_at((index + k) * self._period_s) for k in (0, 1))
        way_mm = after.above_apex_mm - before.above_apex_mm
        if not (before.over(pose) and pose.over(after) and 0 < abs(way_mm) <= _BETWEEN_MM):
            return None
        share = (pose.above_apex_mm - before.above_apex_mm) / way_mm
        if before not in self._forces or after not in self._forces or not 0 <= share <= 1:
            return None
        return (1 - share) * self._forces[before] + share * self._forces[after]

    def _ask_next(self) -> None:
        """The next unsolved pose from the last sample instant on; who is behind begins with the farthest.

        That is where the indentor will be when the answer comes, and often where it will rest.
        """
        if self._asked is not None or self.ended:
            return
        index, took = self._index(), self._samples_ahead()
        ahead = range(max(_AHEAD, took) + 1)
        in_time = took == 1 and self._known_at(index * self._period_s) is not None
        for k in ahead if in_time else reversed(ahead):
            t_s = (index + k) * self._period_s
            pose = self._carriage.pose_at(t_s)
            if pose not in self._forces:
                self._asked = t_s, pose
                with contextlib.suppress(OSError):  # a process that has just died is noticed at its pipe
                    self._press.ask(pose)
                return

    def _take_answer(self) -> None:
        answer = self._press.answer()
        asked, self._asked = self._asked, None
        self._learn(answer)
        if asked is not None:  # it may have taken so long that its instant is past
            self._note(asked[0])

    def _learn(self, answer: PressAnswer) -> None:
        self._forces[answer.pose] = answer.force_n
        if len(self._forces) > _KEPT:
            self._forces.popitem(last=False)
        self._solved(answer.solve_s, answer.problem)
