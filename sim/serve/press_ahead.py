"""Forces in real time: the poses of the coming sample instants are solved before anybody asks for them.

A stage under way has its path planned, so where the indentor will be at the next sample instants is known before it
is there. A cell that is sampled faster than contact is solved gets forces in between, linear in the height. A plan
that changes (a stop, a hold) makes an answer late for a sample or two: then the last force is given, it is not called
fresh, and it is counted; after STALE_S it is no answer at all.
"""

import contextlib
import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from sim.plant.plant import Carriage, Pose
from sim.serve.press_process import PressAnswer, PressProcess
from sim.serve.wall_clock import WallScheduler

STALE_S = 0.5
_SHORTEST_S = 0.01  # between two solves
_BETWEEN_MM = 0.02  # farther apart, two forces say too little of those between them
_AHEAD = 4  # periods
_KEPT = 512


@dataclass
class PressStatistics:
    """How the forces came: readings asked for, those that were late, and the time of each solve (s)."""

    asked: int = 0
    late: int = 0
    unknown: int = 0
    stalest_s: float = 0.0
    slowest_s: float = 0.0
    solved: int = 0


class PressAhead:
    """force_n(t) for the virtual devices, without ever waiting."""

    def __init__(
        self,
        scheduler: WallScheduler,
        carriage: Carriage,
        press: PressProcess,
        period_s: float,
        complain: Callable[[str], object],
    ) -> None:
        """period_s: of the samples; complain gets one line each time the finger begins to have no answer."""
        self._scheduler, self._carriage, self._press = scheduler, carriage, press
        self._period_s, self._complain = max(period_s, _SHORTEST_S), complain
        self._forces: OrderedDict[Pose, float] = OrderedDict()
        self._asked: tuple[float, Pose] | None = None
        self._troubled = False
        self._last_n, self._last_s = math.nan, -math.inf
        self.statistics = PressStatistics()
        self.ended = False  # there is no finger any more; the scheduler has been stopped
        self._press.ask(carriage.pose_at(scheduler.monotonic_s()))
        self._learn(self._press.answer())
        scheduler.watch(press, self._on_answer)
        self._tick()

    def force_n(self, t_s: float) -> float:
        """Force at an instant, N; the last one known where that is not solved yet, NaN where it is too old."""
        self.statistics.asked += 1
        known = self._known_at(t_s)
        if known is not None:
            return known
        stale_s = max(t_s - self._last_s, 0.0)
        self.statistics.late += 1
        self.statistics.stalest_s = max(self.statistics.stalest_s, stale_s)
        if stale_s <= STALE_S:
            return self._last_n
        self.statistics.unknown += 1
        return math.nan

    def fresh(self, t_s: float) -> bool:
        """Whether the force of this instant is known, and not just the last one before it."""
        return self._known_at(t_s) is not None

    def close(self) -> None:
        if not self.ended:
            self._scheduler.unwatch(self._press)
        self._press.close()

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

    def _tick(self) -> None:
        self._note(self._index() * self._period_s)
        self._ask_next()
        self._scheduler.call_at((self._index() + 1) * self._period_s, self._tick)

    def _note(self, t_s: float) -> None:
        """Keep the force of a sample instant that is past, if it is known and newer than the one kept."""
        known = self._known_at(t_s)
        if known is not None and self._last_s < t_s <= self._scheduler.monotonic_s():
            self._last_n, self._last_s = known, t_s

    def _index(self) -> int:
        return math.floor(self._scheduler.monotonic_s() / self._period_s + 1e-6)

    def _ask_next(self) -> None:
        """The next unsolved pose from the last sample instant on; who is behind begins with the farthest.

        That is where the indentor will be when the answer comes, and often where it will rest.
        """
        if self._asked is not None or self.ended:
            return
        index = self._index()
        ahead = range(_AHEAD + 1)
        for k in ahead if self._known_at(index * self._period_s) is not None else reversed(ahead):
            t_s = (index + k) * self._period_s
            pose = self._carriage.pose_at(t_s)
            if pose not in self._forces:
                self._asked = t_s, pose
                with contextlib.suppress(OSError):  # a process that has just died is noticed at its pipe
                    self._press.ask(pose)
                return

    def _on_answer(self) -> None:
        try:
            answer = self._press.answer()
        except (EOFError, OSError):
            self._scheduler.unwatch(self._press)
            self.ended = True
            self._complain("the process of the virtual finger has ended")
            self._scheduler.stop()
            return
        asked, self._asked = self._asked, None
        self._learn(answer)
        if asked is not None:  # it may have taken so long that its instant is past
            self._note(asked[0])
        self._ask_next()

    def _learn(self, answer: PressAnswer) -> None:
        self._forces[answer.pose] = answer.force_n
        if len(self._forces) > _KEPT:
            self._forces.popitem(last=False)
        self.statistics.solved += 1
        self.statistics.slowest_s = max(self.statistics.slowest_s, answer.solve_s)
        if answer.problem and not self._troubled:
            self._complain(answer.problem)
        self._troubled = bool(answer.problem)
