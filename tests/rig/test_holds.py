"""Which hold moves a stage: how old it may be, what of its press is over, who else holds. On a clock that stands."""

import math
from typing import Any

import pytest

from rig.engine.dead_man import Direction
from rig.errors import LimitError, NotReadyError
from rig.manual.jog import FASTEST_MM_S, HeldDirection
from rig.manual.orders import AHEAD_S, HOLD_S, HoldRequest, Holds, Orders
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

X_UP, X_DOWN = Direction("x", 1), Direction("x", -1)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock(1.7e9, 5.0)


@pytest.fixture
def holds(clock: VirtualClock) -> Holds:
    return Holds(clock)


def a_hold(clock: VirtualClock, ago_s: float = 0.0, **other: Any) -> HoldRequest:
    usual = {"axis": "x", "sign": 1, "speed_mm_s": 2.0, "tab": "one", "press": 7}
    return HoldRequest.validated({"do": "hold", **usual, "unix_s": clock.unix_s() - ago_s, **other})


# --- what is held ---


def test_what_is_said_counts_for_so_long_from_when_it_was_so(clock: VirtualClock) -> None:
    held = HeldDirection(clock, 0.25)
    assert held() is None
    held.say(X_UP, 0.1)
    clock.wait_s(0.1499)
    assert held() == X_UP
    clock.wait_s(0.0002)
    assert held() is None


def test_what_was_said_later_counts_on_and_another_way_counts_from_its_own_time(clock: VirtualClock) -> None:
    held = HeldDirection(clock, 0.25)
    held.say(X_UP)
    held.say(X_UP, 0.2)
    clock.wait_s(0.24)
    assert held() == X_UP
    held.say(X_DOWN, 0.2)
    clock.wait_s(0.04)
    assert held() == X_DOWN
    clock.wait_s(0.02)
    assert held() is None
    held.say(X_UP)
    held.say(None)
    assert held() is None
    held.say(X_UP, 0.26)
    assert held() is None


# --- what is asked ---


@pytest.mark.parametrize(
    "other",
    [
        {"axis": "a"}, {"sign": 0}, {"sign": 2}, {"speed_mm_s": 10.1}, {"speed_mm_s": 0.0166},
        {"speed_mm_s": float("nan")}, {"tab": 3}, {"tab": "t" * 101}, {"press": None}, {"unix_s": "now"},
    ],
)  # fmt: skip
def test_what_is_no_hold_is_told_by_its_key(clock: VirtualClock, other: dict[str, Any]) -> None:
    ((key, value),) = other.items()
    with raises(LimitError, "invalid_request", do="hold", key=key, value=value):
        a_hold(clock, **other)


def test_any_speed_that_a_jog_has_is_one(clock: VirtualClock) -> None:
    assert FASTEST_MM_S == 10.0
    assert [a_hold(clock, speed_mm_s=mm_s).speed_mm_s for mm_s in (0.017, 10)] == [0.017, 10.0]
    assert a_hold(clock, sign=-1, axis="z").direction == Direction("z", -1)
    assert a_hold(clock, tab="t" * 100).tab == "t" * 100


# --- one press is one motion ---


@pytest.mark.parametrize(
    ("ago_s", "taken"),
    [(0.0, True), (0.2499, True), (0.2501, False), (3.0, False), (-0.99, True), (-1.01, False), (math.nan, False)],
)
def test_a_hold_that_waited_in_a_queue_moves_nothing(
    holds: Holds, clock: VirtualClock, ago_s: float, taken: bool
) -> None:
    assert (HOLD_S, AHEAD_S) == (0.25, 1.0)
    if not taken:
        with raises(LimitError, "late_hold", high_s=0.25):
            holds.take(a_hold(clock, ago_s))
        assert holds.press is None
        return
    holds.take(a_hold(clock, ago_s))
    assert holds.live
    clock.wait_s(0.25001 - max(ago_s, 0.0))
    assert not holds.live


def test_holds_of_a_press_prolong_it_and_none_of_another_does(holds: Holds, clock: VirtualClock) -> None:
    first = a_hold(clock)
    holds.take(first)
    for _ in range(5):
        clock.wait_s(0.2)
        holds.take(a_hold(clock, speed_mm_s=9.0))
        for other in ({"tab": "two"}, {"press": 8}, {"axis": "y"}, {"sign": -1}):
            with raises(NotReadyError, "busy", busy="another button is held"):
                holds.take(a_hold(clock, **other))
    assert holds.press is first, "at the speed that it began with"
    assert holds.held(first) == X_UP
    clock.wait_s(0.25)
    assert holds.held(first) is None


def test_a_release_ends_it_at_once_and_no_hold_of_it_counts_after(holds: Holds, clock: VirtualClock) -> None:
    press = a_hold(clock)
    holds.take(press)
    holds.release("two", 9)
    holds.release("one", 6)
    assert holds.held(press) == X_UP
    holds.release("one", 7)
    assert holds.held(press) is None
    assert not holds.lapsed(press)
    for number in (7, 3):
        with raises(NotReadyError, "motion_over"):
            holds.take(a_hold(clock, press=number))
    later = a_hold(clock, press=8, sign=-1)
    holds.take(later)
    assert (holds.held(press), holds.held(later)) == (None, X_DOWN)
    holds.end(press)
    assert holds.press is later
    assert holds.live


def test_a_release_that_comes_before_its_holds_ends_them_too(holds: Holds, clock: VirtualClock) -> None:
    said = a_hold(clock)
    holds.release("one", 7)
    holds.release("one", 2)
    with raises(NotReadyError, "motion_over"):
        holds.take(said)
    holds.take(a_hold(clock, tab="two"))


