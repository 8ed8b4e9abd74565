"""Interface of a source of counts, and the counts that a run accepts from it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from rig.design.presses import PossiblePress
from rig.errors import CountError
from rig_shared.number_text import read_number


@dataclass(frozen=True)
class MadePress:
    """A press that was just made: its number in the run, from 0, and among the presses that may be chosen.

    `tau` is its planned time from the middle of the session, in units of ten minutes.
    """

    index: int
    possible: int
    press: PossiblePress
    tau: float


class CountSource(Protocol):
    """Source of the spikes counted in the holds of a run.

    A real run asks it in a process of its own, so that a source which blocks or crashes delays no stop. A source of
    your own is a class with these methods, and a function that opens it: `counts=my_module:my_function`.
    """

    def made(self, press: MadePress) -> None:
        """Record that a press was made, whose count is requested next."""

    def new(self) -> Sequence[tuple[Any, Any]]:
        """Return the counts that arrived since the last call, as pairs (number of the press from 0, count).

        Pairs are returned as they came, without a wait; the run checks them. Raises CountError.
        """

    def truth(self) -> Mapping[str, Any] | None:
        """Return the parameters of a virtual nerve, with its `candidate`; None for a recorded nerve."""

    def close(self) -> None:
        """Release the resources of the source."""


class AcceptedCounts:
    """Counts by press: each a whole number, once, and of a press that was made.

    `known` counts, in the journal of a stopped run, may arrive once more.
    """

    def __init__(self, source: CountSource, known: Sequence[int | None] = ()) -> None:
        self.source = source
        self._known = {index: count for index, count in enumerate(known) if count is not None}
        self._found: dict[int, int] = {}

    def look(self, presses: int) -> None:
        """Read the counts that have arrived, given the number of presses made. Raises CountError."""
        for press, count in self.source.new():
            self._take(press, count, presses)

    def count(self, index: int) -> int | None:
        """Return the count of a press, or None if it has not arrived."""
        return self._found.get(index)

    def _take(self, press: Any, count: Any, presses: int) -> None:
        index = _whole(press)
        if index is None:
            raise CountError(
                f"the number of a press {_short(press)}: must be a whole number from 0", "no_press_number"
            )
        if index >= presses:
            made = "no press was finished yet" if not presses else f"the last finished press was {presses - 1}"
            raise CountError(f"a count for press index {index} arrived, but {made}", "press_not_made")
        spikes = _whole(count)
        if spikes is None:
            raise CountError(
                f"the count {_short(count)} of press index {index}: must be a whole number from 0", "bad_count"
            )
        if index in self._found or self._known.get(index, spikes) != spikes:
            before = self._found.get(index, self._known.get(index))
            raise CountError(
                f"two counts for press index {index}, {before} and {spikes}: there must be one", "two_counts"
            )
        self._found[index] = spikes


_MOST = 1_000_000


def _short(value: Any) -> str:
    return repr(value)[:60]


def _whole(value: Any) -> int | None:
    """Return a whole number from 0, or None for any other value."""
    try:
        number = read_number(value) if isinstance(value, str) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool) or not (0 <= number <= _MOST and number == math.floor(number)):
        return None
    return int(number)
