"""Read the recordings that a command names: tables of rates or counts, and spike times."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import same_name
from rig.compare.recordings.columns import ColumnMap
from rig.compare.recordings.copies import common_data
from rig.compare.recordings.presses_table import COUNTS, RATES, Roles, holds_counts, read_srp
from rig.compare.recordings.recording import (
    Recording,
    ShapeKey,
    refuse_impossible_rate,
    shape_key,
    with_enough_positions,
)
from rig.compare.recordings.spike_files import SPIKES, spike_file
from rig.compare.recordings.spikes import rates_in_run, read_spike_times
from rig.compare.recordings.table import has_column, header_of
from rig.compare.recordings.table_cells import file_and_sheet
from rig.data import Run
from rig_shared.user_files import sha256_of
from sim.contact.shapes import shape_name

_MOST_SIGNS = 20
"""Maximum number of equals signs in a shape, or of # before a unit, at which a name is split."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """Options for reading recordings: window from the start of a hold (s), x of the receptive field (mm), columns."""

    window_s: tuple[float, float] = (0.0, 1.0)
    field_centre_mm: float = 0.0
    columns: ColumnMap = field(default_factory=ColumnMap)
    may_be_silent: bool = False
    """Whether a unit without spikes is a recording, and not an error."""


def read_recordings(
    recorded: Sequence[str], mirror: Sequence[str], runs: Sequence[Run], reading: Reading
) -> dict[str, Recording]:
    """Return recordings by shape and condition, from "SHAPE[@CONDITION]=FILE" and the shapes to mirror.

    A CSV with a column of times, or an NWB file, contains spike times, which belong to the only run with that shape.
    Raises RecordingError, ShapeError.
    """
    named: dict[ShapeKey, tuple[str, str]] = {}
    for text in recorded:
        shape, file = _shape_and_file(text)
        key = shape_key(shape)
        if key in named:
            raise RecordingError(
                f"--recorded {text!r}: {shape} is given twice; give each shape once", "recorded_twice"
            )
        named[key] = shape, file
    found = {key: read_recording(file, shape, runs, reading) for key, (shape, file) in named.items()}
    refuse_unused_columns([file for _, file in named.values()], reading.columns)
    _refuse_twice(found, {key: file for key, (_, file) in named.items()})
    turned = to_mirror(found, mirror)
    return of_one_afferent({str(key): one.mirrored() if key in turned else one for key, one in found.items()})


def to_mirror(
    held: Iterable[ShapeKey], mirror: Sequence[str], only: Mapping[str, str] | None = None
) -> set[ShapeKey]:
    """Return the recordings that --mirror names; a shape without a condition is all of its. Raises RecordingError.

    `only`: the only condition of each shape whose recordings state none.
    """
    keys, turned, only = list(dict.fromkeys(held)), set[ShapeKey](), only or {}
    for shape in mirror:
        said = shape_key(shape)
        meant = [key for key in keys if said.shape == key.shape
                 and said.condition in ("", key.condition or only.get(key.shape, ""))]  # fmt: skip
        if not meant:
            remedy = f"use one of {', '.join(map(str, keys))}" if keys else f"add --recorded {shape}=FILE"
            raise RecordingError(f"--mirror {shape}: there is no recording of it; {remedy}", "nothing_to_mirror")
        turned.update(meant)
    return turned


def of_one_afferent(found: Mapping[str, Recording]) -> dict[str, Recording]:
    """Return the recordings of an afferent; one with an sd says so if it does not count, since others have none.

    Raises RecordingError if their rates are in several units.
    """
    _refuse_several_units(found)
    stated = {
        key: np.isfinite(one.sd) & np.array([len(rates) == 1 for rates in one.repeats]) for key, one in found.items()
    }
    if all(some.all() for some in stated.values()) and any((one.sd > 0).any() for one in found.values()):
        return dict(found)
    text = "Its sd is not used: every recording of the afferent needs one, without repeats, and above 0 somewhere."
    return {
        key: replace(one, read_as=f"{one.read_as.removesuffix(text).rstrip()} {text}") if stated[key].all() else one
        for key, one in found.items()
    }


def _refuse_several_units(found: Mapping[str, Recording]) -> None:
    """Refuse rates of one afferent in several units, which no one gain converts. Raises RecordingError."""
    units = {one.rate_unit.casefold().replace(".", ""): key for key, one in found.items()}
    if len(units) > 1:
        one, other = list(units.values())[:2]
        raise RecordingError(
            f"the rates of {one} are in {found[one].rate_unit}, those of {other} in {found[other].rate_unit}; "
            "convert them to one unit",
            "several_units",
        )


def _refuse_twice(found: Mapping[ShapeKey, Recording], files: Mapping[ShapeKey, str]) -> None:
    """Refuse a table that is the recording of two stimuli: it would count twice."""
    tables = {key: one for key, one in found.items() if one.spikes is None}
    for other, key in combinations(tables, 2):
        if common_data(tables[key], file_part(files[key]), tables[other], file_part(files[other])):
            raise RecordingError(
                f"--recorded {key}={files[key]}: the recording of {other} already, in {files[other]}, with the same "
                "rates; those of one stimulus are not those of another: name a file of its own for each, or, if both "
                "have these rates, compare each alone",
                "file_twice",
            )


