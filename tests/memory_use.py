"""How many bytes Python holds for what is done again and again, by its own count: not what the system gave it."""

import gc
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Step = Callable[[], object]


def kept_bytes(step: Step, *, first: int, then: int) -> int:
    """How many more are held after `then` steps than before them; `first` ones fill what has an end."""
    with _counted():
        _again(step, first)
        before = _held()
        _again(step, then)
        return _held() - before


def needed_bytes(step: Step) -> int:
    """The most that were held at once during a step, above what was held before it; it has been done before."""
    with _counted():
        step()
        before = _held()
        tracemalloc.reset_peak()
        step()
        return tracemalloc.get_traced_memory()[1] - before


def _again(step: Step, times: int) -> None:
    for _ in range(times):
        step()


def _held() -> int:
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


@contextmanager
def _counted() -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
    finally:
        tracemalloc.stop()
