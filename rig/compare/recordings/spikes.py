"""Discharge rates from spike times and a run."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import MOST_MM
from rig.compare.recordings.columns import ColumnMap
from rig.compare.recordings.recording import (
    SAME_PLACE_DECIMALS,
    FromSpikes,
    Recording,
    condition_of,
    recording,
    shape_key,
    with_enough_positions,
)
from rig.compare.recordings.run_clock import on_the_runs_clock, width_s
from rig.compare.recordings.spike_checks import CHECKS
from rig.compare.recordings.spike_files import read_unit
from rig.compare.recordings.spike_times import SpikeTimes, joined
from rig.compare.recordings.sync_pulses import leading_edges
from rig.data import Run
from rig.data.presses import presses
from rig_shared.natural_order import natural_order
from sim.contact.shapes import shape_name

Array = NDArray[np.float64]


def read_spike_times(
    path: Path, run: Run, unit: str = "", columns: ColumnMap | None = None, *, may_be_silent: bool = False
) -> SpikeTimes:
    """Return the spikes of a unit on the run's clock, from NWB, a file of a recording system, or a table.

    Sync pulses in the file are matched with the run's, which gives the offset and drift of the amplifier's clock.
    Without them, the times must already count from the start of the run. `unit` selects a unit in a file that may
    have several. Raises RecordingError.
    """
    found = read_unit(path, unit, columns or ColumnMap(), str(run.start.get("uid", "")))
    if not len(found.spike_s) and not may_be_silent:
        raise RecordingError(f"{found.where}: contains no spikes; at least one spike time is required", "no_spikes")
    found = found.noted(*(check(found) for check in CHECKS))
    found = leading_edges(replace(found, spike_s=np.sort(found.spike_s)), width_s(run))
    return on_the_runs_clock(found, run)


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

    @cache
    def counted(length_s: float) -> Recording:
        return rates_in_run(run, shape, times, name, (begin, begin + length_s), centre_mm)

    notes = (*times.notes, *_differences(run, {hold.press for hold in holds}))
    presses, spike_s = len(rows) + len(lost_mm), times.spike_s
    about = FromSpikes(presses, tuple(lost_mm), times.span, times.clock, notes, spike_s, shifted, counted)
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
