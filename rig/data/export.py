"""Export of the journal as HDF5 and CSV, or as NWB (extra `nwb`); each file is replaced in one step."""

import csv
import io
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.data.dictionary import about_table, column_of
from rig.data.events import Column, HoldEndEvent, columns_of
from rig.data.folder import replacement, write_all
from rig.data.presses import PressRecord, presses_table
from rig.data.run import Run, RunError, RunReadings, provenance_of
from rig.data.spike_files import SPIKES, SYNTHETIC, SpikeRecord, about_columns, values_of, write_csv, write_nix
from rig.data.tables import Table, tables
from rig.errors import RigError
from rig.printable import printable
from rig.units import GWT_N

if TYPE_CHECKING:
    import h5py

ROWS_AT_ONCE = 1 << 14
"""Rows of a table in memory, whatever its length."""


def export_run(run: Run, *, again: bool = True) -> None:
    """Write data.h5 (units as attributes) and STREAM.csv beside the journal; again=False writes only missing files.

    Events of indentations that were interrupted and repeated go into separate tables, STREAM_superseded. Texts are
    without NUL, halves of surrogate pairs and other control characters, which HDF5 cannot hold.
    """
    run = replace(run, start=_plain(run.start), units=_plain(run.units))
    found = tables(run)
    for name in found:
        if not re.fullmatch(r"\w+", name):  # it becomes the name of a file
            raise RunError(f"run folder {run.folder.path}: the stream {name!r} is not a name", "bad_journal")
    if again or not run.folder.data.exists():
        with _hdf5(run.folder.data) as file:
            _write_hdf5(run, found, file)
    for name, table in found.items():
        path = run.folder.path / f"{name}.csv"
        if again or not path.exists():
            with replacement(path) as stream:
                _write_csv(table, stream)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return printable(value) if isinstance(value, str) else value


def _blocks(table: Table) -> Iterator[list[list[Any]]]:
    """Yield the rows of a table, some at once, with its columns in order; None where a row lacks one."""
    rows = iter(table.rows)
    while some := [[_plain(row.get(name)) for name in table.units] for row in islice(rows, ROWS_AT_ONCE)]:
        yield some


def _write_csv(table: Table, stream: io.FileIO) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.units)
    for rows in _blocks(table):
        writer.writerows(rows)
        write_all(stream, text.getvalue().encode("utf-8", "backslashreplace"))
        text.seek(0)
        text.truncate()


class _Image:
    """File for HDF5, which cannot be closed after a failed write: the first error is kept, and the rest is lost."""

    def __init__(self, file: io.FileIO) -> None:
        self._file = file
        self.problem: OSError | None = None
        self.seek, self.tell, self.flush = file.seek, file.tell, file.flush
        self.read, self.readinto = file.read, file.readinto

    def write(self, content: memoryview) -> int:
        if self.problem is None:
            try:
                write_all(self._file, content)
            except OSError as error:
                self.problem = error
        return len(content)

    def truncate(self, size: int) -> int:
        try:
            return self._file.truncate(size)
        except OSError as error:
            self.problem = self.problem or error
            return size


@contextmanager
def _hdf5(path: Path) -> "Iterator[h5py.File]":
    """Yield a new HDF5 file, which replaces a file on disk in one step. Raises UnwritableError."""
    import h5py  # a command that has nothing to write yet does without

    with replacement(path) as stream:
        image = _Image(stream)
        try:
            with h5py.File(image, "w") as file:
                yield file
        except Exception:
            if image.problem is None:
                raise
        if image.problem is not None:
            raise image.problem


class _TextError(Exception):
    """Text in a column of numbers."""


def _write_hdf5(run: Run, found: Mapping[str, Table], file: "h5py.File") -> None:
    file.attrs.update(_attributes(run))
    for stream, table in found.items():
        texts = set[str]()
        while True:
            try:
                _write_group(file.create_group(stream), stream, table, texts)
                break
            except _TextError as error:  # in a journal of another program
                texts.add(str(error))
                del file[stream]


