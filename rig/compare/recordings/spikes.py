"""Discharge rates from spike times and a run, and synthetic recordings, which are not data."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import MOST_MM
from rig.compare.recordings.columns import (
    COLUMNS_HINT,
    ColumnMap,
    Row,
    columns_read,
    header_of,
    read_table,
    role_name,
)
from rig.compare.recordings.neo_file import neo_format, read_neo
from rig.compare.recordings.number_cells import label_key
from rig.compare.recordings.nwb_file import is_nwb, read_nwb
from rig.compare.recordings.recording import (
    SAME_PLACE_DECIMALS,
    FromSpikes,
    Recording,
    condition_of,
    recording,
    shape_key,
    with_enough_positions,
)
from rig.compare.recordings.spike_times import (
    SpikeClock,
    SpikeTimes,
    UnitSpikes,
    both,
    extent,
    joined,
    union,
    without,
)
from rig.compare.recordings.summary_rows import refuse_summary_labels
from rig.compare.recordings.sync_pulses import (
    ALL_UNSEEN,
    NO_GAPS,
    NO_PULSES,
    ClockFit,
    Gaps,
    called_like_pulses,
    fitted_clock,
    leading_edges,
)
from rig.compare.stimuli import StimulusRow
from rig.data import Run
from rig.data.folder import replace_text
from rig.data.presses import presses
from rig.printable import either
from rig_shared.natural_order import natural_order
from rig_shared.plural import number_of
from sim.contact.shapes import shape_name
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]


SPIKES = (("time",), ("kind", "unit", "sync", "observed"))
SPIKES_IN_NWB = (("time",), ("sync", "observed"))
SPIKES_IN_NEO: tuple[tuple[str, ...], tuple[str, ...]] = ((), ("sync", "observed", "segment"))
"""Roles of required and of optional columns, by kind of file."""


def read_spike_times(
    path: Path, run: Run, unit: str = "", columns: ColumnMap | None = None, *, may_be_silent: bool = False
) -> SpikeTimes:
    """Return the spikes of a unit on the run's clock, from NWB, a file of a recording system, or a CSV.

    Sync pulses in the file are matched with the run's, which gives the offset and drift of the amplifier's clock.
    Without them, the times must already count from the start of the run. `unit` selects a unit in a file that may
    have several. Raises RecordingError.
    """
    columns = columns or ColumnMap()
    if is_nwb(path):
        found = read_nwb(path, unit, columns, str(run.start.get("uid", "")))
    elif neo_format(path) is not None:
        found = read_neo(path, unit, columns)
    else:
        found = _read_csv(path, columns, unit)
    if not len(found.spike_s) and not may_be_silent:
        raise RecordingError(
            f"{_unit_in(path, unit)}: contains no spikes; at least one spike time is required", "no_spikes"
        )
    if "observed" in columns.named and not is_nwb(path) and not columns.observed_throughout:
        raise _no_observed(path, columns["observed"].name, "it must be throughout (a CSV states intervals in rows of "
                           "kind start and stop)")  # fmt: skip
    found = replace(found, throughout=columns.observed_throughout)
    found = _without_doubles(path, unit, leading_edges(_in_order(found), _width_s(run)))
    times = _on_the_runs_clock(path, found, run)
    _refuse_another_clock(path, found, times, run)
    return times


def _unit_in(path: Path, unit: str) -> str:
    return f"{path}#{unit}" if unit else str(path)


def _in_order(found: UnitSpikes) -> UnitSpikes:
    """Return the spikes in ascending order, with a note if those of the file are in another one."""
    back = np.flatnonzero(np.diff(found.spike_s) < 0)
    if not len(back):
        return found
    before_s, after_s = found.spike_s[back[0] : back[0] + 2].tolist()
    note = (
        f"Spike times are not in ascending order, and were sorted: {after_s:g} s follows after {before_s:g} s"
        f"{f', and {len(back) - 1} more fall' if len(back) > 1 else ''}. If the file has several recordings that "
        "begin anew, give each its own file."
    )
    return replace(found, spike_s=np.sort(found.spike_s), notes=(*found.notes, note))


def _outside_run(file_s: Array, run_s: Array, end_s: float) -> list[str]:
    """Return a sentence on the spikes that lie outside of the run, or have negative times in the file."""
    outside_s = file_s[(run_s < 0) | (run_s > end_s) | (file_s < 0)]
    if not len(outside_s):
        return []
    first, last = float(outside_s[0]), float(outside_s[-1])
    lie, at = ("lies", f"{first:g} s") if len(outside_s) == 1 else ("lie", f"{first:g} to {last:g} s")
    return [f"{len(outside_s)} of {number_of(len(file_s), 'spikes')} {lie} before or after the run, or at a negative "
            f"time of the file ({at})."]  # fmt: skip


def _without_doubles(path: Path, unit: str, found: UnitSpikes) -> UnitSpikes:
    """Return the spikes, with a note on a few that follow another closer than a neuron fires; refuse many."""
    gaps_s = np.diff(found.spike_s)
    same, close = (int(np.count_nonzero(gaps_s < least_s)) for least_s in (_TICK_S, _REFRACTORY_S))
    spikes = len(found.spike_s)
    if same > max(_FEW, _MOST_SAME * spikes) or close > max(_FEW, _MOST_CLOSE * spikes):
        raise RecordingError(
            f"{_unit_in(path, unit)}: {close} of {spikes} spikes come less than {1e3 * _REFRACTORY_S:g} ms after "
            f"another, {same} of them at the same time, which no neuron does; if spikes are in the file twice (a "
            "unit merged with itself, a file appended to itself), delete the copies; if times begin anew in each "
            "trial, export those of the whole recording; if they are rounded, export them with more decimals; else "
            "check their unit of time",
            "spikes_twice",
        )
    _refuse_echoes(path, unit, gaps_s)
    comes = "spike comes" if close == 1 else "spikes come"
    note = f"{close} {comes} less than {1e3 * _REFRACTORY_S:g} ms after another, and all are counted."
    return replace(found, notes=(*found.notes, note)) if close else found


def _refuse_echoes(path: Path, unit: str, gaps_s: Array) -> None:
    """Refuse spikes of which many come less than 2 ms after another with one delay.

    A detector that triggers on both phases of each spike gives such pairs, at the same delay or, if noise moves the
    crossings of the threshold, at nearly the same. A neuron that fires in bursts has intervals that vary more, and
    follow one another.
    """
    short, spikes = gaps_s < _ECHO_S, len(gaps_s) + 1
    beside = np.pad(short, 1)
    paired = short & ~beside[:-2] & ~beside[2:]
    delay_s = float(np.median(gaps_s[short])) if short.any() else 0.0
    most = max(_FEW, _MOST_ECHOES * spikes)
    for some, jitter_s in ((short, _SAME_S), (paired, _JITTER_S)):
        echoes = int(np.count_nonzero(some & (np.abs(gaps_s - delay_s) < jitter_s)))
        if echoes > most:
            raise RecordingError(
                f"{_unit_in(path, unit)}: {echoes} of {spikes} spikes come {1e3 * delay_s:.2f} ms (± "
                f"{1e3 * jitter_s:g} ms) after another, which no neuron does; the detector may have triggered on "
                "both phases of each spike: delete one of the two",
                "spikes_twice",
            )


def _short_intervals(run_s: Array, end_s: float) -> list[str]:
    """Return a sentence on the intervals below 2 ms within the run if they are more than a tenth; none for fewer."""
    gaps_s = np.diff(run_s[(run_s >= 0) & (run_s <= end_s)])
    short = int(np.count_nonzero(gaps_s < _ECHO_S))
    if short <= _MOST_SHORT * len(gaps_s):
        return []
    share = f"{short} of {number_of(len(gaps_s), 'intervals')} between spikes ({100 * short / len(gaps_s):.0f} %)"
    return [f"{share} are shorter than {1e3 * _ECHO_S:g} ms, and all spikes are counted: they may be echoes of a "
            "threshold, of a detector that triggers several times on a spike, or bursts."]  # fmt: skip


_ECHO_S, _SAME_S, _JITTER_S, _MOST_ECHOES, _MOST_SHORT = 2e-3, 2e-5, 1.5e-4, 0.3, 0.1
_REFRACTORY_S = 5e-4
_TICK_S = 1e-6
_FEW, _MOST_SAME, _MOST_CLOSE = 2, 0.01, 0.05


def _no_observed(path: Path, name: str, problem: str) -> RecordingError:
    return RecordingError(f"{path}: --columns observed={name} cannot be used: {problem}", "no_observed")


def _on_the_runs_clock(path: Path, found: UnitSpikes, run: Run) -> SpikeTimes:
    made = sorted(run.stream("sync"), key=lambda event: float(event["rise_s"]))
    rise_s = np.array([event["rise_s"] for event in made], dtype=float)
    if len(found.pulse_s):
        fit = fitted_clock(path, found.pulse_s, rise_s, _width_s(run))
    else:
        fit = _without_pulses(path, found, len(rise_s))
    spike_s = fit.run_s(found.spike_s)
    notes = [*_outside_run(found.spike_s, spike_s, run.end_s), *_short_intervals(spike_s, run.end_s)]
    found = replace(found, notes=(*found.notes, *notes))
    observed_s = fit.run_s(found.observed_s)
    every_s = np.concatenate([spike_s, fit.run_s(found.pulse_s), fit.run_s(found.file_s)])
    is_open = [bool(some.any()) for some in (np.isneginf(observed_s), np.isposinf(observed_s))]
    gaps = fit.gaps(made, _are_inside(observed_s, rise_s))
    is_gap = [bool(some.any()) for some in (np.isneginf(gaps.paused_s), np.isposinf(gaps.paused_s))]
    beyond = [bool(_are_inside(observed_s, some).any()) and len(every_s) > 0 and not gap
              for some, gap in zip(fit.unseen_s, is_gap, strict=True)]  # fmt: skip
    contradicted = _contradicted(found.throughout, any(beyond), gaps, observed_s)
    if found.throughout:
        if not any((*is_open, *beyond, len(gaps.paused_s) > 0)):
            raise _no_observed(path, "throughout", "the file states when the unit was observed")
        beyond, gaps = [False, False], gaps._replace(paused_s=NO_GAPS)
    events_s = float(every_s.min()) if beyond[0] else -np.inf, float(every_s.max()) if beyond[1] else np.inf
    stated = any(one and not left for one, left in zip(beyond, is_open, strict=True)) * (_MORE_THAN_PULSES,)
    every = (*found.notes, *_not_observed(found.spike_s, found.observed_s), *stated, *contradicted)
    observed_s = without(observed_s, np.concatenate(gaps))
    return SpikeTimes(spike_s, observed_s, events_s, fit.clock, every, found.read_as)


def _contradicted(throughout: bool, beyond: bool, gaps: Gaps, observed_s: Array) -> list[str]:
    """Return sentences on times at which the file has fewer pulses than the run; none without them."""
    stated = len(observed_s) != 1 or bool(np.isfinite(observed_s).any())
    said = []
    if throughout and (beyond or len(gaps.paused_s)):
        where = f": {_spans_text(gaps.paused_s)}" if len(gaps.paused_s) else ""
        said.append("The file has fewer pulses than the run, but presses count as observed, as observed=throughout "
                    f"states{where}.")  # fmt: skip
    elif len(gaps.paused_s):
        although = ", although it states that the unit was observed" * stated
        said.append(f"{_capitalized(gaps.paused_s)} of the run, the file has fewer pulses than the run, as if the "
                    f"recorder had paused{although}: presses there count as not observed. If it recorded there, use "
                    "--columns observed=throughout.")  # fmt: skip
    if len(gaps.astray_s):
        said.append(f"{_capitalized(gaps.astray_s)} of the run, its pulses and those of the file do not fit one "
                    "another, as if the recorder had lost data or its clock had wandered: presses there count as not "
                    "observed.")  # fmt: skip
    return said


def _capitalized(spans_s: Array) -> str:
    return _spans_text(spans_s).capitalize()


def _spans_text(spans_s: Array) -> str:
    each = [_span_text(first, last) for first, last in spans_s[:_FEW_LISTED].tolist()]
    more = [f"{len(spans_s) - _FEW_LISTED} more times"] if len(spans_s) > _FEW_LISTED else []
    return joined([*each, *more])


def _span_text(first_s: float, last_s: float) -> str:
    if np.isinf(first_s):
        return f"before {last_s:.1f} s"
    return f"after {first_s:.1f} s" if np.isinf(last_s) else f"between {first_s:.1f} and {last_s:.1f} s"


def _not_observed(spike_s: Array, observed_s: Array) -> list[str]:
    """Return a sentence on the spikes that lie outside of the intervals; none for none."""
    outside = int(np.count_nonzero(~_are_inside(observed_s, spike_s)))
    lie = "lies" if outside == 1 else "lie"
    return [f"{outside} of {number_of(len(spike_s), 'spikes')} {lie} outside of the times at which the unit was "
            "observed."] if outside else []  # fmt: skip


def _are_inside(spans_s: Array, times_s: Array) -> NDArray[np.bool_]:
    first, last = union(spans_s).T
    return np.searchsorted(first, times_s, side="right") > np.searchsorted(last, times_s, side="left")


_MORE_THAN_PULSES = (
    "The file states that the unit was observed at times whose sync pulses are not in it, before its first or after "
    "its last event: a press at these times counts as not observed."
)


def _width_s(run: Run) -> float:
    """Return the width of the run's pulses, NaN if its journal does not state it."""
    widths = [float(event["width_s"]) for event in run.stream("sync") if event.get("width_s") is not None]
    return float(np.median(widths)) if widths else np.nan


