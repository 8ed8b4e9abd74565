"""A stop from another thread: past what the main thread does, through the port wherever it is, told once."""

import threading
from collections.abc import Callable
from typing import Any

import pytest

import rig.session.control.stop_switch as stop_switch
from rig.devices.stage.base import StageError
from rig.engine import LimitError
from rig.plan.config import Config
from rig.session.control.stop_switch import StopSwitch
from rig.session.running import stopped_at_once
from rig.transport import TransportError
from sim.devices.clock import VirtualClock
from tests.waiting import DEADLINE_S

NOTHING = Config()


class Opened:
    """What became of the stage's port: opened so often, told to stop, closed."""

    def __init__(self, patch: pytest.MonkeyPatch, clock: VirtualClock, problems: list[Exception]) -> None:
        self.done: list[str] = []
        self._problems = problems
        patch.setattr(stop_switch, "open_stage", self.open)
        patch.setattr(stop_switch, "WallClock", lambda: clock)

    def open(self, settings: Config, clock: Any, sink: Any) -> "Opened":
        assert settings is NOTHING
        if self._problems:
            self.done.append("refused")
            raise self._problems.pop(0)
        self.done.append("opened")
        sink.write("!\n")
        return self

    def stop(self) -> None:
        self.done.append("stopped")

    def close(self) -> None:
        self.done.append("closed")


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch, clock: VirtualClock) -> Callable[..., Opened]:
    return lambda *problems: Opened(monkeypatch, clock, list(problems))


@pytest.fixture
def interrupts() -> list[str]:
    return []


@pytest.fixture
def switch(interrupts: list[str]) -> StopSwitch:
    return StopSwitch(NOTHING, lambda: interrupts.append("main"))


def test_the_engines_own_stop_goes_out_before_the_main_thread_is_told(
    switch: StopSwitch, interrupts: list[str], port: Callable[..., Opened]
) -> None:
    opened, seen = port(), list[tuple[bool, list[str]]]()
    with switch.at_hand(lambda: seen.append((switch.stopped, list(interrupts)))):
        switch.stop()
    assert seen == [(True, [])], "what the main thread meets from then on is the stop"
    assert interrupts == ["main"]
    assert opened.done == []
    assert switch.sent.getvalue() == ""


@pytest.mark.parametrize("used", [False, True], ids=["never open", "closed again"])
def test_where_no_port_is_open_it_is_opened_told_and_closed(
    switch: StopSwitch, interrupts: list[str], port: Callable[..., Opened], used: bool
) -> None:
    opened = port()
    if used:
        with switch.at_hand(lambda: pytest.fail("its port is closed")):
            pass
    switch.stop()
    assert opened.done == ["opened", "stopped", "closed"]
    assert (interrupts, switch.sent.getvalue(), switch.stopped) == (["main"], "!\n", True)


def test_a_port_that_is_just_being_closed_is_waited_for(
    switch: StopSwitch, interrupts: list[str], port: Callable[..., Opened], clock: VirtualClock
) -> None:
    opened = port(TransportError("in use"), TransportError("in use"))
    began_s = clock.monotonic_s()
    switch.stop()
    assert opened.done == ["refused", "refused", "opened", "stopped", "closed"]
    assert interrupts == ["main"], "at the first refusal, and once"
    assert clock.monotonic_s() - began_s == pytest.approx(0.01)


def test_a_port_that_the_engine_has_just_opened_is_stopped_there(
    switch: StopSwitch, interrupts: list[str], port: Callable[..., Opened]
) -> None:
    opened, told = port(TransportError("in use")), list[str]()

    def interrupt() -> None:
        switch._at_hand = lambda: told.append("engine")

    switch._interrupt_main = interrupt
    switch.stop()
    assert (opened.done, told) == (["refused"], ["engine"])


def test_a_port_that_cannot_be_had_is_told_of_and_the_run_ends_all_the_same(
    switch: StopSwitch, interrupts: list[str], port: Callable[..., Opened], clock: VirtualClock
) -> None:
    port(*[TransportError("there is no port")] * 1000)
    began_s = clock.monotonic_s()
    with pytest.raises(TransportError, match="there is no port"):
        switch.stop()
    assert clock.monotonic_s() - began_s == pytest.approx(3.0, abs=0.01)
    assert interrupts == ["main"]


def test_a_stage_that_does_not_stand_is_told_of_and_the_run_ends_all_the_same(
    switch: StopSwitch, interrupts: list[str]
) -> None:
    def still_runs() -> None:
        raise StageError("still runs")

    with switch.at_hand(still_runs), pytest.raises(StageError):
        switch.stop()
    assert interrupts == ["main"]


def test_on_a_virtual_bench_the_main_thread_stops(interrupts: list[str], port: Callable[..., Opened]) -> None:
    opened = port()
    switch = StopSwitch(None, lambda: interrupts.append("main"))
    with switch.at_hand(lambda: pytest.fail("not from another thread")):
        switch.stop()
    assert (interrupts, opened.done, switch.stopped) == (["main"], [], True)


def test_the_main_thread_is_interrupted_once_for_what_it_does(switch: StopSwitch, interrupts: list[str]) -> None:
    """A second press must not cut short what writes the first one down; what begins after that may be stopped."""
    told: list[str] = []
    with switch.at_hand(lambda: told.append("stop")):
        for _ in range(3):
            switch.stop()
        assert (told, interrupts) == (["stop"] * 3, ["main"]), "the stage is told each time"
        switch.ready()
        switch.stop()
    assert interrupts == ["main"] * 2


def test_who_has_noticed_the_stop_is_not_interrupted_any_more(switch: StopSwitch, interrupts: list[str]) -> None:
    assert switch.noticed() is False
    noticed: list[bool] = []
    with switch.at_hand(lambda: noticed.append(switch.noticed())):
        switch.stop()
    assert (noticed, interrupts) == ([True], [])


def test_where_nothing_was_stopped_noticing_changes_nothing(switch: StopSwitch, interrupts: list[str]) -> None:
    assert switch.noticed() is False
    with switch.at_hand(lambda: None):
        switch.stop()
    assert interrupts == ["main"]


def test_a_stop_under_way_is_waited_for(switch: StopSwitch) -> None:
    begun, over, settled = threading.Event(), threading.Event(), threading.Event()

    def slow() -> None:
        begun.set()
        assert over.wait(DEADLINE_S)

    def wait() -> None:
        switch.settled()
        settled.set()

    with switch.at_hand(slow):
        threads = [threading.Thread(target=switch.stop), threading.Thread(target=wait)]
        threads[0].start()
        assert begun.wait(DEADLINE_S)
        threads[1].start()
        assert not settled.is_set()
        over.set()
        for thread in threads:
            thread.join(DEADLINE_S)
    assert settled.is_set()


# --- what the main thread makes of it ---


class Stopped:
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
def test_what_fails_after_a_stop_has_failed_for_that(
    engine: Any, error: BaseException, stopped: bool, raised: type[BaseException], times: int
) -> None:
    with pytest.raises(raised), stopped_at_once(engine, lambda: stopped):
        raise error
    assert engine.times == times


def test_what_ends_well_ends_well(engine: Any) -> None:
    with stopped_at_once(engine, lambda: True):
        pass
    assert engine.times == 0
