"""What holds for every served finger, so that a machine that is busy with other things has its forces in time."""

import math
import os
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from sim.carriage import Carriage, Placement, Pose, Screws
from sim.serve.force_process import (
    ForceProcess,
    PressAnswer,
    PressProcess,
    TrajectoryForces,
    TrajectoryProcess,
    TrajectoryUpdate,
)
from sim.serve.prefetch import STALE_S, ForcePrefetcher, PressAhead, TrajectoryPrefetcher
from tests.sim.stepped_scheduler import SteppedScheduler

PERIOD_S = 0.05
LONG_S = 0.22
"""An answer: with it the time to the next one's is less than STALE_S, whatever is asked in between."""


def as_press(asked: Pose, solve_s: float) -> PressAnswer:
    return PressAnswer(asked, -asked.above_apex_mm, solve_s)


def as_way(asked: TrajectoryUpdate, solve_s: float) -> TrajectoryForces:
    return TrajectoryForces(tuple(-leg.pose.above_apex_mm for leg in (*asked.gone, *asked.planned)), solve_s)


KINDS: dict[type[Any], tuple[type[ForcePrefetcher], Callable[..., Any]]] = {
    PressProcess: (PressAhead, as_press),
    TrajectoryProcess: (TrajectoryPrefetcher, as_way),
}


class Slow:
    """Stands in for the process: takes its time for all but the first answer; the force is the depth."""

    def __init__(self, scheduler: SteppedScheduler, answer: Callable[..., Any]) -> None:
        self._scheduler, self._answer = scheduler, answer
        self._done, self._tell = os.pipe()
        self.solve_s, self.pending = 0.0, 0
        self.asked: list[tuple[float, Any]] = []

    def fileno(self) -> int:
        return self._done

    def ask(self, asked: Any) -> None:
        self.pending += 1
        assert self.pending == 1, "a question waits behind another one"
        now_s = self._scheduler.monotonic_s()
        self.asked.append((now_s, asked))
        if self.solve_s:
            self._scheduler.call_at(now_s + self.solve_s, lambda: os.write(self._tell, b"."))
        else:
            os.write(self._tell, b".")

    def answer(self) -> Any:
        os.read(self._done, 1)
        self.pending -= 1
        return self._answer(self.asked[-1][1], self.solve_s)

    def close(self) -> None:
        os.close(self._done)
        os.close(self._tell)


class Served:
    """A finger behind one of the two, under a stage that goes down at 1 mm/s."""

    def __init__(self, kind: type[Any]) -> None:
        self.scheduler, self.told = SteppedScheduler(), list[str]()
        self.depth_mm: Callable[[float], float] = lambda t_s: t_s
        ahead, answer = KINDS[kind]
        self.finger = Slow(self.scheduler, answer)
        carriage = Carriage(lambda t_s: (0, 0, -round(400 * self.depth_mm(t_s))), Screws(), Placement(0.0, 0.0))
        make: Callable[..., ForcePrefetcher] = ahead
        self.ahead = make(self.scheduler, carriage, self.finger, PERIOD_S, self.told.append)

    def each_sample(self, until_s: float) -> Iterator[float]:
        """The instants, once everything has happened by then."""
        while (now_s := self.scheduler.monotonic_s()) < until_s:
            self.scheduler.run_once(now_s + PERIOD_S)
            yield self.scheduler.monotonic_s()


@pytest.fixture(params=KINDS, ids=lambda kind: kind.__name__)
def served(request: pytest.FixtureRequest) -> Iterator[Served]:
    found = Served(request.param)
    yield found
    found.ahead.close()
    found.scheduler.close()


def test_the_tests_of_served_fingers_cover_every_kind() -> None:
    assert {one for one in ForceProcess.__subclasses__() if one.__module__ == ForceProcess.__module__} == set(KINDS)


def test_a_served_finger_solves_the_newest_pose_first_and_queues_none(served: Served) -> None:
    """No pose is solved that is past while a newer one is not: behind, the newest is among what is asked first."""
    served.finger.solve_s = LONG_S
    for _ in served.each_sample(3.0):
        pass
    asked = served.finger.asked[3:]
    assert len(asked) > 8
    for t_s, what in asked:
        newest = what if isinstance(what, Pose) else what.planned[-1].pose
        ahead_s = -newest.above_apex_mm - t_s
        assert LONG_S - 2 * PERIOD_S < ahead_s < STALE_S, "where the indentor will be when the answer comes"
        if isinstance(what, TrajectoryUpdate):
            assert len(what.gone) <= 3
            assert len(what.planned) == 1


def test_a_served_force_counts_from_the_arrival_of_its_answer(served: Served) -> None:
    served.finger.solve_s = LONG_S
    for now_s in served.each_sample(4.0):
        assert now_s - served.ahead.force_n(now_s) <= STALE_S + PERIOD_S
    assert served.ahead.statistics.late > 10
    assert served.ahead.statistics.unknown == 0
    assert served.told == []


def test_after_a_change_of_plan_the_last_served_force_counts_until_the_new_one_is_solved(served: Served) -> None:
    for _ in served.each_sample(0.5):
        pass
    now_s, late = served.scheduler.monotonic_s(), served.ahead.statistics.late
    before = served.ahead.force_n(now_s)
    assert served.ahead.fresh(now_s)
    served.depth_mm = lambda t_s: 2.0
    assert not served.ahead.fresh(now_s)
    assert served.ahead.force_n(now_s) == pytest.approx(before, abs=PERIOD_S + 1e-6)
    assert served.ahead.statistics.late == late + 1
    assert math.isnan(served.ahead.force_n(now_s + STALE_S + PERIOD_S)), "too old to be an answer"
    *_, later_s = served.each_sample(now_s + 5 * PERIOD_S)
    assert served.ahead.fresh(later_s)
    assert served.ahead.force_n(later_s) == pytest.approx(2.0)


def test_a_served_finger_reports_each_late_period_once(served: Served) -> None:
    for _ in served.each_sample(0.5):
        pass
    for times in (1, 2):
        served.finger.solve_s = 4 * STALE_S
        begin_s = served.scheduler.monotonic_s()
        found = [served.ahead.force_n(now_s) for now_s in served.each_sample(begin_s + 3 * STALE_S)]
        assert sum(math.isnan(force) for force in found) > 5
        assert len(served.told) == times
        assert [float(said) >= STALE_S for said in re.findall(r"([\d.]+) s\b", served.told[-1])] == [True]
        served.finger.solve_s = 0.001
        for _ in served.each_sample(begin_s + 8 * STALE_S):
            pass
        now_s = served.scheduler.monotonic_s()
        assert served.ahead.force_n(now_s) == pytest.approx(now_s, abs=0.01)
