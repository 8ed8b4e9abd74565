"""Spike times and sync pulses from the files of recording systems, read through the package neo.

A file has spike trains and event channels. Spikes come from a spike train, or from an event channel such as the line
of a spike discriminator. Pulses come from an event channel; of an epoch its beginning counts. A channel whose events
carry several labels, such as the lines of a TTL port, also appears once per label, as "TTL/1".
"""

import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import same_name
from rig.compare.recordings.columns import ColumnMap
from rig.compare.recordings.hdf5 import trouble
from rig.compare.recordings.recording import finite_times
from rig.compare.recordings.spike_times import THROUGHOUT, FileIntervals, UnitSpikes, extent, no_such_unit
from rig.compare.recordings.sync_pulses import NO_PULSES, called_like_pulses, edges
from rig_shared.plural import number_of
from rig_shared.user_files import open_file

Array = NDArray[np.float64]


class NeoFormat(NamedTuple):
    """A format: its title, the class of neo that reads it, and whether it was tried on a file of this format."""

    title: str
    reader: str
    tried: bool


OPEN_EPHYS = NeoFormat("Open Ephys binary", "OpenEphysBinaryIO", True)

BY_SUFFIX = {
    ".nix": NeoFormat("NIX", "NixIO", True),
    ".smr": NeoFormat("Spike2", "Spike2IO", True),
    ".smrx": NeoFormat("Spike2, 64 bit", "CedIO", False),
    ".plx": NeoFormat("Plexon", "PlexonIO", True),
    ".pl2": NeoFormat("Plexon 2", "Plexon2IO", False),
    ".nex": NeoFormat("NeuroExplorer", "NeuroExplorerIO", True),
    ".nev": NeoFormat("Blackrock", "BlackrockIO", False),
}
"""Formats that are one file. Formats that neo unpickles are left out, since such a file can run any code."""

_OEBIN = "structure.oebin"
_MOST_LISTED = 20
_MOST_LABELS = 64


def neo_format(path: Path) -> NeoFormat | None:
    """Return the format by which neo reads a path, or None for other files."""
    if path.is_dir():
        return OPEN_EPHYS if next(path.rglob(_OEBIN), None) is not None else None
    return BY_SUFFIX.get(path.suffix.lower())


@dataclass(frozen=True)
class _Train:
    """A spike train: its spikes (s), when it states that it began and ended (s), and its annotations."""

    spike_s: Array
    begin_s: float
    end_s: float
    annotations: Mapping[str, str]

    @property
    def unread(self) -> list[str]:
        """Return a sentence on annotations, which may say that the unit does not count."""
        said = [f"{name} = {text}" for name, text in self.annotations.items()][:_MOST_LISTED]
        return [f"Annotations of the unit that are not read: {', '.join(said)}. If they say that it does not count, "
                "choose another unit."] if said else []  # fmt: skip

    @property
    def last_s(self) -> float:
        """Time of the last spike; the beginning without one."""
        return float(self.spike_s.max(initial=self.begin_s))

    def observed(self, name: str, *, throughout: bool) -> tuple[Array, list[str]]:
        """Return the span in which the unit was observed, and sentences on a beginning or end that is not believed.

        An end at the last spike is not believed, nor a beginning at 0 beside it: exports write them if they do not
        know when the recording began and ended. A beginning at the first spike holds unless the user knows better.
        """
        ends_known = self.end_s > self.last_s
        begin_s = self.begin_s if ends_known or self.begin_s > 0 else -np.inf
        end_s = self.end_s if ends_known else np.inf
        said = []
        first_s = float(self.spike_s.min(initial=np.inf))
        if 0 < first_s < np.inf and abs(begin_s - first_s) <= _SAME_S:
            before = (
                "as observed, as observed=throughout states."
                if throughout
                else "as not observed; if the unit was observed, use --columns observed=throughout."
            )
            said.append(
                f"The file states that {name} begins at its first spike ({first_s:.1f} s), as exports do that do not "
                f"know when the recording began. Presses before it count {before}"
            )
            begin_s = -np.inf if throughout else begin_s
        if not ends_known and len(self.spike_s):
            said.append(
                f"The file states that {name} ends at its last spike ({self.last_s:.1f} s), as exports do that do "
                "not know when the recording ended. This is not taken for its end: presses before later events of "
                "the file count as observed."
            )
        return np.array([[begin_s, end_s]]), said


_SAME_S = 1e-6


