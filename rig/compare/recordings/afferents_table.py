"""Recordings of several afferents: a table that names them, or a folder with one folder per afferent.

Columns of a table: `afferent,shape,file[,depth_mm][,force_gwt][,columns][,distinct_from]`; files are relative to the
table. In a folder, AFFERENT/SHAPE@CONDITION.csv is named like --recorded, with a hyphen for the colon:
a01/step-1@8gwt.csv.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import same_name
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.copies import common_data
from rig.compare.recordings.number_cells import label_key
from rig.compare.recordings.reading import (
    Reading,
    file_part,
    of_one_afferent,
    read_recording,
    refuse_unused_columns,
    to_mirror,
)
from rig.compare.recordings.recording import Recording, shape_key
from rig.compare.recordings.table import LEAVE_EMPTY, Row, no_rows, read_table
from rig.compare.stimuli import StimulusRow
from rig.data import Run
from rig_shared.natural_order import natural_order
from rig_shared.plural import number_of
from rig_shared.summary_rows import is_summary

REQUIRED = ("afferent", "shape", "file")
OPTIONAL = ("depth_mm", "force_gwt", "columns", "distinct_from")
_CONDITIONS = {"depth_mm": "mm", "force_gwt": "gwt"}
_TABLE = "afferents.csv"


class _Named(NamedTuple):
    """A recording by name: where it is named, its afferent, SHAPE[@CONDITION], its file, and its own --columns.

    `distinct_from`: afferents whose rates are the same by chance.
    """

    where: str
    row: int
    afferent: str
    shape: str
    file: str
    columns: str = ""
    distinct_from: tuple[str | float, ...] = ()


Recordings = dict[str, dict[str, Recording]]
"""Recordings by afferent, then by shape and condition."""

_MOST_LISTED = 100
_HOW_DISTINCT = "write {} into a column distinct_from of this row of the table of afferents"
_ONE_AFFERENT = "; a recording of one afferent is --recorded SHAPE=FILE, e.g. step:1=FILE"


def read_afferents(
    path: Path, mirror: Sequence[str], runs: Sequence[Run], stimuli: Sequence[StimulusRow], reading: Reading
) -> Recordings:
    """Return the recordings that a table or a folder names.

    Raises
    ------
    RecordingError
        With a line for every row that cannot be used.
    """
    table = path / _TABLE if path.is_dir() and (path / _TABLE).is_file() else path
    named, wrong = _in_folder(path) if table.is_dir() else _in_table(table)
    found: Recordings = {}
    seen: list[tuple[_Named, Recording]] = []
    for one in named:
        try:
            key, own = str(shape_key(one.shape)), _own(reading, one)
            recording = read_recording(one.file, one.shape, runs, own)
            refuse_unused_columns([one.file], own.columns)
            _refuse(one, key, recording, found, seen, stimuli)
        except (RecordingError, ValueError) as error:
            wrong.append(_wrong(one.where, one.row, str(error)))
        else:
            found.setdefault(one.afferent, {})[key] = recording
    if wrong:
        wrong.sort(key=lambda row: row[0])
        more = f"\n… and {len(wrong) - _MOST_LISTED} more" if len(wrong) > _MOST_LISTED else ""
        problems = "\n".join(problem for _, problem in wrong[:_MOST_LISTED]) + more
        raise RecordingError(f"{path}: {number_of(len(wrong), 'recordings')} cannot be used\n{problems}", "bad_rows")
    if not found:
        raise no_rows(table, "recordings")
    keys = [shape_key(key) for some in found.values() for key in some]
    only = {stimulus.shape: stimulus.condition for stimulus in stimuli}  # of keys without a condition: see _refuse
    turned = set(map(str, to_mirror(keys, mirror, only)))
    return {
        afferent: of_one_afferent({key: one.mirrored() if key in turned else one for key, one in some.items()})
        for afferent, some in found.items()
    }


Wrong = list[tuple[int, str]]
"""Numbers of rows, and what is wrong in each."""


def _wrong(where: str, row: int, problem: str) -> tuple[int, str]:
    about = " ".join(problem.split()).removeprefix(f"{where}, ")
    return row, f"{where}: {about}"


def _own(reading: Reading, one: _Named) -> Reading:
    columns = column_map(one.columns.split(";")) if one.columns else reading.columns
    return replace(reading, columns=columns, may_be_silent=True)  # it is left out of the group, and listed


def _refuse(
    one: _Named,
    key: str,
    recording: Recording,
    found: Recordings,
    seen: list[tuple[_Named, Recording]],
    stimuli: Sequence[StimulusRow],
) -> None:
    """Refuse a shape that the runs do not have, a recording or copy that is named twice, and an unclear name."""
    alike = [name for name in found if name != one.afferent and label_key(name) == label_key(one.afferent)]
    if alike or is_summary(one.afferent):
        like = f", or the same as {alike[0]!r}" if alike else ""
        raise RecordingError(
            f"{one.afferent!r} is no name of an afferent{like}; name each afferent in one way, and delete rows of "
            "means and the like",
            "unclear_name",
        )
    shape = key.partition("@")[0]
    conditions = [stimulus.condition for stimulus in stimuli if stimulus.shape == shape]
    if not conditions or ("@" in key and key.partition("@")[2] not in conditions):
        held = [f"{stimulus.shape} at {stimulus.condition}" for stimulus in stimuli]
        raise RecordingError(f"the runs contain no {key}; they contain {', '.join(held)}", "never_pressed")
    if "@" not in key and len(conditions) > 1:
        both = " and ".join(sorted(conditions, key=natural_order))
        raise RecordingError(f"{shape} was pressed to {both}; state depth_mm or force_gwt", "several_conditions")
    if key in found.get(one.afferent, {}):
        raise RecordingError(
            f"afferent {one.afferent} already has a recording of {key}; name it once", "recorded_twice"
        )
    for same, other in seen:
        of_one_unit = one.afferent == same.afferent and recording.spikes is not None  # its file has several stimuli
        are_two = label_key(same.afferent) in one.distinct_from or label_key(one.afferent) in same.distinct_from
        parts = file_part(one.file), file_part(same.file)
        data = "" if of_one_unit or are_two else common_data(
            recording, parts[0], other, parts[1], scaled=one.afferent != same.afferent)  # fmt: skip
        if data:
            is_file = Path(one.file).resolve() == Path(same.file).resolve()
            two = _HOW_DISTINCT.format(same.afferent)
            copy = (
                "" if is_file else f", {same.file}, with {data}; give one unit one name, or, if they are two, {two}"
            )
            raise RecordingError(
                f"{one.file} is the recording of {same.shape} of afferent {same.afferent} already "
                f"({same.where}){copy}",
                "file_twice",
            )
    seen.append((one, recording))


def _in_table(path: Path) -> tuple[list[_Named], Wrong]:
    named, wrong = list[_Named](), Wrong()

    def refused(row: int, error: RecordingError) -> None:
        wrong.append(_wrong(f"{path}, row {row}", row, str(error)))

    for row in read_table(path, REQUIRED, OPTIONAL, hint=_ONE_AFFERENT, on_wrong_row=refused):
        try:
            named.append(_row(f"{path}, row {row.row}", row))
        except RecordingError as error:
            refused(row.row, error)
    return named, wrong


def _row(where: str, row: Row) -> _Named:
    cell = row.cells
    for name in REQUIRED:
        if not cell[name]:
            raise RecordingError(f"column {name} must not be empty", "empty_cell")
    pressed = [
        f"{row.number(name, 0.0, no_data=LEAVE_EMPTY):.6g}{unit}"
        for name, unit in _CONDITIONS.items() if cell.get(name)
    ]  # fmt: skip
    if len(pressed) > 1 or (pressed and "@" in cell["shape"]):
        raise RecordingError("state one depth or force", "several_conditions")
    shape = "@".join([cell["shape"], *pressed])
    file = Path(cell["file"])
    distinct_from = tuple(label_key(one) for one in cell.get("distinct_from", "").split(";") if one.strip())
    file_name = str(row.path.parent / file)
    return _Named(where, row.row, cell["afferent"], shape, file_name, cell.get("columns", ""), distinct_from)


_NO_RECORDINGS = (
    *(".md", ".pdf", ".docx", ".html", ".json", ".toml", ".yaml", ".yml", ".py", ".ipynb", ".m"),
    *(".png", ".svg", ".jpg", ".jpeg", ".log", ".ini", ".db"),
)
_ABOUT = ("readme", "notes", "license", "licence")


def _leads_nowhere(file: Path) -> str:
    """Return what is wrong with a link whose target is missing; "" for any other file."""
    if not file.is_symlink() or file.exists():
        return ""
    return f"a link to {file.readlink()}, which is missing; put its target back, or remove the link"


def _passed_over(file: Path) -> str:
    """Return what is wrong with a file beside the folders of the afferents; "" if it is no recording."""
    if file.suffix.lower() in _NO_RECORDINGS or file.stem.casefold() in _ABOUT:
        return ""
    return "in no folder of an afferent; put it into one, as AFFERENT/SHAPE, e.g. a1/step-1.csv, or elsewhere"


def _in_folder(path: Path) -> tuple[list[_Named], Wrong]:
    named, wrong, number = [], [], 0
    shown = sorted(one for one in path.iterdir() if not one.name.startswith("."))
    wrong += [
        (0, f"{one}: {said}")
        for one in shown
        if not one.is_dir() and (said := _leads_nowhere(one) or _passed_over(one))
    ]
    for folder in (one for one in shown if one.is_dir()):
        files = sorted(file for file in folder.iterdir() if not file.name.startswith("."))
        if not files:
            wrong.append((number, f"{folder}: has no recording; put its files back, or remove the folder"))
        for file in files:
            number += 1
            if said := _leads_nowhere(file):
                wrong.append((number, f"{file}: {said}"))
                continue
            stem = file.stem if file.is_file() else file.name
            shape = stem if ":" in stem else stem.replace("-", ":", 1)
            named.append(_Named(str(file), number, same_name(folder.name), shape, str(file)))
    return named, wrong
