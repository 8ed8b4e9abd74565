"""Spike times of one unit from a user's table with the columns `time_s[,kind][,unit]`.

Rows of kind sync are pulses; rows of kind start and stop limit the time in which the unit that they name was
observed, or every unit.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import ColumnMap, role_name
from rig.compare.recordings.number_cells import label_key
from rig.compare.recordings.spike_times import Array, UnitSpikes, both, extent, no_such_unit
from rig.compare.recordings.sync_pulses import NO_PULSES, called_like_pulses
from rig.compare.recordings.table import COLUMNS_HINT, Row, columns_read, read_table
from rig.printable import either
from rig_shared.natural_order import natural_order

_KINDS = ("spike", "sync", "start", "stop")
_MOST_LISTED = 50
_CHANNEL = re.compile(
    r"\b(ch(an(nels?)?)?|electrodes?|contacts?|tetrodes?|probes?|shanks?|sites?|arrays?|units?|clusters?|neurons?|cells?"
    r"|afferents?)(\b|(?=[_\d]))",
    re.IGNORECASE,
)


class _Event(NamedTuple):
    """A row: its kind, its unit (None: of the file), its time (s)."""

    kind: str
    unit: str | None
    time_s: float
    row: Row

    @property
    def key(self) -> str | float | None:
        """What all ways of writing the unit have in common."""
        return None if self.unit is None else label_key(self.unit)


def read_spikes_table(path: Path, unit: str, columns: ColumnMap, uid: str = "") -> UnitSpikes:
    """Return the spikes and pulses of a unit. Raises RecordingError."""
    stated = "sync" in columns.named
    if stated and columns["sync"].name != NO_PULSES:
        raise RecordingError(
            f"{path}: --columns sync={columns['sync'].name} cannot be used for a table, which has pulses as rows "
            "of kind sync; use kind=COLUMN, or sync=none if times are those of the run's journal (t_s)",
            "no_pulses",
        )
    given = {name: column for name, column in columns.by_name.items() if name != role_name("sync")}
    rows = read_table(path, *columns.split(("time",), ("kind", "unit")), given=given, hint=COLUMNS_HINT)
    if not stated:
        _refuse_pulses_beside(path, rows)
    events = [_event(row) for row in rows]
    _refuse_unclear_units(path, unit, events)
    of_file = [one for one in events if one.unit is None]
    mine = [one for one in events if one.unit is not None and (not unit or one.key == label_key(unit))]
    _refuse_several_channels(path, [one.row for one in mine if one.kind == "spike"], unit)
    observed = both(*(_between(path, _times(some, "start"), _times(some, "stop")) for some in (of_file, mine)))
    return UnitSpikes(
        path,
        unit,
        np.array([one.time_s for one in mine if one.kind == "spike"], dtype=float),
        np.empty(0) if stated else _times(of_file, "sync"),
        observed,
        stated=stated,
        read_as=columns_read(rows),
        file_s=extent(_times(events, "spike")),
        fired_s=extent(_times(events, "spike")),
    )


def _event(row: Row) -> _Event:
    kind = (row.cells.get("kind") or "spike").casefold()
    if kind not in _KINDS:
        raise row.wrong("kind", "unknown_kind", either(_KINDS))
    name = "" if kind == "sync" else row.cells.get("unit", "")
    return _Event(kind, name if kind == "spike" or name else None, row.number(role_name("time")), row)


def _times(events: Sequence[_Event], kind: str) -> Array:
    return np.array(sorted(one.time_s for one in events if one.kind == kind), dtype=float)


def _refuse_unclear_units(path: Path, unit: str, events: Sequence[_Event]) -> None:
    """Refuse a unit that is written in several ways, has limits and no spikes, is not there, or is not chosen."""
    names: dict[str | float | None, str] = {}
    for one in (one for one in events if one.unit is not None):
        if (same := names.setdefault(one.key, one.unit or "")) != one.unit:
            expected = f"{same!r}, if this is the same unit; name each unit in one way"
            raise one.row.wrong("unit", "unclear_name", expected)
    fired = dict.fromkeys(one.key for one in events if one.kind == "spike")
    limits = {one.key: one.row for one in reversed(events) if one.kind != "spike" and one.unit is not None}
    listed = [names[key] or "(empty)" for key in fired][:_MOST_LISTED]
    for row in (row for key, row in limits.items() if key not in fired):
        if fired and label_key(unit) not in limits:  # it may be meant for the unit that is read
            expected = (
                f"a unit with spikes ({', '.join(listed)}); correct it, or, if this unit has none, delete the row, "
                "or state start and stop of the unit that is read, too"
            )
            raise row.wrong("unit", "unclear_name", expected)
    if label_key(unit) not in names if unit else len(names) > 1:
        file = path.name + "#SHEET" * (path.suffix.lower() == ".xlsx")
        raise no_such_unit(path, unit, f"{len(names)} units", ", ".join(listed) or "none", file)


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
    unread = [name for name in (rows[0].unread if rows else ()) if called_like_pulses(name)]
    if unread:
        raise RecordingError(
            f"{path}: the column {unread[0]!r} may have the sync pulses and is not read; a CSV has them as rows "
            "whose kind is sync (--columns kind=COLUMN); else remove the column, or use sync=none if times are "
            "those of the run's journal (t_s)",
            "unknown_pulses",
        )


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