_OF_RUN = SpikeClock("run", "Times are the run's: the file was exported from it.")
_STATED = SpikeClock("stated", "Times are those of the run's journal (t_s), as sync=none states.")


def _without_pulses(path: Path, found: UnitSpikes, made: int) -> ClockFit:
    if found.of_run:
        return ClockFit(1.0, 0.0, ALL_UNSEEN, _OF_RUN)
    if found.stated:
        return ClockFit(1.0, 0.0, ALL_UNSEEN, _STATED)
    if made:
        raise RecordingError(
            f"{path}: has no sync pulses, but the run made {made}; export them with the spikes (in a CSV as rows "
            "of kind sync), or, if times are those of the run's journal (t_s), use --columns sync=none",
            "no_pulses_in_file",
        )
    return ClockFit(1.0, 0.0, ALL_UNSEEN, SpikeTimes(found.spike_s).clock)


def _refuse_another_clock(path: Path, found: UnitSpikes, times: SpikeTimes, run: Run) -> None:
    """Refuse spikes that are in another unit of time than the pulses, or that count from another start."""
    spike_s, pulsed = times.spike_s, len(found.pulse_s) > 0
    if not len(spike_s):
        return
    inside = int(np.count_nonzero((spike_s >= 0) & (spike_s <= run.end_s)))
    far = float(np.abs(found.spike_s).max()) > _FAR * float(np.abs(found.pulse_s).max()) if pulsed else True
    if inside >= _LEAST_INSIDE * len(spike_s) or (inside and not far):
        return
    remedy = (
        "the spikes must be in the same unit of time as the pulses, or have theirs in --columns time=COLUMN:ms"
        if pulsed
        else "times must be in s, or have their unit in --columns time=COLUMN:ms, and count from the start of the "
        "run (t_s), or the file must contain its sync pulses"
    )
    raise RecordingError(
        f"{path}: only {inside} of {len(spike_s)} spikes, {spike_s[0]:g} to {spike_s[-1]:g} s, lie in the run of "
        f"{run.end_s:g} s; {remedy}",
        "outside_run",
    )


