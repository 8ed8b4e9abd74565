"""Spike times of one unit from an NWB file, read as the HDF5 that it is, so that h5py is enough.

Layout: NWB 2 schema. Spikes are in the table `units` (spike_times, its index, id), with the intervals in which each
unit was observed (obs_intervals), without those of the table `invalid_times`. Sync pulses are a table of intervals or
a TimeSeries called `sync_pulses`: events with timestamps, or a sampled line, whose rises count.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import ColumnMap, RecordingColumn, role_name
from rig.compare.recordings.hdf5 import Hdf5File, trouble
from rig.compare.recordings.spike_times import (
    THROUGHOUT,
    Array,
    FileIntervals,
    UnitSpikes,
    are_inside,
    extent,
    no_such_unit,
    union,
    without,
)
from rig.compare.recordings.sync_pulses import NO_PULSES, called_like_pulses, edges
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

    `uid` is that of the run: a file that was exported from it needs no pulses. The roles time, sync, observed and
    invalid of `columns` name another column of times, the pulses, another column of intervals, and another table of
    invalid times, each with its own unit.
    """
    with _damage_in_one_line(path), h5py.File(path) as opened:
        file = Hdf5File(path, opened)
        units = _Units.of(file, columns)
        row = units.row_of(unit)
        spikes = columns["time"].factor * units.times(row)
        file_s = columns["time"].factor * units.extent()
        observed = _observed(file, columns, units, row, spikes)
        invalid = _invalid(file, columns, np.append(file_s, observed[np.isfinite(observed)]))
        of_run = uid != "" and file.text("identifier").endswith(uid)
        pulses, stated, others = _pulses(file, columns, required=not of_run)
        pulse_s, end_s = (columns["sync"].factor * np.sort(one) for one in (pulses.begin, pulses.end))
        which = f"unit {units.ids[row]}, row {row + 1} of {len(units.ids)}"
        return UnitSpikes(
            path,
            unit,
            spikes,
            pulse_s,
            without(observed, invalid.spans_s),
            of_run=of_run,
            stated=stated,
            notes=tuple(units.unread(row, columns["observed"].name)),
            end_s=end_s,
            line=pulses.line,
            read_as=f"Spike times read: units/{units.column} in {columns['time'].unit or 's'}, {which}.",
            file_s=file_s,
            fired_s=file_s,
            intervals=(*([invalid] if len(invalid.spans_s) else []), *others),
        )


@contextmanager
def _damage_in_one_line(path: Path) -> Iterator[None]:
    """Raise RecordingError for any error that a file which cannot be opened, or a damaged one, causes."""
    try:
        open_file(path).close()  # for its checks
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}", "unreadable") from None
    try:
        yield
    except RecordingError:
        raise
    except OSError as error:
        raise trouble(path, error, "an NWB file") from None
    except (KeyError, RuntimeError, ValueError, TypeError, AttributeError, MemoryError) as error:
        reason = (str(error).strip("'\" ") or type(error).__name__).splitlines()[0]
        raise RecordingError(f"{path}: this NWB file (HDF5) is damaged: {reason}", "damaged_hdf5") from None


