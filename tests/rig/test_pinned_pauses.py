"""A rest, an operator's pause, and what a script writes into the journal."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.engine import Pause, RunAborted, verbs
from rig.engine.engine import State
from rig.engine.errors import PressPaused

Make = Callable[..., Any]


def test_a_rest_takes_its_seconds_whenever_it_begins(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    for seconds in (2.0, 7.5):
        start_s = bench.clock.monotonic_s()
        verbs.rest(engine, seconds)
        assert bench.clock.monotonic_s() - start_s == pytest.approx(seconds, abs=1e-6)
        assert bench.of("rest")[-1] == {"rest_s": seconds}


def test_a_pause_in_a_rest_is_taken_at_once(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    start_s = bench.clock.monotonic_s()
    asked: list[bool] = []
    bench.clock.call_at(start_s + 3.0, lambda: asked.append(True))
    bench.interrupt = lambda: bool(asked)
    with pytest.raises(RunAborted):
        verbs.rest(engine, 600.0)
    assert bench.clock.monotonic_s() - start_s == pytest.approx(3.0, abs=0.1)
    assert bench.of("paused") == [{"reason": "operator"}]
    assert bench.of("rest") == []


def test_an_operator_who_goes_on_goes_on_but_a_press_begins_again(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    before = len(bench.events)
    bench.pause = Pause(lambda: True, lambda: True)
    verbs.safe_point(engine)
    assert [stream for stream, _ in bench.events[before:]] == ["paused", "resumed"]
    engine.state = State.IN_CONTACT
    with pytest.raises(PressPaused, match=r"^paused by the operator$"):
        verbs.safe_point(engine)
    assert [stream for stream, _ in bench.events[before + 2 :]] == ["retract", "paused", "resumed"]
    assert bench.of("resumed") == [{"by": "operator"}] * 2
    assert engine.state is State.READY


def test_what_a_script_says_of_itself_is_in_the_journal(spring: Make) -> None:
    bench = spring()
    verbs.note(bench.engine, "a word")
    verbs.checkpoint(bench.engine, "here")
    assert bench.events == [("note", {"text": "a word"}), ("checkpoint", {"name": "here"})]
