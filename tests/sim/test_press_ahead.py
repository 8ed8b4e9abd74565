"""The finger in a process of its own: forces that are there before they are asked for."""

import math
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator

import pytest

from sim.carriage import Carriage, Placement, Screws, Truth
from sim.config import FingertipConfig
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, Samples
from sim.models.fingertip import Fingertip
from sim.serve.force_process import FingerNotLoadedError, PressProcess
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


def test_forces_of_a_planned_descent_are_known_without_a_wait(
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


def test_after_a_change_of_plan_the_last_force_counts_and_is_reported_as_late(
    following: Following, finger: Fingertip
) -> None:
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


def test_a_depth_beyond_the_model_gives_no_force_and_one_complaint(following: Following) -> None:
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


def test_dead_finger_process_stops_the_loop_and_is_reported_once(following: Following) -> None:
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


def test_a_served_finger_that_cannot_be_loaded_is_an_error_at_once() -> None:
    with raises(FingerNotLoadedError, "not_loaded", problem="shape 'spoon': there is no such indentor"):
        PressProcess(FingertipConfig(), "spoon")


def test_a_force_sample_solved_late_is_used_from_then_on() -> None:
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
