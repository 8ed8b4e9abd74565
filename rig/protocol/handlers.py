"""Handlers around another handler: replay of a resumed run, and the timeout of a script that makes no steps."""

import ctypes
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, TypeVar

from rig.errors import BadInputError
from rig.protocol.api import Handler
from rig.protocol.check import PressPlace
from rig.protocol.same_steps import SameSteps
from rig.protocol.steps import Journalled, Mount, ResumeRule, Step, Zero
from rig.protocol.turns import script_under_way

E = TypeVar("E")
A = TypeVar("A")


class ResumeHandler:
    """Handler of a resumed run: passes on the missing steps, and the earlier steps that they need.

    The journal answers for a finished press. A step before the next missing press that is still required
    (`Step.on_resume`) is passed on only when that press comes, at the place where the script made it. A step that is
    not that of the journal is refused. `press_mm_s` is the speed of a press that names none.
    """

    def __init__(self, before: Journalled, then: Handler, press_mm_s: float) -> None:
        self._before, self._then, self._press_mm_s = before, then, press_mm_s
        self._same = SameSteps(before)
        self._answers: dict[type[Step[Any, Any]], dict[int, Any]] = {}
        self._asked: Counter[str] = Counter()
        self._pending: dict[str, tuple[Step[Any, Any], PressPlace]] = {}
        self._last_done = max(before.done, default=-1)
        self._behind = True  # until the first missing indentation after the last one that is done

    def handle(self, step: Step[E, A], place: PressPlace) -> A:
        """Return the step's answer, from the journal or from `then`. Raises BadInputError if it is another one."""
        self._same.compare(step, place, self._press_mm_s)
        if step.on_resume is ResumeRule.ANSWER:
            return self._answer(step, place)
        if not self._behind:
            return self._then.handle(step, place)
        if step.on_resume is ResumeRule.ONCE:
            return self._once(step, place)
        if step.verb == Mount.verb:
            self._drop(ResumeRule.LAST_OF_INDENTOR)
        if step.on_resume in (ResumeRule.LAST, ResumeRule.LAST_OF_INDENTOR, ResumeRule.LAST_IF_NEXT):
            # Pending presses need the zero before them; one after them is pending beside it.
            pressing = any(one.on_resume is ResumeRule.LAST_OF_INDENTOR for one, _ in self._pending.values())
            key = f"{step.verb} after presses" if step.verb == Zero.verb and pressing else step.verb
            self._pending.pop(key, None)
            self._pending[key] = step, place
        return None  # type: ignore[return-value]

    @property
    def differences(self) -> list[str]:
        """Notes and rests that differ from the journal, in words."""
        return self._same.differences

    def end(self) -> None:
        """Raise the refusal of a step that a script caught."""
        self._same.end()

    def _answer(self, step: Step[E, A], place: PressPlace) -> A:
        (press,) = place.ids
        answers, data = self._recorded_answers(step), press.purpose == "data"
        if press.index in answers:
            if data:
                self._drop(ResumeRule.LAST_IF_NEXT)
            return answers[press.index]
        pending, self._pending = self._pending, {}
        for earlier, where in pending.values():
            self._then.handle(earlier, where)
        if data:
            self._behind = press.index < self._last_done
        return self._then.handle(step, place)

    def _drop(self, rule: ResumeRule) -> None:
        self._pending = {verb: one for verb, one in self._pending.items() if one[0].on_resume is not rule}

    def _once(self, step: Step[E, A], place: PressPlace) -> A:
        """Answer a step that is journalled once; the journal has the first ones of each verb, in order."""
        index = self._asked[step.verb]
        self._asked[step.verb] += 1
        if index >= len(self._before.stream(step.verb)):
            return self._then.handle(step, place)
        return self._recorded_answers(step).get(index)  # type: ignore[return-value]

    def _recorded_answers(self, step: Step[E, A]) -> dict[int, A]:
        if type(step) not in self._answers:
            self._answers[type(step)] = step.answers(self._before)
        return self._answers[type(step)]


MOST_STEPS = 10_000
LONGEST_SILENCE_S = 30.0


class SilentScriptError(BaseException):
    """Error of a script that made no step for too long; `except Exception` in a script does not catch it."""

    code = "silent"

    def __init__(self, sentence: str | None = None) -> None:
        super().__init__(sentence or f"the script timed out: no step for {LONGEST_SILENCE_S:g} s")


