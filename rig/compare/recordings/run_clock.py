"""Spikes of a file, and the times at which it was observed, on the clock of the run."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.spike_checks import RUN_CHECKS
from rig.compare.recordings.spike_times import (
    Array,
    FileIntervals,
    SpikeClock,
    SpikeTimes,
    UnitSpikes,
    are_inside,
    extent,
    joined,
    no_observed,
    without,
)
from rig.compare.recordings.sync_pulses import ALL_UNSEEN, NO_GAPS, ClockFit, Gaps, fitted_clock
from rig.data import Run
from rig_shared.plural import number_of

_OF_RUN = SpikeClock("run", "Times are the run's: the file was exported from it.")
_STATED = SpikeClock("stated", "Times are those of the run's journal (t_s), as sync=none states.")
_MORE_THAN_PULSES = (
    "The file states that the unit was observed at times whose sync pulses are not in it, before its first or after "
    "its last event: a press at these times counts as not observed."
)
_MOST_LISTED = 4


class _Ends(NamedTuple):
    """Something that may hold before the first event of a file, and after its last one."""

    before: bool
    after: bool


def on_the_runs_clock(found: UnitSpikes, run: Run) -> SpikeTimes:
    """Return the spikes in s since the start of the run, and when the unit was observed. Raises RecordingError."""
    made = sorted(run.stream("sync"), key=lambda event: float(event["rise_s"]))
    rise_s = np.array([event["rise_s"] for event in made], dtype=float)
    half_s = np.array([event.get("uncertainty_s") or 0.0 for event in made], dtype=float) / 2
    pulsed = len(found.pulse_s) > 0
    if pulsed:
        fit = fitted_clock(found.path, found.pulse_s, rise_s, width_s(run), half_s)
    else:
        fit = _without_pulses(found, made)
    spike_s, observed_s = fit.run_s(found.spike_s), fit.run_s(found.observed_s)
    found = found.noted(*(check(found, spike_s, run.end_s) for check in RUN_CHECKS))
    holds_s = _holds(run)
    found = found.noted(*_of_intervals(found, fit, holds_s, run.end_s), *_of_silence(found, fit, spike_s, holds_s))
    every_s = np.concatenate([spike_s, fit.run_s(found.pulse_s), fit.run_s(found.file_s)])
    gaps = fit.gaps(made, are_inside(observed_s, rise_s))
    beyond = _Ends(*(
        bool(are_inside(observed_s, some).any()) and len(every_s) > 0 and not is_gap
        for some, is_gap in zip(fit.unseen_s, _open_ends(gaps.paused_s), strict=True)
    ))  # fmt: skip
    contradicted = _contradicted(found.throughout, any(beyond), gaps, observed_s)
    if found.throughout:
        if not any((*_open_ends(observed_s), *beyond, len(gaps.paused_s) > 0)):
            raise no_observed(found.path, "throughout", "the file states when the unit was observed")
        beyond, gaps = _Ends(False, False), gaps._replace(paused_s=NO_GAPS)
    is_open = _open_ends(observed_s)
    stated = (beyond.before and not is_open.before) or (beyond.after and not is_open.after)
    return SpikeTimes(
        spike_s,
        without(observed_s, np.concatenate(gaps)),
        (float(every_s.min()) if beyond.before else -np.inf, float(every_s.max()) if beyond.after else np.inf),
        _with_unpaired(fit, made, run) if pulsed else fit.clock,
        found.noted(_MORE_THAN_PULSES * stated, *contradicted).notes,
        found.read_as,
    )


def _open_ends(spans_s: Array) -> _Ends:
    return _Ends(bool(np.isneginf(spans_s).any()), bool(np.isposinf(spans_s).any()))


def width_s(run: Run) -> float:
    """Return the width of the run's pulses, NaN if its journal does not state it."""
    widths = [float(event["width_s"]) for event in run.stream("sync") if event.get("width_s") is not None]
    return float(np.median(widths)) if widths else np.nan


def _with_unpaired(fit: ClockFit, made: Sequence[Mapping[str, Any]], run: Run) -> SpikeClock:
    """Return the clock with a sentence on the presses and the pulses that have no partner."""
    unpaired = fit.unpaired(made, run.done.keys())
    if unpaired is None:
        return fit.clock
    within = f"within {1000 * unpaired.tolerance_s:g} ms"
    partly = [f"{press} ({at})" for press, at in unpaired.missing if press not in unpaired.presses]
    said = [
        *([f"of {_few('press', partly)} a pulse is missing"] if partly else []),
        *([f"{_few('press', unpaired.presses)} without any pulse"] if unpaired.presses else []),
        *([f"pulses without a press at {_few('', [f'{t:.3f}' for t in unpaired.others_s])} s"]
          if unpaired.others_s else []),
    ]  # fmt: skip
    text = f"In the file, {within}: {'; '.join(said)}." if said else f"Every press has its pulses, {within}."
    return fit.clock._replace(text=f"{fit.clock.text} {text}", unpaired=unpaired)


