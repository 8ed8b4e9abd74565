"""A stop from another thread: past what the main thread does, told once."""

import threading
from collections.abc import Callable
from typing import Any

import pytest

from rig.control.owned_stage import EndedError, StopSwitch
from rig.devices.base import StageError
from rig.engine import LimitError
from rig.session.script_run import stopped_at_once
from rig.transport import TransportError
from tests.error_codes import raises
from tests.waiting import DEADLINE_S, until


class InHand:
    """A stage that is told to stop so often; `act` is what it then does."""

    kept = "!\n"

    def __init__(self) -> None:
        self.told = 0
        self.act: Callable[[], object] = lambda: None

    def stop(self) -> None:
        self.told += 1
        self.act()


@pytest.fixture
def interrupts() -> list[str]:
    return []


@pytest.fixture
def stage() -> Any:
    return InHand()


@pytest.fixture
def switch(stage: Any, interrupts: list[str]) -> StopSwitch:
    switch = StopSwitch(stage, lambda: interrupts.append("main"))
    switch.begins()
    return switch


def test_a_stop_reaches_the_stage_before_the_main_thread_is_interrupted(
    switch: StopSwitch, stage: Any, interrupts: list[str]
) -> None:
    seen: list[tuple[bool, list[str]]] = []
    stage.act = lambda: seen.append((switch.stopped, list(interrupts)))
    assert switch.stopped is False
    switch.stop()
    assert seen == [(True, [])], "what the main thread meets from then on is the stop"
    assert interrupts == ["main"]
    assert switch.kept == "!\n"


def test_a_stop_that_the_stage_does_not_confirm_is_reported_and_ends_the_run(
    switch: StopSwitch, stage: Any, interrupts: list[str]
) -> None:
    problem = TransportError("there is no port")

    def fails() -> None:
        raise problem

    stage.act = fails
    with pytest.raises(type(problem)) as caught:
        switch.stop()
    assert caught.value is problem
    assert interrupts == ["main"]
    assert switch.stopped


def test_on_a_virtual_bench_a_stop_interrupts_the_main_thread(interrupts: list[str]) -> None:
    switch = StopSwitch(None, lambda: interrupts.append("main"))
    switch.begins()
    switch.stop()
    assert (interrupts, switch.kept, switch.stopped) == (["main"], "", True)


def test_the_main_thread_is_interrupted_once_per_work(switch: StopSwitch, stage: Any, interrupts: list[str]) -> None:
    """A second press must not cut short what writes the first one down; what begins after that may be stopped."""
    for _ in range(3):
        switch.stop()
    assert (stage.told, interrupts) == (3, ["main"]), "the stage is told each time"
    switch.ready()
    switch.stop()
    assert interrupts == ["main"] * 2


def test_a_main_thread_that_noticed_the_stop_is_not_interrupted(
    switch: StopSwitch, stage: Any, interrupts: list[str]
) -> None:
    assert switch.noticed() is False
    noticed: list[bool] = []
    stage.act = lambda: noticed.append(switch.noticed())
    switch.stop()
    assert (noticed, interrupts) == ([True], [])


def test_a_stop_before_the_work_begins_ends_it_at_its_beginning(stage: Any, interrupts: list[str]) -> None:
    switch = StopSwitch(stage, lambda: interrupts.append("main"))
    switch.stop()
    assert (stage.told, interrupts) == (1, []), "where it is would record nothing"
    with pytest.raises(KeyboardInterrupt):
        switch.begins()
    switch.stop()
    assert (stage.told, interrupts) == (2, []), "it is ending already"


def test_after_its_end_a_run_refuses_stops(switch: StopSwitch, stage: Any, interrupts: list[str]) -> None:
    switch.over()
    with raises(EndedError, "ended"):
        switch.stop()
    assert (stage.told, interrupts, switch.stopped) == (0, [], False)


def test_the_end_waits_for_a_stop_under_way_and_is_not_interrupted_by_it(
    switch: StopSwitch, stage: Any, interrupts: list[str]
) -> None:
    begun, go_on, ended = threading.Event(), threading.Event(), threading.Event()

    def slow() -> None:
        begun.set()
        assert go_on.wait(DEADLINE_S)

    def end() -> None:
        switch.over()
        ended.set()

    stage.act = slow
    threads = [threading.Thread(target=switch.stop), threading.Thread(target=end)]
    threads[0].start()
    assert begun.wait(DEADLINE_S)
    threads[1].start()
    until(lambda: switch._taken)  # the end waits for the stop from here on
    assert not ended.is_set()
    go_on.set()
    for thread in threads:
        thread.join(DEADLINE_S)
    assert ended.is_set()
    assert (switch.stopped, interrupts) == (True, [])


# --- what the main thread makes of it ---


class Stopped:
    problem = None

    def __init__(self) -> None:
        self.times = 0

    def stop(self) -> None:
        self.times += 1


@pytest.fixture
def engine() -> Any:
    return Stopped()


@pytest.mark.parametrize(
    ("error", "stopped", "raised", "times"),
    [
        (LimitError("too deep"), False, LimitError, 0),
        (LimitError("too deep"), True, KeyboardInterrupt, 1),
        (StageError("the board was reset"), True, KeyboardInterrupt, 1),
        (KeyboardInterrupt(), False, KeyboardInterrupt, 1),
        (KeyboardInterrupt(), True, KeyboardInterrupt, 1),
        (SystemExit(), True, SystemExit, 1),
    ],
)
def test_an_error_after_a_stop_is_reported_as_the_stop(
    engine: Any, error: BaseException, stopped: bool, raised: type[BaseException], times: int
) -> None:
    with pytest.raises(raised), stopped_at_once(engine, lambda: stopped):
        raise error
    assert engine.times == times
