"""The virtual clock acts at exact instants, in one order."""

import math

import pytest

from sim.devices.clock import VirtualClock
from sim.errors import ArgumentError
from tests.error_codes import raises


def test_time_jumps_to_the_event_that_makes_it_ready() -> None:
    clock = VirtualClock(start_unix_s=1000.0)
    heard: list[float] = []
    clock.call_at(3.0, lambda: heard.append(clock.monotonic_s()))
    clock.call_at(1.0, lambda: heard.append(clock.monotonic_s()))
    assert clock.wait_until(lambda: bool(heard), 10.0)
    assert heard == [1.0]
    assert clock.monotonic_s() == 1.0
    assert clock.unix_s() == 1001.0


def test_the_deadline_ends_a_wait_and_later_events_stay() -> None:
    clock = VirtualClock()
    heard: list[int] = []
    clock.call_at(2.0, lambda: heard.append(1))
    assert not clock.wait_until(lambda: bool(heard), 1.5)
    assert clock.monotonic_s() == 1.5
    clock.wait_s(0.5)
    assert heard == [1]


def test_ties_run_in_the_order_they_were_made() -> None:
    clock = VirtualClock()
    heard: list[int] = []
    for number in range(20):
        clock.call_at(1.0, lambda number=number: heard.append(number))
    clock.wait_s(1.0)
    assert heard == list(range(20))


def test_a_wait_that_nothing_can_end_is_an_error() -> None:
    with pytest.raises(RuntimeError):
        VirtualClock().wait_until(lambda: False, math.inf)
    with raises(ArgumentError, "no_deadline"):
        VirtualClock().wait_until(lambda: False, math.nan)
    with raises(ArgumentError, "endless_time", t_s=math.inf):
        VirtualClock().call_at(math.inf, lambda: None)


def test_time_does_not_run_backwards() -> None:
    clock = VirtualClock()
    clock.wait_s(1.0)
    clock.wait_s(-5.0)
    assert not clock.wait_until(lambda: False, 0.5)
    assert clock.monotonic_s() == 1.0
