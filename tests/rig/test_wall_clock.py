"""The wall clock waits, but not longer than it has to."""

import time

import pytest

from rig.clock import Clock, WallClock
from tests.waiting import DEADLINE_S


def test_the_wall_clock_advances_with_real_time() -> None:
    clock: Clock = WallClock()
    start_s, before_s = clock.monotonic_s(), time.time()
    clock.wait_s(0.01)
    assert clock.monotonic_s() - start_s >= 0.01
    assert before_s + 0.009 <= clock.unix_s() <= time.time()


def test_the_wall_clock_waits_no_longer_than_requested(monkeypatch: pytest.MonkeyPatch) -> None:
    waited_s: list[float] = []
    monkeypatch.setattr("rig.clock.time.sleep", waited_s.append)
    WallClock().wait_s(0.01)
    WallClock().wait_s(-1.0)
    assert waited_s == [0.01, 0.0]


def test_the_wall_clock_waits_until_a_condition_or_the_deadline() -> None:
    clock = WallClock()
    at_s = clock.monotonic_s() + 0.01
    assert clock.wait_until(lambda: clock.monotonic_s() >= at_s, at_s + DEADLINE_S)
    assert clock.monotonic_s() < at_s + DEADLINE_S, "it did not wait for the deadline"
    assert not clock.wait_until(lambda: False, clock.monotonic_s() + 0.005)


def test_suspended_time_stays_zero_while_the_computer_is_awake() -> None:
    """The difference of two clocks, which are read one after the other."""
    clock = WallClock()
    before_s = clock.suspended_s()
    clock.wait_s(0.01)
    assert abs(clock.suspended_s() - before_s) < 0.1