class _Units(NamedTuple):
    """The table of units: the column of times, ids, and the datasets of the times and of their ends."""

    file: Hdf5File
    column: str
    ids: list[str]
    all_times: h5py.Dataset
    ends: h5py.Dataset

    @classmethod
    def of(cls, file: Hdf5File, columns: ColumnMap) -> "_Units":
        name = columns["time"].name if "time" in columns.named else _TIMES
        times, ends, numbers = (file.numbers(f"units/{column}") for column in (name, f"{name}_index", "id"))
        if times is None or ends is None or numbers is None:
            raise RecordingError(
                f"{file.path}: no spike times; the file must have a table units with a column {name} (and "
                f"{name}_index and id)",
                "no_spike_times",
            )
        ids = [str(number) for number in file.values(numbers, most=_MOST_UNITS)]
        if len(ends) != len(ids):
            raise RecordingError(
                f"{file.path}: units/{name}_index has {len(ends)} values, but units/id has {len(ids)}",
                "not_one_end_a_unit",
            )
        return cls(file, name, ids, times, ends)

    def row_of(self, unit: str) -> int:
        """Return the row of a unit by its id or a text of its row, "COLUMN=TEXT", or "row=NUMBER" from 1.

        Raises RecordingError.
        """
        if unit == "" and len(self.ids) == 1:
            return 0
        labels = self._labels()
        column, equals, text = unit.partition("=")
        if equals and column == _ROW:
            found = [n for n in range(len(self.ids)) if str(n + 1) == text]
        elif equals and (texts := labels.get(column) or self._whole_numbers(column)):
            found = [n for n, one in enumerate(texts) if one == text]
        else:
            found = [n for n in range(len(self.ids)) if any(texts[n] == unit for texts in labels.values())]
        if unit and len(found) == 1:
            return found[0]
        several = len(found) > 1 and unit != ""
        listed = found if several else range(len(self.ids))
        each = [self._described(labels, n, several) for n in list(listed)[:_MOST_LISTED]]
        between = "; " if any(":" in one for one in each) else ", "
        ids = between.join(each) + f"{between}…" * (len(listed) > _MOST_LISTED)
        if several:
            raise RecordingError(
                f"{self.file.path}: several units are called {unit}; use SHAPE={self.file.path.name}#UNIT with UNIT "
                f"one of {ids}",
                "unit_twice",
            )
        rows = f"row=1 to row={len(self.ids)}{between}" if equals and column == _ROW else ""
        raise no_such_unit(self.file.path, unit, f"{len(self.ids)} units", f"{rows}{ids}")

    def _labels(self) -> dict[str, list[str]]:
        """Return the ids and the texts of all units by column, the names of the units first."""
        found = {"id": self.ids}
        for column in sorted(self.file.members("units"), key=lambda one: (one not in _NAMES, one)):
            texts = self.file.texts(f"units/{column}")
            if texts is not None and len(texts) == len(self.ids):
                found[column] = texts
        return found

    def _plain(self, column: str, kinds: str) -> h5py.Dataset | None:
        """Return a column with one value for each unit, of some kinds of values; None for others."""
        found = self.file.dataset(f"units/{column}")
        shapes = (len(self.ids),), (len(self.ids), 1)
        return found if found is not None and found.dtype.kind in kinds and found.shape in shapes else None

    def _whole_numbers(self, column: str) -> list[str]:
        """Return the whole numbers of all units in a column as texts; none without such a column."""
        found = self._plain(column, "iu")
        return [] if found is None else [str(number) for number in self.file.values(found).ravel().tolist()]

    def unread(self, row: int, observed: str) -> list[str]:
        """Return a sentence on the values of a unit that are not read and may say that it does not count."""
        every = self.file.members("units")
        read = {self.column, observed, "id", *_NAMES[:2]}
        ragged = {name.removesuffix("_index") for name in every if name.endswith("_index")}
        each = (name for name in every if name.removesuffix("_index") not in read | ragged)
        said = [f"{name} = {value}" for name in each if (value := self._value(name, row)) is not None]
        more = f" and {len(said) - _MOST_LISTED} more" * (len(said) > _MOST_LISTED)
        return [f"Columns of the unit that are not read: {', '.join(said[:_MOST_LISTED])}{more}. If they say that it "
                "does not count, choose another unit."] if said else []  # fmt: skip

    def _value(self, column: str, row: int) -> str | None:
        """Return the text, truth value or number of a unit in a column as text; None in another kind of column."""
        texts = self.file.texts(f"units/{column}")
        if texts is not None:
            return texts[row] if len(texts) == len(self.ids) else None
        found = self._plain(column, "iufb")
        if found is None:
            return None
        value = self.file.values(found, row, row + 1)[0].item()
        return f"{value:g}" if isinstance(value, float) else str(value)

    def _described(self, labels: dict[str, list[str]], row: int, several: bool) -> str:
        """Return a unit for a list: its id and texts, and how to choose it if its id or text does not."""
        about = ", ".join(f"{column} {texts[row]}" for column, texts in list(labels.items())[1:_MOST_TEXTS])
        shown = f"{self.ids[row]}{f' ({about})' if about else ''}"
        if not several and self.ids.count(self.ids[row]) == 1:
            return shown
        alone = (f"{column}={texts[row]}" for column, texts in labels.items() if texts.count(texts[row]) == 1)
        return f"{shown}: #{next(alone, f'{_ROW}={row + 1}')}"

    def times(self, row: int) -> Array:
        """Return the spike times of a row in the unit of the file. Raises RecordingError."""
        name = f"unit {self.ids[row]}, column {self.column}"
        return self.file.times(self.all_times, *self.bounds(self.ends, self.column, row, len(self.all_times)), name)

    def bounds(self, ends: h5py.Dataset, column: str, row: int, values: int) -> tuple[int, int]:
        """Return the first and the end index of a unit's values in a column of this length."""
        at = [0, *self.file.times(ends).tolist()]
        if ends.dtype.kind not in "iu" or (np.diff(at) < 0).any() or at[-1] != values:
            raise self.file.refused(
                f"units/{column}_index",
                "wrong_index",
                f"must rise to {values}, the length of {column}, with a number for each of {len(self.ids)} units, "
                f"but ends at {at[-1]:g}",
            )
        return int(at[row]), int(at[row + 1])

    def extent(self) -> Array:
        """Return the first and the last spike times of parts of the column, of all units, in the unit of the file."""
        parts = (slice(at, at + _AT_ONCE) for at in range(0, len(self.all_times), _AT_ONCE))
        each = (self.file.part(self.all_times, part).ravel() for part in parts)
        return extent(*(some.astype(float) for some in each if some.dtype.kind in "iuf"))


