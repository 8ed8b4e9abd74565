"""Signals: Ctrl-C, Ctrl-Z, Ctrl-\\, a terminal that goes away, and `rig stop` from another process.

A process that is suspended cannot lift: Ctrl-Z does what Ctrl-C does, and a background process is not suspended for
using its terminal. Handlers are installed whatever the program inherited: a shell starts background programs with
SIGINT ignored, and others may have blocked a signal.
"""

import _thread
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from rig.cli.keyboard import line_waits
from rig.cli.output import err, resting
from rig.clock import WallClock

STOP_SIGNAL: signal.Signals | None = getattr(signal, "SIGUSR1", None)
"""Signal of `rig stop` to an owner whose socket does not answer; None on Windows."""
ENDING_SIGNALS = tuple(getattr(signal, name) for name in ("SIGUSR1", "SIGKILL") if hasattr(signal, name)) or (
    signal.SIGTERM,
)
"""Signals that end an owner that does not answer to `rig stop`, gentlest first; SIGTERM of Windows ends at once."""
_HANG_UP: signal.Signals | None = getattr(signal, "SIGHUP", None)
KEYS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTSTP", "SIGQUIT", "SIGBREAK") if hasattr(signal, name))
"""Ctrl-C, Ctrl-Z and Ctrl-\\, on Windows Ctrl-C and Ctrl-Break: the first requests a pause, a second one stops."""
_BACKGROUND = tuple(getattr(signal, name) for name in ("SIGTTIN", "SIGTTOU") if hasattr(signal, name))

Handlers = dict[signal.Signals | None, Callable[[int, FrameType | None], object] | signal.Handlers]

_NOT_SUSPENDED: Handlers = dict.fromkeys(_BACKGROUND, signal.SIG_IGN)
_LOOK_S = 0.05
PAUSING = "pausing at the next safe point; press Ctrl-C again to stop now"


class PauseRequest:
    """Request to pause, from the terminal or another process, and whether to continue afterwards."""

    def __init__(self) -> None:
        self._asked = self._alone = self._from_elsewhere = False
        self.waits = False  # paused and lifted, waiting for the answer to continue

    def asked(self) -> bool:
        """Return whether a signal or another process has requested a pause."""
        return self._asked

    def ask(self, number: int | None = None, *_: object) -> None:
        """Handle the signal: from now on Ctrl-C, Ctrl-Z or Ctrl-\\ stops at once."""
        if _stopping.is_set() or (self._asked and number in KEYS):
            _stopping.clear()
            raise KeyboardInterrupt
        self._asked, self._from_elsewhere = True, False
        err.print(PAUSING)

    def ask_from_elsewhere(self) -> None:
        """Request a pause from another process; the first answer counts, from this terminal or that process."""
        self._asked = self._from_elsewhere = True
        err.print("pausing at the next safe point, as the panel requested; press Ctrl-C to stop now")

    def end(self) -> None:
        """Request the end of the run at the next safe point, without a question."""
        self._asked = self._alone = True

    def continue_remotely(self) -> None:
        """Continue on request of another process, without an answer at the terminal."""
        self._asked = self._from_elsewhere = False
        err.print("continuing, as the panel requested")

    def hang_up(self, *_: object) -> None:
        """Pause after the terminal has disappeared; no answer can come from it."""
        silence = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(silence, stream)
        self.end()

    def go_on(self, meanwhile: Callable[[], object] = lambda: None) -> bool:
        """Return the first answer, from the terminal or another process; without both, end the run."""
        at_terminal = sys.stdin.isatty() and sys.stderr.isatty()
        if at_terminal and not self._alone:
            err.print(
                "paused after a lift: press Enter to continue, Ctrl-C to end the run (rig resume can finish it later)"
            )
        elif self._from_elsewhere:
            err.print("paused after a lift: continue from the panel, or press Ctrl-C to end the run")
        self.waits = True
        try:
            goes_on = self._answer(meanwhile, at_terminal=at_terminal)
        finally:
            self.waits = False
        if goes_on:
            self._asked = self._from_elsewhere = False
        return goes_on

    def _answer(self, meanwhile: Callable[[], object], *, at_terminal: bool) -> bool:
        clock = WallClock()
        while self._asked:
            meanwhile()
            if self._alone or not (at_terminal or self._from_elsewhere):
                return False
            if not at_terminal:
                clock.wait_s(_LOOK_S)
            elif line_waits(_LOOK_S):
                return bool(typed_line())
        return True


