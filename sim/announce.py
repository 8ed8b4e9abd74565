"""Lines on standard error about work that takes long, for programs that do not set up `logging`."""

import logging
import multiprocessing
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

FIRST_S, EVERY_S = 0.8, 4.0
"""Time after which work prints its first line, and time between its further lines (s)."""

_now: list[str] = []
"""What the work does at the moment; empty while nothing takes long."""


class _Announcer(logging.Handler):
    """Handler that prints messages of the simulator while no other handler takes them."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print the message in one line."""
        if not logging.getLogger().handlers:
            note(record.getMessage())
            _print(record.getMessage())


def announce() -> None:
    """Print what takes long, unless the program listens to the simulator itself or is a worker of another one."""
    logger, root = logging.getLogger("sim"), logging.getLogger()
    if logger.handlers or root.handlers or logger.level or multiprocessing.parent_process() is not None:
        return
    logger.addHandler(_Announcer())
    logger.setLevel(logging.INFO)


def note(what: str) -> None:
    """Set what the work does now, for its next line."""
    if _now:
        _now[0] = what


@contextmanager
def taking_long(what: str) -> Iterator[None]:
    """Print lines about work while it runs: none if it is short, or if somebody else listens."""
    heard = any(isinstance(one, _Announcer) for one in logging.getLogger("sim").handlers)
    if _now or not heard or logging.getLogger().handlers:
        yield
        return
    done = threading.Event()
    _now.append(what)
    printer = threading.Thread(target=_keep_printing, args=(done, time.monotonic()), name="announce", daemon=True)
    printer.start()
    try:
        yield
    finally:
        done.set()
        _now.clear()
        printer.join()  # a program may fork afterwards, which no thread survives


def _keep_printing(done: threading.Event, began_s: float) -> None:
    wait_s = FIRST_S
    while not done.wait(wait_s):
        for what in _now[:1]:
            _print(f"{what} {time.monotonic() - began_s:.0f} s so far")
        wait_s = EVERY_S


def _print(line: str) -> None:
    print(f"sim: {line}", file=sys.stderr, flush=True)