def _observed(file: Hdf5File, columns: ColumnMap, units: _Units, row: int, spike_s: Array) -> Array:
    """Return the intervals (n, 2) in which a unit was observed, in s; infinite if the file states none."""
    named = "observed" in columns.named and not columns.observed_throughout
    column = columns["observed"] if named else RecordingColumn(role_name("observed"))
    place = f"units/{column.name}"
    if not named and {column.name, f"{column.name}_index"}.isdisjoint(file.members("units")):
        return THROUGHOUT
    intervals, ends = file.numbers(place, columns=2), file.numbers(f"{place}_index")
    if intervals is None or ends is None or len(ends) != len(units.ids):
        problem = f"must be intervals (n × 2) with an index {place}_index of {len(units.ids)} units"
        raise file.refused(place, "bad_obs_intervals", problem)
    spans = file.times(intervals, *units.bounds(ends, column.name, row, len(intervals)))
    found = _intervals_s(file, place, "observed", column, spans)
    inside = int(np.count_nonzero(are_inside(found, spike_s)))
    if len(found) and 2 * inside < len(spike_s):
        raise RecordingError(
            f"{file.path}: only {inside} of {len(spike_s)} spikes of unit {units.ids[row]} ({spike_s.min():g} to "
            f"{spike_s.max():g} s) lie in its {column.name}, {float(found[0, 0]):g} to {float(found[-1, 1]):g} s, "
            f"and all should; if one of the two is in ms, state it, e.g. --columns observed={column.name}:ms or "
            f"--columns time={units.column}:ms; if the unit was lost, or not held, at these times, delete the spikes "
            "there, or correct its intervals",
            "spikes_outside_observed",
        )
    return found


def _invalid(file: Hdf5File, columns: ColumnMap, others_s: Array) -> FileIntervals:
    """Return the intervals of the table invalid_times; none without such a table.

    `others_s` are other times of the file.
    """
    column = columns["invalid"]
    place = f"intervals/{column.name}"
    if column.name not in file.members("intervals") and "invalid" not in columns.named:
        return FileIntervals(column.name, np.empty((0, 2)))
    ends = [file.numbers(f"{place}/{end}") for end in ("start_time", "stop_time")]
    each = [file.times(one) for one in ends if one is not None]
    if len(each) < len(ends) or len(each[0]) != len(each[1]):
        raise file.refused(place, "bad_invalid_times", "must have as many start_time as stop_time")
    last_s = float(others_s.max(initial=0.0))
    spans_s = _intervals_s(file, place, "invalid", column, np.column_stack(each), last_s)
    option = "" if column.stated else f"--columns invalid={column.name}"
    return FileIntervals(column.name, spans_s, excluded=True, unit_option=option)


