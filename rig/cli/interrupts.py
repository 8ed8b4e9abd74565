"""Signals: Ctrl-C, a terminal that goes away, and `rig stop` from another process."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from rig.cli.output import err

# Not on Windows, where `rig stop` can only open a port that nobody owns.
STOP_SIGNAL: signal.Signals | None = getattr(signal, "SIGUSR1", None)
_HANG_UP: signal.Signals | None = getattr(signal, "SIGHUP", None)

Handlers = dict[signal.Signals | None, Callable[[int, FrameType | None], object]]


class Pause:
    """Whether the operator has asked for a pause, and whether to go on after it."""

    def __init__(self) -> None:
        self._asked = self._alone = False

    def asked(self) -> bool:
        """Whether Ctrl-C, SIGTERM or the end of the terminal has come."""
        return self._asked

    def ask(self, *_: object) -> None:
        """The signal: from now on a second Ctrl-C stops at once."""
        self._asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
        err.print("pausing: stopping at the next safe point; Ctrl-C again stops now")

    def hang_up(self, *_: object) -> None:
        """The terminal has gone: nobody can be told anything, and nobody will say that it goes on."""
        silence = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(silence, stream)
        self._asked = self._alone = True

    def go_on(self) -> bool:
        """The answer of whoever sits at the terminal; without one there is nobody to wait for."""
        if self._alone or not (sys.stdin.isatty() and sys.stderr.isatty()):
            return False
        err.print("paused, the indentor is lifted: Enter goes on, Ctrl-C ends the run; rig resume can take it up")
        if not sys.stdin.readline():
            return False
        self._asked = False
        signal.signal(signal.SIGINT, self.ask)
        return True


@contextmanager
def at_a_safe_point() -> Iterator[Pause]:
    """Ctrl-C (or SIGTERM) once asks for a pause at the next safe point; twice, or `rig stop`, stops at once.

    A terminal that goes away ends the run there, lifted, unless the program was told not to mind (`nohup`).
    """
    pause = Pause()
    handlers: Handlers = {
        signal.SIGINT: pause.ask,
        signal.SIGTERM: pause.ask,
        STOP_SIGNAL: signal.default_int_handler,
    }
    if _HANG_UP is not None and signal.getsignal(_HANG_UP) is not signal.SIG_IGN:
        handlers[_HANG_UP] = pause.hang_up
    with _handling(handlers):
        yield pause


@contextmanager
def at_once() -> Iterator[None]:
    """Every such signal is a KeyboardInterrupt: at the bench the stage stops when whoever moves it goes away."""
    numbers = (signal.SIGINT, signal.SIGTERM, _HANG_UP, STOP_SIGNAL)
    with _handling(dict.fromkeys(numbers, signal.default_int_handler)):
        yield


@contextmanager
def asked_to_leave(leave: Callable[[], object]) -> Iterator[None]:
    """Ctrl-C, SIGTERM or a terminal that goes away asks for the end; another one is a KeyboardInterrupt."""
    numbers = (signal.SIGINT, signal.SIGTERM, _HANG_UP)

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
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