class Patience:
    """Handler that limits the number of steps, and with `impatient` the time between two of them.

    Only the script's own time counts, not that of a step: model, stage, rest or operator. It is measured by an alarm
    on the main thread, or by another thread on Windows; elsewhere Ctrl-C ends a script that makes no steps. `on_step`
    gets the number of steps so far, before each.
    """

    def __init__(self, then: Handler, on_step: Callable[[int], None] = lambda steps: None) -> None:
        self._then, self._on_step = then, on_step
        self._steps = 0

    def handle(self, step: Step[E, A], place: PressPlace) -> A:
        """Return the answer of `then`. Raises BadInputError beyond MOST_STEPS."""
        self._steps += 1
        self._on_step(self._steps)
        if self._steps > MOST_STEPS:
            raise BadInputError(
                f"{step.verb}: the script makes more than {MOST_STEPS} steps, which is the limit", "too_many_steps"
            )
        _alarm_in(0.0)
        try:
            return self._then.handle(step, place)
        finally:
            _alarm_in(LONGEST_SILENCE_S)


@contextmanager
def impatient() -> Iterator[None]:
    """Take the steps of a script, and raise SilentScriptError if it makes none for LONGEST_SILENCE_S."""
    if threading.current_thread() is not threading.main_thread():
        with script_under_way():
            yield
        return
    with script_under_way(), _alarms():
        _alarm_in(LONGEST_SILENCE_S)
        try:
            yield
        finally:
            _alarm_in(0.0)


def _alarm_in(seconds: float) -> None:
    if threading.current_thread() is threading.main_thread():
        _set_alarm(seconds)


if sys.platform == "win32":

    class _Watch(threading.Thread):
        """Thread that raises SilentScriptError in the main thread; a script in compiled code or asleep ends later."""

        def __init__(self) -> None:
            super().__init__(name="patience", daemon=True)
            self._changed = threading.Condition()
            self._deadline_s: float | None = None
            self._over = self._raised = False

        def set(self, seconds: float) -> None:
            """Set the alarm, or none for 0. Raises SilentScriptError if it went off before."""
            with self._changed:
                self._deadline_s = time.monotonic() + seconds if seconds else None
                self._changed.notify()
                went_off, self._raised = self._raised, False
                if went_off:  # It may not have arrived yet, and must not do so in a step.
                    _raise_in_main(None)
            if went_off and not isinstance(sys.exc_info()[1], SilentScriptError):
                raise SilentScriptError

        def run(self) -> None:
            with self._changed:
                while not self._over:
                    left_s = None if self._deadline_s is None else self._deadline_s - time.monotonic()
                    if left_s is not None and left_s <= 0.0:
                        self._deadline_s, self._raised = None, True
                        _raise_in_main(SilentScriptError)
                    else:
                        self._changed.wait(left_s)

        def end(self) -> None:
            """End the thread."""
            with self._changed:
                self._over = True
                self._changed.notify()

    def _raise_in_main(kind: type[BaseException] | None) -> None:
        main = ctypes.c_ulong(threading.main_thread().ident or 0)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(main, None if kind is None else ctypes.py_object(kind))

    _watches: list[_Watch] = []

    @contextmanager
    def _alarms() -> Iterator[None]:
        watch = _Watch()
        watch.start()
        _watches.append(watch)
        try:
            yield
        finally:
            _watches.remove(watch)
            watch.end()

    def _set_alarm(seconds: float) -> None:
        if _watches:
            _watches[-1].set(seconds)
else:
    _handlers: list[Callable[[int, FrameType | None], None]] = []
    """Those of the scripts under way; without one an alarm would end the program."""

    @contextmanager
    def _alarms() -> Iterator[None]:
        def too_long(number: int, frame: FrameType | None) -> None:
            raise SilentScriptError

        before, began_s = signal.signal(signal.SIGALRM, too_long), time.monotonic()
        left_s, _ = signal.getitimer(signal.ITIMER_REAL)  # an alarm set by the caller
        _handlers.append(too_long)
        try:
            yield
        finally:
            _handlers.pop()
            signal.signal(signal.SIGALRM, before)
            if left_s:
                signal.setitimer(signal.ITIMER_REAL, max(left_s - (time.monotonic() - began_s), 1e-3))

    def _set_alarm(seconds: float) -> None:
        if _handlers:
            signal.setitimer(signal.ITIMER_REAL, seconds)
