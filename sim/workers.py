"""Work in separate processes that leave Ctrl-C to their parent and end with it."""

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
    """Strategy for many work items: here or in processes, with or without progress messages."""

    def __call__(self, what: str, function: Callable[[Item], Answer], items: Sequence[Item], /) -> Iterable[Answer]:
        """Return the results in the order of the items; `what` describes them. The function is importable."""
        ...


def one_by_one(what: str, function: Callable[[Item], Answer], items: Sequence[Item], /) -> Iterable[Answer]:
    """Apply the function to the items in this process, without messages."""
    return map(function, items)


def in_processes(
    function: Callable[[Item], Answer], items: Sequence[Item], processes: int | None = None
) -> Iterator[Answer]:
    """Yield results in the order of the items, by default with one process per core. The function must be importable.

    An error, Ctrl-C or a caller that stops iterating ends the processes at once. Raises BrokenProcessPool when one of
    them was killed.
    """
    with _pool(processes or os.cpu_count() or 1) as pool:
        with leaving_ctrl_c_to_us():
            futures = [pool.submit(function, item) for item in items]
        for future in futures:
            yield future.result()


def here_and_in_processes(
    function: Callable[[Item], Answer], items: Sequence[Item], processes: int
) -> Iterator[Answer]:
    """Yield results in any order, of `processes` processes of which this one is the first.

    This process takes items from the end while the others start and work from the beginning; it needs no start and no
    copy of what the function refers to. Otherwise as `in_processes`.
    """
    with _pool(processes - 1) as pool:
        with leaving_ctrl_c_to_us():
            futures = [pool.submit(function, item) for item in items]
        first, last = 0, len(items)
        while first < last and futures[last - 1].cancel():
            last -= 1
            yield function(items[last])
            while first < last and futures[first].done():
                yield futures[first].result()
                first += 1
        for future in futures[first:last]:
            yield future.result()


@contextmanager
def _pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Start processes that end at once where the caller fails or stops iterating."""
    before = set(multiprocessing.active_children())
    spawning = multiprocessing.get_context("spawn")  # a forked MKL may hang
    with ProcessPoolExecutor(processes, spawning) as pool:
        try:
            yield pool
        except BaseException:
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
                if sys.platform != "win32" and process.pid is not None:
                    with suppress(ProcessLookupError):
                        os.kill(process.pid, signal.SIGCONT)  # a process suspended by Ctrl-Z would never end
            raise


@contextmanager
def leaving_ctrl_c_to_us() -> Iterator[None]:
    """Block Ctrl-C, which a terminal sends to all, in processes started inside; here it arrives at the end."""
    with _blocked("SIGINT"):
        yield


@contextmanager
def leaving_signals_to_us() -> Iterator[None]:
    """Block all signals that go to a command's processes in those started inside."""
    with _blocked("SIGTERM", *TO_THE_GROUP):
        yield


@contextmanager
def _blocked(*names: str) -> Iterator[None]:
    if sys.platform == "win32":
        yield
    else:
        numbers = {signal.Signals[name] for name in names}
        before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)  # the mask is inherited
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


_SESSION = Path("/proc/self/autogroup")
_AGAIN_S, _TRIES = 0.05, 10


def give_way(to: int) -> None:
    """Leave the terminal's session, and set the priority: 0 normal, 19 lowest.

    Where Linux shares processors between sessions, niceness counts within a session alone, and a session has its own.
    Source: sched(7), The autogroup feature.
    """
    if sys.platform != "win32":
        os.setsid()
        to = os.nice(to)
    for _ in range(_TRIES):
        try:
            _SESSION.write_text(str(to), encoding="ascii")
        except BlockingIOError:  # the kernel limits changes to one per tenth of a second
            time.sleep(_AGAIN_S)
        except OSError:
            return
        else:
            return


_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # M_… of malloc.h
_LARGEST_KEPT, _MOST_KEPT = 1 << 25, 1 << 28  # bytes


def keep_freed_memory() -> None:
    """Keep freed memory in this process, with glibc; for processes that must be fast.

    A contact allocates and frees megabytes; the system clears returned pages, which makes a deep contact a quarter
    slower. Source: mallopt(3).
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", lambda *_: 0)
        mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_TRIM_THRESHOLD, _MOST_KEPT)