def _few(noun: str, each: Sequence[object]) -> str:
    more = [f"{len(each) - _MOST_LISTED} more"] if len(each) > _MOST_LISTED else []
    named = joined([*map(str, each[:_MOST_LISTED]), *more])
    return f"{noun}{'' if len(each) == 1 else 'es'} {named}" if noun else named


def _without_pulses(found: UnitSpikes, made: Sequence[object]) -> ClockFit:
    if made and not (found.of_run or found.stated):
        raise RecordingError(
            f"{found.path}: has no sync pulses, but the run made {len(made)}; export them with the spikes (in a CSV "
            "as rows of kind sync), or, if times are those of the run's journal (t_s), use --columns sync=none",
            "no_pulses_in_file",
        )
    clock = _OF_RUN if found.of_run else _STATED if found.stated else SpikeTimes(found.spike_s).clock
    return ClockFit(1.0, 0.0, ALL_UNSEEN, clock)


def _contradicted(throughout: bool, beyond: bool, gaps: Gaps, observed_s: Array) -> list[str]:
    """Return sentences on times at which the file has fewer pulses than the run; none without them."""
    stated = len(observed_s) != 1 or bool(np.isfinite(observed_s).any())
    said = []
    if throughout and (beyond or len(gaps.paused_s)):
        where = f": {_spans_text(gaps.paused_s)}" if len(gaps.paused_s) else ""
        said.append(
            "The file has fewer pulses than the run, but presses count as observed, as observed=throughout states"
            f"{where}."
        )
    elif len(gaps.paused_s):
        although = ", although it states that the unit was observed" * stated
        said.append(
            f"{_spans_text(gaps.paused_s).capitalize()} of the run, the file has fewer pulses than the run, as if "
            f"the recorder had paused{although}: presses there count as not observed. If it recorded there, use "
            "--columns observed=throughout."
        )
    if len(gaps.astray_s):
        said.append(
            f"{_spans_text(gaps.astray_s).capitalize()} of the run, its pulses and those of the file do not fit one "
            "another, as if the recorder had lost data or its clock had wandered: presses there count as not "
            "observed."
        )
    return said


def _spans_text(spans_s: Array) -> str:
    each = [
        f"before {last:.1f} s" if np.isinf(first) else f"after {first:.1f} s" if np.isinf(last)
        else f"between {first:.1f} and {last:.1f} s"
        for first, last in spans_s[:_MOST_LISTED].tolist()
    ]  # fmt: skip
    more = [f"{len(spans_s) - _MOST_LISTED} more times"] if len(spans_s) > _MOST_LISTED else []
    return joined([*each, *more])


def _holds(run: Run) -> Array:
    """Return the beginning and the end of every hold (n, 2) of a run, in s."""
    began = {(event["index"], event["hold"]): float(event["t_s"]) for event in run.stream("hold_start")}
    ended = {(event["index"], event["hold"]): float(event["t_s"]) for event in run.stream("hold_end")}
    return np.array([(began[key], ended[key]) for key in began if key in ended]).reshape(-1, 2)


def _touched(spans_s: Array, holds_s: Array) -> NDArray[np.bool_]:
    """Return which of n intervals touch which of m holds (n, m)."""
    return np.asarray((spans_s[:, :1] < holds_s[:, 1]) & (holds_s[:, 0] < spans_s[:, 1:]))


def _of_intervals(found: UnitSpikes, fit: ClockFit, holds_s: Array, end_s: float) -> list[str]:
    """Return sentences on intervals that leave out no press, and on those that are not used."""
    inner_s = found.observed_s[np.argsort(found.observed_s[:, 0])]
    gaps_s = np.column_stack([inner_s[:-1, 1], inner_s[1:, 0]])
    stated_s = [one.spans_s for one in found.intervals if one.excluded]
    gaps_s = gaps_s[~_touched(gaps_s, np.concatenate([np.empty((0, 2)), *stated_s])).any(axis=1)]
    said, unused = [], []
    for one in (*found.intervals, FileIntervals("", gaps_s, excluded=True)):
        if not len(one.spans_s):
            continue
        run_s = fit.run_s(one.spans_s)
        touched = _touched(run_s, holds_s)
        if one.excluded:
            _refuse_other_unit(found, one, fit, holds_s)
            said += _idle(one.name, run_s, touched, end_s)
        else:
            during = f"during {number_of(int(touched.any(axis=0).sum()), 'presses')}"
            about = [number_of(len(run_s), "intervals"), *one.about, _range_text(run_s), during]
            unused.append(f"{one.name} ({', '.join(about)})")
    is_one = len(unused) == 1 and all(len(one.spans_s) == 1 for one in found.intervals if not one.excluded)
    return [*said, *([_NOT_USED.format(joined(unused), "is" if is_one else "are")] if unused else [])]