_LEAST_INSIDE = 0.05  # share of spikes in the run; of times in ms, read as s, a thousandth is
_FAR = 100  # times in ms beside pulses in s are a thousand times as large

_KINDS = ("spike", "sync", "start", "stop")


def _read_csv(path: Path, columns: ColumnMap, unit: str = "") -> UnitSpikes:
    """Read the rows `time_s[,kind][,unit]`.

    Rows of kind start and stop limit the time in which the unit that they name was observed, or every unit.
    """
    stated = "sync" in columns.named
    if stated and columns["sync"].name != NO_PULSES:
        raise RecordingError(
            f"{path}: --columns sync={columns['sync'].name} cannot be used for a table, which has pulses as rows "
            "of kind sync; use kind=COLUMN, or sync=none if times are those of the run's journal (t_s)",
            "no_pulses",
        )
    given = {name: column for name, column in columns.by_name.items() if name != role_name("sync")}
    rows = read_table(path, *columns.split(("time",), ("kind", "unit")), given=given, hint=COLUMNS_HINT)
    refuse_summary_labels(rows)
    if not stated:
        _refuse_pulses_beside(path, rows)
    of_file, of_unit = ({kind: list[float]() for kind in _KINDS} for _ in range(2))
    units: dict[str | float, str] = {}
    fired: dict[str | float, str] = {}
    limited: dict[str | float, Row] = {}
    every_s = list[float]()
    counted = list[Row]()
    for row in rows:
        said = (row.cells.get("kind") or "spike").casefold()
        if said not in _KINDS:
            raise row.wrong("kind", "unknown_kind", either(_KINDS))
        name = "" if said == "sync" else row.cells.get("unit", "")
        of_a_unit = said == "spike" or name != ""
        if of_a_unit and (same := units.setdefault(label_key(name), name)) != name:
            expected = f"{same!r}, if this is the same unit; name each unit in one way"
            raise row.wrong("unit", "unclear_name", expected)
        if said == "spike":
            fired[label_key(name)] = name
        elif of_a_unit:
            limited.setdefault(label_key(name), row)
        seconds = row.number(role_name("time"))
        every_s += [seconds] if said == "spike" else []
        if not of_a_unit:
            of_file[said].append(seconds)
        elif not unit or label_key(unit) == label_key(name):
            of_unit[said].append(seconds)
            counted += [row] if said == "spike" else []
    named = [name or "(empty)" for name in fired.values()][:_MOST_LISTED]
    for key, row in limited.items():
        if fired and key not in fired and label_key(unit) not in limited:  # it may be meant for the unit that is read
            expected = (
                f"a unit with spikes ({', '.join(named)}); correct it, or, if this unit has none, delete the row, or "
                "state start and stop of the unit that is read, too"
            )
            raise row.wrong("unit", "unclear_name", expected)
    if (unit and label_key(unit) not in units) or (not unit and len(units) > 1):
        problem = f"there is no unit {unit}" if unit else f"{len(units)} units"
        file = path.name + "#SHEET" * (path.suffix.lower() == ".xlsx")
        ids = ", ".join(named) or "none"
        raise RecordingError(
            f"{path}: {problem}; use SHAPE={file}#UNIT with UNIT one of {ids}",
            "no_unit" if unit else "several_units",
        )
    _refuse_several_channels(path, counted, unit)
    observed = both(*(_between(path, np.sort(one["start"]), np.sort(one["stop"])) for one in (of_file, of_unit)))
    pulses = np.array([] if stated else sorted(of_file["sync"]), dtype=float)
    spikes = np.array(of_unit["spike"], dtype=float)
    extent_s = extent(np.array(every_s))
    return UnitSpikes(spikes, pulses, observed, stated=stated, read_as=columns_read(rows), file_s=extent_s)


