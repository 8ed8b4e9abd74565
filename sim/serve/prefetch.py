"""Forces in real time, from a finger in another process: what is known by when it is asked for, and what is not.

For a force that is not known yet the last one before it stands in. It is not called fresh, and it is counted; after
STALE_S it is no answer at all, and one line says so. Nothing queues: the process has one question at a time, and what
it is asked next is chosen when it has answered, of where the indentor is by then and will be.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from sim.devices.clock import sample_at
from sim.serve.wall_clock import WallScheduler

STALE_S = 0.5
_SHORTEST_S = 0.01  # between two solves
_ON_GRID = 1e-6  # of a period: round-off
_FARTHEST_S = STALE_S / 2  # ahead: beyond that plans change before they come


@dataclass
class PressStatistics:
    """How the forces came: readings asked for, those that were late, and the time of each solve (s)."""

    asked: int = 0
    late: int = 0
    unknown: int = 0
    stalest_s: float = 0.0
    slowest_s: float = 0.0
    solved: int = 0


class ItsProcess(Protocol):
    """The finger's."""

    def fileno(self) -> int:
        """Readable when there is an answer, or it has gone."""
        ...

    def close(self) -> None:
        """End it."""
        ...


class Ahead(ABC):
    """force_n(t) for the virtual devices, without ever waiting."""

    def __init__(
        self, scheduler: WallScheduler, process: ItsProcess, period_s: float, complain: Callable[[str], object]
    ) -> None:
        """period_s: of the samples; complain gets one line each time the finger begins to have no answer."""
        self._scheduler, self._process, self._complain = scheduler, process, complain
        self._period_s = max(period_s, _SHORTEST_S)
        self._troubled = self._too_late = False
        self._last_n, self._last_s = math.nan, -math.inf
        self._noted = self._index() - 1
        self._asked_s, self._took = math.inf, 1
        self.statistics = PressStatistics()
        self.ended = False  # there is no finger any more; the scheduler has been stopped

    @abstractmethod
    def _known_at(self, t_s: float) -> float | None:
        """The force of an instant, None where it is not known (yet)."""

    @abstractmethod
    def _ask_next(self) -> None:
        """Have the next forces solved, if nothing is asked just now."""

    @abstractmethod
    def _take_answer(self) -> None:
        """What was asked for. Raises EOFError, OSError if the process has gone."""

    def force_n(self, t_s: float) -> float:
        """Force at an instant, N; the last one known where that is not solved yet, NaN where it is too old."""
        self.statistics.asked += 1
        known = self._known_at(t_s)
        if known is not None:
            return known
        stale_s = max(t_s - self._last_s, 0.0)
        self.statistics.late += 1
        self.statistics.stalest_s = max(self.statistics.stalest_s, stale_s)
        if stale_s <= STALE_S:
            return self._last_n
        self.statistics.unknown += 1
        if not self._too_late:
            self._complain(f"the virtual finger has no force for {stale_s:.1f} s: this machine is too busy for it")
        self._too_late = True
        return math.nan

    def fresh(self, t_s: float) -> bool:
        """Whether the force of this instant is known, and not just the last one before it."""
        return self._known_at(t_s) is not None

    def close(self) -> None:
        if not self.ended:
            self._scheduler.unwatch(self._process)
        self._process.close()

    def _begin(self) -> None:
        """The first answer is there; from now on nobody waits."""
        self._scheduler.watch(self._process, self._on_answer)
        self._tick()

    def _tick(self) -> None:
        """A loop that was kept from running may have missed some instants."""
        now = self._index()
        for index in range(max(self._noted + 1, now - math.ceil(STALE_S / self._period_s)), now + 1):
            self._note(index * self._period_s)
        self._noted = now
        self._ask_next()
        self._scheduler.call_at((self._index() + 1) * self._period_s, self._tick)

    def _note(self, t_s: float) -> None:
        """Keep the force of a sample instant that is past, if it is known and newer than the one kept."""
        if not self._last_s < t_s <= self._scheduler.monotonic_s():
            return
        known = self._known_at(t_s)
        if known is not None:
            self._last_n, self._last_s, self._too_late = known, t_s, False

    def _samples_ahead(self) -> int:
        """How many samples from now the answer to what is asked now will be there, as the last one was."""
        self._asked_s = self._scheduler.monotonic_s()
        return self._took

    def _index(self) -> int:
        return sample_at(self._scheduler.monotonic_s(), self._period_s)

    def _on_answer(self) -> None:
        took_s = min(self._scheduler.monotonic_s() - self._asked_s, _FARTHEST_S)
        self._took = max(math.ceil(took_s / self._period_s - _ON_GRID), 1)
        try:
            self._take_answer()
        except (EOFError, OSError):
            self._scheduler.unwatch(self._process)
            self.ended = True
            self._complain("the process of the virtual finger has ended")
            self._scheduler.stop()
            return
        self._ask_next()

    def _solved(self, solve_s: float, problem: str) -> None:
        self.statistics.solved += 1
        self.statistics.slowest_s = max(self.statistics.slowest_s, solve_s)
        if problem and not self._troubled:
            self._complain(problem)
        self._troubled = bool(problem)
