"""What each signal does, before a pause, in it and after it; raised in this very process, and answered at once."""

import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from rig.cli.signals import PAUSING, STOP_SIGNAL, PauseRequest, at_a_safe_point, at_once, leaving_on_signal

if STOP_SIGNAL is None:
    pytest.skip("only where there are signals", allow_module_level=True)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, STOP_SIGNAL)
GENTLE = (signal.SIGINT, signal.SIGTERM)


@pytest.fixture(autouse=True)
def mine() -> Iterator[dict[signal.Signals, Callable[..., None]]]:
    """Handlers of this test's own, which must be back after whatever was tried; none of them ends the process."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    own: dict[signal.Signals, Callable[..., None]] = {number: lambda *_: None for number in SIGNALS}
    for number in SIGNALS:
        signal.signal(number, own[number])
    yield own
    for number, handler in before.items():
        signal.signal(number, handler)


class Terminal(io.StringIO):
    """Somebody, or nobody, at a keyboard or a screen."""

    def __init__(self, typed: str = "", *, there: bool = True) -> None:
        super().__init__(typed)
        self.there = there

    def isatty(self) -> bool:
        return self.there


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Terminal]:
    """What is typed at a terminal from now on; gives its screen."""

    def make(typed: str, *, keyboard: bool = True, screen: bool = True) -> Terminal:
        monkeypatch.setattr(sys, "stdin", Terminal(typed, there=keyboard))
        shown = Terminal(there=screen)
        monkeypatch.setattr(sys, "stderr", shown)
        return shown

    return make


@pytest.mark.parametrize("number", GENTLE, ids=lambda number: number.name)
def test_the_first_signal_requests_a_pause_and_a_following_ctrl_c_stops_at_once(
    number: signal.Signals, terminal: Callable[..., Terminal]
) -> None:
    screen = terminal("")
    with at_a_safe_point() as pause:
        signal.raise_signal(number)
        assert pause.asked() is True
        assert screen.getvalue().splitlines() == [PAUSING]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("enter", [at_a_safe_point, at_once])
@pytest.mark.parametrize("how", ["badly", "paused"])
def test_every_signal_handler_is_restored_after_a_run(
    enter: Callable[[], AbstractContextManager[object]], how: str, mine: dict[signal.Signals, Callable[..., None]]
) -> None:
    try:
        with enter():
            assert signal.getsignal(signal.SIGINT) is not mine[signal.SIGINT]
            if how == "badly":
                raise RuntimeError
            if how == "paused":
                signal.raise_signal(signal.SIGINT)
    except (RuntimeError, KeyboardInterrupt):
        pass
    assert {number: signal.getsignal(number) for number in SIGNALS} == mine


# --- go on, or not ---


@pytest.mark.parametrize(
    ("typed", "keyboard", "screen", "goes_on"),
    [
        ("\n", True, True, True),
        ("", True, True, False),  # its end: Ctrl-D
        ("\n", False, True, False),
        ("\n", True, False, False),
    ],
)
def test_a_paused_run_continues_only_on_enter_at_a_terminal(
    terminal: Callable[..., Terminal], typed: str, keyboard: bool, screen: bool, goes_on: bool
) -> None:
    shown = terminal(typed, keyboard=keyboard, screen=screen)
    with at_a_safe_point() as pause:
        signal.raise_signal(signal.SIGINT)
        assert pause.go_on() is goes_on
        assert pause.asked() is not goes_on
    assert ("press Enter to continue, Ctrl-C to end the run" in shown.getvalue()) is (keyboard and screen)


def test_after_continuing_a_signal_requests_a_pause_again(terminal: Callable[..., Terminal]) -> None:
    terminal("\n\n")
    with at_a_safe_point() as pause:
        for _ in range(2):
            signal.raise_signal(signal.SIGINT)
            assert pause.asked() is True
            assert pause.go_on() is True
            assert pause.asked() is False


# --- the terminal goes away ---


@contextmanager
def _standard_streams(path: Path) -> Iterator[None]:
    """Standard input, output and error of the process at a file; as they were afterwards."""
    kept = [os.dup(stream) for stream in (0, 1, 2)]
    with path.open("w+b") as file:
        for stream in (0, 1, 2):
            os.dup2(file.fileno(), stream)
    try:
        yield
    finally:
        for stream, was in enumerate(kept):
            os.dup2(was, stream)
            os.close(was)


def test_a_terminal_that_closes_requests_an_end_and_receives_no_more_output(
    tmp_path: Path, terminal: Callable[..., Terminal]
) -> None:
    terminal("\n")
    told = tmp_path / "told"
    with at_a_safe_point() as pause, _standard_streams(told):
        for stream in (1, 2):
            os.write(stream, b"before ")
        signal.raise_signal(signal.SIGHUP)
        for stream in (1, 2):
            os.write(stream, b"after ")
        asked, goes_on = pause.asked(), pause.go_on()
        silent = [os.path.samestat(os.fstat(stream), os.stat(os.devnull)) for stream in (0, 1, 2)]
    assert told.read_bytes() == b"before before "
    assert silent == [True, True, True]
    assert asked is True
    assert goes_on is False  # whatever a keyboard says


def test_a_run_under_nohup_continues_without_its_terminal() -> None:
    """`nohup`."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with at_a_safe_point() as pause:
        signal.raise_signal(signal.SIGHUP)
        assert pause.asked() is False
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


@pytest.mark.parametrize("enter", [at_a_safe_point, at_once])
def test_ctrl_c_pauses_a_run_on_a_system_without_sighup(
    enter: Callable[[], AbstractContextManager[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows has neither SIGHUP nor what `rig stop` sends."""
    monkeypatch.setattr("rig.cli.signals._HANG_UP", None)
    monkeypatch.setattr("rig.cli.signals.STOP_SIGNAL", None)
    with enter() as pause:
        if isinstance(pause, PauseRequest):
            signal.raise_signal(signal.SIGINT)
            assert pause.asked() is True
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_the_first_signal_asks_a_manual_session_to_leave_and_the_second_interrupts_it(
    number: signal.Signals, mine: dict[signal.Signals, Callable[..., None]]
) -> None:
    """`rig stop` is left to whoever looks after it."""
    asked: list[int] = []
    with leaving_on_signal(lambda: asked.append(1)):
        assert signal.getsignal(STOP_SIGNAL) is mine[STOP_SIGNAL]  # type: ignore[arg-type, index]
        signal.raise_signal(number)
        assert asked == [1]
        for again in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(again)
    assert asked == [1]
    assert all(signal.getsignal(n) is mine[n] for n in SIGNALS)
