"""Time gone and left of a run by its rehearsal: from its first second, and without what a person takes."""

from typing import Any, NamedTuple

import pytest

from rig.data.run_state import TimeLeft, Timeline


class Told:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.s = 100.0

    def now(self) -> float:
        return self.s


DATA: dict[str, Any] = {
    "indentation_start": {"index": 0}, "hold_end": {"index": 0, "hold": 1}, "indentation_end": {"index": 0},
    "sample": {"index": 0},
}  # fmt: skip
PRESSED = ("mount", "home", "indentation_start", "hold_end", "indentation_end")


def _left(clock: Told, *, pace: float = 1.0, measured: bool = False) -> TimeLeft:
    """0 mount, 10 home, 20 begun, 30 held, 32 over; 40 mount, 50 home, 60 rested; ends at 70 s."""
    rehearsal, seconds = Told(), [0.0, 10.0, 20.0, 30.0, 32.0, 40.0, 50.0, 60.0]
    timeline = Timeline(rehearsal.now)
    for rehearsal.s, stream in zip(seconds, (*PRESSED, "mount", "home", "rest"), strict=True):
        timeline.event(stream, DATA.get(stream, {}))
        timeline.event("sample", DATA["sample"])
    return TimeLeft(timeline.instants_s, 70.0, clock.now, pace=pace, measured=measured)


class Then(NamedTuple):
    """What passes (s), the events that come then, and what is gone and left after them (s)."""

    waits_s: float
    events: tuple[str, ...]
    gone_s: float
    left_s: float


AS_FAST: dict[str, Any] = {}
RUNS: dict[str, tuple[dict[str, Any], list[Then]]] = {
    "it does not run before the indentor is mounted": (
        AS_FAST, [Then(0, (), 0, 70), Then(300, (), 0, 70), Then(0, ("mount",), 0, 70)],
    ),
    "it counts down to the next milestone and waits there": (
        AS_FAST,
        [
            Then(0, ("mount",), 0, 70), Then(4, (), 4, 66), Then(0, ("note",), 4, 66), Then(4, (), 8, 62),
            Then(7, (), 10, 60),  # homing is late: by what, is known when it is over
            Then(0, ("home",), 15, 60),
            Then(3, ("indentation_start",), 18, 50),  # sooner than rehearsed
        ],
    ),
    "it excludes pauses and counts a repeated indentation again": (
        AS_FAST,
        [
            Then(0, ("mount",), 0, 70), Then(10, ("home",), 10, 60), Then(10, ("indentation_start",), 20, 50),
            Then(4, ("sample",), 24, 46), Then(1, ("paused",), 25, 45), Then(500, (), 25, 45),
            Then(0, ("resumed",), 25, 45), Then(1, (), 26, 44), Then(0, ("indentation_start",), 26, 50),
        ],
    ),
    "it does not run while the next indentor is mounted": (
        AS_FAST,
        [
            Then(0, PRESSED, 0, 38), Then(8, (), 8, 30), Then(100, (), 8, 30),
            Then(0, ("mount",), 0, 30),  # what led to it was the person's: no more is known of it
        ],
    ),
    "it falls to zero after the last milestone": (AS_FAST, [Then(0, ("rest",), 0, 10), Then(50, (), 10, 0)]),
    "at four times the speed it is a quarter": (
        {"pace": 0.25},
        [Then(0, (), 0, 17.5), Then(0, ("home",), 0, 15), Then(2, (), 2, 13), Then(2, (), 2.5, 12.5)],
    ),
    "without a pace it follows the measured one": (
        {"pace": 0.01, "measured": True},
        [
            Then(0, (), 0, 0.7), Then(0, ("mount",), 0, 0.7),
            Then(1, ("home",), 1, 6),  # 1 s for 10 of the bench
            Then(0.5, (), 1.5, 5.5),
            Then(1.5, ("indentation_start",), 3, 7.5),  # 3 s for 20
        ],
    ),
}  # fmt: skip


@pytest.mark.parametrize("run", RUNS)
def test_time_gone_and_left_follow_the_rehearsal_without_what_a_person_takes(run: str) -> None:
    clock, (pace, course) = Told(), RUNS[run]
    left = _left(clock, **pace)
    for number, then in enumerate(course):
        clock.s += then.waits_s
        for stream in then.events:
            left.event(stream, DATA.get(stream, {}))
        assert (left.elapsed_s, left.left_s) == (pytest.approx(then.gone_s), pytest.approx(then.left_s)), number


def test_a_run_without_milestones_has_its_rehearsed_duration_left() -> None:
    assert TimeLeft({}, 5.0, Told().now, pace=1.0).left_s == 5.0