def _write_group(group: "h5py.Group", stream: str, table: Table, texts: Collection[str]) -> None:
    """Write a table; numbers as float64 (NaN if missing), flags as bool, text as UTF-8. Raises _TextError."""
    import h5py

    group.attrs["description"] = about_table(stream)
    size, columns = len(table.events), {name: column_of(stream, name) for name in table.units}
    of_text = h5py.string_dtype()
    kinds: dict[str, Any] = {}
    for name, column in columns.items():
        type_ = str if name in texts else float if column is None else column.type
        kinds[name] = bool if type_ is bool else of_text if type_ is str else float
    datasets = dict[str, h5py.Dataset]()
    begin = 0
    for rows in _blocks(table):
        end = begin + len(rows)
        for (name, kind), values in zip(kinds.items(), zip(*rows, strict=True), strict=True):
            array = _as_array(name, kind, values)
            if end - begin == size:  # Filling a dataset that exists takes twice as long.
                datasets[name] = group.create_dataset(name, data=array, dtype=kind)
                continue
            if not begin:
                datasets[name] = group.create_dataset(name, shape=(size,), dtype=kind)
            datasets[name][begin:end] = array
        begin = end
    for name, dataset in datasets.items():
        column = columns[name]
        dataset.attrs["unit"] = table.units[name]
        dataset.attrs["description"] = "" if column is None else column.what


def _attributes(run: Run) -> dict[str, Any]:
    """Return the attributes of the file, as described in rig/data/dictionary.py."""
    start = run.start
    return {
        "run": printable(run.folder.path.resolve().name),
        "uid": start.get("uid", ""),
        "date_utc": datetime.fromtimestamp(start["unix_s"], UTC).isoformat(timespec="seconds"),
        "version": _plain(provenance_of(run)).get("versions", {}).get("indentation-rig", ""),
        "protocol": start["protocol"],
        "title": start["title"],
        "subject": start.get("subject") or "",
        "virtual": bool(start["virtual"]),
        "planned_indentations": start["planned_indentations"],
        "complete": run.complete,
    }


def _as_array(name: str, kind: Any, values: Sequence[Any]) -> Any:
    """Return values as an array of a kind. Raises _TextError."""
    if kind is bool:
        return np.array([value is True for value in values])
    if kind is not float:
        return np.array(["" if value is None else str(value) for value in values], dtype=kind)
    if not all(value is None or isinstance(value, int | float) for value in values):
        raise _TextError(name)
    return np.array([np.nan if value is None else float(value) for value in values])


# A run as Neurodata Without Borders (NWB 2, HDF5), for sharing beside a recording. Needs the extra `nwb`.
# Times are seconds since the start of the run. Positions are in the finger's frame, in meters as NWB
# requires.

_M_PER_MM = 1e-3


class NwbMissingError(RigError):
    """Error of missing libraries for NWB."""

    default_code = "pynwb_missing"


def export_spikes(run: Run, spikes: SpikeRecord) -> tuple[list[Path], list[str]]:
    """Write simulated spikes as CSV, NWB and NIX; return the files and the extras that were missing."""
    written, missing = write_csv(run.folder, spikes), []
    try:
        written.append(export_nwb(run, spikes))
    except NwbMissingError:
        missing.append("nwb")
    nix = write_nix(run, spikes)
    if nix is None:
        missing.append("neo")
    else:
        written.append(nix)
    return written, missing


def export_nwb(run: Run, spikes: SpikeRecord | None = None) -> Path:
    """Write run.nwb, or the run with simulated spikes, into the run's folder in one step.

    Raises NwbMissingError without pynwb, UnwritableError.
    """
    try:
        import pynwb
    except ImportError:
        raise NwbMissingError(
            "export --nwb requires pynwb; install it with pip install 'indentation-rig[nwb]'"
        ) from None
    path = run.folder.path / ("run.nwb" if spikes is None else f"{SPIKES}.nwb")
    with _hdf5(path) as hdf5, pynwb.NWBHDF5IO(mode="w", file=hdf5) as file:
        file.write(_as_nwb(_visible(run), pynwb, spikes))
    return path


