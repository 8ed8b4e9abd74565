"""Time gone and left of a run by its rehearsal: from its first second, and without what a person takes."""

import pytest

from rig.data.run_state import TimeLeft, Timeline

START = ("indentation_start", {"index": 0})
HELD = ("hold_end", {"index": 0, "hold": 1})
END = ("indentation_end", {"index": 0})


class Told:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.s = 100.0

    def now(self) -> float:
        return self.s


def _left(clock: Told, *, pace: float = 1.0, measured: bool = False) -> TimeLeft:
    """0 mount, 10 home, 20 begun, 30 held, 32 over; 40 mount, 50 home, 60 rested; ends at 70 s."""
    rehearsal, seconds = Told(), [0.0, 10.0, 20.0, 30.0, 32.0, 40.0, 50.0, 60.0]
    timeline = Timeline(rehearsal.now)
    events = [("mount", {}), ("home", {}), START, HELD, END, ("mount", {}), ("home", {}), ("rest", {})]
    for rehearsal.s, (stream, data) in zip(seconds, events, strict=True):
        timeline.event(stream, data)
        timeline.event("sample", {"index": 0})
    return TimeLeft(timeline.instants_s, 70.0, clock.now, pace=pace, measured=measured)


def _is(left: TimeLeft, elapsed_s: float, left_s: float) -> None:
    assert (left.elapsed_s, left.left_s) == (pytest.approx(elapsed_s), pytest.approx(left_s))


def test_the_time_left_does_not_run_before_the_indentor_is_mounted() -> None:
    clock = Told()
    left = _left(clock)
    _is(left, 0.0, 70.0)
    clock.s += 300.0
    _is(left, 0.0, 70.0)
    left.event("mount", {})
    _is(left, 0.0, 70.0)


def test_the_time_left_counts_down_to_the_next_milestone_and_waits_there() -> None:
    clock = Told()
    left = _left(clock)
    left.event("mount", {})
    clock.s += 4.0
    _is(left, 4.0, 66.0)
    left.event("note", {})
    clock.s += 4.0
    _is(left, 8.0, 62.0)
    clock.s += 7.0
    _is(left, 10.0, 60.0)  # homing is late: by what, is known when it is over
    left.event("home", {})
    _is(left, 15.0, 60.0)
    clock.s += 3.0
    left.event(*START)  # sooner than rehearsed
    _is(left, 18.0, 50.0)


def test_the_time_left_excludes_pauses_and_counts_a_repeated_indentation_again() -> None:
    clock = Told()
    left = _left(clock)
    for stream, data, gone_s in (
        ("mount", {}, 0.0),
        ("home", {}, 10.0),
        (*START, 10.0),
        ("sample", {"index": 0}, 4.0),
    ):
        clock.s += gone_s
        left.event(stream, data)
    _is(left, 24.0, 46.0)
    clock.s += 1.0
    left.event("paused", {})
    clock.s += 500.0
    _is(left, 25.0, 45.0)
    left.event("resumed", {})
    _is(left, 25.0, 45.0)
    clock.s += 1.0
    _is(left, 26.0, 44.0)
    left.event(*START)
    _is(left, 26.0, 50.0)


def test_the_time_left_does_not_run_while_the_next_indentor_is_mounted() -> None:
    clock = Told()
    left = _left(clock)
    for stream, data in (("mount", {}), ("home", {}), START, HELD, END):
        left.event(stream, data)
    _is(left, 0.0, 38.0)
    clock.s += 8.0
    _is(left, 8.0, 30.0)
    clock.s += 100.0
    _is(left, 8.0, 30.0)
    left.event("mount", {})
    _is(left, 0.0, 30.0)  # what led to it was the person's: no more is known of it


def test_the_time_left_after_the_last_milestone_falls_to_zero() -> None:
    clock = Told()
    left = _left(clock)
    left.event("rest", {})
    _is(left, 0.0, 10.0)
    clock.s += 50.0
    _is(left, 10.0, 0.0)
    assert TimeLeft({}, 5.0, clock.now, pace=1.0).left_s == 5.0


def test_the_time_left_of_a_bench_at_four_times_speed_is_a_quarter() -> None:
    """--speed 4: a quarter of a second for each of the bench's."""
    clock = Told()
    left = _left(clock, pace=0.25)
    _is(left, 0.0, 17.5)
    left.event("home", {})
    clock.s += 2.0
    _is(left, 2.0, 13.0)
    clock.s += 2.0
    _is(left, 2.5, 12.5)


def test_the_time_left_of_an_unpaced_bench_follows_its_measured_pace() -> None:
    clock = Told()
    left = _left(clock, pace=0.01, measured=True)
    _is(left, 0.0, 0.7)
    left.event("mount", {})
    _is(left, 0.0, 0.7)
    clock.s += 1.0
    left.event("home", {})  # 1 s for 10 of the bench
    _is(left, 1.0, 6.0)
    clock.s += 0.5
    _is(left, 1.5, 5.5)
    clock.s += 1.5
    left.event(*START)  # 3 s for 20
    _is(left, 3.0, 7.5)
