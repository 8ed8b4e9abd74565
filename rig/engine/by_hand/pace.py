"""Whether a stage that is told to go on and on was stopped meanwhile, by its speed and by how soon it listens."""

import math

# A stage that goes on by less than this of its way, or takes a line in so much later than before, may have stood.
_SLOWER, _LATER, _LATER_S = 0.9, 2.0, 0.005
_PRINTED_MM = 0.001
_LOOKS = 3


class Pace:
    """The pace of a stage since it began.

    A GRBL board cancels a jog that somebody holds, and says nothing of it. A line that comes while it slows down it
    takes in once it stands, and goes on: line and stage are late then. Each by itself is doubtful, since this machine
    may be busy; a doubtful stage is told no more until it is at rest, where what it lacks can be seen.
    """

    def __init__(self, step_mm: float) -> None:
        self._rounding_mm = step_mm + _PRINTED_MM
        self._quickest_s = math.inf
        self._begin()

    def _begin(self) -> None:
        self._looks: list[tuple[float, float, float]] = []  # asked, heard, gone
        self._fastest_mm_s = 0.0
        self._late = False
        self.doubtful = self.stood = False

    def told(self, took_s: float) -> None:
        """A line was taken in after so long."""
        self._late = took_s > _LATER * self._quickest_s + _LATER_S
        self._quickest_s = min(took_s, self._quickest_s)

    def seen(self, asked_s: float, heard_s: float, gone_mm: float, *, at_rest: bool) -> None:
        """A look at it: when it was asked for and heard, and how far it had gone."""
        if at_rest:
            self._begin()
        self._looks = [*self._looks[1 - _LOOKS :], (asked_s, heard_s, gone_mm)]
        before_asked_s, before_heard_s, before_mm = self._looks[0]
        since_mm, at_least_s = gone_mm - before_mm, asked_s - before_heard_s
        slower = since_mm + self._rounding_mm < _SLOWER * self._fastest_mm_s * at_least_s
        if at_least_s > 0:
            surely_mm_s = (since_mm - self._rounding_mm) / (heard_s - before_asked_s)
            self._fastest_mm_s = max(self._fastest_mm_s, surely_mm_s)
        self.doubtful = self.doubtful or slower or self._late
        self.stood = slower and self._late
        self._late = False
