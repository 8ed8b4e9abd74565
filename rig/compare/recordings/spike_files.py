"""Files with spike times, by kind: how to tell one, the roles of its columns, and its reader.

Each reader returns what its file has of one unit, as `UnitSpikes`; what follows does not depend on the kind.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from rig.compare.recordings.columns import ColumnMap
from rig.compare.recordings.neo_file import neo_format, read_neo
from rig.compare.recordings.nwb_file import is_nwb, read_nwb
from rig.compare.recordings.presses_table import Roles
from rig.compare.recordings.spike_times import UnitSpikes, no_observed
from rig.compare.recordings.spikes_table import read_spikes_table

SPIKES: Roles = (("time",), ("kind", "unit", "sync", "observed"))
"""Roles of required and of optional columns of a table of spike times."""


class SpikeFile(NamedTuple):
    """A kind of file: how it is told, the roles of required and of optional columns, and the reader.

    The reader takes the path, the name of the unit ("" for the only one), the columns and the uid of the run.
    """

    is_one: Callable[[Path], bool]
    roles: Roles
    read: Callable[[Path, str, ColumnMap, str], UnitSpikes]
    names_intervals: bool = False
    """Whether the role observed may be a column of intervals, and not only "throughout"."""


SPIKE_FILES = (
    SpikeFile(is_nwb, (("time",), ("sync", "observed", "invalid")), read_nwb, names_intervals=True),
    SpikeFile(lambda path: neo_format(path) is not None, ((), ("sync", "observed", "segment")), read_neo),
)
_TABLE = SpikeFile(lambda path: True, SPIKES, read_spikes_table)


def spike_file(path: Path) -> SpikeFile | None:
    """Return the kind of a file by its name, or None for a table, which may have rates, counts or spike times."""
    return next((kind for kind in SPIKE_FILES if kind.is_one(path)), None)


def read_unit(path: Path, unit: str, columns: ColumnMap, uid: str) -> UnitSpikes:
    """Return what a file has of a unit. Raises RecordingError."""
    kind = spike_file(path) or _TABLE
    found = kind.read(path, unit, columns, uid)
    if "observed" in columns.named and not kind.names_intervals and not columns.observed_throughout:
        problem = "it must be throughout (a CSV states intervals in rows of kind start and stop)"
        raise no_observed(path, columns["observed"].name, problem)
    return replace(found, throughout=columns.observed_throughout)
