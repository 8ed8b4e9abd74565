"""Forces in real time from a finger in another process, solved before they are needed.

Where a force is not solved in time, the last one replaces it, marked as not fresh, and is counted; after STALE_S
there is no answer, and one message reports it. Nothing queues: the process has one request at a time, and the next
is chosen from the indentor's planned motion when it has answered.
"""

import contextlib
import math
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import Protocol

import numpy as np

from sim.carriage import Carriage, Pose
from sim.devices.clock import sample_at
from sim.serve.force_process import (
    Leg,
    PressAnswer,
    PressProcess,
    TrajectoryForces,
    TrajectoryProcess,
    TrajectoryUpdate,
)
from sim.serve.real_time_loop import WallScheduler

STALE_S = 0.5
_SHORTEST_S = 0.01  # between two solves
_ON_GRID = 1e-6  # of a period: round-off
_FARTHEST_S = STALE_S / 2  # horizon: plans farther ahead change too often


@dataclass
class PressStatistics:
    """Counts of readings, late and missing ones, and solve times (s)."""

    requested: int = 0
    late: int = 0
    unknown: int = 0
    stalest_s: float = 0.0
    slowest_s: float = 0.0
    solved: int = 0


class ItsProcess(Protocol):
    """Process of the finger."""

    def fileno(self) -> int:
        """Return a descriptor that is readable when there is an answer, or the process has ended."""
        ...

    def close(self) -> None:
        """End the process."""
        ...


class ForcePrefetcher(ABC):
    """Force signal force_n(t) for virtual devices that never blocks."""

    def __init__(
        self, scheduler: WallScheduler, process: ItsProcess, period_s: float, complain: Callable[[str], object]
    ) -> None:
        """Take the sample period and a callback for one line each time the finger stops answering."""
        self._scheduler, self._process, self._complain = scheduler, process, complain
        self._period_s = max(period_s, _SHORTEST_S)
        self._had_problem = self._too_late = False
        self._last_n, self._last_s = math.nan, -math.inf
        self._stored_until = self._index() - 1
        self._requested_s, self._took = math.inf, 1
        self.statistics = PressStatistics()
        self.ended = False  # the process has ended and the scheduler was stopped

    @abstractmethod
    def _known_at(self, t_s: float) -> float | None:
        """Return the force at a time, None where it is not solved (yet)."""

    @abstractmethod
    def _ask_next(self) -> None:
        """Request the next forces, unless a request is running."""

    @abstractmethod
    def _take_answer(self) -> None:
        """Read the answer. Raises EOFError or OSError if the process has ended."""

    def force_n(self, t_s: float) -> float:
        """Return the force at a time in N; the last one if unsolved, NaN if that is too old."""
        self.statistics.requested += 1
        known = self._known_at(t_s)
        if known is not None:
            return known
        stale_s = max(t_s - self._last_s, 0.0)
        self.statistics.late += 1
        self.statistics.stalest_s = max(self.statistics.stalest_s, stale_s)
        if stale_s <= STALE_S:
            return self._last_n
        self.statistics.unknown += 1
        if not self._too_late:
            self._complain(f"the virtual finger has had no force for {stale_s:.1f} s; this machine is too busy")
        self._too_late = True
        return math.nan

    def fresh(self, t_s: float) -> bool:
        """Return whether the force at this time is solved, and not just the last one."""
        return self._known_at(t_s) is not None

    def close(self) -> None:
        if not self.ended:
            self._scheduler.unwatch(self._process)
        self._process.close()

    def _begin(self) -> None:
        """Start prefetching after the first answer."""
        self._scheduler.watch(self._process, self._on_answer)
        self._tick()

    def _tick(self) -> None:
        """Store sample forces, including those that a delayed loop missed, and request the next."""
        now = self._index()
        for index in range(max(self._stored_until + 1, now - math.ceil(STALE_S / self._period_s)), now + 1):
            self._note(index * self._period_s)
        self._stored_until = now
        self._ask_next()
        self._scheduler.call_at((self._index() + 1) * self._period_s, self._tick)

    def _note(self, t_s: float) -> None:
        """Store the force of a past sample if it is solved and newer than the stored one."""
        if not self._last_s < t_s <= self._scheduler.monotonic_s():
            return
        known = self._known_at(t_s)
        if known is not None:
            self._last_n, self._last_s, self._too_late = known, t_s, False

    def _samples_ahead(self) -> int:
        """Return how many samples from now the answer is expected, as the last one took."""
        self._requested_s = self._scheduler.monotonic_s()
        return self._took

    def _index(self) -> int:
        return sample_at(self._scheduler.monotonic_s(), self._period_s)

    def _on_answer(self) -> None:
        took_s = min(self._scheduler.monotonic_s() - self._requested_s, _FARTHEST_S)
        self._took = max(math.ceil(took_s / self._period_s - _ON_GRID), 1)
        try:
            self._take_answer()
        except (EOFError, OSError):
            self._scheduler.unwatch(self._process)
            self.ended = True
            self._complain("the process of the virtual finger ended")
            self._scheduler.stop()
            return
        self._ask_next()

    def _solved(self, solve_s: float, problem: str) -> None:
        self.statistics.solved += 1
        self.statistics.slowest_s = max(self.statistics.slowest_s, solve_s)
        if problem and not self._had_problem:
            self._complain(problem)
        self._had_problem = bool(problem)