def _visible(run: Run) -> Run:
    """Return a run whose texts HDF5 can hold, except those of its readings."""
    events = {name: found if isinstance(found, RunReadings) else _plain(found) for name, found in run.events.items()}
    return replace(run, start=_plain(run.start), events=events)


def _as_nwb(run: Run, pynwb: Any, spikes: SpikeRecord | None) -> Any:
    began = datetime.fromtimestamp(run.start["unix_s"] - run.start["t_s"], UTC)
    description = f"{run.start['title']}. {run.start['source']}".strip()
    fired = spikes is not None and any(len(one.spike_s) for one in spikes.trains)
    silent = "" if spikes is None or fired else "; no afferent fired, so there is no table of units"
    file = pynwb.NWBFile(
        session_description=description if spikes is None else f"{SYNTHETIC}. {description}",
        identifier=run.start["uid"] if spikes is None else f"synthetic {run.start['uid']}",
        session_start_time=began,
        file_create_date=began,
        session_id=printable(run.folder.path.name),
        protocol=run.start["protocol"],
        notes=f"virtual bench: {run.start['virtual']}; complete: {run.complete}{silent}",
        subject=_subject(run, pynwb) if spikes is None else _subject(run, pynwb) or _model_subject(pynwb),
        **({} if spikes is None else {"experiment_description": SYNTHETIC, "keywords": ["synthetic", "simulation"]}),
    )
    _add_devices(run, file)
    _add_samples(run, file, pynwb)
    _add_presses(run, file)
    _add_holds(run, file, pynwb)
    _add_sync(run, file, pynwb)
    if fired:
        assert spikes is not None
        _add_spikes(run, spikes, file, pynwb)
    return file


def _subject(run: Run, pynwb: Any) -> Any:
    """Return the subject by its code, or None without one: nothing else about a participant is recorded."""
    code = run.start.get("subject")
    return pynwb.file.Subject(subject_id=code) if code else None


def _model_subject(pynwb: Any) -> Any:
    """Return the finger model as a subject, which the file format requires beside spikes."""
    return pynwb.file.Subject(
        subject_id="synthetic",
        description=(
            "Finite-element model of a fingertip, not an animal and not a participant. Species: of the finger whose "
            "shape is the model's default. Sex and age do not apply."
        ),
        species="Macaca mulatta",
        sex="U",
        age="P0D",
    )


def _add_devices(run: Run, file: Any) -> None:
    """Add stage, force sensor and indentors with their identifications."""
    kinds = _plain(provenance_of(run)).get("devices", {})
    identifications = {
        "stage": _identification(run, "home", "controller"),
        "force": _identification(run, "zero", "sensor"),
    }
    for name, about in {"stage": "moves the indentor", "force": "measures the force on the finger"}.items():
        kind = kinds.get(name, "type unknown")
        file.create_device(name=name, description=f"{about}: {kind}; identification: {identifications[name]}")
    shapes = dict.fromkeys(str(event["indentor"]) for event in run.stream("mount"))
    for number, shape in enumerate(shapes, 1):  # NWB allows no colon or slash in a name, and shapes contain them.
        file.create_device(name=f"indentor {number}", description=f"rigid shape {shape}")


def _identification(run: Run, stream: str, key: str) -> str:
    events = run.stream(stream)
    return str(events[-1][key]) if events else "nothing"


def _add_samples(run: Run, file: Any, pynwb: Any) -> None:
    """Add the force readings with the position at each."""
    samples = run.stream("sample")
    if not samples:
        return
    t_s = _numbers(samples, "t_s")
    force = pynwb.TimeSeries(
        name="force",
        description="Force on the finger as read by the sensor.",
        data=_numbers(samples, "force_gwt"),
        unit="newtons",
        conversion=GWT_N,
        timestamps=t_s,
        comments="Stored in gram-weight.",
    )
    file.add_acquisition(force)
    position = pynwb.behavior.SpatialSeries(
        name="position",
        description=(
            "Reference point of the indentor: x across the finger from the center of the pad, height above its apex."
        ),
        data=np.stack([_numbers(samples, "x_mm"), _numbers(samples, "height_mm")], axis=1),
        reference_frame="the finger's frame: x = 0 at the center of the pad, height 0 at the nominal apex",
        unit="meters",
        conversion=_M_PER_MM,
        timestamps=force,
        comments="Stored in mm.",
    )
    file.add_acquisition(position)


