"""A run that is taken up: its script runs again, and what is done is not done again."""

from typing import Any, TypeVar

from rig.protocol.api import Handler
from rig.protocol.steps import Journalled, Owed, Step
from rig.protocol.walk import Spot

E = TypeVar("E")
A = TypeVar("A")


class TakenUp:
    """Hands on to `then` what is missing, and what each step owes before that.

    What is done answers as it was journalled; what comes before the next missing press is owed, and handed on only
    when that comes, at the spot where the script had it.
    """

    def __init__(self, before: Journalled, then: Handler) -> None:
        self._before, self._then = before, then
        self._answers: dict[type[Step[Any, Any]], dict[int, Any]] = {}
        self._written: dict[str, int] = {}
        self._owed: dict[str, tuple[Step[Any, Any], Spot]] = {}
        self._last_done = max(before.done, default=-1)
        self._behind = True  # until the first missing indentation after the last one that is done

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """The step's answer, from the journal or from `then`."""
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
        """Whether the journal lacks it: so many of its kind are written as the script had come to."""
        left = self._written.setdefault(step.verb, len(self._before.stream(step.verb)))
        self._written[step.verb] = left - 1
        return left <= 0
