"""Spike times of one unit from an NWB file.

Layout: NWB 2 schema, `units` (spike_times, its index, id), read as the HDF5 that it is, so that h5py is enough. Sync
pulses, where the file has them: a table of intervals or a TimeSeries called `sync_pulses`.
"""

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.compare.errors import RecordingError

Array = NDArray[np.float64]

_PULSES = ("intervals/sync_pulses/start_time", "acquisition/sync_pulses/timestamps")


def read_nwb(path: Path, unit: str) -> tuple[Array, Array]:
    """Spike times and sync pulses (s, ascending) of the unit with an id, "" for the only one; RecordingError."""
    if not path.is_file():
        raise RecordingError(f"{path}: No such file or directory")
    try:
        with h5py.File(path) as file:
            return np.sort(_spikes(file, path, unit)), np.sort(_pulses(file))
    except OSError:
        raise RecordingError(f"{path}: not an NWB file (HDF5)") from None


def _spikes(file: h5py.File, path: Path, unit: str) -> Array:
    units = file.get("units")
    if units is None or "spike_times" not in units:
        raise RecordingError(f"{path}: no spike times, expected a table units with a column spike_times")
    ids = [str(number) for number in units["id"][:]]
    if unit not in ids and not (unit == "" and len(ids) == 1):
        wanted = f"no unit {unit}" if unit else f"{len(ids)} units"
        raise RecordingError(f"{path}: {wanted}, expected SHAPE={path.name}#UNIT, UNIT one of {', '.join(ids)}")
    row = ids.index(unit) if unit else 0
    ends = np.concatenate([[0], units["spike_times_index"][:]]).astype(int)
    return np.asarray(units["spike_times"][ends[row] : ends[row + 1]], dtype=float)


def _pulses(file: h5py.File) -> Array:
    names = [name for name in _PULSES if name in file]
    return np.asarray(file[names[0]][:] if names else [], dtype=float)