def _add_presses(run: Run, file: Any) -> None:
    """Add one trial for each press that is complete or ended at clearance, with the columns that any of them has."""
    finished = [row for row in presses_table(run) if row["complete"] or row["end_s"] is not None]
    for row in finished:
        file.add_trial(start_time=row["t_s"], stop_time=row["hold_end_s"] if row["end_s"] is None else row["end_s"])
    for column in columns_of(PressRecord):
        values = [row[column.name] for row in finished]
        if column.name not in ("t_s", "end_s") and any(value is not None for value in values):
            file.add_trial_column(column.name, _about(column), data=_without_none(column, values))


def _about(column: Column) -> str:
    """Return the meaning of a column with its unit, for which the format has no other place."""
    return f"{column.what} ({column.unit})" if column.unit else column.what


def _without_none(column: Column, values: Sequence[Any]) -> list[Any]:
    """Return values with an empty text or NaN for None."""
    if column.type is str:
        return ["" if value is None else value for value in values]
    return [math.nan if value is None else float(value) for value in values] if None in values else list(values)


def _add_holds(run: Run, file: Any, pynwb: Any) -> None:
    ends = {(event["index"], event["hold"]): event for event in run.stream("hold_end")}
    began = [event for event in run.stream("hold_start") if (event["index"], event["hold"]) in ends]
    if not began:
        return
    table = pynwb.epoch.TimeIntervals(name="holds", description="Indentor at rest on the finger, as delivered.")
    names = ("index", "hold", "x_mm", "doi_mm", "force_gwt", "force_sd_gwt")
    for column in columns_of(HoldEndEvent):
        if column.name in names:
            table.add_column(column.name, _about(column))
    for event in began:
        end = ends[event["index"], event["hold"]]
        columns = {name: end[name] for name in names}
        table.add_row(start_time=event["t_s"], stop_time=end["t_s"], **columns)
    file.add_time_intervals(table)


def _add_sync(run: Run, file: Any, pynwb: Any) -> None:
    """Add the pulses for the recording amplifier."""
    pulses = run.stream("sync")
    if not pulses:
        return
    table = pynwb.epoch.TimeIntervals(name="sync_pulses", description="Pulses on the sync output.")
    table.add_column("uncertainty_s", "uncertainty of the rise time, s")
    for pulse in pulses:
        rise, width = pulse["rise_s"], pulse["width_s"]
        table.add_row(start_time=rise, stop_time=rise + width, uncertainty_s=pulse["uncertainty_s"])
    file.add_time_intervals(table)


def _add_spikes(run: Run, spikes: SpikeRecord, file: Any, pynwb: Any) -> None:
    """Add simulated spikes as units, with the electrode that they would have been recorded by."""
    device = file.create_device(name="virtual nerve", description=f"{SYNTHETIC}; seed {spikes.seed}")
    group = file.create_electrode_group(
        name="nerve", description=f"One electrode {spikes.electrode}.", location=spikes.electrode, device=device
    )
    file.add_electrode(location=spikes.electrode, group=group)
    file.units = pynwb.misc.Units(name="units", description=SYNTHETIC, resolution=spikes.resolution_s)
    for name, about in about_columns().items():
        file.add_unit_column(name, f"{SYNTHETIC}: {about}")
    for number, train in enumerate(spikes.trains):
        end_s = max([run.end_s, *train.spike_s[-1:].tolist()])
        file.add_unit(
            id=number,
            spike_times=train.spike_s,
            obs_intervals=[[0.0, end_s]],
            electrodes=[0],
            electrode_group=group,
            **values_of(train),
        )


def _numbers(events: Iterable[Mapping[str, Any]], key: str) -> np.ndarray:
    values = (math.nan if event.get(key) is None else float(event[key]) for event in events)
    return np.fromiter(values, dtype=float)
