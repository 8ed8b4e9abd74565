"""Handlers around another one: replay of a resumed run, and the end of a script that makes no steps."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, TypeVar

from rig.errors import BadInputError
from rig.protocol.api import Handler
from rig.protocol.check import Spot
from rig.protocol.steps import Journalled, Owed, Step

E = TypeVar("E")
A = TypeVar("A")


class ResumeHandler:
    """Handler of a resumed run: passes on the missing steps, and the earlier steps that they need.

    The journal answers for a finished press. What a step before the next missing press still requires (`Step.owed`)
    is passed on only when that press comes, at the spot where the script made the step.
    """

    def __init__(self, before: Journalled, then: Handler) -> None:
        self._before, self._then = before, then
        self._answers: dict[type[Step[Any, Any]], dict[int, Any]] = {}
        self._written: dict[str, int] = {}
        self._owed: dict[str, tuple[Step[Any, Any], Spot]] = {}
        self._last_done = max(before.done, default=-1)
        self._behind = True  # until the first missing indentation after the last one that is done

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """Return the step's answer, from the journal or from `then`."""
        if step.owed is Owed.ANSWER:
            return self._answer(step, spot)
        if not self._behind:
            return self._then.handle(step, spot)
        if step.owed is Owed.ONCE and self._is_new(step):
            return self._then.handle(step, spot)
        if step.owed in (Owed.LAST, Owed.LAST_IF_NEXT):
            self._owed.pop(step.verb, None)
            self._owed[step.verb] = step, spot
        return None  # type: ignore[return-value]

    def _answer(self, step: Step[E, A], spot: Spot) -> A:
        (press,) = spot.ids
        if type(step) not in self._answers:
            self._answers[type(step)] = step.answers(self._before)
        answers: dict[int, A] = self._answers[type(step)]
        data = press.purpose == "data"
        if press.index in answers:
            if data:
                self._forget_what_was_for_this_one()
            return answers[press.index]
        owed, self._owed = self._owed, {}
        for step_owed, where in owed.values():
            self._then.handle(step_owed, where)
        if data:
            self._behind = press.index < self._last_done
        return self._then.handle(step, spot)

    def _forget_what_was_for_this_one(self) -> None:
        self._owed = {verb: owed for verb, owed in self._owed.items() if owed[0].owed is not Owed.LAST_IF_NEXT}

    def _is_new(self, step: Step[Any, Any]) -> bool:
        """Return whether the journal lacks the step; it has the first ones of each verb, in order."""
        left = self._written.setdefault(step.verb, len(self._before.stream(step.verb)))
        self._written[step.verb] = left - 1
        return left <= 0


MOST_STEPS = 10_000
LONGEST_SILENCE_S = 30.0


class SilentScriptError(BaseException):
    """Error of a script that made no step for too long; `except Exception` in a script does not catch it."""

    code = "silent"

    def __init__(self, longest_s: float) -> None:
        super().__init__(f"the script makes no step for {longest_s:g} s, expected one")
        self.fields = {"longest_s": longest_s}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.fields["longest_s"],)


class Patience:
    """Handler that limits the number of steps, and with `impatient` the time between two of them.

    Only the script's own time counts, not that of a step: model, stage, rest or operator. It is measured by an
    alarm, on the main thread of a system that has alarms; elsewhere Ctrl-C ends a script that makes no steps.

    Parameters
    ----------
    then : Handler
    on_step : callable
        Called with the number of steps so far, before each step.
    """

    def __init__(self, then: Handler, on_step: Callable[[int], None] = lambda steps: None) -> None:
        self._then, self._on_step = then, on_step
        self._steps = 0

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """Return the answer of `then`. Raises BadInputError beyond MOST_STEPS."""
        self._steps += 1
        self._on_step(self._steps)
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
    """Raise SilentScriptError in a script that makes no step for LONGEST_SILENCE_S."""
    if not _has_alarms():
        yield
        return

    def too_long(number: int, frame: FrameType | None) -> None:
        raise SilentScriptError(LONGEST_SILENCE_S)

    before, began_s = signal.signal(signal.SIGALRM, too_long), time.monotonic()
    left_s, _ = signal.getitimer(signal.ITIMER_REAL)  # an alarm set by the caller
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