_NOT_USED = (
    "The file's {} {} not used: presses are those of the run's journal. If they mark presses that do not count, "
    "leave these out of the times at which the unit was observed."
)


def _idle(name: str, run_s: Array, touched: NDArray[np.bool_], end_s: float) -> list[str]:
    """Return a sentence on the excluded intervals (n, 2) that touch no hold."""
    idle_s = run_s[~touched.any(axis=1)]
    if not len(idle_s):
        return []
    kind = f"intervals of {name}" if name else "gaps in the times at which the unit was observed"
    count = number_of(len(run_s), kind) if len(idle_s) == len(run_s) else f"{len(idle_s)} of {len(run_s)} {kind}"
    leave, they, lie = ("leaves", "it", "lies") if len(idle_s) == 1 else ("leave", "they", "lie")
    outside = bool(((idle_s[:, 1] <= 0) | (idle_s[:, 0] >= end_s)).all())
    where = f"outside the run (0 to {end_s:.1f} s)" if outside else "between presses, or outside the run"
    return [f"{count} ({_range_text(idle_s)}) {leave} out no press: {they} {lie} {where}."]


def _range_text(run_s: Array) -> str:
    first, last = f"{run_s.min():.1f}".removesuffix(".0"), f"{run_s.max():.1f}".removesuffix(".0")
    return f"{first} to {last} s of the run" if first != last else f"{first} s of the run"


_OTHER_UNITS = {"ms": 1e-3, "min": 60.0}


def _refuse_other_unit(found: UnitSpikes, one: FileIntervals, fit: ClockFit, holds_s: Array) -> None:
    """Refuse excluded intervals that lie outside the recording, and in another unit of time inside it."""
    recorded_s = extent(found.spike_s, found.pulse_s, found.file_s)
    if not one.unit_option or not len(recorded_s) or _touched(fit.run_s(one.spans_s), holds_s).any():
        return
    first_s, last_s = float(recorded_s.min()), float(recorded_s.max())
    if one.spans_s.min() >= first_s and one.spans_s.max() <= last_s:
        return
    for unit, factor in _OTHER_UNITS.items():
        spans_s = factor * one.spans_s
        inside = min(0.0, first_s) < spans_s.min() and spans_s.max() <= last_s
        presses = int(_touched(fit.run_s(spans_s), holds_s).any(axis=0).sum())
        if inside and presses:
            raise RecordingError(
                f"{found.path}, intervals/{one.name}: {one.spans_s.min():g} to {one.spans_s.max():g} s do not lie in "
                f"the recording ({first_s:g} to {last_s:g} s) and leave out no press; in {unit} they would leave out "
                f"{presses}: if they are in {unit}, use {one.unit_option}:{unit} (in s: "
                f"{one.unit_option.removeprefix('--columns ')}:s)",
                "beyond_a_finger",
            )


def _of_silence(found: UnitSpikes, fit: ClockFit, spike_s: Array, holds_s: Array) -> list[str]:
    """Return sentences on a unit that falls silent while others fire, and on a long silence within a hold."""
    said, fired_s = [], fit.run_s(found.fired_s)
    last_s = float(spike_s.max(initial=-np.inf))
    after = int(np.count_nonzero(holds_s[:, 0] > last_s))
    if len(spike_s) and len(fired_s) and after >= _FEWEST_SILENT and fired_s.max() > last_s + _REACH_S:
        said.append(
            f"No spikes of this unit after {last_s:.1f} s of the run, while others of the file continue: "
            f"{number_of(after, 'presses')} may count as silent. If it was lost, state its observed intervals."
        )
    for begin_s, end_s in holds_s.tolist():
        inside_s = spike_s[(spike_s >= begin_s) & (spike_s <= end_s)]
        gaps_s = np.diff(inside_s)
        if len(gaps_s) < _FEWEST_GAPS:
            continue
        longest, next_s = int(gaps_s.argmax()), float(np.sort(gaps_s)[-2])
        if gaps_s[longest] > max(_LONG_GAP_S, _MUCH_LONGER * next_s):
            said.append(
                f"Between {inside_s[longest]:.2f} and {inside_s[longest + 1]:.2f} s of the run, in a hold, no spike, "
                f"{gaps_s[longest] / next_s:.0f} times as long as the next longest interval: if the recorder paused, "
                "leave it out of the times at which the unit was observed."
            )
    more = [f"{len(said) - _MOST_LISTED} more holds have such a silence."] if len(said) > _MOST_LISTED else []
    return [*said[:_MOST_LISTED], *more]


_FEWEST_SILENT, _REACH_S = 2, 1.0
_FEWEST_GAPS, _LONG_GAP_S, _MUCH_LONGER = 9, 0.1, 6.0