def _shape_and_file(text: str) -> tuple[str, str]:
    """Split "step:1=mine.csv"; both parts may contain further equals signs: "bar:3,turn_deg=30=mine.csv"."""
    words = text.split("=", _MOST_SIGNS)
    parted = [("=".join(words[:n]), "=".join(words[n:])) for n in range(1, len(words))]
    if not parted or not all(parted[-1]):
        raise RecordingError(f"--recorded {text!r}: must be SHAPE=CSV", "no_shape_and_file")
    return next((one for one in parted if _is_shape(one[0])), parted[0])


def _is_shape(text: str) -> bool:
    try:
        shape_key(text)
    except ValueError:
        return False
    return True


def _file_and_unit(text: str) -> tuple[Path, str]:
    """Split a file from the unit named after it, as in "afferent.nwb#3"; the unit is empty if none is named."""
    path, sheet = file_and_sheet(Path(text))
    if sheet and path.is_file():
        return Path(text), ""
    marks = [] if Path(text).exists() else [n for n, sign in enumerate(text) if sign == "#"][:_MOST_SIGNS]
    parted = [(text[:n], text[n + 1 :]) for n in marks]  # a unit may be called "ch1#2"
    named = (one for one in reversed(parted) if file_and_sheet(Path(one[0]))[1] and _may_have_units(Path(one[0])))
    others = (one for one in parted if _may_have_units(Path(one[0])))
    file, unit = next(named, next(others, (text, "")))
    return Path(file), same_name(unit)


def file_part(text: str) -> tuple[str, str]:
    """Return the unit and the sheet that are named after a file, "" for none."""
    return _file_and_unit(text)[1], file_and_sheet(Path(text))[1]


def _may_have_units(path: Path) -> bool:
    return spike_file(path) is not None or file_and_sheet(path)[0].is_file()


def _roles(path: Path, columns: ColumnMap) -> Roles:
    """Return the required and the optional roles of a file's columns, by its kind."""
    if (file := spike_file(path)) is not None:
        return file.roles
    header = header_of(path)
    if "time" in columns.named or has_column(header, "time", {}):
        of_presses = any(has_column(header, role, columns.by_name) for role in ("position", "rate", "count"))
        if columns["time"].name in header or not of_presses:
            return SPIKES
    return COUNTS if holds_counts(header, columns) else RATES


def read_recording(file: str, shape: str, runs: Sequence[Run], reading: Reading) -> Recording:
    """Read the recording of one stimulus. Raises RecordingError."""
    path, unit = _file_and_unit(file)
    roles = _roles(path, reading.columns)
    if unit and roles in (RATES, COUNTS):
        raise RecordingError(
            f"{file}: a table of rates or counts has no units to choose from; remove #{unit}", "no_unit_here"
        )
    if roles in (RATES, COUNTS):
        found = read_srp(path, reading.columns)
    else:
        run = _run_with(shape, path, runs)
        times = read_spike_times(path, run, unit, reading.columns, may_be_silent=reading.may_be_silent)
        found = rates_in_run(run, shape, times, path.name, reading.window_s, reading.field_centre_mm)
        used = (*roles[0], *(role for role in roles[1] if role in reading.columns.named))
        assert found.spikes is not None
        changes = (*reading.columns.changes(*used), *found.spikes.changes)
        found = replace(with_enough_positions(path, found), changes=changes)
        refuse_impossible_rate(path, found)
    return replace(found, sha256=sha256(file_and_sheet(path)[0]))


def _run_with(shape: str, path: Path, runs: Sequence[Run]) -> Run:
    name = shape_key(shape).shape
    holding = [run for run in runs if any(shape_name(e["indentor"]) == name for e in run.stream("mount"))]
    if len(holding) != 1:
        raise RecordingError(
            f"{path}: spike times apply to exactly one run with {shape}, but {len(holding)} were given", "not_one_run"
        )
    return holding[0]


def refuse_unused_columns(files: Sequence[str], columns: ColumnMap) -> None:
    """Raise RecordingError for a role of `--columns` that no file uses."""
    used = {role for file in files for roles in _roles(_file_and_unit(file)[0], columns) for role in roles}
    for role, column in columns.named.items():
        if role not in used:
            remedy = f"a role must be one of {', '.join(sorted(used))}" if used else "add --recorded"
            raise RecordingError(
                f"--columns {role}={column.name}: no recording uses this column; {remedy}", "unused_column"
            )


def refuse_unused_options(found: Iterable[Recording], reading: Reading) -> None:
    """Refuse options of spike times if no recording has any. Raises RecordingError."""
    usual = Reading()
    given = {
        "--window-s": reading.window_s != usual.window_s,
        "--field-centre-mm": reading.field_centre_mm != usual.field_centre_mm,
    }
    option = next((name for name, is_given in given.items() if is_given), None)
    if option and not any(one.spikes for one in found):
        raise RecordingError(
            f"{option} applies to spike times, and no recording has any: rates, counts and their positions are "
            "taken from a table as they are; remove it",
            "unused_option",
        )


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, for provenance; of a folder, that of its files' names and SHA-256."""
    if path.is_dir():
        inside = [
            f"{one.relative_to(path).as_posix()} {sha256(one)}" for one in sorted(path.rglob("*")) if one.is_file()
        ]
        return hashlib.sha256("\n".join(inside).encode()).hexdigest()
    return sha256_of(path)
