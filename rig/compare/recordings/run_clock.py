"""Spikes of a file, and the times at which it was observed, on the clock of the run."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.spike_checks import RUN_CHECKS
from rig.compare.recordings.spike_times import (
    Array,
    SpikeClock,
    SpikeTimes,
    UnitSpikes,
    are_inside,
    joined,
    no_observed,
    without,
)
from rig.compare.recordings.sync_pulses import ALL_UNSEEN, NO_GAPS, ClockFit, Gaps, fitted_clock
from rig.data import Run

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
    pulsed = len(found.pulse_s) > 0
    fit = fitted_clock(found.path, found.pulse_s, rise_s, width_s(run)) if pulsed else _without_pulses(found, made)
    spike_s, observed_s = fit.run_s(found.spike_s), fit.run_s(found.observed_s)
    found = found.noted(*(check(found, spike_s, run.end_s) for check in RUN_CHECKS))
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
        fit.clock,
        found.noted(_MORE_THAN_PULSES * stated, *contradicted).notes,
        found.read_as,
    )


def _open_ends(spans_s: Array) -> _Ends:
    return _Ends(bool(np.isneginf(spans_s).any()), bool(np.isposinf(spans_s).any()))


def width_s(run: Run) -> float:
    """Return the width of the run's pulses, NaN if its journal does not state it."""
    widths = [float(event["width_s"]) for event in run.stream("sync") if event.get("width_s") is not None]
    return float(np.median(widths)) if widths else np.nan


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
