"""Work in processes of their own, which leave Ctrl-C to the one that began them and end with it."""

import ctypes
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol, TypeVar

TO_THE_GROUP = ("SIGINT", "SIGTSTP", "SIGQUIT", "SIGTTIN", "SIGTTOU", "SIGHUP", "SIGUSR1")
"""Signals that a terminal, or a program that ends a run, sends to all processes of a command."""

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class Work(Protocol):
    """How many pieces of work are done: here, in processes, with or without a word on how far it is."""

    def __call__(self, what: str, function: Callable[[Item], Answer], items: Sequence[Item], /) -> Iterable[Answer]:
        """The answers in the order of the items; what: these, in words. The function is importable."""
        ...


def one_by_one(what: str, function: Callable[[Item], Answer], items: Sequence[Item], /) -> Iterable[Answer]:
    """In this process, in silence."""
    return map(function, items)


def in_processes(
    function: Callable[[Item], Answer], items: Sequence[Item], processes: int | None = None
) -> Iterator[Answer]:
    """The answers in the order of the items; by default as many processes as cores. The function must be importable.

    An error, Ctrl-C or a caller that asks for no more ends the processes at once. Raises BrokenProcessPool when one
    of them was killed.
    """
    before = set(multiprocessing.active_children())
    spawning = multiprocessing.get_context("spawn")  # a forked MKL may hang
    with ProcessPoolExecutor(processes or os.cpu_count(), spawning) as pool:
        try:
            with leaving_ctrl_c_to_us():
                futures = [pool.submit(function, item) for item in items]
            for future in futures:
                yield future.result()
        except BaseException:
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
                if process.pid is not None and hasattr(signal, "SIGCONT"):
                    with suppress(ProcessLookupError):
                        os.kill(process.pid, signal.SIGCONT)  # Ctrl-Z has suspended it: it would never end
            raise


@contextmanager
def leaving_ctrl_c_to_us() -> Iterator[None]:
    """Processes that are begun inside never see Ctrl-C, which a terminal sends to all; here it comes at the end."""
    with _kept_from_others("SIGINT"):
        yield


@contextmanager
def leaving_signals_to_us() -> Iterator[None]:
    """The same of everything that a terminal, or whoever ends a run, sends to all processes of a command."""
    with _kept_from_others("SIGTERM", *TO_THE_GROUP):
        yield


@contextmanager
def _kept_from_others(*names: str) -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    numbers = {signal.Signals[name] for name in names}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)  # the mask is inherited
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_SESSION = Path("/proc/self/autogroup")
_AGAIN_S, _TRIES = 0.05, 10


def give_way(to: int) -> None:
    """Leave the terminal's session, and run after others that have something to do: to 0 never, to 19 nearly always.

    Where Linux shares processors between sessions, niceness counts within a session alone, and a session has its own.
    Source: sched(7), The autogroup feature.
    """
    if hasattr(os, "setsid"):
        os.setsid()
    if hasattr(os, "nice"):
        to = os.nice(to)
    for _ in range(_TRIES):
        try:
            _SESSION.write_text(str(to), encoding="ascii")
        except BlockingIOError:  # one of a machine's sessions in a tenth of a second
            time.sleep(_AGAIN_S)
        except OSError:
            return
        else:
            return


_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # M_… of malloc.h
_LARGEST_KEPT, _MOST_KEPT = 1 << 25, 1 << 28  # bytes


def keep_freed_memory() -> None:
    """Have this process keep the memory it frees, where the C library is glibc; for one that lives to be quick.

    A contact frees and asks for megabytes; pages that come back from the system are cleared first, which makes a
    deep contact a quarter slower. Source: mallopt(3).
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", lambda *_: 0)
        mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_TRIM_THRESHOLD, _MOST_KEPT)
