"""Independent pieces of work over the processes of this machine, or over a dask.distributed cluster."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from threadpoolctl import threadpool_limits

from rig.compare.errors import WorkersError

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_RETRIES = 3
_CONNECT_S = 10


def spread(
    function: Callable[[Item], Answer],
    items: Sequence[Item],
    processes: int | None = None,
    scheduler: str | None = None,
) -> Iterator[Answer]:
    """The answers in the order of the items: over a scheduler's workers where one is named, else over processes.

    The function must be importable. What a lost worker of a cluster had is done again by another. Raises
    WorkersError.
    """
    if scheduler is not None:
        yield from _over_cluster(function, items, scheduler)
        return
    spawning = multiprocessing.get_context("spawn")  # a forked MKL may hang
    with ProcessPoolExecutor(processes or os.cpu_count(), spawning, initializer=_one_thread) as pool:
        try:
            yield from pool.map(function, items)
        except BrokenProcessPool:
            raise WorkersError("a worker process was killed; is there memory for fewer only (--processes)?") from None


def _one_thread() -> None:
    threadpool_limits(1)


def _over_cluster(function: Callable[[Item], Answer], items: Sequence[Item], scheduler: str) -> Iterator[Answer]:
    try:
        from distributed import Client
    except ImportError:
        needed = "needs dask.distributed, expected pip install 'indentation-rig[cluster]'"
        raise WorkersError(f"--scheduler: {needed}") from None
    try:
        client = Client(scheduler, timeout=_CONNECT_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError):
        raise WorkersError(f"--scheduler {scheduler}: nobody answers, expected for example tcp://host:8786") from None
    with client:
        futures = client.map(function, items, retries=_RETRIES, pure=False)
        for future in futures:
            yield future.result()