def test_a_motion_that_is_over_is_not_begun_again_by_its_press(holds: Holds, clock: VirtualClock) -> None:
    press = a_hold(clock)
    holds.take(press)
    assert not holds.lapsed(press)
    holds.end(press)
    assert (holds.press, holds.live) == (None, False)
    with raises(NotReadyError, "motion_over"):
        holds.take(a_hold(clock))
    holds.take(a_hold(clock, press=8))


def test_one_that_is_not_heard_of_has_lapsed_until_it_is_heard_of_again(holds: Holds, clock: VirtualClock) -> None:
    press = a_hold(clock)
    holds.take(press)
    clock.wait_s(0.25)
    assert holds.lapsed(press)
    assert holds.held(press) is None
    holds.take(a_hold(clock))
    assert holds.held(press) == X_UP
    clock.wait_s(0.3)
    other = a_hold(clock, tab="two", press=1)
    holds.take(other)
    assert holds.press is other
    assert not holds.lapsed(press), "it was given up for another one"
    with raises(NotReadyError, "motion_over"):
        holds.take(a_hold(clock))


def test_what_is_dropped_is_over(holds: Holds, clock: VirtualClock) -> None:
    holds.drop()
    holds.take(a_hold(clock))
    holds.drop()
    assert holds.press is None
    with raises(NotReadyError, "motion_over"):
        holds.take(a_hold(clock))


# --- one thing at a time ---


@pytest.fixture
def orders(clock: VirtualClock) -> Orders:
    return Orders(clock)


def test_nothing_asked_is_nothing_to_do(orders: Orders) -> None:
    assert (orders.next(), orders.busy, orders.tab, orders.stopped, orders.leaving) == (
        None,
        None,
        None,
        False,
        False,
    )


def test_what_is_asked_is_done_once(orders: Orders) -> None:
    for verb, word in (("home", "home"), ("zero", "zero"), ("zero anyway", "zero")):
        orders.do(verb)  # type: ignore[arg-type]
        assert orders.busy == word
        done = orders.next()
        assert done == verb
        assert orders.busy == word
        assert not orders.lapsed(done)
        orders.over(done)
        assert (orders.next(), orders.busy) == (None, None)


def test_a_press_that_is_over_begins_nothing_more(orders: Orders, clock: VirtualClock) -> None:
    orders.hold(a_hold(clock))
    press = orders.next()
    assert isinstance(press, HoldRequest)
    orders.over(press)
    assert (orders.next(), orders.busy) == (None, None)
    with raises(NotReadyError, "motion_over"):
        orders.hold(a_hold(clock))


def test_busy_is_said_until_what_is_done_is_over(orders: Orders, clock: VirtualClock) -> None:
    """Also where its button was let go, or a stop came: it takes a moment until the stage is at rest."""
    press = a_hold(clock)
    orders.hold(press)
    assert (orders.busy, orders.tab) == ("jog", "one")
    assert orders.next() is press
    held = orders.held(press)
    assert held() == X_UP
    orders.release("one", 7)
    assert held() is None
    assert (orders.busy, orders.tab) == ("jog", "one")
    for verb in ("home", "zero"):
        with raises(NotReadyError, "busy", busy="jog"):
            orders.do(verb)  # type: ignore[arg-type]
    orders.hold(a_hold(clock, press=8))
    orders.over(press)
    following = orders.next()
    assert isinstance(following, HoldRequest)
    assert following.press == 8
    orders.stop()
    assert orders.busy == "jog"
    orders.over(following)
    assert (orders.busy, orders.tab, orders.next()) == (None, None, None)


def test_nothing_is_held_while_something_else_is_done(orders: Orders, clock: VirtualClock) -> None:
    for verb in ("home", "zero anyway"):
        orders.do(verb)  # type: ignore[arg-type]
        with raises(NotReadyError, "busy", busy=verb[:4]):
            orders.hold(a_hold(clock))
        orders.next()
        with raises(NotReadyError, "busy", busy=verb[:4]):
            orders.hold(a_hold(clock))
        orders.over("home")


def test_what_was_asked_for_before_a_stop_is_not_begun_after_it(orders: Orders, clock: VirtualClock) -> None:
    orders.do("home")
    orders.stop()
    assert orders.next() is None
    orders.over("home")
    assert orders.stopped
    orders.homed()
    assert not orders.stopped
    press = a_hold(clock)
    orders.hold(press)
    held = orders.held(press)
    orders.stop()
    assert held() is None
    assert orders.next() is None


def test_after_a_stop_only_homing_is_taken(orders: Orders, clock: VirtualClock) -> None:
    orders.stop()
    for asked in (lambda: orders.hold(a_hold(clock)), lambda: orders.do("zero"), lambda: orders.do("zero anyway")):
        with raises(NotReadyError, "stopped"):
            asked()
    orders.do("home")


def test_a_stop_that_comes_while_it_homes_is_not_over_with_that(orders: Orders) -> None:
    for stops in (1, 2):
        for _ in range(stops):
            orders.stop()
        orders.do("home")
        orders.next()
        orders.stop()
        orders.homed()
        assert orders.stopped
        orders.over("home")
    orders.do("home")
    orders.next()
    orders.homed()
    assert not orders.stopped


def test_who_leaves_holds_nothing(orders: Orders, clock: VirtualClock) -> None:
    press = a_hold(clock)
    orders.hold(press)
    orders.leave()
    assert orders.leaving
    assert orders.held(press)() is None


def test_whether_a_press_has_lapsed_is_told_of_presses_only(orders: Orders, clock: VirtualClock) -> None:
    press = a_hold(clock)
    orders.hold(press)
    orders.next()
    assert not orders.lapsed(press)
    clock.wait_s(0.3)
    assert orders.lapsed(press)
    assert not orders.lapsed("home")
