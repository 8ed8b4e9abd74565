"""Spike times of one unit from an NWB file, read as the HDF5 that it is, so that h5py is enough.

Layout: NWB 2 schema. Spikes are in the table `units` (spike_times, its index, id), with the intervals in which each
unit was observed (obs_intervals), without those of the table `invalid_times`. Sync pulses are a table of intervals or
a TimeSeries called `sync_pulses`: events with timestamps, or a sampled line, whose rises count.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import ColumnMap
from rig.compare.recordings.hdf5 import (
    attribute_of,
    dataset_at,
    members,
    numbers_in,
    part_of,
    rows_of,
    text_at,
    texts_in,
    trouble,
    values_of,
)
from rig.compare.recordings.recording import finite_times
from rig.compare.recordings.spike_times import NOT_USED, THROUGHOUT, Array, UnitSpikes, extent, joined, union, without
from rig.compare.recordings.sync_pulses import NO_PULSES, called_like_pulses, edges
from rig_shared.number_text import read_number
from rig_shared.plural import number_of
from rig_shared.user_files import open_file
from sim.tables import REJECTING

NWB = ".nwb"

_TIMES = "spike_times"
_TWO = 2  # levels of a line
_ROW, _NAMES, _MOST_TEXTS = "row", ("unit_name", "name", "label"), 5
_MOST_UNITS, _MOST_LISTED = 100_000, 50
_MOST_SAMPLES, _AT_ONCE = 200_000_000, 5_000_000


def is_nwb(path: Path) -> bool:
    """Return whether a path is called as an NWB file."""
    return path.suffix.lower() == NWB


def read_nwb(path: Path, unit: str, columns: ColumnMap, uid: str = "") -> UnitSpikes:
    """Return the spikes and pulses of a unit by its id, "" for the only one. Raises RecordingError.

    `uid` is that of the run: a file that was exported from it needs no pulses. The roles time, sync and observed of
    `columns` name another column of times, the pulses, and another column of intervals, each with its own unit.
    """
    try:
        open_file(path).close()  # for its checks
    except OSError as error:
        reason = error.strerror or str(error)
        raise RecordingError(f"{path}: {reason}", "unreadable") from None
    with _damage_in_one_line(path), h5py.File(path) as file:
        units = _Units.of(file, path, columns)
        row = units.row_of(file, unit)
        spikes = columns["time"].factor * units.times(file, row)
        observed = _observed(file, path, columns, units, row, spikes)
        of_run = uid != "" and text_at(file, path, "identifier").endswith(uid)
        pulses, stated, notes = _pulses(file, path, columns, required=not of_run)
        pulse_s, end_s = (columns["sync"].factor * np.sort(one) for one in (pulses.begin, pulses.end))
        which = f"unit {units.ids[row]}, row {row + 1} of {len(units.ids)}"
        read_as = f"Spike times read: units/{units.column} in {columns['time'].unit or 's'}, {which}."
        return UnitSpikes(
            spikes,
            pulse_s,
            observed,
            of_run=of_run,
            stated=stated,
            notes=(*notes, *units.unread(file, row, columns["observed"].name)),
            end_s=end_s,
            line=pulses.line,
            read_as=read_as,
            file_s=columns["time"].factor * units.extent(),
        )


@contextmanager
def _damage_in_one_line(path: Path) -> Iterator[None]:
    """Raise RecordingError for any error that a damaged HDF5 file causes."""
    try:
        yield
    except RecordingError:
        raise
    except OSError as error:
        raise trouble(path, error, "an NWB file") from None
    except (KeyError, RuntimeError, ValueError, TypeError, AttributeError, MemoryError) as error:
        reason = (str(error).strip("'\" ") or type(error).__name__).splitlines()[0]
        raise RecordingError(f"{path}: this NWB file (HDF5) is damaged: {reason}", "damaged_hdf5") from None


_LONGEST_S = 86_400.0
_FARTHEST = 100.0
"""Ratio of times beyond which the later ones are in another unit."""


class _Units(NamedTuple):
    """The table of units: the column of times, ids, and the datasets of the times and of their ends."""

    path: Path
    column: str
    ids: list[str]
    all_times: h5py.Dataset
    ends: h5py.Dataset

    @classmethod
    def of(cls, file: h5py.File, path: Path, columns: ColumnMap) -> "_Units":
        name = columns["time"].name if "time" in columns.named else _TIMES
        wanted = (name, f"{name}_index", "id")
        found = [numbers_in(file, path, f"units/{column}") for column in wanted]
        if any(one is None for one in found):
            raise RecordingError(
                f"{path}: no spike times; the file must have a table units with a column {name} (and {name}_index "
                "and id)",
                "no_spike_times",
            )
        times, ends, numbers = (one for one in found if one is not None)
        ids = [str(number) for number in values_of(numbers, path, most=_MOST_UNITS)]
        if len(ends) != len(ids):
            raise RecordingError(
                f"{path}: units/{name}_index has {len(ends)} values, but units/id has {len(ids)}",
                "not_one_end_a_unit",
            )
        return cls(path, name, ids, times, ends)

    def row_of(self, file: h5py.File, unit: str) -> int:
        """Return the row of a unit by its id or a text of its row, "COLUMN=TEXT", or "row=NUMBER" from 1.

        Raises RecordingError.
        """
        if unit == "" and len(self.ids) == 1:
            return 0
        labels = self._labels(file)
        column, equals, text = unit.partition("=")
        if equals and column == _ROW:
            found = [n for n in range(len(self.ids)) if str(n + 1) == text]
        elif equals and (texts := labels.get(column) or self._whole_numbers(file, column)):
            found = [n for n, one in enumerate(texts) if one == text]
        else:
            found = [n for n in range(len(self.ids)) if any(texts[n] == unit for texts in labels.values())]
        if unit and len(found) == 1:
            return found[0]
        several = len(found) > 1 and unit != ""
        listed = found if several else range(len(self.ids))
        each = [self._described(labels, n, several) for n in list(listed)[:_MOST_LISTED]]
        between = "; " if any(":" in one for one in each) else ", "
        known = f"there is no unit {unit}" if unit else f"{len(self.ids)} units"
        known = f"several units are called {unit}" if several else known
        known += f"; rows count from 1 to {len(self.ids)}" if equals and column == _ROW else ""
        ids = between.join(each) + f"{between}…" * (len(listed) > _MOST_LISTED)
        raise RecordingError(
            f"{self.path}: {known}; use SHAPE={self.path.name}#UNIT with UNIT one of {ids}",
            "unit_twice" if several else "no_unit" if unit else "several_units",
        )

    def _labels(self, file: h5py.File) -> dict[str, list[str]]:
        """Return the ids and the texts of all units by column, the names of the units first."""
        found = {"id": self.ids}
        for column in sorted(members(file, self.path, "units"), key=lambda one: (one not in _NAMES, one)):
            texts = texts_in(file, self.path, f"units/{column}")
            if texts is not None and len(texts) == len(self.ids):
                found[column] = texts
        return found

    def _whole_numbers(self, file: h5py.File, column: str) -> list[str]:
        """Return the whole numbers of all units in a column as texts; none without such a column."""
        found = dataset_at(file, self.path, f"units/{column}")
        if found is None or found.dtype.kind not in "iu" or found.shape not in ((len(self.ids),), (len(self.ids), 1)):
            return []
        return [str(number) for number in values_of(found, self.path).ravel().tolist()]

    def unread(self, file: h5py.File, row: int, observed: str) -> list[str]:
        """Return a sentence on the values of a unit that are not read and may say that it does not count."""
        every = members(file, self.path, "units")
        read = {self.column, observed, "id", *_NAMES[:2]}
        ragged = {name.removesuffix("_index") for name in every if name.endswith("_index")}
        each = (name for name in every if name.removesuffix("_index") not in read | ragged)
        said = [f"{name} = {value}" for name in each if (value := self._value(file, name, row)) is not None]
        more = f" and {len(said) - _MOST_LISTED} more" * (len(said) > _MOST_LISTED)
        return [f"Columns of the unit that are not read: {', '.join(said[:_MOST_LISTED])}{more}. If they say that it "
                "does not count, choose another unit."] if said else []  # fmt: skip

    def _value(self, file: h5py.File, column: str, row: int) -> str | None:
        """Return the text, truth value or number of a unit in a column as text; None in another kind of column."""
        place = f"units/{column}"
        texts = texts_in(file, self.path, place)
        if texts is not None:
            return texts[row] if len(texts) == len(self.ids) else None
        found = dataset_at(file, self.path, place)
        shapes = (len(self.ids),), (len(self.ids), 1)
        if found is None or found.dtype.kind not in "iufb" or found.shape not in shapes:
            return None
        value = values_of(found, self.path, row, row + 1)[0].item()
        return f"{value:g}" if isinstance(value, float) else str(value)

    def _described(self, labels: dict[str, list[str]], row: int, several: bool) -> str:
        """Return a unit for a list: its id and texts, and how to choose it if its id or text does not."""
        about = ", ".join(f"{column} {texts[row]}" for column, texts in list(labels.items())[1:_MOST_TEXTS])
        shown = f"{self.ids[row]}{f' ({about})' if about else ''}"
        if not several and self.ids.count(self.ids[row]) == 1:
            return shown
        alone = (f"{column}={texts[row]}" for column, texts in labels.items() if texts.count(texts[row]) == 1)
        return f"{shown}: #{next(alone, f'{_ROW}={row + 1}')}"

    def times(self, file: h5py.File, row: int) -> Array:
        """Return the spike times of a row in the unit of the file. Raises RecordingError."""
        begin, end = _bounds(self.ends, self.path, self.column, row, len(self.all_times), len(self.ids))
        return _numbers(
            values_of(self.all_times, self.path, begin, end), self.path, f"unit {self.ids[row]}, column {self.column}"
        )

    def extent(self) -> Array:
        """Return the first and the last spike times of parts of the column, of all units, in the unit of the file."""
        parts = (slice(at, at + _AT_ONCE) for at in range(0, len(self.all_times), _AT_ONCE))
        each = (part_of(self.all_times, self.path, part).ravel() for part in parts)
        return extent(*(some.astype(float) for some in each if some.dtype.kind in "iuf"))


def _bounds(ends: h5py.Dataset, path: Path, column: str, row: int, values: int, units: int) -> tuple[int, int]:
    last = _numbers(values_of(ends, path), path, f"units/{column}_index")
    at = [0, *last.tolist()]
    if ends.dtype.kind not in "iu" or (np.diff(at) < 0).any() or at[-1] != values:
        raise RecordingError(
            f"{path}, units/{column}_index: must rise to {values}, the length of {column}, with a number for each of "
            f"{units} units, but ends at {at[-1]:g}",
            "wrong_index",
        )
    begin, end = (int(place) for place in [0, *last.tolist()][row : row + 2])
    return begin, end


def _observed(file: h5py.File, path: Path, columns: ColumnMap, units: _Units, row: int, spike_s: Array) -> Array:
    """Return the intervals (n, 2) in which a unit was observed, in s; infinite if the file states none."""
    column = columns["observed"]
    place = f"units/{column.name}"
    found = THROUGHOUT
    if columns.observed_throughout:
        place = "units/obs_intervals"
    is_there = not {place, f"{place}_index"}.isdisjoint(f"units/{name}" for name in members(file, path, "units"))
    if is_there or ("observed" in columns.named and not columns.observed_throughout):
        intervals, ends = numbers_in(file, path, place, columns=2), numbers_in(file, path, f"{place}_index")
        if intervals is None or ends is None or len(ends) != len(units.ids):
            raise RecordingError(
                f"{path}, {place}: must be intervals (n × 2) with an index {place}_index of {len(units.ids)} units",
                "bad_obs_intervals",
            )
        begin, end = _bounds(ends, path, column.name, row, len(intervals), len(units.ids))
        spans = column.factor * _numbers(values_of(intervals, path, begin, end), path, place)
        _refuse_backwards(path, place, spans)
        found = union(spans)
        if len(found) and float(found[-1, 1] - found[0, 0]) > _LONGEST_S:
            raise RecordingError(
                f"{path}, {place}: {float(found[0, 0]):g} to {float(found[-1, 1]):g} s are longer than a day; if "
                f"they are in ms, use --columns observed={column.name}:ms",
                "beyond_a_finger",
            )
        inside = sum(int(np.count_nonzero((spike_s >= a) & (spike_s <= b))) for a, b in found.tolist())
        if len(found) and 2 * inside < len(spike_s):
            raise RecordingError(
                f"{path}: only {inside} of {len(spike_s)} spikes of unit {units.ids[row]} ({spike_s.min():g} to "
                f"{spike_s.max():g} s) lie in its {column.name}, {float(found[0, 0]):g} to "
                f"{float(found[-1, 1]):g} s, and all should; if one of the two is in ms, state it, e.g. --columns "
                f"observed={column.name}:ms or --columns time={units.column}:ms",
                "spikes_outside_observed",
            )
    invalid = _invalid(file, path)
    if invalid is None:
        return found
    every_s = columns["time"].factor * _numbers(values_of(units.all_times, path), path, f"units/{units.column}")
    _refuse_another_unit(path, invalid, np.concatenate([every_s, found[np.isfinite(found)]]))
    return without(found, invalid)


def _refuse_another_unit(path: Path, invalid: Array, times_s: Array) -> None:
    """Refuse intervals that end after a day, or long after the other times of the file (s)."""
    ends_s = invalid[np.isfinite(invalid)]
    last_s = float(np.abs(times_s).max(initial=0.0))
    if len(ends_s) and ends_s.max() > min(_LONGEST_S, _FARTHEST * last_s or _LONGEST_S):
        raise RecordingError(
            f"{path}, intervals/invalid_times: end at {ends_s.max():g} s, and the last time of a unit is "
            f"{last_s:g} s; write them in s, also if the spikes are in ms",
            "beyond_a_finger",
        )


def _invalid(file: h5py.File, path: Path) -> Array | None:
    """Return the intervals (n, 2) of the table invalid_times, in s; None without such a table."""
    places = ("intervals/invalid_times/start_time", "intervals/invalid_times/stop_time")
    if "invalid_times" not in members(file, path, "intervals"):
        return None
    begin, end = (numbers_in(file, path, place) for place in places)
    if begin is None or end is None or len(begin) != len(end):
        raise RecordingError(
            f"{path}, intervals/invalid_times: must have as many start_time as stop_time", "bad_invalid_times"
        )
    spans = np.column_stack(
        [_numbers(values_of(one, path), path, place) for one, place in zip((begin, end), places, strict=True)]
    )
    _refuse_backwards(path, "intervals/invalid_times", spans)
    return union(spans)


def _refuse_backwards(path: Path, place: str, spans: Array) -> None:
    if (spans[:, 1] < spans[:, 0]).any():
        raise RecordingError(f"{path}, {place}: an interval ends before it begins", "backwards")


class _Candidate(NamedTuple):
    """Something that may be sync pulses: its place, what it is, and its size."""

    place: str
    kind: str  # one of _TELLING
    size: int

    @property
    def name(self) -> str:
        """Last part of the place."""
        return self.place.rpartition("/")[2]

    def __str__(self) -> str:
        """Return the name and the size; the whole place if it is not a usual one."""
        usual = self.place.startswith(("intervals/", "acquisition/"))
        return f"{self.name if usual else self.place} ({number_of(self.size, self.kind)})"


_NO_INTERVALS = ("invalid_times",)
_WHERE = ("acquisition", "stimulus", "processing", "events", "analysis", "scratch")
_DEEPEST = 3
_TELLING = {
    "events": ("timestamps",),
    "intervals": ("start_time",),
    "times": ("timestamp",),
    "samples": ("data", "starting_time"),
}
"""Datasets of a group by which its kind is told; the first has the times, or is as long."""


def _candidates(file: h5py.File, path: Path) -> list[_Candidate]:
    """Return all tables of intervals and series of a file that have times, sampled or not."""
    found = [
        _Candidate(f"intervals/{name}", "intervals", size)
        for name in members(file, path, "intervals")
        if name not in _NO_INTERVALS and (size := rows_of(file, path, f"intervals/{name}/start_time")) is not None
    ]
    places = [(where, 0) for where in _WHERE]
    while places:
        place, depth = places.pop(0)
        inside = members(file, path, place)
        has = next((kind for kind, names in _TELLING.items() if all(name in inside for name in names)), None)
        if has is not None:
            size = rows_of(file, path, f"{place}/{_TELLING[has][0]}")
            found += [] if size is None else [_Candidate(place, has, size)]
        elif depth <= _DEEPEST:
            places += [(f"{place}/{name}", depth + 1) for name in inside]
    return found


def _may_be_pulses(file: h5py.File, path: Path, one: _Candidate) -> bool:
    """Return whether something looks like pulses, although it is not called so: no measured signal does."""
    if one.kind in ("intervals", "times") or called_like_pulses(one.place):
        return True
    if one.kind != "events":
        return False
    data = dataset_at(file, path, f"{one.place}/data")
    return data is None or data.dtype.kind in "iubSO"


def _pulses(
    file: h5py.File, path: Path, columns: ColumnMap, *, required: bool
) -> tuple["_Pulses", bool, tuple[str, ...]]:
    """Return the pulses, whether the user states that there are none, and notes.

    Without `required`, something that may be pulses by another name is not.
    """
    name, named = columns["sync"].name, "sync" in columns.named
    if named and name == NO_PULSES:
        return _Pulses(np.empty(0)), True, _unused(file, path, _candidates(file, path))
    every = _candidates(file, path)
    meant = [one for one in every if name in (one.place, one.name)]
    if len(meant) == 1:
        return _edges(file, path, meant[0]), False, _unused(file, path, every, meant[0])
    likely = [one for one in every if _may_be_pulses(file, path, one)]
    if not (meant or named or (likely and required)):
        return _Pulses(np.empty(0)), False, ()
    listed = [one.place if meant else str(one) for one in meant or likely or every][:_MOST_LISTED]
    held = ", ".join(listed) or "nothing that has times"
    problem = (
        f"several series are called {name}: {held}"
        if meant
        else f"there are no sync pulses {name}: {held}"
        if named
        else f"there are no sync pulses {name}, but there is {held}"
    )
    raise RecordingError(
        f"{path}: {problem}; use --columns sync=NAME for the pulses, or sync=none if times are those of the run's "
        "journal (t_s)",
        "pulses_twice" if meant else "no_pulses" if named else "unknown_pulses",
    )


def _unused(
    file: h5py.File, path: Path, every: list[_Candidate], pulses: _Candidate | None = None
) -> tuple[str, ...]:
    """Return a sentence on the intervals that are not the pulses, with tags, and columns that may reject some."""
    others = [one for one in every if one.kind == "intervals" and one is not pulses][:_MOST_LISTED]
    held = [f"{one.name} ({', '.join([number_of(one.size, one.kind), *_about(file, path, one)])})" for one in others]
    return (NOT_USED.format(joined(held)),) if held else ()


def _about(file: h5py.File, path: Path, one: _Candidate) -> list[str]:
    columns = [name for name in members(file, path, one.place) if REJECTING.search(name)]
    tags = sorted(set(texts_in(file, path, f"{one.place}/tags") or []))
    return [*(f"column {name}" for name in columns), *tags][:_MOST_LISTED]


class _Pulses(NamedTuple):
    """Beginnings and ends of pulses in the unit of the file, and whether they are those of a line with two levels."""

    begin: Array
    end: Array = np.empty(0)
    line: bool = False


def _edges(file: h5py.File, path: Path, one: _Candidate) -> _Pulses:
    if one.kind in ("intervals", "times"):
        stop = f"{one.place}/stop_time"
        end = _times(file, path, stop) if rows_of(file, path, stop) is not None else np.empty(0)
        return _Pulses(_times(file, path, f"{one.place}/{_TELLING[one.kind][0]}"), end[np.isfinite(end)])
    if one.kind == "events":
        return _edges_of_events(file, path, one.place)
    return _edges_of_samples(file, path, one.place)


def _times(file: h5py.File, path: Path, place: str) -> Array:
    found = numbers_in(file, path, place)
    assert found is not None
    return _numbers(values_of(found, path), path, place)


def _edges_of_events(file: h5py.File, path: Path, place: str) -> _Pulses:
    """Return the times of events; if their data have two levels, of the first events at each.

    Data with labels are numbers of lines, not levels: the pulses are then found among all events.
    """
    times = _times(file, path, f"{place}/timestamps")
    data = dataset_at(file, path, f"{place}/data")
    if data is None or data.dtype.kind not in "iufb" or data.shape != times.shape:
        return _Pulses(times)
    values = np.asarray(values_of(data, path), dtype=float)
    levels = np.unique(values)
    if len(levels) != _TWO or "labels" in data.attrs:
        return _Pulses(times)
    up, down = edges(values, float(levels.mean()), high_before=not values[0] > levels.mean())
    return _Pulses(times[up], times[down], True)


def _edges_of_samples(file: h5py.File, path: Path, place: str) -> _Pulses:
    """Return the times at which a sampled line rises beyond the middle of its range, and falls below it."""
    data, start = numbers_in(file, path, f"{place}/data"), dataset_at(file, path, f"{place}/starting_time")
    rate_hz = attribute_of(file, path, f"{place}/starting_time", "rate")
    if data is None or start is None or rate_hz is None or not 0 < rate_hz < np.inf or len(data) > _MOST_SAMPLES:
        raise RecordingError(
            f"{path}, {place}: must be one column of at most {_MOST_SAMPLES} samples, with the rate of sampling "
            "in starting_time",
            "no_line",
        )
    parts = [slice(at, at + _AT_ONCE) for at in range(0, len(data), _AT_ONCE)]
    read = (part_of(data, path, part).ravel() for part in parts)
    ends = np.array([(part.min(), part.max()) for part in read], dtype=float).reshape(-1, 2)
    low, high = (float(ends[:, 0].min()), float(ends[:, 1].max())) if len(ends) else (0.0, 0.0)
    up, down, before = [np.empty(0)], [np.empty(0)], None
    for part in parts if high > low else ():
        values, middle = part_of(data, path, part).ravel(), (low + high) / 2
        for every, some in zip((up, down), edges(values, middle, before), strict=True):
            every.append((part.start + some) / rate_hz)
        before = bool(values[-1] > middle)
    return _Pulses(float(start[()]) + np.concatenate(up), float(start[()]) + np.concatenate(down), True)


def _numbers(values: NDArray[np.generic], path: Path, dataset: str) -> Array:
    try:
        if values.dtype.kind in "SO":
            each = (one.decode() if isinstance(one, bytes) else str(one) for one in values.ravel().tolist())
            times = np.array([read_number(one) for one in each], dtype=np.float64).reshape(values.shape)
        else:
            times = np.asarray(values if values.dtype.kind in "iuf" else [None], dtype=np.float64)
    except (ValueError, TypeError):
        raise RecordingError(
            f"{path}, {dataset}: the values have type {values.dtype}; they must be times as numbers", "no_numbers"
        ) from None
    finite_times(path, dataset, times.ravel())
    return times
