"""How long a script is listened to, checked or carried out: so many steps, and so long between two of them."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, TypeVar

from rig.protocol.api import Handler
from rig.protocol.errors import BadInputError
from rig.protocol.steps import Step
from rig.protocol.walk import Spot

E = TypeVar("E")
A = TypeVar("A")

MOST_STEPS = 10_000
LONGEST_SILENCE_S = 30.0


class SilentScriptError(BaseException):
    """The script has made no step for too long; no `except Exception` of a script stands in its way."""

    code = "silent"

    def __init__(self, longest_s: float) -> None:
        super().__init__(f"the script makes no step for {longest_s:g} s, expected one")
        self.fields = {"longest_s": longest_s}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.fields["longest_s"],)


class Patience:
    """Counts the steps of a script on their way to `then`, and has each of them told.

    The silence is a script's own: what a step takes is no part of it, be it the model, the stage, a rest or a person.
    It is measured on the main thread of a system that has alarms; elsewhere a script that makes no steps is ended by
    Ctrl-C.
    """

    def __init__(self, then: Handler, told: Callable[[int], None] = lambda steps: None) -> None:
        self._then, self._told = then, told
        self._steps = 0

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """What `then` answers. Raises BadInputError beyond MOST_STEPS."""
        self._steps += 1
        self._told(self._steps)
        if self._steps > MOST_STEPS:
            raise BadInputError("{verb}: the script makes more than {high} steps, expected no more",
                                code="too_many_steps", verb=step.verb, high=MOST_STEPS)  # fmt: skip
        _alarm_in(0.0)
        try:
            return self._then.handle(step, spot)
        finally:
            _alarm_in(LONGEST_SILENCE_S)


@contextmanager
def impatient() -> Iterator[None]:
    """Raises SilentScriptError in the script where it makes no step for LONGEST_SILENCE_S."""
    if not _has_alarms():
        yield
        return

    def too_long(number: int, frame: FrameType | None) -> None:
        raise SilentScriptError(LONGEST_SILENCE_S)

    before, began_s = signal.signal(signal.SIGALRM, too_long), time.monotonic()
    left_s, _ = signal.getitimer(signal.ITIMER_REAL)  # of somebody else's alarm
    _alarm_in(LONGEST_SILENCE_S)
    try:
        yield
    finally:
        _alarm_in(0.0)
        signal.signal(signal.SIGALRM, before)
        if left_s:
            _alarm_in(max(left_s - (time.monotonic() - began_s), 1e-3))


def _alarm_in(seconds: float) -> None:
    if _has_alarms():
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _has_alarms() -> bool:
    return hasattr(signal, "SIGALRM") and threading.current_thread() is threading.main_thread()
