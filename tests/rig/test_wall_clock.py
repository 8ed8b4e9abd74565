"""The wall clock waits, but not longer than it has to."""

import time

import pytest

from rig.clock import Clock, WallClock
from tests.waiting import DEADLINE_S


def test_wall_clock() -> None:
    clock: Clock = WallClock()
    start_s, before_s = clock.monotonic_s(), time.time()
    clock.wait_s(0.01)
    assert clock.monotonic_s() - start_s >= 0.01
    assert before_s + 0.009 <= clock.unix_s() <= time.time()


def test_a_wait_is_no_longer_than_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    waited_s: list[float] = []
    monkeypatch.setattr("rig.clock.time.sleep", waited_s.append)
    WallClock().wait_s(0.01)
    WallClock().wait_s(-1.0)
    assert waited_s == [0.01, 0.0]


def test_wait_until_ready_or_late() -> None:
    clock = WallClock()
    at_s = clock.monotonic_s() + 0.01
    assert clock.wait_until(lambda: clock.monotonic_s() >= at_s, at_s + DEADLINE_S)
    assert clock.monotonic_s() < at_s + DEADLINE_S, "it did not wait for the deadline"
    assert not clock.wait_until(lambda: False, clock.monotonic_s() + 0.005)


def test_a_computer_that_is_awake_is_not_suspended() -> None:
    """The difference of two clocks, which are read one after the other."""
    clock = WallClock()
    before_s = clock.suspended_s()
    clock.wait_s(0.01)
    assert abs(clock.suspended_s() - before_s) < 0.1
