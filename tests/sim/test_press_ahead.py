"""The finger in a process of its own: forces that are there before they are asked for."""

import math
import multiprocessing
import os
from collections import Counter
from collections.abc import Callable, Iterator

import pytest

from sim.carriage import Carriage, Placement, Pose, Screws, Truth
from sim.config import FingertipConfig
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, Samples
from sim.models.fingertip import Fingertip
from sim.serve.force_process import FingerNotLoadedError, PressAnswer, PressProcess
from sim.serve.prefetch import STALE_S, PressAhead
from sim.serve.real_time_loop import WallScheduler
from sim.units import GWT_N
from tests.error_codes import raises
from tests.waiting import DEADLINE_S, until

PERIOD_S = 0.05


class Following:
    """A carriage whose plan a test changes as it likes, over a finger in real time."""

    def __init__(self) -> None:
        self.scheduler = WallScheduler()
        self.plan = lambda t_s: 1.0
        self.complaints: list[str] = []
        carriage = Carriage(self._steps_at, Screws(), Placement(0.0, 0.0))
        process = PressProcess(FingertipConfig(), "bar:3.0", Truth(2.0))
        self.press = PressAhead(self.scheduler, carriage, process, PERIOD_S, self.complaints.append)

    def _steps_at(self, t_s: float) -> tuple[int, int, int]:
        return (0, 0, round(400 * self.plan(t_s)))

    def run(self, seconds: float) -> None:
        """Let the loop run, and come back to it later."""
        end_s = self.scheduler.monotonic_s() + seconds
        while self.scheduler.monotonic_s() < end_s:
            self.scheduler.run_once(end_s)

    def run_until(self, look: Callable[[], bool]) -> None:
        """Let the loop run until that is so."""

        def looked() -> bool:
            self.run(PERIOD_S)
            return look()

        until(looked)

    def known(self) -> bool:
        """Whether the force of this moment is known."""
        return self.press.fresh(self.scheduler.monotonic_s())

    def close(self) -> None:
        self.press.close()
        self.scheduler.close()


@pytest.fixture(scope="module")
def following(finger: Fingertip) -> Iterator[Following]:
    assert finger is not None  # in the cache from here on
    following = Following()
    yield following
    following.close()


def force_at(finger: Fingertip, height_mm: float) -> float:
    """Twice the model's answer: the stiffness of this finger."""
    doi = finger.touch_height_mm("bar:3.0", 0.0) - finger.apex_height_mm - height_mm
    return 2.0 * finger.indent("bar:3.0", 0.0, doi_mm=doi).force_n


def test_a_planned_descent_is_answered_without_a_wait(
    following: Following, finger: Fingertip, work: Counter[str]
) -> None:
    """0.5 mm in one second, each sample asked for at its instant; what is fresh is the model's answer."""
    start_s = following.scheduler.monotonic_s() + 0.5
    following.plan = lambda t_s: 0.2 - 0.5 * min(max(t_s - start_s, 0.0), 1.0)
    following.run(0.5)
    fresh: list[tuple[float, float]] = []

    def enough() -> bool:
        """Past the descent, with those at rest and some on the way; nearly all where nothing else runs."""
        t_s = PERIOD_S * math.floor(following.scheduler.monotonic_s() / PERIOD_S)
        force = following.press.force_n(t_s)
        if following.press.fresh(t_s):
            fresh.append((round(400 * following.plan(t_s)) / 400, force))
        return len(fresh) > 10 and t_s > start_s + 1.0

    following.run_until(enough)
    assert not work, "nothing is solved in this process"
    for height_mm, force in fresh:
        doi_mm = finger.touch_height_mm("bar:3.0", 0.0) - finger.apex_height_mm - height_mm
        expected = force_at(finger, height_mm) if doi_mm > 0 else 0.0
        assert force == pytest.approx(expected, rel=1e-6)


def test_a_force_between_two_solved_poses_lies_between_theirs(following: Following, finger: Fingertip) -> None:
    """Solved every 15 µm: on 10 µm a force bends by 0.15 % of the largest at most (docs/validation/speed.md)."""

    def descent() -> int:
        """How many were between."""
        start_s, between = following.scheduler.monotonic_s() + 0.5, 0
        following.plan = lambda t_s: -0.1 - 0.3 * min(max(t_s - start_s, 0.0), 1.0)
        following.run(0.5)
        for _ in range(40):
            following.run(0.47 * PERIOD_S)
            t_s = following.scheduler.monotonic_s()
            height_mm = round(400 * following.plan(t_s)) / 400
            if following.press.fresh(t_s) and -0.39 < height_mm < -0.11:
                on_grid = abs(t_s / PERIOD_S - round(t_s / PERIOD_S)) < 0.1
                between += not on_grid
                assert following.press.force_n(t_s) == pytest.approx(force_at(finger, height_mm), rel=4e-3)
        return between

    until(lambda: descent() > 5)  # where nothing else runs, the first is enough


