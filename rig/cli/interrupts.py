"""Signals: Ctrl-C, a terminal that goes away, and `rig stop` from another process."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from rig.cli.output import err

# Not on Windows, where `rig stop` can only open a port that nobody owns.
STOP_SIGNAL: signal.Signals | None = getattr(signal, "SIGUSR1", None)
_HANG_UP: signal.Signals | None = getattr(signal, "SIGHUP", None)


@contextmanager
def at_a_safe_point() -> Iterator[Callable[[], bool]]:
    """Ctrl-C (or SIGTERM) once asks for a stop at the next safe point; twice, or `rig stop`, stops at once."""
    asked: list[bool] = []

    def ask(*_: object) -> None:
        asked.append(True)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        err.print("stopping at the next safe point; Ctrl-C again stops now")

    with _handling({signal.SIGINT: ask, signal.SIGTERM: ask, STOP_SIGNAL: signal.default_int_handler}):
        yield lambda: bool(asked)


@contextmanager
def at_once() -> Iterator[None]:
    """Every such signal is a KeyboardInterrupt: at the bench the stage stops when whoever moves it goes away."""
    numbers = (signal.SIGINT, signal.SIGTERM, _HANG_UP, STOP_SIGNAL)
    with _handling(dict.fromkeys(numbers, signal.default_int_handler)):
        yield


@contextmanager
def _handling(handlers: dict[signal.Signals | None, Callable[[int, FrameType | None], object]]) -> Iterator[None]:
    before = [(number, signal.signal(number, act)) for number, act in handlers.items() if number is not None]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
