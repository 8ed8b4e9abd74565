"""Threads for what waits for an answer elsewhere, where nothing else may wait behind it."""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from rig.session.control.announcements import ControlError

Answer = TypeVar("Answer")
Given = TypeVar("Given")


class Few:
    """So many at once, each in a thread; what comes while all are busy is refused, and waits nowhere."""

    def __init__(self, threads: int, name: str, problem: str, code: str = "busy") -> None:
        """problem, code: what is said where all are busy."""
        self._pool, self._problem, self._code = ThreadPoolExecutor(threads, name), problem, code
        self._idle = threading.Semaphore(threads)

    def begin(self, do: Callable[[], Answer]) -> "asyncio.Future[Answer]":
        """Have it done. Raises ControlError."""
        return self.begin_behind(lambda: None, lambda _: do())

    def begin_behind(self, first: Callable[[], Given], do: Callable[[Given], Answer]) -> "asyncio.Future[Answer]":
        """Have it done with what comes of `first`, which is done here and now: a thread may wait for its turn.

        Raises ControlError, and then neither is done.
        """
        if not self._idle.acquire(blocking=False):
            raise ControlError(self._problem, code=self._code)
        try:
            begun = self._pool.submit(do, first())
        except BaseException:
            self._idle.release()
            raise
        begun.add_done_callback(lambda _: self._idle.release())
        return asyncio.wrap_future(begun)