def test_a_plan_that_changes_gives_the_last_force_and_says_so(following: Following, finger: Fingertip) -> None:
    following.plan = lambda t_s: -0.3
    following.run_until(following.known)
    following.run(2 * PERIOD_S)
    now_s = following.scheduler.monotonic_s()
    before, late = following.press.force_n(now_s), following.press.statistics.late
    assert before == pytest.approx(force_at(finger, -0.3), rel=1e-6)
    following.plan = lambda t_s: -0.41
    assert following.press.force_n(now_s) == before
    assert not following.press.fresh(now_s)
    assert following.press.statistics.late == late + 1
    assert math.isnan(following.press.force_n(now_s + STALE_S + 0.01)), "too old to be an answer"
    following.run_until(following.known)
    now_s = following.scheduler.monotonic_s()
    assert following.press.fresh(now_s)
    assert following.press.force_n(now_s) == pytest.approx(force_at(finger, -0.41), rel=1e-6)


def test_a_depth_beyond_the_model_is_no_force_and_one_complaint(following: Following) -> None:
    """However many poses there are on the way."""
    start_s = following.scheduler.monotonic_s()
    following.plan = lambda t_s: -3.0 - 0.1 * (t_s - start_s)
    solved = following.press.statistics.solved
    following.run_until(lambda: following.press.statistics.solved > solved + 10)
    following.run_until(lambda: math.isnan(following.press.force_n(following.scheduler.monotonic_s())))
    told = [line for line in following.complaints if "this machine is too busy" not in line]
    assert len(told) == 1
    assert told[0].startswith("DOI ")
    assert "must be more than 0 and at most 2 mm" in told[0]
    following.plan = lambda t_s: 1.0
    following.run_until(following.known)
    assert following.press.force_n(following.scheduler.monotonic_s()) == 0.0


def test_a_finger_whose_process_dies_stops_the_loop_and_is_told_once(following: Following) -> None:
    """The last test with this process."""
    (process,) = multiprocessing.active_children()
    process.kill()
    process.join(DEADLINE_S)
    following.complaints.clear()
    following.run_until(lambda: following.press.ended)
    following.run(2 * PERIOD_S)
    assert following.complaints == ["the process of the virtual finger ended"]
    following.plan = lambda t_s: -0.777  # where it has not been
    assert math.isnan(following.press.force_n(following.scheduler.monotonic_s() + 2 * STALE_S))


def test_a_finger_closed_while_it_answers_ends_without_a_word(
    finger: Fingertip, capfd: pytest.CaptureFixture[str]
) -> None:
    assert finger is not None  # in the cache from here on
    process = PressProcess(FingertipConfig(), "bar:3.0")
    process.ask(Pose(0.0, -0.8))  # from rest: it is at it for tens of milliseconds
    process.close()
    assert capfd.readouterr() == ("", "")


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


class SlowFinger:
    """Takes its time for each answer, more than two sample periods; the force is the depth."""

    SOLVE_S = 2.4 * PERIOD_S

    def __init__(self, scheduler: WallScheduler) -> None:
        self._scheduler = scheduler
        self._done, self._tell = os.pipe()
        self._pose: Pose | None = None
        os.write(self._tell, b".")

    def fileno(self) -> int:
        return self._done

    def ask(self, pose: Pose) -> None:
        if self._pose is not None:
            self._scheduler.call_at(self._scheduler.monotonic_s() + self.SOLVE_S, lambda: os.write(self._tell, b"."))
        self._pose = pose

    def answer(self) -> PressAnswer:
        os.read(self._done, 1)
        assert self._pose is not None
        return PressAnswer(self._pose, -self._pose.above_apex_mm, self.SOLVE_S)

    def close(self) -> None:
        os.close(self._done)
        os.close(self._tell)


def test_a_finger_slower_than_the_samples_gives_late_forces_and_does_not_give_up() -> None:
    """1 mm/s for 1.5 s, no two samples in one place: each force given is that of a place passed a moment ago."""
    scheduler, told = SteppedScheduler(), []
    carriage = Carriage(lambda t_s: (0, 0, -round(400 * t_s)), Screws(), Placement(0.0, 0.0))
    press = PressAhead(scheduler, carriage, SlowFinger(scheduler), PERIOD_S, told.append)
    while (now_s := scheduler.monotonic_s()) < 1.5:
        scheduler.run_once(now_s + PERIOD_S)
        ago_mm = scheduler.monotonic_s() - press.force_n(scheduler.monotonic_s())
        assert ago_mm <= STALE_S + 0.01
    assert press.statistics.late > 10
    assert press.statistics.unknown == 0
    press.close()
    scheduler.close()


def test_a_finger_that_cannot_be_loaded_is_an_error_and_not_a_wait() -> None:
    with raises(FingerNotLoadedError, "not_loaded", problem_code="no_such"):
        PressProcess(FingertipConfig(), "spoon")


def test_a_sample_that_is_solved_after_it_was_asked_for_is_right_from_then_on() -> None:
    """At rest there is nothing to solve ahead, so the first sample behind a motion is known a few ms late."""
    solved, clock = dict[float, float](), VirtualClock()
    load = Load(lambda t_s: solved.get(t_s, 1.0), lambda t_s: t_s in solved)
    samples = Samples(clock, load, 0.05)
    clock.wait_s(0.101)
    assert samples.grams(2) * GWT_N == pytest.approx(1.0)
    solved[0.1] = 2.0
    assert samples.grams(2) * GWT_N == pytest.approx(2.0)
    solved[0.1] = 3.0
    assert samples.grams(2) * GWT_N == pytest.approx(2.0)  # a sample is taken once
