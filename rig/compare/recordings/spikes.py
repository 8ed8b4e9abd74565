"""Discharge rates from spike times: text files, NWB units, and synthetic ones, which are not data."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import COLUMNS_HINT, ColumnMap, read_table
from rig.compare.recordings.hdf5 import numbers_in, values_of
from rig.compare.recordings.neo_file import neo_format, read_neo
from rig.compare.recordings.recording import Recording, condition_of, finite_times, recording, shape_key
from rig.compare.stimuli import StimulusRow
from rig.data import Run
from rig.data.folder import replace_text
from rig.printable import either
from rig_shared.user_files import open_file
from sim.contact.shapes import shape_name
from sim.measures.measures import MEASURES

# Spike times of one unit from an NWB file.
#
# Layout: NWB 2 schema, `units` (spike_times, its index, id), read as the HDF5 that it is, so that h5py is enough.
# Sync pulses, where the file has them: a table of intervals or a TimeSeries called `sync_pulses`.

Array = NDArray[np.float64]

_TIMES = "spike_times"
_MOST_UNITS, _MOST_LISTED = 100_000, 50


def read_nwb(path: Path, unit: str, columns: ColumnMap) -> tuple[Array, Array]:
    """Return spike times and sync pulses (s, ascending) of a unit by its id, "" for the only one. Raises
    RecordingError.

    The roles time and sync of `columns` name another column of times with its unit, and the pulses.
    """
    try:
        open_file(path).close()  # for its checks
    except OSError as error:
        reason = error.strerror or str(error)
        raise RecordingError("{path}: {reason}", code="unreadable", path=str(path), reason=reason) from None
    factor = columns["time"].factor
    with _damage_in_one_line(path), h5py.File(path) as file:
        spikes, pulses = _spikes(file, path, unit, columns), _pulses(file, path, columns)
    return factor * np.sort(spikes), factor * np.sort(pulses)


@contextmanager
def _damage_in_one_line(path: Path) -> Iterator[None]:
    """Raise RecordingError for any error that a damaged HDF5 file causes."""
    try:
        yield
    except RecordingError:
        raise
    except OSError:
        raise RecordingError("{path}: not an NWB file (HDF5)", code="no_hdf5", path=str(path)) from None
    except (KeyError, RuntimeError, ValueError, TypeError, AttributeError, MemoryError) as error:
        reason = (str(error).strip("'\" ") or type(error).__name__).splitlines()[0]
        raise RecordingError(
            "{path}: this NWB file (HDF5) is damaged: {reason}", code="damaged_hdf5", path=str(path), reason=reason
        ) from None


def _spikes(file: h5py.File, path: Path, unit: str, columns: ColumnMap) -> Array:
    name = columns["time"].name if "time" in columns.named else _TIMES
    wanted = (name, f"{name}_index", "id")
    found = [numbers_in(file, path, f"units/{column}") for column in wanted]
    if any(one is None for one in found):
        raise RecordingError(
            "{path}: no spike times; the file must have a table units with a column {column} (and "
            "{column}_index and id)",
            code="no_spike_times",
            path=str(path),
            column=name,
        )
    times, ends, numbers = (one for one in found if one is not None)
    ids = [str(number) for number in values_of(numbers, path, most=_MOST_UNITS)]
    if len(ends) != len(ids):
        raise RecordingError(
            "{path}: units/{column}_index has {ends} values, but units/id has {units}",
            code="not_one_end_a_unit",
            path=str(path),
            column=name,
            ends=len(ends),
            units=len(ids),
        )
    if unit not in ids and not (unit == "" and len(ids) == 1):
        known = "there is no unit {unit}" if unit else "{units} units"
        raise RecordingError(
            "{path}: " + known + "; use SHAPE={file}#UNIT with UNIT one of {ids}",
            code="no_unit" if unit else "several_units",
            path=str(path),
            file=path.name,
            unit=unit,
            units=len(ids),
            ids=", ".join(ids[:_MOST_LISTED]) + ", …" * (len(ids) > _MOST_LISTED),
        )
    row = ids.index(unit) if unit else 0
    last = _numbers(values_of(ends, path), path, f"units/{name}_index")
    if ends.dtype.kind not in "iu" or (np.diff([0, *last.tolist(), len(times)]) < 0).any():
        raise RecordingError(
            "{path}, units/{column}_index: must rise to {times}, one for each of {units} units",
            code="wrong_index",
            path=str(path),
            column=name,
            times=len(times),
            units=len(ids),
        )
    begin, end = (int(place) for place in [0, *last.tolist()][row : row + 2])
    return _numbers(values_of(times, path, begin, end), path, f"unit {ids[row]}, column {name}")


def _pulses(file: h5py.File, path: Path, columns: ColumnMap) -> Array:
    name = columns["sync"].name
    places = (f"intervals/{name}/start_time", f"acquisition/{name}/timestamps")
    each = {place: numbers_in(file, path, place) for place in places}
    found = next(((place, pulses) for place, pulses in each.items() if pulses is not None), None)
    if found is None and "sync" in columns.named:
        raise RecordingError(
            "{path}: there are no sync pulses {name}; use {places}",
            code="no_pulses",
            path=str(path),
            name=name,
            places=either(places),
        )
    return np.empty(0) if found is None else _numbers(values_of(found[1], path), path, found[0])


def _numbers(values: NDArray[np.generic], path: Path, dataset: str) -> Array:
    try:
        times = np.asarray(values if values.dtype.kind in "iufSO" else [None], dtype=np.float64)
    except (ValueError, TypeError):
        raise RecordingError(
            "{path}, {dataset}: the values have type {dtype}; they must be times as numbers",
            code="no_numbers",
            path=str(path),
            dataset=dataset,
            dtype=str(values.dtype),
        ) from None
    return finite_times(path, dataset, times)


_SAME_PLACE_DECIMALS = 3


SPIKES = (("time",), ("kind",))
SPIKES_IN_NWB = (("time",), ("sync",))
SPIKES_IN_NEO: tuple[tuple[str, ...], tuple[str, ...]] = ((), ("sync", "segment"))
"""Roles of required and of optional columns, by kind of file."""


def read_spike_times(
    path: Path, run: Run, unit: str = "", columns: ColumnMap | None = None, *, may_be_silent: bool = False
) -> Array:
    """Return spike times (n,) in s since the start of the run, ascending, from NWB or a CSV. Raises RecordingError.

    The CSV has the columns `time_s[,kind]`. Rows of kind "sync" are the run's pulses by the amplifier's clock, from
    which the offset and drift of that clock are fitted. Without them, the times must already count from the start of
    the run. `unit` selects a unit in a file that may have several.
    """
    columns = columns or ColumnMap()
    if path.suffix == NWB:
        spikes, pulses = read_nwb(path, unit, columns)
    elif neo_format(path) is not None:
        spikes, pulses = read_neo(path, unit, columns)
    else:
        spikes, pulses = _read_csv(path, columns)
    if not len(spikes) and not may_be_silent:
        raise RecordingError(
            "{path}: contains no spikes; at least one spike time is required",
            code="no_spikes",
            path=f"{path}#{unit}" if unit else str(path),
        )
    if len(pulses):
        return _on_the_runs_clock(path, spikes, pulses, run)
    inside = int(np.count_nonzero((spikes >= 0) & (spikes <= run.end_s)))
    if inside < _LEAST_INSIDE * len(spikes):
        raise RecordingError(
            "{path}: only {inside} of {spikes} spikes, {first_s:g} to {last_s:g} s, lie in the run of {end_s:g} s; "
            "times must be in s, or have their unit in --columns time=COLUMN:ms, and count from the start of the run "
            "(t_s), or the file must contain its sync pulses",
            code="outside_run",
            path=str(path),
            inside=inside,
            spikes=len(spikes),
            first_s=float(spikes[0]),
            last_s=float(spikes[-1]),
            end_s=run.end_s,
        )
    return spikes


NWB = ".nwb"


def _read_csv(path: Path, columns: ColumnMap) -> tuple[Array, Array]:
    times: dict[str, list[float]] = {"spike": [], "sync": []}
    time, kind = columns["time"], columns["kind"].name
    for row in read_table(path, *columns.split(*SPIKES), others=bool(columns.named), hint=COLUMNS_HINT):
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
            "{path}: {pulses} sync pulses, but the run's journal has {journalled}"
            + "; if times are its t_s, remove the pulses from the file" * (not len(rise_s)),
            code="number_of_pulses",
            path=str(path),
            pulses=len(pulse_s),
            journalled=len(rise_s),
        )
    if np.array_equal(pulse_s, rise_s):  # the same clock, to the last bit
        return spike_s
    if len(rise_s) == 1:
        return spike_s + (rise_s[0] - pulse_s[0])
    line = _line_through(pulse_s, rise_s)
    worst_s = float(np.abs(line(pulse_s) - rise_s).max())
    if worst_s > _PULSE_TOLERANCE_S:
        raise RecordingError(
            "{path}: the sync pulses differ from the journal's by up to {worst_ms:.1f} ms; at most "
            "{most_ms:g} ms is allowed",
            code="pulses_apart",
            path=str(path),
            worst_ms=1e3 * worst_s,
            most_ms=1e3 * _PULSE_TOLERANCE_S,
        )
    return np.asarray(line(spike_s))


def _line_through(pulse_s: Array, rise_s: Array) -> Callable[[Array], Array]:
    """Fit the run's time as a line over the amplifier's time; as an offset if all pulses are at one time."""
    constant = np.polynomial.Polynomial([float(rise_s.mean())])
    if np.ptp(pulse_s) == 0:
        return constant
    with warnings.catch_warnings():
        warnings.simplefilter("error", np.exceptions.RankWarning)
        try:
            return np.polynomial.Polynomial.fit(pulse_s, rise_s, deg=1)
        except np.exceptions.RankWarning:
            return constant


_PULSE_TOLERANCE_S = 0.005
_LEAST_INSIDE = 0.05  # share of spikes in the run; of times in ms, read as s, a thousandth is


def rates_in_run(
    run: Run, shape: str, spike_s: Array, name: str, window_s: tuple[float, float], centre_mm: float = 0.0
) -> Recording:
    """Return rates (1/s) in a window from the start of each last hold; presses at one position are repeats.

    If the shape was pressed to several forces or depths, `shape` must name one, as in "step:1@8gwt". Positions are
    the x of the indentor minus the center of the receptive field. Raises RecordingError if the window is empty or
    longer than a hold, or if the run has no such press.
    """
    begin, end = window_s
    if not 0 <= begin < end:
        raise RecordingError(
            "--window-s {begin_s:g},{end_s:g}: must satisfy 0 ≤ begin < end, in s from the start of the hold",
            code="no_window",
            begin_s=begin,
            end_s=end,
        )
    if not np.isfinite(centre_mm):
        raise RecordingError(
            "--field-centre-mm {centre_mm:g}: must be a number in mm", code="no_centre", centre_mm=centre_mm
        )
    rows = []
    for x_mm, start_s, stop_s in _last_holds(run, shape, name):
        if start_s + end > stop_s + _CLOCK_TICK_S:
            raise RecordingError(
                "--window-s {begin_s:g},{end_s:g}: must end within each hold; the hold at x = {x_mm:g} mm "
                "lasts {hold_s:.3f} s",
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
            "{file}: run {run} contains no finished indentation by {shape}",
            code="never_pressed",
            file=name,
            run=run.folder.path.name,
            shape=shape,
        )
    return recording(name, rows, end - begin)


_CLOCK_TICK_S = 1e-6


def _last_holds(run: Run, shape: str, name: str) -> list[tuple[float, float, float]]:
    """Return x (mm), start and end (s since the start of the run) of the last hold of each finished indentation."""
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
            "{file}: {shape} was pressed to {conditions}; name one, e.g. --recorded '{shape}@{first}={file}'",
            code="several_conditions",
            file=name,
            shape=shape,
            conditions=" and ".join(told),
            first=told[0],
        )
    return [(x, start, stop) for condition, x, start, stop in found if meant.condition in ("", condition)]


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