def _intervals_s(
    file: Hdf5File, place: str, role: str, column: RecordingColumn, spans: Array, last_s: float = np.inf
) -> Array:
    """Return intervals (n, 2) in s; refuse those that end before they begin, or seem to be in another unit.

    They do if they reach over a day, or end long after the last other time of the file, unless their unit is stated.
    """
    if (spans[:, 1] < spans[:, 0]).any():
        raise file.refused(place, "backwards", "an interval ends before it begins")
    found = union(column.factor * spans)
    finite = found[np.isfinite(found)]
    too_long = len(finite) and np.ptp(finite) > _LONGEST_S
    too_late = len(finite) and finite.max() > _FARTHEST * last_s > 0
    if (too_long or too_late) and not column.stated:
        reason = "are longer than a day" if too_long else f"end long after the last time of a unit, {last_s:g} s"
        raise file.refused(
            place,
            "beyond_a_finger",
            f"{finite.min():g} to {finite.max():g} s {reason}; if they are in ms, use --columns "
            f"{role}={column.name}:ms (in s: {column.name}:s)",
        )
    return found


_LONGEST_S = 86_400.0
_FARTHEST = 100.0
"""Ratio of times beyond which the later ones are in another unit."""


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


_WHERE = ("acquisition", "stimulus", "processing", "events", "analysis", "scratch")
_DEEPEST = 3
_TELLING = {
    "events": ("timestamps",),
    "intervals": ("start_time",),
    "times": ("timestamp",),
    "samples": ("data", "starting_time"),
}
"""Datasets of a group by which its kind is told; the first has the times, or is as long."""


def _candidates(file: Hdf5File, invalid: str) -> list[_Candidate]:
    """Return all tables of intervals but the `invalid` ones, and series that have times, sampled or not."""
    found = [
        _Candidate(f"intervals/{name}", "intervals", size)
        for name in file.members("intervals")
        if name != invalid and (size := file.rows(f"intervals/{name}/start_time")) is not None
    ]
    places = [(where, 0) for where in _WHERE]
    while places:
        place, depth = places.pop(0)
        inside = file.members(place)
        has = next((kind for kind, names in _TELLING.items() if all(name in inside for name in names)), None)
        if has is not None:
            size = file.rows(f"{place}/{_TELLING[has][0]}")
            found += [] if size is None else [_Candidate(place, has, size)]
        elif depth <= _DEEPEST:
            places += [(f"{place}/{name}", depth + 1) for name in inside]
    return found


def _may_be_pulses(file: Hdf5File, one: _Candidate) -> bool:
    """Return whether something looks like pulses, although it is not called so: no measured signal does."""
    if one.kind in ("intervals", "times") or called_like_pulses(one.place):
        return True
    if one.kind != "events":
        return False
    data = file.dataset(f"{one.place}/data")
    return data is None or data.dtype.kind in "iubSO"


class _Pulses(NamedTuple):
    """Beginnings and ends of pulses in the unit of the file, and whether they are those of a line with two levels."""

    begin: Array
    end: Array = np.empty(0)
    line: bool = False


def _pulses(file: Hdf5File, columns: ColumnMap, *, required: bool) -> tuple[_Pulses, bool, list[FileIntervals]]:
    """Return the pulses, whether the user states that there are none, and intervals that are not pulses.

    Without `required`, something that may be pulses by another name is not.
    """
    name, named = columns["sync"].name, "sync" in columns.named
    every = _candidates(file, columns["invalid"].name)
    if named and name == NO_PULSES:
        return _Pulses(np.empty(0)), True, _unused(file, every)
    meant = [one for one in every if name in (one.place, one.name)]
    if len(meant) == 1:
        return _edges(file, meant[0]), False, _unused(file, [one for one in every if one is not meant[0]])
    likely = [one for one in every if _may_be_pulses(file, one)]
    if not (meant or named or (likely and required)):
        return _Pulses(np.empty(0)), False, []
    listed = [one.place if meant else str(one) for one in meant or likely or every][:_MOST_LISTED]
    held = ", ".join(listed) or "nothing that has times"
    problem, code = (
        f"there are no sync pulses {name}, but there is {held}",
        "no_pulses" if named else "unknown_pulses",
    )
    if meant:
        problem, code = f"several series are called {name}: {held}", "pulses_twice"
    raise RecordingError(
        f"{file.path}: {problem}; use --columns sync=NAME for the pulses, or sync=none if times are those of the "
        "run's journal (t_s)",
        code,
    )


