"""Spike times of one unit from an NWB file.

Layout: NWB 2 schema, `units` (spike_times, its index, id), read as the HDF5 that it is, so that h5py is enough. Sync
pulses, where the file has them: a table of intervals or a TimeSeries called `sync_pulses`.
"""

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.compare.errors import RecordingError
from rig.compare.recordings.column_map import ColumnMap

Array = NDArray[np.float64]

_TIMES = "spike_times"


def read_nwb(path: Path, unit: str, columns: ColumnMap) -> tuple[Array, Array]:
    """Spike times and sync pulses (s, ascending) of the unit with an id, "" for the only one; RecordingError.

    Another column of times, its unit, and the pulses' name are the columns' time and sync.
    """
    if not path.is_file():
        reason = "Is a directory" if path.is_dir() else "No such file or directory"
        raise RecordingError("{path}: {reason}", code="unreadable", path=str(path), reason=reason)
    factor = columns["time"].factor
    try:
        with h5py.File(path) as file:
            return factor * np.sort(_spikes(file, path, unit, columns)), factor * np.sort(
                _pulses(file, path, columns)
            )
    except OSError:
        raise RecordingError("{path}: not an NWB file (HDF5)", code="no_hdf5", path=str(path)) from None


def _spikes(file: h5py.File, path: Path, unit: str, columns: ColumnMap) -> Array:
    name = columns["time"].name if "time" in columns.given else _TIMES
    wanted = (name, f"{name}_index", "id")
    if any(f"units/{column}" not in file for column in wanted):
        raise RecordingError(
            "{path}: no spike times, expected a table units with a column {column} (and {column}_index and id)",
            code="no_spike_times",
            path=str(path),
            column=name,
        )
    times, ends, numbers = (file[f"units/{column}"][:] for column in wanted)
    ids = [str(number) for number in numbers]
    if unit not in ids and not (unit == "" and len(ids) == 1):
        known = "no unit {unit}" if unit else "{units} units"
        raise RecordingError(
            "{path}: " + known + ", expected SHAPE={file}#UNIT, UNIT one of {ids}",
            code="no_unit" if unit else "several_units",
            path=str(path),
            file=path.name,
            unit=unit,
            units=len(ids),
            ids=", ".join(ids),
        )
    row = ids.index(unit) if unit else 0
    begin, end = np.concatenate([[0], ends])[row : row + 2].astype(int)
    return _numbers(times[begin:end], path, f"unit {ids[row]}, column {name}")


def _pulses(file: h5py.File, path: Path, columns: ColumnMap) -> Array:
    name = columns["sync"].name
    places = (f"intervals/{name}/start_time", f"acquisition/{name}/timestamps")
    found = next((place for place in places if place in file), None)
    if found is None and "sync" in columns.given:
        raise RecordingError(
            "{path}: no sync pulses {name}, expected {places}",
            code="no_pulses",
            path=str(path),
            name=name,
            places=" or ".join(places),
        )
    return np.empty(0) if found is None else _numbers(file[found][:], path, found)


def _numbers(values: NDArray[np.generic], path: Path, dataset: str) -> Array:
    try:
        times = np.asarray(values, dtype=float)
    except ValueError:
        raise RecordingError(
            "{path}, {dataset}: {dtype} values, expected times in numbers",
            code="no_numbers",
            path=str(path),
            dataset=dataset,
            dtype=str(values.dtype),
        ) from None
    wrong = np.flatnonzero(~np.isfinite(times))
    if len(wrong):
        raise RecordingError(
            "{path}, {dataset}, entry {entry}: {value:g}, expected a number",
            code="not_finite",
            path=str(path),
            dataset=dataset,
            entry=int(wrong[0]) + 1,
            value=float(times[wrong[0]]),
        )
    return times
