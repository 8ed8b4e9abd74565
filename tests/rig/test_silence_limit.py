"""The caps of a script, on a clock of the test and with alarms that strike nothing, on both kinds of system.

With true alarms: tests/rig/test_patience.py.
"""

import ctypes
import importlib.util
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest

from rig.errors import BadInputError
from rig.protocol import handlers
from rig.protocol.check import PressPlace
from rig.protocol.steps import Note
from tests.error_codes import has_code, raises
from tests.waiting import until

NOTE, NOWHERE = Note(text="again"), PressPlace("", 0.0, 0.0, ())


def _loaded(platform: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The handlers as such a system imports them."""
    spec = importlib.util.spec_from_file_location(f"handlers_on_{platform}", handlers.__file__)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with monkeypatch.context() as there:
        there.setattr(sys, "platform", platform)
        spec.loader.exec_module(module)
    return module


class Time:
    """A clock of the test."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


# --- alarms of POSIX ---


class Alarms:
    """The timer and the handler of SIGALRM; a caller had set an alarm that is due in `left_s`."""

    SIGALRM, ITIMER_REAL = "alarm", "real"

    def __init__(self, left_s: float = 0.0) -> None:
        self.handler: Any = "the caller's"
        self.left_s = left_s
        self.set_s: list[float] = []

    def signal(self, number: str, handler: Any) -> Any:
        assert number == self.SIGALRM
        before, self.handler = self.handler, handler
        return before

    def getitimer(self, which: str) -> tuple[float, float]:
        assert which == self.ITIMER_REAL
        return self.left_s, 0.0

    def setitimer(self, which: str, seconds: float) -> None:
        assert which == self.ITIMER_REAL
        self.set_s.append(seconds)


@pytest.fixture
def posix(monkeypatch: pytest.MonkeyPatch) -> Any:
    module = _loaded("linux", monkeypatch)
    module.time, module.signal = Time(), Alarms()
    return module


def test_a_script_may_be_silent_for_thirty_seconds_and_then_its_main_thread_is_interrupted(posix: Any) -> None:
    with posix.impatient():
        assert posix.signal.set_s == [30.0]
        with pytest.raises(posix.SilentScriptError, match="no step for 30 s") as caught:
            posix.signal.handler(0, None)
    assert caught.value.code == "silent"
    assert not isinstance(caught.value, Exception), "so that no script catches it"
    assert posix.signal.set_s == [30.0, 0.0]
    assert posix.signal.handler == "the caller's"
    assert str(posix.SilentScriptError("another sentence")) == "another sentence"


def test_the_time_of_a_step_does_not_count_as_silence_of_the_script(posix: Any) -> None:
    during, counted = list[list[float]](), list[int]()

    class Then:
        def handle(self, step: object, place: object) -> str:
            during.append(list(posix.signal.set_s))
            if len(during) == 2:
                raise BadInputError("refused", "refused")
            return "answer"

    patience = posix.Patience(Then(), counted.append)
    with posix.impatient():
        assert patience.handle(NOTE, NOWHERE) == "answer"
        with raises(BadInputError, "refused"):
            patience.handle(NOTE, NOWHERE)
    assert during == [[30.0, 0.0], [30.0, 0.0, 30.0, 0.0]]
    assert posix.signal.set_s == [30.0, 0.0, 30.0, 0.0, 30.0, 0.0]
    assert counted == [1, 2]


def test_without_a_script_under_way_no_alarm_is_set(posix: Any) -> None:
    """Nobody would catch it: it would end the program."""
    posix.Patience(SimpleNamespace(handle=lambda step, place: None)).handle(NOTE, NOWHERE)
    assert posix.signal.set_s == []
    with posix.impatient(), posix.impatient():
        pass
    posix.Patience(SimpleNamespace(handle=lambda step, place: None)).handle(NOTE, NOWHERE)
    assert posix.signal.set_s == [30.0, 30.0, 0.0, 0.0]


@pytest.mark.parametrize(("left_s", "lasts_s", "then_s"), [
    (0.0, 4.0, []), (10.0, 4.0, [6.0]), (10.0, 10.0, [0.001]), (10.0, 40.0, [0.001]),
])  # fmt: skip
def test_an_alarm_of_the_caller_is_set_again_with_the_time_it_has_left(
    posix: Any, left_s: float, lasts_s: float, then_s: list[float]
) -> None:
    posix.signal = Alarms(left_s)
    with suppress(BadInputError), posix.impatient():
        posix.time.now_s += lasts_s
        raise BadInputError("refused", "refused")
    assert posix.signal.set_s == [30.0, 0.0, *then_s]
    assert posix.signal.handler == "the caller's"


def _in_another_thread(act: Callable[[], None]) -> None:
    thread = threading.Thread(target=act)
    thread.start()
    thread.join()


def test_outside_the_main_thread_a_script_has_no_alarm(posix: Any) -> None:
    made = list[object]()

    def script() -> None:
        with posix.impatient():
            made.append(posix.Patience(SimpleNamespace(handle=lambda step, place: "answer")).handle(NOTE, NOWHERE))

    _in_another_thread(script)
    with posix._alarms():
        _in_another_thread(script)
    assert made == ["answer", "answer"]
    assert posix.signal.set_s == []


def test_a_script_makes_ten_thousand_steps_and_no_more(posix: Any) -> None:
    made = list[object]()
    patience = posix.Patience(SimpleNamespace(handle=lambda step, place: made.append(step)))
    for _ in range(10_000):
        patience.handle(NOTE, NOWHERE)
    for _ in range(2):
        with pytest.raises(BadInputError) as caught:
            patience.handle(NOTE, NOWHERE)
        has_code(caught.value, "too_many_steps", verb="note", high=10_000)
    assert len(made) == 10_000


# --- the thread of Windows, which has no alarms ---


class Changed:
    """A condition on the clock of the test: each wait is as the test says, and ends the thread after the last one."""

    def __init__(self, watch: Any, clock: Time, *acts: Callable[[], None]) -> None:
        self.watch, self.clock, self.acts = watch, clock, list(acts)
        self.waits_s: list[float | None] = []
        self.notified = 0

    def __enter__(self) -> None:
        """Nobody else is there."""

    def __exit__(self, *error: object) -> None:
        """Nobody else is there."""

    def notify(self) -> None:
        self.notified += 1

    def wait(self, left_s: float | None) -> None:
        self.waits_s.append(left_s)
        assert len(self.waits_s) < 20, "it waits no longer"
        if self.acts:
            self.acts.pop(0)()
        else:
            self.watch.end()


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> Any:
    module = _loaded("win32", monkeypatch)
    module.time, module.raised = Time(), []
    module.really_raise_in_main, module._raise_in_main = module._raise_in_main, module.raised.append
    return module


def _watch(windows: Any, *acts: Callable[[], None]) -> Any:
    watch = windows._Watch()
    watch._changed = Changed(watch, windows.time, *acts)
    return watch


def _after(windows: Any, seconds: float) -> Callable[[], None]:
    return lambda: setattr(windows.time, "now_s", windows.time.now_s + seconds)


def test_on_windows_a_silent_script_is_interrupted_once_when_its_time_is_over(windows: Any) -> None:
    watch = _watch(windows, _after(windows, 29.0), _after(windows, 1.0))
    watch.set(30.0)
    watch.run()
    assert watch._changed.waits_s == [30.0, 1.0, None]
    assert windows.raised == [windows.SilentScriptError]


def test_on_windows_a_step_ends_the_silence_and_a_new_one_begins_after_it(windows: Any) -> None:
    watch = _watch(windows, lambda: watch.set(0.0), lambda: watch.set(30.0), _after(windows, 5.0))
    watch.set(30.0)
    watch.run()
    assert watch._changed.waits_s == [30.0, None, 30.0, 25.0]
    assert windows.raised == []
    assert watch._changed.notified == 4, "so that the thread looks again at once"


def test_on_windows_an_interrupt_that_has_not_arrived_yet_is_raised_before_the_step_and_not_in_it(
    windows: Any,
) -> None:
    watch = _watch(windows, _after(windows, 30.0))
    watch.set(30.0)
    watch.run()
    with pytest.raises(windows.SilentScriptError):
        watch.set(0.0)
    assert windows.raised == [windows.SilentScriptError, None]
    watch.set(30.0)
    assert windows.raised == [windows.SilentScriptError, None], "once"


def test_on_windows_an_interrupt_that_has_arrived_is_not_raised_again(windows: Any) -> None:
    watch = _watch(windows, _after(windows, 30.0))
    watch.set(30.0)
    watch.run()
    try:
        raise windows.SilentScriptError
    except windows.SilentScriptError:
        watch.set(0.0)
    assert windows.raised == [windows.SilentScriptError, None]


def test_on_windows_an_interrupt_goes_to_the_main_thread(windows: Any) -> None:
    sent = list[tuple[int, object]]()

    def send(thread: ctypes.c_ulong, kind: Any) -> None:
        sent.append((thread.value, None if kind is None else kind.value))

    windows.ctypes = SimpleNamespace(
        c_ulong=ctypes.c_ulong,
        py_object=ctypes.py_object,
        pythonapi=SimpleNamespace(PyThreadState_SetAsyncExc=send),
    )
    windows.really_raise_in_main(windows.SilentScriptError)
    windows.really_raise_in_main(None)
    main = threading.main_thread().ident
    assert sent == [(main, windows.SilentScriptError), (main, None)]


def test_on_windows_the_thread_lives_as_long_as_the_script_and_holds_no_program_back(windows: Any) -> None:
    assert windows._watches == []
    windows._set_alarm(30.0)
    with windows._alarms():
        (outer,) = windows._watches
        assert outer.is_alive()
        assert outer.daemon
        windows._set_alarm(20.0)
        assert outer._deadline_s == windows.time.now_s + 20.0
        windows._set_alarm(0.0)
        with suppress(BadInputError), windows._alarms():
            (_, inner) = windows._watches
            windows._set_alarm(30.0)
            assert (outer._deadline_s, inner._deadline_s) == (None, windows.time.now_s + 30.0)
            windows._set_alarm(0.0)
            raise BadInputError("refused", "refused")
        assert windows._watches == [outer]
        until(lambda: not inner.is_alive())
    assert windows._watches == []
    until(lambda: not outer.is_alive())
    assert windows.raised == []
