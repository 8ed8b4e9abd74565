"""The wall-clock scheduler: timers in order, files in between, and a stop from anywhere."""

import socket
import threading
from collections.abc import Iterator

import pytest

from sim.errors import ArgumentError
from sim.serve.real_time_loop import WallScheduler
from tests.error_codes import raises
from tests.waiting import DEADLINE_S


@pytest.fixture
def scheduler() -> Iterator[WallScheduler]:
    scheduler = WallScheduler()
    yield scheduler
    scheduler.close()


def run_until(scheduler: WallScheduler, t_s: float) -> None:
    scheduler.call_at(t_s, scheduler.stop)
    scheduler.run()


def test_scheduled_calls_run_in_order_and_not_before_their_time(scheduler: WallScheduler) -> None:
    heard: list[tuple[str, float]] = []
    now_s = scheduler.monotonic_s()
    for name, after_s in (("late", 0.02), ("early", 0.01), ("past", -1.0)):
        scheduler.call_at(now_s + after_s, lambda name=name: heard.append((name, scheduler.monotonic_s())))
    scheduler.call_at(now_s + 0.015, lambda: heard.append(("cancelled", 0.0))).cancel()
    run_until(scheduler, now_s + 0.03)
    assert [name for name, _ in heard] == ["past", "early", "late"]
    assert heard[1][1] >= now_s + 0.01
    assert heard[2][1] >= now_s + 0.02


def test_the_scheduler_reads_watched_files_between_timers_until_unwatched(scheduler: WallScheduler) -> None:
    near, far = socket.socketpair()
    heard: list[bytes] = []
    scheduler.watch(near, lambda: (heard.append(near.recv(10)), scheduler.stop()))
    with near, far:
        scheduler.call_at(scheduler.monotonic_s() + 0.01, lambda: far.send(b"a") and None)
        scheduler.call_at(scheduler.monotonic_s() + DEADLINE_S, scheduler.stop)
        scheduler.run()
        assert heard == [b"a"]
        scheduler.unwatch(near)
        far.send(b"b")
        for _ in range(3):
            scheduler.run_once(scheduler.monotonic_s())  # only what is there to read now
    assert heard == [b"a"]


def test_a_stop_from_another_thread_ends_an_idle_scheduler(scheduler: WallScheduler) -> None:
    thread = threading.Thread(target=scheduler.run)
    thread.start()
    scheduler.stop()
    thread.join(DEADLINE_S)
    assert not thread.is_alive()


def test_the_scheduler_refuses_a_time_of_nan(scheduler: WallScheduler) -> None:
    with raises(ArgumentError, "endless_time"):
        scheduler.call_at(float("nan"), lambda: None)
