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
        raise RecordingError(f"{path}: {'Is a directory' if path.is_dir() else 'No such file or directory'}")
    factor = columns["time"].factor
    try:
        with h5py.File(path) as file:
            return factor * np.sort(_spikes(file, path, unit, columns)), factor * np.sort(
                _pulses(file, path, columns)
            )
    except OSError:
        raise RecordingError(f"{path}: not an NWB file (HDF5)") from None


def _spikes(file: h5py.File, path: Path, unit: str, columns: ColumnMap) -> Array:
    name = columns["time"].name if "time" in columns.given else _TIMES
    wanted = (name, f"{name}_index", "id")
    if any(f"units/{column}" not in file for column in wanted):
        raise RecordingError(
            f"{path}: no spike times, expected a table units with a column {name} (and {name}_index and id)"
        )
    times, ends, numbers = (file[f"units/{column}"][:] for column in wanted)
    ids = [str(number) for number in numbers]
    if unit not in ids and not (unit == "" and len(ids) == 1):
        known = f"no unit {unit}" if unit else f"{len(ids)} units"
        raise RecordingError(f"{path}: {known}, expected SHAPE={path.name}#UNIT, UNIT one of {', '.join(ids)}")
    row = ids.index(unit) if unit else 0
    begin, end = np.concatenate([[0], ends])[row : row + 2].astype(int)
    return _numbers(times[begin:end], f"{path}, unit {ids[row]}, column {name}")


def _pulses(file: h5py.File, path: Path, columns: ColumnMap) -> Array:
    name = columns["sync"].name
    places = (f"intervals/{name}/start_time", f"acquisition/{name}/timestamps")
    found = next((place for place in places if place in file), None)
    if found is None and "sync" in columns.given:
        raise RecordingError(f"{path}: no sync pulses {name}, expected {' or '.join(places)}")
    return np.empty(0) if found is None else _numbers(file[found][:], f"{path}, {found}")


def _numbers(values: NDArray[np.generic], where: str) -> Array:
    try:
        times = np.asarray(values, dtype=float)
    except ValueError:
        raise RecordingError(f"{where}: {values.dtype} values, expected times in numbers") from None
    wrong = np.flatnonzero(~np.isfinite(times))
    if len(wrong):
        raise RecordingError(f"{where}, entry {wrong[0] + 1}: {times[wrong[0]]:g}, expected a number")
    return times
