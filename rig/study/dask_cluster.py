"""Tasks on a dask.distributed cluster, with a one-line error for each way in which that can fail."""

import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any, TypeVar

from distributed import Client, KilledWorker, wait
from distributed.comm.core import CommClosedError

from rig.study.exceptions import WorkersError
from sim.models.cache import content_key

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_RETRIES = 3
_CONNECT_S = 10
_PATIENCE_S = 10


def over_cluster(function: Callable[[Item], Answer], items: Sequence[Item], scheduler: str) -> Iterator[Answer]:
    """Yield the results in the order of the items; raise WorkersError if the cluster fails."""
    with _naming(scheduler), _connected(scheduler) as client:
        _expect_workers(client)
        _expect_same_program(client)
        for future in client.map(function, items, retries=_RETRIES, pure=False):
            _await(future, client)
            yield future.result()


@contextmanager
def _naming(scheduler: str) -> Iterator[None]:
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # it logs the errors that are raised here
    try:
        yield
    except WorkersError as error:
        raise WorkersError(f"--scheduler {scheduler}: {error}", error.code) from None
    except (CancelledError, CommClosedError):
        raise WorkersError(
            f"--scheduler {scheduler}: the scheduler is no longer reachable; check it and start again",
            "scheduler_gone",
        ) from None
    except KilledWorker:
        raise WorkersError(
            f"--scheduler {scheduler}: {_RETRIES} or more workers were lost on the same case; check their memory",
            "case_lost",
        ) from None


def _connected(scheduler: str) -> Any:
    try:
        return Client(scheduler, timeout=_CONNECT_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError):
        raise WorkersError("no scheduler answers; give its address, e.g. tcp://host:8786", "no_answer") from None


def _expect_workers(client: Any) -> None:
    try:
        client.wait_for_workers(1, timeout=_PATIENCE_S)
    except TimeoutError:
        raise WorkersError("the scheduler has no workers; start some with dask worker", "no_workers") from None


def _expect_same_program(client: Any) -> None:
    """Raise WorkersError if a worker runs another version, since its results would differ unnoticed."""
    expected = program()
    for worker, found in client.run(program, on_error="return").items():
        if found != expected:
            raise WorkersError(
                f"worker {worker} runs {found}, expected {expected}; install the same version", "other_program"
            )


def program() -> str:
    """Return the version of this program, with a digest of the code that builds models."""
    return f"indentation-rig {version('indentation-rig')} ({content_key([])[:8]})"


def _await(future: Any, client: Any) -> None:
    """Wait for the result; raise WorkersError if all workers have gone."""
    while not future.done():
        try:
            wait([future], timeout=_PATIENCE_S)  # type: ignore[no-untyped-call]
        except TimeoutError:
            _expect_workers(client)
