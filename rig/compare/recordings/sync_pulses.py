"""The clock of an amplifier, from the run's sync pulses in its recording.

A recording may have pulses that the run did not make, such as one at switch-on, may miss some, or may have both
edges. The pulses are therefore matched by their times, and what has no partner is reported.
"""

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.spike_times import Array, SpikeClock, UnitSpikes, UnpairedPulses, joined
from rig_shared.plural import number_of

NO_PULSES = "none"
"""Name that states that a file has no sync pulses."""

_SUGGESTIVE = re.compile(r"sync|ttl|puls|trig|dig|strobe|marker|event|barcode", re.IGNORECASE)


def called_like_pulses(name: str) -> bool:
    """Return whether a channel is called as one that may have sync pulses."""
    return _SUGGESTIVE.search(name) is not None


def edges(
    values: NDArray[Any], middle: float, high_before: bool | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers of the samples (n,) at which a line rises beyond a middle level, and falls below it."""
    above = np.asarray(values > middle)
    before = np.concatenate([above[:1] if high_before is None else [high_before], above[:-1]])
    return np.flatnonzero(above & ~before), np.flatnonzero(~above & before)


TOLERANCE_S = 0.005
MOST_DRIFT = 0.01
"""Largest deviation of a clock's rate: the worst oscillators of microcontrollers are within 0.5 %."""

_SEARCHED_DRIFT, _DRIFT_STEP = 1e-3, 2.5e-5  # of a search for partners
_FEWEST_MATCHED = 4  # where some have no partner: three even intervals are found in many series
_MOST_UNMATCHED = 0.1
_MOST_MISSING = 0.5
_ONE_PULSE_S = 0.05  # two edges of one pulse are closer
_MOST_PAIRS = 4_000_000
_ROUNDS = 6


def leading_edges(found: UnitSpikes, width_s: float) -> UnitSpikes:
    """Return the spikes with the times at which their pulses begin.

    A line that is high at rest is inverted: its pulses begin where it falls. `width_s` is that of the run's pulses,
    NaN if unknown; otherwise the line rests at the level at which it is longer.
    """
    if not len(found.end_s):
        return found
    high_s, low_s = _lasts(found.pulse_s, found.end_s), _lasts(found.end_s, found.pulse_s)
    as_wide = [abs(lasts - width_s) <= max(TOLERANCE_S, _AS_WIDE * width_s) for lasts in (high_s, low_s)]
    rests_high = found.line and (math.isnan(high_s) or low_s < high_s)
    if as_wide[1] if as_wide[0] != as_wide[1] else rests_high:
        return replace(found, pulse_s=found.end_s, notes=(*found.notes, _INVERTED))
    return found


def _first_of_both_edges(pulse_s: Array, rises: int, width_s: float) -> Iterator[Array]:
    """Yield what the pulses are if the list has both edges of each, so that about every second gap is one width.

    The width is that of the journal, or, with too many edges for the run's rises, one that the list suggests.
    """
    gaps_s = np.diff(pulse_s)
    own = (gaps_s[::2], gaps_s[1::2]) if len(pulse_s) > _TOO_MANY * rises else ()
    for width in (width_s, *(float(np.median(some)) for some in own if len(some))):
        follows = np.abs(gaps_s - width) <= min(TOLERANCE_S, _AS_WIDE * width)
        if len(gaps_s) and _PAIRED[0] <= follows.mean() <= _PAIRED[1]:
            yield pulse_s[:-1][follows]


def _lasts(begin_s: Array, end_s: Array) -> float:
    """Return the median time from a beginning to the next end, NaN without any."""
    after = np.searchsorted(end_s, begin_s, side="right")
    ended = after < len(end_s)
    return float(np.median(end_s[after[ended]] - begin_s[ended])) if ended.any() else math.nan


_INVERTED = "The line of the pulses is high at rest: a pulse begins where it falls."
_AS_WIDE = 0.2  # of the journal's width
_PAIRED = 0.4, 0.65  # share of gaps that are as wide as a pulse, if both edges are in a file
_TOO_MANY = 1.5  # edges for each rise of the run


class _Match(NamedTuple):
    """A line from the times of the file to those of the run, and the pairs that it joins."""

    slope: float
    offset_s: float
    pulses: NDArray[np.int64]
    rises: NDArray[np.int64]
    worst_s: float

    def unseen_s(self, rise_s: Array) -> tuple[Array, Array]:
        """Return the rises before the first and after the last that has a pulse."""
        return rise_s[: self.rises[0]], rise_s[self.rises[-1] + 1 :]

    def clock_fit(self, pulse_s: Array, rise_s: Array, clock: SpikeClock) -> "ClockFit":
        """Return the clock of the file."""
        others_s = self.slope * np.delete(pulse_s, self.pulses) + self.offset_s
        return ClockFit(self.slope, self.offset_s, self.unseen_s(rise_s), clock, self.rises, others_s)


NO_GAPS = np.empty((0, 2))
_NO_PRESS = str(None)
_RARELY = 0.5  # of the share of the most frequent kind


class Gaps(NamedTuple):
    """Times (n, 2) at which pulses of the run are not in the file, and those at which it has others instead.

    They are infinite before its first pulse and after its last one.
    """

    paused_s: Array
    astray_s: Array


class ClockFit(NamedTuple):
    """The run's time as a line over the file's time.

    `unseen_s` are the times of the run's pulses before the first and after the last that is in the file, infinite if
    the file has no pulses. `rises` are the numbers of the run's pulses that are in the file, None if no gap can be
    told, and `others_s` the file's other pulses.
    """

    slope: float
    offset_s: float
    unseen_s: tuple[Array, Array]
    clock: SpikeClock
    rises: NDArray[np.int64] | None = None
    others_s: Array = np.empty(0)

    def gaps(self, made: Sequence[Mapping[str, Any]], expected: NDArray[np.bool_]) -> "Gaps":
        """Return the times between pulses of the file, and beyond them, at which those of the run are not in it.

        `made` are the run's pulses, ascending, and `expected` (n,) is whether the file may have them. One that is
        missing may be an edge that was lost; two in a row, or all of a press, are a gap. So is one without a press,
        if the file has another pulse instead. A kind of pulse (`at`) that the file rarely has was not recorded.
        """
        if self.rises is None:
            return Gaps(NO_GAPS, NO_GAPS)
        found = np.zeros(len(made), dtype=bool)
        found[self.rises] = True
        at, press = (np.array([str(event.get(key)) for event in made]) for key in ("at", "index"))
        shares = {kind: float(found[at == kind].mean()) for kind in np.unique(at).tolist()}
        kept = expected & np.array([shares[kind] >= _RARELY * max(shares.values()) for kind in at.tolist()])
        lost_press = {one for one in press[kept] if one != _NO_PRESS and not found[kept & (press == one)].any()}
        rise_s = np.array([-math.inf, *(float(event["rise_s"]) for event in made), math.inf])
        paused, astray = list[tuple[float, float]](), list[tuple[float, float]]()
        for first, last in pairwise([-1, *np.flatnonzero(found).tolist(), len(made)]):
            lost = first + 1 + np.flatnonzero(kept[first + 1 : last])
            begin_s, end_s = rise_s[[first + 1, last + 1]].tolist()
            other = bool(((self.others_s > begin_s) & (self.others_s < end_s)).any())
            alone = len(lost) == 1 and press[lost[0]] == _NO_PRESS and other
            if len(lost) > 1 or alone or any(press[n] in lost_press for n in lost):
                (astray if other else paused).append((begin_s, end_s))
        return Gaps(*(np.array(some, dtype=float).reshape(-1, 2) for some in (paused, astray)))

    def unpaired(self, made: Sequence[Mapping[str, Any]], done: Collection[int]) -> UnpairedPulses | None:
        """Return the pulses without a partner, or None if those of the run do not name their presses.

        `made` are the run's pulses, ascending, and `done` its finished presses.
        """
        if any("index" not in event for event in made):
            return None
        found = set(range(len(made)) if self.rises is None else self.rises.tolist())
        missing = tuple((int(one["index"]), str(one.get("at"))) for n, one in enumerate(made) if n not in found)
        heard = {int(made[n]["index"]) for n in found}
        silent = tuple(index for index in sorted(done) if index not in heard)
        return UnpairedPulses(TOLERANCE_S, missing, silent, tuple(np.sort(self.others_s).tolist()))

    def run_s(self, file_s: Array) -> Array:
        """Return times of the file in s since the start of the run."""
        if self.slope == 1.0 and self.offset_s == 0.0:
            return file_s
        return np.asarray(self.slope * file_s + self.offset_s)


NONE_UNSEEN = np.empty(0), np.empty(0)
ALL_UNSEEN = np.array([-np.inf]), np.array([np.inf])


def fitted_clock(
    path: Path, pulse_s: Array, rise_s: Array, width_s: float = math.nan, half_s: Array | float = 0.0
) -> ClockFit:
    """Return the clock by which the pulses of a file (ascending, at least one) are those of the run.

    `width_s` is that of the run's pulses: it tells the edges of a file that has both of each pulse. `half_s` is half
    the uncertainty of each rise, which lies between its request and its confirmation at `rise_s`: its middle counts.

    Raises
    ------
    RecordingError
        If the pulses are not the run's, could be several of them, or drift more than a clock can.
    """
    if np.array_equal(pulse_s, rise_s):
        text = "Times are the run's: the pulses equal those of its journal."
        return ClockFit(1.0, 0.0, NONE_UNSEEN, SpikeClock("run", text, 0.0, 0.0, 0.0))
    rise_s = np.asarray(rise_s - half_s)
    fit = _fitted(path, pulse_s, rise_s, width_s)
    known_ms = 1e3 * float(np.max(half_s, initial=0.0))
    if not known_ms:
        return fit
    text = f"{fit.clock.text} The run knows its rises to ± {known_ms:.2g} ms."
    return fit._replace(clock=fit.clock._replace(text=text, known_ms=known_ms))


def _fitted(path: Path, pulse_s: Array, rise_s: Array, width_s: float) -> ClockFit:
    if len(pulse_s) == len(rise_s) == 1:
        at_start_s = float(pulse_s[0] - rise_s[0])
        text = (
            f"By a single pulse, the file's clock reads {at_start_s:.3f} s at the start of the run; its drift is "
            "unknown."
        )
        return ClockFit(1.0, -at_start_s, NONE_UNSEEN, SpikeClock("pulses", text, at_start_s=at_start_s))
    both = () if _every(pulse_s, rise_s) is not None else _first_of_both_edges(pulse_s, len(rise_s), width_s)
    for first_s in both:
        if (found := _matched(path, first_s, rise_s)) is not None and abs(found.slope - 1) <= MOST_DRIFT:
            about = _described(found, first_s, rise_s)
            about = about._replace(text=f"{about.text} Both edges of the pulses are in the file; the first counts.")
            return found.clock_fit(first_s, rise_s, about)
    found = _matched(path, pulse_s, rise_s)
    if found is None:
        raise _not_the_runs(path, pulse_s, rise_s)
    if abs(found.slope - 1) > MOST_DRIFT:
        raise _no_clock(path, found.slope)
    about = _described(found, pulse_s, rise_s)
    lasts = "" if math.isnan(width_s) else f", which last {width_s:g} s"
    about = about._replace(text=f"{about.text} The pulses are taken as the beginnings of those of the run{lasts}.")
    return found.clock_fit(pulse_s, rise_s, about)


def _matched(path: Path, pulse_s: Array, rise_s: Array) -> _Match | None:
    return _every(pulse_s, rise_s) or _searched(path, pulse_s, rise_s)


def _every(pulse_s: Array, rise_s: Array) -> _Match | None:
    """Return the match of as many pulses as rises, or None if they are others."""
    every = _line(pulse_s, rise_s) if len(pulse_s) == len(rise_s) else None
    return every if every is not None and every.worst_s <= TOLERANCE_S else None


def _line(pulse_s: Array, rise_s: Array) -> _Match:
    """Fit a line to as many pulses as rises; an offset if all are at one time."""
    middle, every = float(pulse_s.mean()), np.arange(len(pulse_s))
    spread = float(((pulse_s - middle) ** 2).sum())
    slope = float(((pulse_s - middle) * (rise_s - rise_s.mean())).sum()) / spread if spread > 0 else 1.0
    offset_s = float(rise_s.mean()) - slope * middle
    left = rise_s - slope * (pulse_s - middle) - rise_s.mean()
    return _Match(slope, offset_s, every, every, float(np.abs(left).max()))


def _searched(path: Path, pulse_s: Array, rise_s: Array) -> _Match | None:
    """Return the match that joins the most pulses, or None; refuse several that are as good."""
    if len(pulse_s) * len(rise_s) > _MOST_PAIRS or min(len(pulse_s), len(rise_s)) < _FEWEST_MATCHED:
        return None
    matches = [_refined(pulse_s, rise_s, 1.0 + drift, offset_s) for drift, offset_s in _lines(pulse_s, rise_s)]
    found = sorted((one for one in matches if one is not None), key=lambda one: (-len(one.pulses), one.worst_s))
    fewest = min(len(pulse_s), len(rise_s))
    enough = max(_FEWEST_MATCHED, fewest - max(1, int(_MOST_UNMATCHED * fewest)))
    if not found or len(found[0].pulses) < enough:
        return None
    best = found[0]
    for other in (one for one in found[1:] if len(one.pulses) == len(best.pulses)):
        apart_s = float(rise_s[other.rises[0]] - rise_s[best.rises[0]]) - float(
            pulse_s[other.pulses[0]] - pulse_s[best.pulses[0]]
        )
        if abs(apart_s) > _ONE_PULSE_S:
            raise RecordingError(
                f"{path}: the {len(pulse_s)} sync pulses fit the {len(rise_s)} of the run's journal at several "
                "places; export all pulses of the run",
                "pulses_fit_twice",
            )
        if apart_s > TOLERANCE_S:  # the later time of the run belongs to the earlier edge in the file
            best = other
    return best


def _lines(pulse_s: Array, rise_s: Array) -> list[tuple[float, float]]:
    """Return drifts and offsets at which many pairs of a pulse and a rise lie on one line, best first."""
    middle = float(pulse_s.mean())
    span_s = float(np.ptp(pulse_s))
    pulse_s = pulse_s[:: -(-len(pulse_s) // _MOST_VOTING)]
    wide_s = 2 * TOLERANCE_S + _DRIFT_STEP * span_s
    found = []
    for drift in np.arange(-_SEARCHED_DRIFT, _SEARCHED_DRIFT + _DRIFT_STEP / 2, _DRIFT_STEP):
        apart = np.sort((rise_s[:, None] - (1 + drift) * (pulse_s - middle)[None, :]).ravel())
        votes = np.searchsorted(apart, apart + wide_s, side="right") - np.arange(len(apart))
        taken: list[float] = []
        for at in np.argsort(-votes, kind="stable")[: 50 * _KEPT]:
            if len(taken) < _KEPT and all(abs(apart[at] - other) > wide_s for other in taken):
                taken.append(float(apart[at]))
                inside = apart[at : at + votes[at]]
                found.append((int(votes[at]), float(drift), float(np.median(inside)) - (1 + float(drift)) * middle))
    found.sort(key=lambda one: -one[0])
    return [(drift, offset_s) for _, drift, offset_s in found[:_TRIED]]


_KEPT, _TRIED, _MOST_VOTING = 4, 60, 300


def _refined(pulse_s: Array, rise_s: Array, slope: float, offset_s: float) -> _Match | None:
    """Join each rise with the nearest pulse, and refit, until the line joins no more."""
    within_s = 4 * TOLERANCE_S + _DRIFT_STEP * float(np.ptp(pulse_s))
    best: _Match | None = None
    for _ in range(_ROUNDS):
        told = slope * pulse_s + offset_s
        after = np.clip(np.searchsorted(told, rise_s), 1, max(len(told) - 1, 1))
        near = np.where(np.abs(told[after - 1] - rise_s) <= np.abs(told[after] - rise_s), after - 1, after)
        rises = np.flatnonzero(np.abs(told[near] - rise_s) <= within_s)
        pulses, first = np.unique(near[rises], return_index=True)
        rises = rises[first]
        if len(pulses) < _FEWEST_MATCHED:
            return best
        line = _line(pulse_s[pulses], rise_s[rises])
        slope, offset_s = line.slope, line.offset_s
        if line.worst_s <= TOLERANCE_S and (best is None or len(pulses) >= len(best.pulses)):
            best = _Match(slope, offset_s, pulses, rises, line.worst_s)
        within_s = max(within_s / 2, TOLERANCE_S)
    return best


def _not_the_runs(path: Path, pulse_s: Array, rise_s: Array) -> RecordingError:
    if len(pulse_s) != len(rise_s):
        remedy = (
            ", and their intervals do not match"
            if len(rise_s)
            else "; if times are its t_s, remove the pulses from a CSV, or use --columns sync=none"
        )
        return RecordingError(
            f"{path}: {len(pulse_s)} sync pulses, but the run's journal has {len(rise_s)}{remedy}", "number_of_pulses"
        )
    return RecordingError(
        f"{path}: the sync pulses differ from the journal's by up to "
        f"{1000.0 * _line(pulse_s, rise_s).worst_s:.1f} ms; at most {1000.0 * TOLERANCE_S:g} ms is allowed",
        "pulses_apart",
    )


_UNITS_BY_SLOPE = {"ms": 1e-3, "us": 1e-6, "min": 60.0}


def _no_clock(path: Path, slope: float) -> RecordingError:
    unit = next((unit for unit, factor in _UNITS_BY_SLOPE.items() if abs(slope / factor - 1) <= MOST_DRIFT), "")
    remedy = (
        f"state their unit: --columns sync=NAME:{unit} (in a CSV time=COLUMN:{unit})"
        if unit
        else "check the unit and the sampling rate of the pulses"
    )
    return RecordingError(
        f"{path}: between sync pulses the run's clock advances {slope:.6g} times as much as the file's; a clock "
        f"deviates by at most {100 * MOST_DRIFT:g} %; {remedy}",
        "no_clock",
    )


def _described(found: _Match, pulse_s: Array, rise_s: Array) -> SpikeClock:
    extra, missing = len(pulse_s) - len(found.pulses), len(rise_s) - len(found.rises)
    besides = [
        *([f"{number_of(extra, 'times')} in the file without a pulse of the run"] if extra else []),
        *([f"{number_of(missing, 'pulses')} of the run not in the file"] if missing else []),
    ]
    drift_ppm, worst_ms = 1e6 * (1 / found.slope - 1), 1e3 * found.worst_s
    at_start_s = round(-found.offset_s / found.slope, 6) + 0.0
    pace = f"{abs(drift_ppm):.0f} ppm {'fast' if drift_ppm >= 0 else 'slow'}"
    text = (
        f"{number_of(len(found.pulses), 'sync pulses')} of the run were found in the file: its clock is {pace} and "
        f"reads {at_start_s:.3f} s at the start of the run, and no pulse is off by more than "
        f"{max(worst_ms, 0.01):.2g} ms{'; ' if besides else ''}{joined(besides)}."
    )
    if len(found.rises) <= _MOST_MISSING * len(rise_s):
        text += (
            f" These are {len(found.rises)} of the {len(rise_s)} pulses of the run: they may be other events, such "
            "as trials, and spikes may be counted in the wrong windows; check which channel has the sync pulses."
        )
    return SpikeClock("pulses", text, drift_ppm, worst_ms, at_start_s)
