"""The one place where tests wait: for the thing itself, until a deadline far beyond any busy machine."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

DEADLINE_S = 180.0
"""Reached by what has failed only: nothing here takes a tenth of it, however busy the machine."""

_LOOK_S = 0.01

Found = TypeVar("Found")


def until(look: Callable[[], Found], told: Callable[[], object] = lambda: "it never came") -> Found:
    """What look() gives as soon as that is true. Raises AssertionError with what told() says at the deadline."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not (found := look()):
        if time.monotonic() > deadline_s:
            raise AssertionError(told())
        time.sleep(_LOOK_S)
    return found


def gathered(read: Callable[[], bytes], whole: Callable[[bytes], bool]) -> bytes:
    """What read() gives in as many pieces as it comes in, once it is whole. Raises AssertionError with what came."""
    heard = bytearray()
    until(lambda: whole(bytes(heard)) or heard.extend(read()), lambda: heard)
    return bytes(heard)


def read_too_late(said: str) -> bool:
    """Whether a busy machine solved the finger too late: the balance was busy, or silent, or answered late."""
    return any(words in said for words in ("no force reading", "the force reading took"))


def journal_says(folder: Path, words: str) -> Callable[[], bool]:
    """Whether a run in one of the folders in `folder` has journalled these words, for until()."""
    return lambda: any(words in path.read_text(encoding="utf-8") for path in folder.glob("*/events.jsonl"))


def repeated(every_s: float) -> Iterator[None]:
    """Again and again, as a keyboard repeats a held key; whoever takes it says when it ends, by the deadline."""
    deadline_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline_s:
        yield
        time.sleep(every_s)
    raise AssertionError("it never ended")
