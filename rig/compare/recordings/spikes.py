"""Discharge rates from spike times recorded during a run."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.compare.errors import RecordingError
from rig.compare.recordings.column_map import ColumnMap
from rig.compare.recordings.nwb_spikes import read_nwb
from rig.compare.recordings.recorded import Recording, recording
from rig.compare.recordings.shape_key import condition_of, shape_key
from rig.compare.recordings.table_file import read_table
from rig.data import Run
from sim.contact.shapes import shape_name

Array = NDArray[np.float64]

_SAME_PLACE_DECIMALS = 3


SPIKES = (("time",), ("kind",))
SPIKES_IN_NWB = (("time",), ("sync",))
"""Roles of the columns that must be there, and of those that may; of a file of each kind."""


def read_spike_times(path: Path, run: Run, unit: str = "", columns: ColumnMap | None = None) -> Array:
    """(n,) ascending s on the run's clock, from NWB or a CSV with columns `time_s[,kind]`. Raises RecordingError.

    Rows of kind "sync" are the run's pulses as the amplifier saw them: offset and drift between the two clocks are
    fitted to them. Without such rows the times must be on the run's clock already. `unit` is the one of an NWB file.
    """
    columns = columns or ColumnMap()
    spikes, pulses = read_nwb(path, unit, columns) if path.suffix == NWB else _read_csv(path, columns)
    if not len(spikes):
        raise RecordingError("{path}: no spikes, expected the times of some", code="no_spikes", path=str(path))
    return _on_the_runs_clock(path, spikes, pulses, run) if len(pulses) else spikes


NWB = ".nwb"


def _read_csv(path: Path, columns: ColumnMap) -> tuple[Array, Array]:
    times: dict[str, list[float]] = {"spike": [], "sync": []}
    time, kind = columns["time"], columns["kind"].name
    for row in read_table(path, *columns.split(*SPIKES), others=bool(columns.given)):
        said = row.cells.get(kind) or "spike"
        if said not in times:
            raise row.wrong(kind, "unknown_kind", "spike or sync")
        times[said].append(time.factor * row.number(time.name))
    spikes, pulses = (np.sort(np.array(times[kind], dtype=float)) for kind in ("spike", "sync"))
    return spikes, pulses


def _on_the_runs_clock(path: Path, spike_s: Array, pulse_s: Array, run: Run) -> Array:
    rise_s = np.sort(np.array([event["rise_s"] for event in run.stream("sync")], dtype=float))
    if len(rise_s) != len(pulse_s):
        raise RecordingError(
            "{path}: {pulses} sync pulses, the journal of the run has {journalled}",
            code="number_of_pulses",
            path=str(path),
            pulses=len(pulse_s),
            journalled=len(rise_s),
        )
    if len(rise_s) == 1:
        return spike_s + (rise_s[0] - pulse_s[0])
    line = np.polynomial.Polynomial.fit(pulse_s, rise_s, deg=1)
    worst_s = float(np.abs(line(pulse_s) - rise_s).max())
    if worst_s > _PULSE_TOLERANCE_S:
        raise RecordingError(
            "{path}: the sync pulses miss the journal's by up to {worst_ms:.1f} ms, expected {most_ms:g} ms or less",
            code="pulses_apart",
            path=str(path),
            worst_ms=1e3 * worst_s,
            most_ms=1e3 * _PULSE_TOLERANCE_S,
        )
    return np.asarray(line(spike_s))


_PULSE_TOLERANCE_S = 0.005


def rates_in_run(
    run: Run, shape: str, spike_s: Array, name: str, window_s: tuple[float, float], centre_mm: float = 0.0
) -> Recording:
    """Spikes per second in a window relative to the start of each last hold; presses at one place are repeats.

    A shape that was pressed to several forces or depths needs the one that is meant: "step:1@8gwt".

    Positions are the indentor's x minus the receptive field's centre. Raises RecordingError where the window is
    empty or longer than a hold, or nothing was pressed.
    """
    begin, end = window_s
    if not 0 <= begin < end:
        raise RecordingError(
            "--window-s {begin_s:g},{end_s:g}: expected 0 ≤ begin < end, in s from the start of the hold",
            code="no_window",
            begin_s=begin,
            end_s=end,
        )
    if not np.isfinite(centre_mm):
        raise RecordingError(
            "--field-centre-mm {centre_mm:g}: expected a number", code="no_centre", centre_mm=centre_mm
        )
    rows = []
    for x_mm, start_s, stop_s in _last_holds(run, shape, name):
        if start_s + end > stop_s + _CLOCK_TICK_S:
            raise RecordingError(
                "--window-s {begin_s:g},{end_s:g}: the hold at x = {x_mm:g} mm lasts {hold_s:.3f} s, "
                "expected a window within the holds",
                code="window_beyond_hold",
                begin_s=begin,
                end_s=end,
                x_mm=x_mm,
                hold_s=stop_s - start_s,
            )
        first, last = np.searchsorted(spike_s, (start_s + begin, start_s + end))
        rows.append((round(x_mm - centre_mm, _SAME_PLACE_DECIMALS), (last - first) / (end - begin), np.nan))
    if not rows:
        raise RecordingError(
            "{file}: run {run} has no finished indentation by {shape}",
            code="never_pressed",
            file=name,
            run=run.folder.path.name,
            shape=shape,
        )
    return recording(name, rows, end - begin)


_CLOCK_TICK_S = 1e-6


def _last_holds(run: Run, shape: str, name: str) -> list[tuple[float, float, float]]:
    """x (mm), start and end (s on the run's clock) of the last hold of each finished indentation by a shape."""
    finished = {event["index"] for event in run.stream("indentation_end")}
    asked = {event["index"]: event for event in run.stream("indentation_start")}
    began = {(event["index"], event["hold"]): event["t_s"] for event in run.stream("hold_start")}
    meant = shape_key(shape)
    found = [
        (condition_of(asked[hold["index"]]), hold["x_mm"], began[hold["index"], hold["hold"]], hold["t_s"])
        for hold in run.stream("hold_end")
        if hold["index"] in finished
        and hold["hold"] == asked[hold["index"]]["increments"]
        and shape_name(asked[hold["index"]]["indentor"]) == meant.shape
    ]
    told = sorted({condition for condition, *_ in found})
    if not meant.condition and len(told) > 1:
        raise RecordingError(
            "{file}: {shape} was pressed to {conditions}, expected one of them: --recorded '{shape}@{first}={file}'",
            code="several_conditions",
            file=name,
            shape=shape,
            conditions=" and ".join(told),
            first=told[0],
        )
    return [(x, start, stop) for condition, x, start, stop in found if meant.condition in ("", condition)]
