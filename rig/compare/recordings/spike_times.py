"""Spike times of one unit, the intervals in which it was observed, and whose clock tells them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError

Array = NDArray[np.float64]

_TICK_S = 1e-6


ClockSource = Literal["pulses", "run", "stated", "assumed"]


class UnpairedPulses(NamedTuple):
    """Pulses of the run and of the file without a partner within the tolerance (s), and presses without any.

    `missing` are the press and the event of each pulse of the run that is not in the file; `presses` are finished
    presses of which the file has no pulse, or for which the run sent none; `others_s` are the file's other pulses, in
    s since the start of the run.
    """

    tolerance_s: float
    missing: tuple[tuple[int, str], ...]
    presses: tuple[int, ...]
    others_s: tuple[float, ...]


class SpikeClock(NamedTuple):
    """Clock of the spike times, and why the program takes them for times of the run.

    `source`: "pulses" were matched; the file is on the clock of the "run", or is "stated" to be; "assumed": nothing
    in the file tells. `drift_ppm` and `worst_ms` describe the pulses, and `at_start_s` is the file's time at
    the start of the run; NaN without pulses. `unpaired` is None without pulses, or where they do not name presses.
    `known_ms` is half the largest uncertainty of a rise in the journal, NaN if it states none.
    """

    source: ClockSource
    text: str
    drift_ppm: float = np.nan
    worst_ms: float = np.nan
    at_start_s: float = np.nan
    unpaired: UnpairedPulses | None = None
    known_ms: float = np.nan


THROUGHOUT = np.array([[-np.inf, np.inf]])
_UNTOLD = SpikeClock(
    "assumed", "Times are taken as those of the run's journal (t_s); nothing in the file confirms it."
)


class FileIntervals(NamedTuple):
    """Intervals (n, 2) of a file, in s of its clock: its name for them, and what it has beside them.

    `excluded`: presses there do not count; else the intervals are not used. `unit_option` states their unit of time,
    as --columns invalid=NAME, "" if it is stated, or known.
    """

    name: str
    spans_s: Array
    excluded: bool = False
    about: tuple[str, ...] = ()
    unit_option: str = ""


@dataclass(frozen=True)
class UnitSpikes:
    """What a file has of one unit, in s of the file's clock: every reader returns it.

    `unit` is the name by which it was chosen, "" for the only one. Spikes are in the order of the file; pulses
    ascend. `pulse_s` are the rises of the pulses, or all edges if the file does not tell them apart; `end_s` are
    their falls, and `line` is whether both are of a line with two levels. `observed_s` (n, 2) are the intervals in
    which the file says that the unit was observed, infinite where it does not say when they begin or end;
    `throughout` is whether the user states that these reach over the whole run. `of_run` is whether the file was
    exported from the run; `stated` is whether the user states that there are no pulses. `file_s` are times at which
    the file recorded anything, as the first and last spike of its other units, and `fired_s` those at which any unit
    fired. `intervals` are others than those of observation, or were taken out of them. `notes` are sentences for the
    page, and `read_as` says what was read, in which unit.
    """

    path: Path
    unit: str
    spike_s: Array
    pulse_s: Array
    observed_s: Array = field(default_factory=THROUGHOUT.copy)
    throughout: bool = False
    of_run: bool = False
    stated: bool = False
    notes: tuple[str, ...] = ()
    end_s: Array = field(default_factory=lambda: np.empty(0))
    line: bool = False
    read_as: str = ""
    file_s: Array = field(default_factory=lambda: np.empty(0))
    fired_s: Array = field(default_factory=lambda: np.empty(0))
    intervals: tuple[FileIntervals, ...] = ()

    @property
    def where(self) -> str:
        """The file and the unit that was chosen."""
        return f"{self.path}#{self.unit}" if self.unit else str(self.path)

    def noted(self, *notes: str) -> "UnitSpikes":
        """Return the spikes with more sentences; empty ones do not count."""
        return replace(self, notes=(*self.notes, *filter(None, notes)))


@dataclass(frozen=True)
class SpikeTimes:
    """Spikes of one unit in s since the start of the run, ascending.

    `observed_s` (n, 2) are the intervals in which the file says that the unit was observed, infinite where it does
    not say when they begin or end. There, and where they have pulses of the run that are not in the file,
    `events_s`, from the first to the last event of the file, limits them, and a press that it touches counts.
    """

    spike_s: Array
    observed_s: Array = field(default_factory=THROUGHOUT.copy)
    events_s: tuple[float, float] = (-np.inf, np.inf)
    clock: SpikeClock = _UNTOLD
    notes: tuple[str, ...] = ()
    read_as: str = ""

    def observed(self, begin_s: float, end_s: float) -> bool:
        """Return whether the unit was observed in a window."""
        first, last = self.observed_s.T
        inside = (first <= begin_s + _TICK_S) & (end_s <= last + _TICK_S)
        return bool(inside.any()) and self.events_s[0] <= end_s and begin_s <= self.events_s[1]

    def shifted(self, shift_s: float) -> "SpikeTimes":
        """Return the spikes as they were if the clock of the file told a time later by `shift_s`."""
        first_s, last_s = self.events_s
        return replace(
            self,
            spike_s=self.spike_s + shift_s,
            observed_s=self.observed_s + shift_s,
            events_s=(first_s + shift_s, last_s + shift_s),
        )

    @property
    def _at_one_event(self) -> bool:
        at_s, last_s = self.events_s
        first, last = self.observed_s.T
        return at_s == last_s and bool(((first <= at_s) & (at_s <= last)).any())

    @property
    def span(self) -> str:
        """The intervals, as a clause."""
        known_s = both(self.observed_s, np.array([self.events_s]))
        spans = " and ".join(f"{_at(first)} to {_at(last)}" for first, last in known_s[:_MOST_SPANS].tolist())
        spans = "from " + spans + f" and {len(known_s) - _MOST_SPANS} more" * (len(known_s) > _MOST_SPANS)
        if not len(known_s) and self._at_one_event:
            known_s, spans = np.array([self.events_s]), f"at {_at(self.events_s[0])}"
        if not len(known_s):
            return "the unit was never observed"
        if np.isinf(known_s).all() and len(known_s) == 1:
            return "the unit was observed throughout"
        if np.isinf(self.events_s).all():
            return f"the unit was observed {spans}"
        throughout = "if throughout the run, use --columns observed=throughout"
        if np.isinf(self.observed_s).all() and len(self.observed_s) == 1:
            return f"the file has events {spans}, and does not state how long it recorded; {throughout}"
        return f"the unit was observed {spans}, as its intervals state and its events show; {throughout}"


_MOST_SPANS = 4


def _at(time_s: float) -> str:
    return f"{time_s:.1f} s" if np.isfinite(time_s) else "the start" if time_s < 0 else "the end"


def are_inside(spans: Array, times: Array) -> NDArray[np.bool_]:
    """Return whether times (m,) lie in intervals (n, 2), ends included."""
    first, last = union(spans).T
    return np.searchsorted(first, times, side="right") > np.searchsorted(last, times, side="left")


def extent(*times_s: Array) -> Array:
    """Return the first and the last of some times, none of none; times that are no numbers do not count."""
    finite = [some[np.isfinite(some)] for some in times_s]
    return np.array([(some.min(), some.max()) for some in finite if len(some)]).ravel()


def union(spans: Array) -> Array:
    """Return intervals (n, 2) sorted, with those that touch joined and empty ones left out."""
    joined: list[list[float]] = []
    for first, last in spans[np.argsort(spans[:, 0], kind="stable")].tolist():
        if joined and first <= joined[-1][1] + _TICK_S:
            joined[-1][1] = max(joined[-1][1], last)
        elif last > first:
            joined.append([first, last])
    return np.array(joined, dtype=float).reshape(-1, 2)


def without(spans: Array, gaps: Array) -> Array:
    """Return intervals (n, 2) minus others (m, 2)."""
    for begin, end in gaps.tolist():
        before = np.column_stack([spans[:, 0], np.minimum(spans[:, 1], begin)])
        after = np.column_stack([np.maximum(spans[:, 0], end), spans[:, 1]])
        both = np.concatenate([before, after])
        spans = both[both[:, 1] > both[:, 0]]
    return union(spans)


def both(spans: Array, others: Array) -> Array:
    """Return what two lists of intervals (n, 2), (m, 2) share."""
    return union(np.array([(max(a, c), min(b, d)) for a, b in spans for c, d in others]).reshape(-1, 2))


def joined(words: Sequence[str]) -> str:
    """Return words with commas, and "and" before the last."""
    return " and ".join(part for part in (", ".join(words[:-1]), *words[-1:]) if part)


def no_such_unit(path: Path, unit: str, units: str, choices: str, file: str = "") -> RecordingError:
    """Return the error for a unit that is not there, or for a choice that is missing among several `units`."""
    problem = f"there is no unit {unit}" if unit else units
    return RecordingError(
        f"{path}: {problem}; use SHAPE={file or path.name}#UNIT with UNIT one of {choices}",
        "no_unit" if unit else "several_units",
    )


def no_observed(path: Path, name: str, problem: str) -> RecordingError:
    """Return the error for a role `observed` that a file cannot have."""
    return RecordingError(f"{path}: --columns observed={name} cannot be used: {problem}", "no_observed")