def _unused(file: Hdf5File, others: Sequence[_Candidate]) -> list[FileIntervals]:
    """Return the intervals that are not the pulses, with tags, and columns that may reject some."""
    found = []
    for one in [one for one in others if one.kind == "intervals"][:_MOST_LISTED]:
        rejecting = [f"column {name}" for name in file.members(one.place) if REJECTING.search(name)]
        about = [*rejecting, *sorted(set(file.texts(f"{one.place}/tags") or []))][:_MOST_LISTED]
        begin, stop = _times(file, f"{one.place}/start_time"), f"{one.place}/stop_time"
        end = _times(file, stop) if file.rows(stop) == len(begin) else begin
        found.append(FileIntervals(one.name, np.column_stack([begin, end]), about=tuple(about)))
    return found


def _edges(file: Hdf5File, one: _Candidate) -> _Pulses:
    if one.kind == "events":
        return _edges_of_events(file, one.place)
    if one.kind == "samples":
        return _edges_of_samples(file, one.place)
    stop = f"{one.place}/stop_time"
    end = _times(file, stop) if file.rows(stop) is not None else np.empty(0)
    return _Pulses(_times(file, f"{one.place}/{_TELLING[one.kind][0]}"), end)


def _times(file: Hdf5File, place: str) -> Array:
    found = file.numbers(place)
    assert found is not None
    return file.times(found, name=place)


def _edges_of_events(file: Hdf5File, place: str) -> _Pulses:
    """Return the times of events; if their data have two levels, of the first events at each.

    Data with labels are numbers of lines, not levels: the pulses are then found among all events.
    """
    times, data = _times(file, f"{place}/timestamps"), file.dataset(f"{place}/data")
    if data is None or data.dtype.kind not in "iufb" or data.shape != times.shape:
        return _Pulses(times)
    values = np.asarray(file.values(data), dtype=float)
    levels = np.unique(values)
    if len(levels) != _TWO or "labels" in data.attrs:
        return _Pulses(times)
    up, down = edges(values, float(levels.mean()), high_before=not values[0] > levels.mean())
    return _Pulses(times[up], times[down], True)


def _edges_of_samples(file: Hdf5File, place: str) -> _Pulses:
    """Return the times at which a sampled line rises beyond the middle of its range, and falls below it."""
    data, start = file.numbers(f"{place}/data"), file.dataset(f"{place}/starting_time")
    rate_hz = file.attribute(f"{place}/starting_time", "rate")
    if data is None or start is None or rate_hz is None or not 0 < rate_hz < np.inf or len(data) > _MOST_SAMPLES:
        raise file.refused(
            place,
            "no_line",
            f"must be one column of at most {_MOST_SAMPLES} samples, with the rate of sampling in starting_time",
        )
    parts = [slice(at, at + _AT_ONCE) for at in range(0, len(data), _AT_ONCE)]
    read = (file.part(data, part).ravel() for part in parts)
    ends = np.array([(part.min(), part.max()) for part in read], dtype=float).reshape(-1, 2)
    low, high = (float(ends[:, 0].min()), float(ends[:, 1].max())) if len(ends) else (0.0, 0.0)
    up, down, before = [np.empty(0)], [np.empty(0)], None
    for part in parts if high > low else ():
        values = file.part(data, part).ravel()
        for every, some in zip((up, down), edges(values, (low + high) / 2, before), strict=True):
            every.append((part.start + some) / rate_hz)
        before = bool(values[-1] > (low + high) / 2)
    return _Pulses(float(start[()]) + np.concatenate(up), float(start[()]) + np.concatenate(down), True)
