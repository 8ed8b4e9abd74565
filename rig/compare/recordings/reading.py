"""Recordings named on the command line."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rig.compare.errors import RecordingError
from rig.compare.recordings.column_map import ColumnMap
from rig.compare.recordings.position_table import COUNTS, RATES, Roles, holds_counts, read_srp
from rig.compare.recordings.recorded import Recording, with_enough_positions
from rig.compare.recordings.shape_key import ShapeKey, shape_key
from rig.compare.recordings.spikes import NWB, SPIKES, SPIKES_IN_NWB, rates_in_run, read_spike_times
from rig.compare.recordings.table_file import header_of
from rig.data import Run
from sim.contact.shapes import shape_name


@dataclass(frozen=True)
class Reading:
    """How files are read: spikes in a window from the start of a hold, about a receptive field; what columns hold."""

    window_s: tuple[float, float] = (0.0, 1.0)
    field_centre_mm: float = 0.0
    columns: ColumnMap = field(default_factory=ColumnMap)


def read_recordings(
    recorded: Sequence[str], mirror: Sequence[str], runs: Sequence[Run], reading: Reading
) -> dict[str, Recording]:
    """Recordings by what they are of, from "SHAPE[@CONDITION]=FILE" and the shapes to be mirrored.

    A CSV with a column of times, or an NWB file, holds spike times of the one run with that shape. Raises
    RecordingError, ShapeError.
    """
    named: dict[ShapeKey, tuple[str, str]] = {}
    for text in recorded:
        shape, file = _shape_and_file(text)
        key = shape_key(shape)
        if key in named:
            raise RecordingError(
                "--recorded {given!r}: {shape} is given twice", code="recorded_twice", given=text, shape=shape
            )
        named[key] = shape, file
    found = {key: _read(file, shape, runs, reading) for key, (shape, file) in named.items()}
    _refuse_unused([file for _, file in named.values()], reading.columns)
    for shape in mirror:
        meant = [key for key in found if shape_key(shape) in (key, ShapeKey(key.shape, ""))]
        if not meant:
            raise RecordingError(
                "--mirror {shape}: nothing recorded for it, expected --recorded {shape}=CSV",
                code="nothing_to_mirror",
                shape=shape,
            )
        found |= {key: found[key].mirrored() for key in meant}
    return {str(key): one for key, one in found.items()}


def _shape_and_file(text: str) -> tuple[str, str]:
    """Of "step:1=mine.csv"; both may have further signs of equality: "bar:3,turn_deg=30=mine.csv"."""
    words = text.split("=")
    parted = [("=".join(words[:n]), "=".join(words[n:])) for n in range(1, len(words))]
    if not parted or not all(parted[-1]):
        raise RecordingError("--recorded {given!r}: expected SHAPE=CSV", code="no_shape_and_file", given=text)
    return next((one for one in parted if _is_shape(one[0])), parted[0])


def _is_shape(text: str) -> bool:
    try:
        shape_key(text)
    except ValueError:
        return False
    return True


def _file_and_unit(text: str) -> tuple[Path, str]:
    """A file, and of an NWB file the unit that is named after it: "afferent.nwb#3"."""
    file, mark, unit = text.rpartition(f"{NWB}#")
    return (Path(file + NWB), unit) if mark else (Path(text), "")


def _roles(path: Path, columns: ColumnMap) -> Roles:
    """What the columns of a file hold, by its kind: those that must be there, and those that may."""
    if path.suffix == NWB:
        return SPIKES_IN_NWB
    if columns["time"].name in header_of(path):
        return SPIKES
    return COUNTS if holds_counts(path, columns) else RATES


def _read(file: str, shape: str, runs: Sequence[Run], reading: Reading) -> Recording:
    path, unit = _file_and_unit(file)
    roles = _roles(path, reading.columns)
    if roles in (RATES, COUNTS):
        found = read_srp(path, reading.columns)
    else:
        run = _run_with(shape, path, runs)
        times = read_spike_times(path, run, unit, reading.columns)
        found = rates_in_run(run, shape, times, path.name, reading.window_s, reading.field_centre_mm)
        found = replace(with_enough_positions(path, found), changes=reading.columns.changes(*roles[0]))
    return replace(found, sha256=sha256(path))


def _run_with(shape: str, path: Path, runs: Sequence[Run]) -> Run:
    name = shape_key(shape).shape
    holding = [run for run in runs if any(shape_name(e["indentor"]) == name for e in run.stream("mount"))]
    if len(holding) != 1:
        raise RecordingError(
            "{path}: spike times belong to one run with {shape}, {runs} are given",
            code="not_one_run",
            path=str(path),
            shape=shape,
            runs=len(holding),
        )
    return holding[0]


def _refuse_unused(files: Sequence[str], columns: ColumnMap) -> None:
    """A name that no file is read by is a mistake."""
    used = {role for file in files for roles in _roles(_file_and_unit(file)[0], columns) for role in roles}
    for role, column in columns.given.items():
        if role not in used:
            expected = "one of {roles}" if used else "it beside --recorded"
            raise RecordingError(
                "--columns {role}={column}: no recording is read by it, expected " + expected,
                code="unused_column",
                role=role,
                column=column.name,
                roles=", ".join(sorted(used)),
            )


def sha256(path: Path) -> str:
    """Of a file, for provenance."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