@dataclass(frozen=True)
class _Segment:
    """A segment's spike trains, event channels (s) and sampled channels, by the names that choose them."""

    trains: Mapping[str, _Train]
    events: Mapping[str, Array]
    lines: Mapping[str, Callable[[], tuple[Array, Array]]]
    """Rises and falls of sampled channels."""
    epochs: Mapping[str, Array]
    """Intervals (n, 2) of the event channels that are epochs (s)."""

    @property
    def spikes(self) -> dict[str, Array]:
        """Spikes of all trains."""
        return {name: train.spike_s for name, train in self.trains.items()}

    @property
    def empty(self) -> bool:
        """Whether there is neither a spike nor an event."""
        return not any(map(len, (*self.spikes.values(), *self.events.values())))

    @property
    def contents(self) -> str:
        """List of all names with their numbers of spikes or events."""
        trains, events = (
            ", ".join(f"{name} ({number_of(len(times), kind)})" for name, times in list(some.items())[:_MOST_LISTED])
            for some, kind in ((self.spikes, "spikes"), (self.events, "events"))
        )
        lines = f"; sampled channels: {', '.join(list(self.lines)[:_MOST_LISTED])}" if self.lines else ""
        return f"spike trains: {trains or 'none'}; event channels: {events or 'none'}{lines}"

    @property
    def may_have_pulses(self) -> bool:
        """Whether there are events, or a sampled channel that is called as a line of pulses."""
        return any(map(len, self.events.values())) or any(map(called_like_pulses, self.lines))


def read_neo(path: Path, unit: str, columns: ColumnMap, uid: str = "") -> UnitSpikes:
    """Return the spikes and sync pulses of a file, and when the unit was observed.

    Parameters
    ----------
    path : Path
        File, or the folder of an Open Ephys recording.
    unit : str
        Name of a spike train or event channel; "" for the only spike train.
    columns : ColumnMap
        `sync` names the event channel or sampled line of the pulses, or is "none"; `segment` is a number from 1.
    uid : str
        Of the run; not used.

    Raises
    ------
    RecordingError
        If the file cannot be read, or if a choice is missing; the message then lists what is in the file.
    """
    segment = _one_segment(path, _segments(path), columns)
    name = _unit(path, segment, unit)
    channel, pulses, ends = _pulses(path, segment, columns)
    train = segment.trains.get(name)
    observed, said = (
        (THROUGHOUT, []) if train is None else train.observed(name, throughout=columns.observed_throughout)
    )
    return UnitSpikes(
        path,
        unit,
        finite_times(path, name, segment.events[name] if train is None else train.spike_s),
        np.sort(finite_times(path, channel, pulses)),
        observed,
        notes=(*said, *(() if train is None else train.unread)),
        stated="sync" in columns.named and columns["sync"].name == NO_PULSES,
        end_s=ends,
        line=channel in segment.lines,
        read_as=f"Spike times read: {name}.",
        file_s=extent(*segment.spikes.values(), *segment.events.values()),
        fired_s=extent(*segment.spikes.values()),
        intervals=tuple(FileIntervals(one, spans) for one, spans in segment.epochs.items() if one != channel),
    )


def _segments(path: Path) -> list[_Segment]:
    """Return all segments, those of every block in order."""
    found = neo_format(path)
    assert found is not None
    try:
        for one in (one for one in path.rglob("*") if not one.is_dir()) if path.is_dir() else (path,):
            open_file(one).close()  # for its checks
    except OSError as error:
        reason = error.strerror or str(error)
        raise RecordingError(f"{error.filename or path}: {reason}", "unreadable") from None
    with warnings.catch_warnings(), redirect_stderr(StringIO()):  # the reader of Plexon files draws progress bars
        warnings.simplefilter("ignore")  # neo warns of its own future and of channels that are not used here
        neo_io = _neo(path, found)
        try:
            read = [_segment(segment) for block in _blocks(neo_io, found, path) for segment in block.segments]
        except Exception as error:  # a reader raises whatever a wrong byte leads to
            said = trouble(path, error, "a NIX file") if found.reader == "NixIO" else None
            if said is not None and said.code in ("locked_hdf5", "truncated_hdf5"):
                raise said from None
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise RecordingError(
                f"{path}: neo cannot read this file as {found.title}: {reason}", "neo_cannot_read"
            ) from None
    return read


def _neo(path: Path, found: NeoFormat) -> Any:
    try:
        import neo.io  # slow to import, and an optional package
    except ImportError:
        raise RecordingError(
            f"{path}: {found.title} files require the package neo; install it with pip install "
            "'indentation-rig[neo]'",
            "neo_missing",
        ) from None
    return neo.io


def _blocks(neo_io: Any, found: NeoFormat, path: Path) -> list[Any]:
    kind = getattr(neo_io, found.reader)
    if found.reader == "NixIO":
        with kind(str(path), mode="ro") as reader:  # the default mode may write to the file
            return list(reader.read_all_blocks())
    return list(kind(str(path)).read(lazy=True))  # leaves signals on the disk


def _segment(segment: Any) -> _Segment:
    trains = {name: _train(one) for name, one in _named([_loaded(one) for one in segment.spiketrains])}
    events: dict[str, Array] = {}
    epochs: dict[str, Array] = {}
    for name, one in _named([_loaded(one) for one in (*segment.events, *segment.epochs)]):
        events[name] = times = _in_seconds(one)
        if hasattr(one, "durations"):
            lasts = np.asarray(one.durations.rescale("s").magnitude, dtype=float)
            epochs[name] = np.column_stack([times, times + lasts]) if len(lasts) == len(times) else np.empty((0, 2))
        texts = np.array([same_name(str(text)) for text in np.asarray(one.labels)], dtype=str)
        distinct = sorted(set(texts.tolist()))
        if 1 < len(distinct) <= _MOST_LABELS and len(texts) == len(times):
            events |= {f"{name}/{text}": times[texts == text] for text in distinct}
    return _Segment(trains, events, _lines(segment), epochs)


