"""Threads for what waits for an answer elsewhere, where nothing else may wait behind it."""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from rig.session.control.announcements import ControlError

Answer = TypeVar("Answer")


class Few:
    """So many at once, each in a thread; what comes while all are busy is refused, and waits nowhere."""

    def __init__(self, threads: int, name: str, problem: str) -> None:
        """problem: what is said where all are busy."""
        self._pool, self._problem = ThreadPoolExecutor(threads, name), problem
        self._idle = threading.Semaphore(threads)

    def begin(self, do: Callable[[], Answer]) -> "asyncio.Future[Answer]":
        """Have it done. Raises ControlError."""
        if not self._idle.acquire(blocking=False):
            raise ControlError(self._problem)
        begun = self._pool.submit(do)
        begun.add_done_callback(lambda _: self._idle.release())
        return asyncio.wrap_future(begun)