_CHANNEL = re.compile(
    r"\b(ch(an(nels?)?)?|electrodes?|contacts?|tetrodes?|probes?|shanks?|sites?|arrays?|units?|clusters?|neurons?|cells?"
    r"|afferents?)(\b|(?=[_\d]))",
    re.IGNORECASE,
)


def _refuse_several_channels(path: Path, spikes: Sequence[Row], unit: str) -> None:
    """Refuse spikes that an unread column says are of several channels: each has units of its own."""
    for name in spikes[0].unread if spikes else ():
        values = sorted({row.unread[name] for row in spikes}, key=natural_order)
        if 1 < len(values) <= max(2, len(spikes) // 2) and _CHANNEL.search(name.replace("_", " ")):
            which, found = f"the spikes of unit {unit}" if unit else "the spikes", ", ".join(values[:_MOST_LISTED])
            raise RecordingError(
                f"{path}, column {name}: {which} have several values ({found}), and a unit of one channel is not "
                f"that of another; join both columns to one of names, such as {values[0]}-"
                f"{unit or 1}, and state it as --columns unit=COLUMN, or keep the rows of one in a file of their own",
                "several_channels",
            )


def _refuse_pulses_beside(path: Path, rows: Sequence[Row]) -> None:
    """Refuse a column that is called like pulses, and is not read, since --columns names others."""
    read = {column.name for column in rows[0].columns.values()} if rows else set()
    unread = [name for name in header_of(path) if rows and called_like_pulses(name) and name not in read]
    if unread:
        raise RecordingError(
            f"{path}: the column {unread[0]!r} may have the sync pulses and is not read; a CSV has them as rows "
            "whose kind is sync (--columns kind=COLUMN); else remove the column, or use sync=none if times are "
            "those of the run's journal (t_s)",
            "unknown_pulses",
        )


_MOST_LISTED = 50


def _between(path: Path, starts: Array, stops: Array) -> Array:
    """Return the intervals (n, 2) between starts and stops; infinite before the first stop, after the last start."""
    open_start = not len(starts) or (len(stops) and stops[0] < starts[0])
    open_stop = not len(stops) or (len(starts) and starts[-1] > stops[-1])
    first = np.concatenate([[-np.inf], starts]) if open_start else starts
    last = np.concatenate([stops, [np.inf]]) if open_stop else stops
    if len(first) != len(last) or (last < first).any() or (first[1:] < last[:-1]).any():
        raise RecordingError(
            f"{path}: rows of kind start and stop must alternate in time; {len(starts)} starts and {len(stops)} "
            "stops do not",
            "no_intervals",
        )
    return np.column_stack([first, last])


def rates_in_run(
    run: Run, shape: str, times: SpikeTimes, name: str, window_s: tuple[float, float], centre_mm: float = 0.0
) -> Recording:
    """Return rates (1/s) in a window from the start of each last hold; presses at one position are repeats.

    Presses at which the unit was not observed are left out and counted. If the shape was pressed to several forces or
    depths, `shape` must name one, as in "step:1@8gwt". Positions are the x of the indentor minus the center of the
    receptive field. Raises RecordingError if the window is empty or longer than a hold, or if the run has no such
    press.
    """
    begin, end = window_s
    if not 0 <= begin < end:
        raise RecordingError(
            f"--window-s {begin:g},{end:g}: must satisfy 0 ≤ begin < end, in s from the start of the hold",
            "no_window",
        )
    if not abs(centre_mm) <= MOST_MM:
        raise RecordingError(
            f"--field-centre-mm {centre_mm:g}: must be a number in mm, of at most {MOST_MM:g}", "no_centre"
        )
    rows, lost_mm = [], []
    holds = _last_holds(run, shape, name)
    for _, x_mm, start_s, stop_s in holds:
        if start_s + end > stop_s + _CLOCK_TICK_S:
            raise RecordingError(
                f"--window-s {begin:g},{end:g}: must end within each hold; the hold at x = {x_mm:g} mm lasts "
                f"{stop_s - start_s:.3f} s",
                "window_beyond_hold",
            )
        at_mm = round(x_mm - centre_mm, SAME_PLACE_DECIMALS)
        if not times.observed(start_s + begin, start_s + end):
            lost_mm.append(at_mm)
            continue
        first, last = np.searchsorted(times.spike_s, (start_s + begin, start_s + end))
        rows.append((at_mm, (last - first) / (end - begin), np.nan))
    if not rows and not lost_mm:
        raise RecordingError(
            f"{name}: run {run.folder.path.name} contains no finished indentation by {shape}", "never_pressed"
        )

    def shifted(shift_s: float) -> Recording:
        moved = rates_in_run(run, shape, times.shifted(shift_s), name, window_s, centre_mm)
        return with_enough_positions(Path(name), moved)

    notes = (*times.notes, *_differences(run, {hold.press for hold in holds}))
    presses, spike_s = len(rows) + len(lost_mm), times.spike_s
    about = FromSpikes(presses, tuple(lost_mm), times.span, times.clock, notes, spike_s, shifted)
    return replace(recording(name, rows, end - begin), spikes=about, read_as=times.read_as)


_CLOCK_TICK_S = 1e-6


_MOTIONS = {
    "verb": ("verb", ""),
    "speed_mm_s": ("speed", " mm/s"),
    "increments": ("increments", ""),
    "asked_s": ("duration of the hold", " s"),
    "along_mm": ("place along the finger", " mm"),
}
"""What a script asks of a press besides its indentor, place across the finger, and target: words and unit."""


def _differences(run: Run, indices: set[int]) -> list[str]:
    """Return a sentence on what the script asked differently of presses that are counted together; none for none.

    Its conditions count if they differ at one position: they may be the positions.
    """
    rows = [row for row in presses(run) if row.complete and row.index in indices]
    labels: dict[float, set[str]] = {}
    for row in rows:
        labels.setdefault(round(row.x_mm, SAME_PLACE_DECIMALS), set()).add(row.condition or "none")
    mixed = set().union(*(some for some in labels.values() if len(some) > 1))
    said = [f"condition ({_listed(mixed, '')})"] if mixed else []
    for name, (words, unit) in _MOTIONS.items():
        asked = [getattr(row, name) for row in rows]
        values = {f"{value:g}" if isinstance(value, float) else str(value or "none") for value in asked}
        said += [f"{words} ({_listed(values, unit)})"] if len(values) > 1 else []
    return [f"These presses differ in {joined(said)}, but count as one condition: those at one position are repeats, "
            "from which the noise is estimated. Compare a run of each alone."] if said else []  # fmt: skip


def _listed(values: set[str], unit: str) -> str:
    named = sorted(values, key=natural_order)
    more = [f"{len(named) - _FEW_LISTED} more"] if len(named) > _FEW_LISTED else []
    return joined([*named[:_FEW_LISTED], *more]) + unit


_FEW_LISTED = 4


class _LastHold(NamedTuple):
    """Last hold of a finished press: its index, x (mm), start and end (s since the start of the run)."""

    press: int
    x_mm: float
    start_s: float
    stop_s: float


def _last_holds(run: Run, shape: str, name: str) -> list[_LastHold]:
    """Return the last hold of each finished press by a shape, to the condition that it may name."""
    asked = {event["index"]: event for event in run.stream("indentation_start")}
    began = {(event["index"], event["hold"]): event["t_s"] for event in run.stream("hold_start")}
    meant = shape_key(shape)
    found = [
        (
            condition_of(asked[hold["index"]]),
            _LastHold(hold["index"], hold["x_mm"], began[hold["index"], hold["hold"]], hold["t_s"]),
        )
        for hold in run.stream("hold_end")
        if hold["index"] in run.done
        and hold["hold"] == asked[hold["index"]]["increments"]
        and shape_name(asked[hold["index"]]["indentor"]) == meant.shape
    ]
    told = sorted({condition for condition, *_ in found}, key=natural_order)
    if not meant.condition and len(told) > 1:
        raise RecordingError(
            f"{name}: {shape} was pressed to {' and '.join(told)}; name one, e.g. --recorded "
            f"'{shape}@{told[0]}={name}'",
            "several_conditions",
        )
    if found and meant.condition not in ("", *told):
        held = " and ".join(f"{meant.shape}@{condition}" for condition in told)
        raise RecordingError(
            f"{name}: run {run.folder.path.name} contains {held}, and no {shape}; name one of these", "never_pressed"
        )
    return [hold for condition, hold in found if meant.condition in ("", condition)]


# Synthetic recordings, for demonstrations and for testing the statistics. They are not data.
#
# Rule: at each position the mean rate is max(0, k(ε − ε₀)), ε the SSRP of a chosen measure at a chosen receptor; each
# repeat counts spikes in a window, Poisson with that mean, and the rate is the count over the window.


@dataclass(frozen=True)
class LinearAfferent:
    """Synthetic afferent with R = max(0, k(ε − ε₀)) in 1/s; ε₀ has the sign and unit of the measure's profile."""

    measure: str
    receptor: int
    k: float
    eps0: float

    def rate(self, stimulus: StimulusRow, position_mm: Array) -> Array:
        """Return the mean rates (p,); NaN at positions that the run does not cover."""
        eps = stimulus.at(position_mm)[MEASURES.index(self.measure), :, self.receptor]
        return np.maximum(0.0, self.k * (eps - self.eps0))


def afferent_for(
    stimuli: list[StimulusRow], measure: str, receptor: int, peak: float, silent: float
) -> LinearAfferent:
    """Return an afferent that fires at `peak` at the largest ε of the stimuli, and not below a share `silent` of its
    range.
    """
    values = np.concatenate([stimulus.ssrp(measure, receptor) for stimulus in stimuli])
    eps0 = float(values.min() + silent * np.ptp(values))
    return LinearAfferent(measure, receptor, peak / (float(values.max()) - eps0), eps0)


def record(
    afferent: LinearAfferent,
    stimulus: StimulusRow,
    position_mm: Array,
    rng: np.random.Generator,
    repeats: int = 5,
    window_s: float = 1.0,
) -> Recording:
    """Return a synthetic recording at the positions (p,) that the run covers."""
    mean = afferent.rate(stimulus, position_mm)
    covered = np.isfinite(mean)
    counts = rng.poisson(window_s * mean[covered], size=(repeats, int(covered.sum())))
    places = np.asarray(position_mm)[covered]
    rows = [(float(x), float(n) / window_s, np.nan) for column in counts for x, n in zip(places, column, strict=True)]
    return replace(recording(_file_name(afferent, stimulus), rows, window_s), changes=("synthetic",))


def write_synthetic(folder: Path, found: Recording) -> Path:
    """Write a synthetic recording as the CSV that `rig compare` reads; its name begins with "synthetic"."""
    lines = ["position_mm,rate,repeat"]
    for x, rates in zip(found.position_mm, found.repeats, strict=True):
        lines += [f"{x:.4f},{rate:.4f},{number}" for number, rate in enumerate(rates, 1)]
    path = folder / found.name
    replace_text(path, "\n".join(lines) + "\n")
    return path


def _file_name(afferent: LinearAfferent, stimulus: StimulusRow) -> str:
    shape = stimulus.shape.replace(":", "").replace(",", "-")
    x = f"{round(float(stimulus.receptor_mm[afferent.receptor]), 2) + 0.0:g}"
    return f"synthetic_{shape}_{stimulus.condition.replace(' ', '')}_{afferent.measure}_at_{x}.csv"