def _train(train: Any) -> _Train:
    begin_s, end_s = (float(end.rescale("s").magnitude) for end in (train.t_start, train.t_stop))
    own = {name: value for name, value in train.annotations.items() if isinstance(value, str | int | float)}
    stated = {one: f"{value}" for one, value in own.items() if one not in _OF_FORMATS and not one.startswith("nix_")}
    return _Train(_in_seconds(train), begin_s, end_s, stated)


_OF_FORMATS = ("id", "name", "description", "unit_id", "channel_id", "unit_index", "channel_index", "segment_index")


def _lines(segment: Any) -> dict[str, Callable[[], tuple[Array, Array]]]:
    """Return the sampled channels that have a name."""
    signals = [one for one in segment.analogsignals if one.name]
    return {
        same_name(str(one.name)) if one.shape[1] == 1 else same_name(f"{one.name}/{k + 1}"): partial(_edges, one, k)
        for one in signals
        for k in range(one.shape[1])
    }


def _edges(signal: Any, channel: int) -> tuple[Array, Array]:
    loaded = _loaded(signal)
    values = np.asarray(loaded.magnitude)[:, channel]
    if not len(values):
        return np.empty(0), np.empty(0)
    start_s, rate_hz = float(loaded.t_start.rescale("s")), float(loaded.sampling_rate.rescale("Hz"))
    up, down = edges(values, (float(values.min()) + float(values.max())) / 2)
    return start_s + up / rate_hz, start_s + down / rate_hz


def _loaded(one: Any) -> Any:
    return one.load() if hasattr(one, "load") else one


def _in_seconds(one: Any) -> Array:
    return np.asarray(one.times.rescale("s").magnitude, dtype=float)


def _named(found: Sequence[Any]) -> Iterator[tuple[str, Any]]:
    """Name each channel: by its name, by its id if several share the name, or by its number."""
    names = [same_name(str(one.name or "")) for one in found]
    ids = [str(one.annotations.get("id", "")) for one in found]
    for number, (one, name, key) in enumerate(zip(found, names, ids, strict=True), 1):
        unique = [text for text, all_ in ((name, names), (key, ids)) if text and Counter(all_)[text] == 1]
        taken = str(number) in names or str(number) in ids
        yield (unique[0] if unique else f"channel {number}" if taken else str(number)), one


def _one_segment(path: Path, segments: list[_Segment], columns: ColumnMap) -> _Segment:
    full = {str(n): one for n, one in enumerate(segments, 1) if not one.empty}
    if not full:
        raise RecordingError(f"{path}: contains no spikes and no events; at least one spike is required", "no_spikes")
    number = columns.named["segment"].name if "segment" in columns.named else ""
    if number in full:
        return full[number]
    if number == "" and len(full) == 1:
        return next(iter(full.values()))
    held = "; ".join(f"segment {n}: {one.contents}" for n, one in full.items())
    problem = f"there is no segment {number}" if number else f"{len(full)} segments"
    raise RecordingError(
        f"{path}: {problem}; use --columns segment=N ({held})", "no_segment" if number else "several_segments"
    )


def _unit(path: Path, segment: _Segment, unit: str) -> str:
    """Return the spike train or event channel that was chosen, or the only train with spikes."""
    if unit in segment.trains or unit in segment.events:
        return unit
    firing = [name for name, spike_s in segment.spikes.items() if len(spike_s)]
    if unit == "" and len(firing) == 1:
        return firing[0]
    raise no_such_unit(path, unit, f"{len(firing)} spike trains", segment.contents)


def _pulses(path: Path, segment: _Segment, columns: ColumnMap) -> tuple[str, Array, Array]:
    """Return the channel of the pulses, their beginnings, and their ends for a line."""
    name = same_name(columns["sync"].name)
    if columns["sync"].stated:
        raise RecordingError(
            f"{path}: --columns sync={name}:{columns['sync'].unit} must not state a unit of time; the file does",
            "no_unit_here",
        )
    if name in segment.events:
        return name, segment.events[name], np.empty(0)
    if name in segment.lines:
        return name, *segment.lines[name]()
    given = "sync" in columns.named
    if name == NO_PULSES or (not given and not segment.may_have_pulses):
        return name, np.empty(0), np.empty(0)
    problem = (
        f"there is no event channel or sampled channel {name}"
        if given
        else "the channel of the sync pulses is unknown"
    )
    raise RecordingError(
        f"{path}: {problem}; use --columns sync=CHANNEL, or sync=none if times are those of the run's journal "
        f"({segment.contents})",
        "no_pulses" if given else "several_channels",
    )
