"""Independent tasks over the processes of this machine, or over a dask.distributed cluster."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import TypeVar

from threadpoolctl import threadpool_limits

from rig.study.exceptions import WorkersError
from sim.workers import in_processes

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def spread(
    function: Callable[[Item], Answer],
    items: Sequence[Item],
    processes: int | None = None,
    scheduler: str | None = None,
) -> Iterator[Answer]:
    """Yield the results in the order of the items, from a scheduler's workers if named, else from processes.

    The function must be importable; each call uses one thread. Tasks of a lost worker of a cluster are repeated by
    another. Raises WorkersError.
    """
    alone = partial(_on_one_thread, function)
    if scheduler is None:
        yield from _over_processes(alone, items, processes)
        return
    try:
        from rig.study.dask_cluster import over_cluster
    except ImportError:
        needed = (
            "--scheduler requires the package dask.distributed; install it with pip install "
            "'indentation-rig[cluster]'"
        )
        raise WorkersError(needed, "dask_missing") from None
    yield from over_cluster(alone, items, scheduler)


def _over_processes(
    function: Callable[[Item], Answer], items: Sequence[Item], processes: int | None
) -> Iterator[Answer]:
    try:
        yield from in_processes(function, items, processes)
    except BrokenProcessPool:
        raise WorkersError(
            "a worker process was killed, perhaps for lack of memory; try fewer processes (--processes)",
            "process_killed",
        ) from None


def _on_one_thread(function: Callable[[Item], Answer], item: Item) -> Answer:
    # For libraries that are imported later; the limits apply to those already loaded.
    os.environ["OMP_NUM_THREADS"] = "1"
    with threadpool_limits(1):
        return function(item)
