"""The wall clock waits, but not longer than it has to."""

import time

from rig.transport.clock import Clock, WallClock


def test_wall_clock() -> None:
    clock: Clock = WallClock()
    start_s = clock.monotonic_s()
    clock.wait_s(0.01)
    clock.wait_s(-1.0)
    assert 0.01 <= clock.monotonic_s() - start_s < 0.5
    assert abs(clock.unix_s() - time.time()) < 1.0


def test_wait_until_ready_or_late() -> None:
    clock = WallClock()
    at_s = clock.monotonic_s() + 0.01
    assert clock.wait_until(lambda: clock.monotonic_s() >= at_s, at_s + 5.0)
    assert clock.monotonic_s() < at_s + 1.0
    assert not clock.wait_until(lambda: False, clock.monotonic_s() + 0.005)