def typed_line(meanwhile: Callable[[], object] | None = None) -> str:
    """Return a typed line; empty at the end of input, and if another program owns the terminal.

    meanwhile: called while it is waited for.
    """
    try:
        with resting():
            while meanwhile is not None and not line_waits(_LOOK_S):
                meanwhile()
            return sys.stdin.readline()
    except OSError:  # a background process
        return ""


_stopping = threading.Event()
"""Whether the next Ctrl-C is a stop, on a system without STOP_SIGNAL."""
_deaf = threading.Event()
"""Whether a stop interrupts nothing there."""


def interrupt_main() -> None:
    """Raise KeyboardInterrupt in the main thread, even if it is blocked in a system call.

    On Windows it ends a sleep; another system call returns first.
    """
    main = threading.main_thread().ident
    if sys.platform == "win32" or STOP_SIGNAL is None or main is None:
        if not _deaf.is_set():
            _stopping.set()
            _thread.interrupt_main()
    else:
        signal.pthread_kill(main, STOP_SIGNAL)


def _interrupt(*_: object) -> NoReturn:
    _stopping.clear()
    raise KeyboardInterrupt


_ONCE: Handlers = {signal.SIGINT: _interrupt}


@contextmanager
def at_a_safe_point(pause: PauseRequest | None = None) -> Iterator[PauseRequest]:
    """Turn Ctrl-C, Ctrl-Z, Ctrl-\\ or SIGTERM into a pause at the next safe point; a second one stops.

    If the terminal disappears, the run ends there, lifted, unless the program ignores hang-ups (`nohup`).
    """
    pause = PauseRequest() if pause is None else pause
    handlers: Handlers = dict.fromkeys((*KEYS, signal.SIGTERM), pause.ask)
    handlers |= {STOP_SIGNAL: signal.default_int_handler, **_NOT_SUSPENDED}
    if _HANG_UP is not None and signal.getsignal(_HANG_UP) is not signal.SIG_IGN:
        handlers[_HANG_UP] = pause.hang_up
    with _handling(handlers):
        yield pause


@contextmanager
def stoppable() -> Iterator[None]:
    """Turn `rig stop`, a stop from another thread and the keys into KeyboardInterrupt."""
    with _handling({**dict.fromkeys((*KEYS, STOP_SIGNAL), signal.default_int_handler), **_NOT_SUSPENDED, **_ONCE}):
        yield


@contextmanager
def unstoppable() -> Iterator[None]:
    """Ignore `rig stop` while the end of a run is being recorded."""
    with _handling({STOP_SIGNAL: signal.SIG_IGN}):
        _deaf.set()
        try:
            yield
        finally:
            _deaf.clear()


@contextmanager
def at_once() -> Iterator[None]:
    """Turn each of these signals into KeyboardInterrupt, so that the stage stops when its process ends."""
    numbers = (*KEYS, signal.SIGTERM, _HANG_UP, STOP_SIGNAL)
    with _handling({**dict.fromkeys(numbers, signal.default_int_handler), **_NOT_SUSPENDED, **_ONCE}):
        yield


@contextmanager
def leaving_on_signal(leave: Callable[[], object]) -> Iterator[None]:
    """Turn a key, SIGTERM or a hang-up into a request to leave; a second one is a KeyboardInterrupt."""
    numbers = (*KEYS, signal.SIGTERM, _HANG_UP)

    def ask(*_: object) -> None:
        for number in numbers:
            if number is not None:
                signal.signal(number, signal.default_int_handler)
        leave()

    with _handling(dict.fromkeys(numbers, ask)):
        yield


@contextmanager
def _handling(handlers: Handlers) -> Iterator[None]:
    before = [(number, signal.signal(number, act)) for number, act in handlers.items() if number is not None]
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [number for number, _ in before])
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