# --- press ahead ---
#
# The motion plan of a moving stage gives the indentor's poses at the next samples, so that their elastic forces can
# be solved ahead. Between solved samples, forces are linear in the height. A changed plan (a stop, a hold) delays a
# sample or two.

_BETWEEN_MM = 0.02  # largest distance for interpolation between two forces
_AHEAD = 4  # periods
_KEPT = 512


class PressAhead(ForcePrefetcher):
    """Prefetched forces of an elastic finger, by pose."""

    def __init__(
        self,
        scheduler: WallScheduler,
        carriage: Carriage,
        press: PressProcess,
        period_s: float,
        complain: Callable[[str], object],
    ) -> None:
        """Take the sample period and a callback for one line each time the finger stops answering."""
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
        rise_mm = after.above_apex_mm - before.above_apex_mm
        if not (before.over(pose) and pose.over(after) and 0 < abs(rise_mm) <= _BETWEEN_MM):
            return None
        share = (pose.above_apex_mm - before.above_apex_mm) / rise_mm
        if before not in self._forces or after not in self._forces or not 0 <= share <= 1:
            return None
        return (1 - share) * self._forces[before] + share * self._forces[after]

    def _ask_next(self) -> None:
        """Request the next unsolved pose from the last sample on; when late, begin with the farthest.

        That is the pose when the answer comes, and often the final one.
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
                with contextlib.suppress(OSError):  # the pipe reports a process that has just ended
                    self._press.ask(pose)
                return

    def _take_answer(self) -> None:
        answer = self._press.answer()
        request, self._asked = self._asked, None
        self._learn(answer)
        if request is not None:  # the sample may be past by now
            self._note(request[0])

    def _learn(self, answer: PressAnswer) -> None:
        self._forces[answer.pose] = answer.force_n
        if len(self._forces) > _KEPT:
            self._forces.popitem(last=False)
        self._solved(answer.solve_s, answer.problem)


# --- trajectory prefetch ---
#
# The force of a finger that relaxes depends on its trajectory, so samples are solved in order. Past samples follow
# the actual motion; the next ones follow the stage's plan, and are solved again where it changes. When late, the
# steps are few: to now by the last turn of the trajectory, since a step at rest is exact whatever its length, and
# from now to the time of the answer.

_SAMPLES_AHEAD = 2  # samples
_TURNS = 1  # turns up to now
_SEARCHED = 64  # samples searched for turns of the trajectory
_STRAIGHT_MM = 0.006  # two steps of a usual screw
_LONGEST_MM = 0.1  # a press starts from a state no farther away


class TrajectoryPrefetcher(ForcePrefetcher):
    """Prefetched forces of a finger that relaxes, by sample."""

    def __init__(
        self,
        scheduler: WallScheduler,
        carriage: Carriage,
        process: TrajectoryProcess,
        period_s: float,
        complain: Callable[[str], object],
    ) -> None:
        """Take the sample period and a callback for one line each time the finger stops answering."""
        super().__init__(scheduler, process, period_s, complain)
        self._carriage, self._way_process = carriage, process
        self._asked: list[tuple[int, Pose]] | None = None
        self._planned: list[tuple[int, Pose]] = []
        self._forces: dict[int, tuple[Pose, float]] = {}
        self._gone = self._index()
        first = self._carriage.pose_at(self._gone * self._period_s)
        process.ask(TrajectoryUpdate((Leg(0.0, first),)))
        self._learn([(self._gone, first)], process.answer())
        self._begin()

    def _known_at(self, t_s: float) -> float | None:
        """Return the force at a sample, or interpolated linearly in time between two."""
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
        planned = [now + 1, now + _SAMPLES_AHEAD] if apart == 1 else [now + apart]
        starts = [self._gone, *gone, *planned]
        legs = [Leg((after - before) * self._period_s, self._pose_of(after)) for before, after in pairwise(starts)]
        self._asked = [(index, leg.pose) for index, leg in zip(starts[1:], legs, strict=True)]
        self._planned, self._gone = self._asked[len(gone) :], now
        with contextlib.suppress(OSError):  # the pipe reports a process that has just ended
            self._way_process.ask(TrajectoryUpdate(tuple(legs[: len(gone)]), tuple(legs[len(gone) :])))

    def _gone_to(self, now: int) -> list[int]:
        """Return the samples up to now: planned ones that came true, which are solved, then turns."""
        confirmed = takewhile(
            lambda sample: sample[0] <= now and sample[1] == self._pose_of(sample[0]), self._planned
        )
        solved = [index for index, _ in confirmed]
        start = solved[-1] if solved else self._gone
        return [*solved, *self._turns(start, now)] if start < now else solved

    def _turns(self, start: int, now: int) -> list[int]:
        each = max(math.ceil((now - start) / _SEARCHED), 1)
        searched = [start, *range(now, start, -each)[::-1]]
        turns, last = list[int](), self._pose_of(start)
        for before, at, after in zip(searched, searched[1:], searched[2:], strict=False):
            here, there = self._pose_of(at), self._pose_of(after)
            if not _straight(self._pose_of(before), here, there) or _apart_mm(last, there) > _LONGEST_MM:
                turns.append(at)
                last = here
        return [*turns[-_TURNS:], now]

    def _take_answer(self) -> None:
        answer = self._way_process.answer()
        request, self._asked = self._asked, None
        self._learn(request or [], answer)
        for index, _ in request or []:  # the samples may be past by now
            self._note(index * self._period_s)

    def _learn(self, samples: list[tuple[int, Pose]], answer: TrajectoryForces) -> None:
        self._forces.update({i: (pose, force) for (i, pose), force in zip(samples, answer.forces_n, strict=True)})
        for old in [index for index in self._forces if index < self._index() - _KEPT]:
            del self._forces[old]
        self._solved(answer.solve_s, answer.problem)


def _straight(before: Pose, here: Pose, after: Pose) -> bool:
    """Return whether the indentor moved on in a straight line at the same speed."""
    first, second, third = (np.array(pose) for pose in (before, here, after))
    return float(np.abs(first - 2 * second + third).max()) <= _STRAIGHT_MM


def _apart_mm(one: Pose, other: Pose) -> float:
    return float(np.abs(np.subtract(one, other)).max())
