"""Read the recordings that a command names: tables of rates or counts, and spike times."""

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import LEAST_PROFILE_MM, MOST_RATE, is_own_unit, same_name
from rig.compare.recordings.columns import (
    COLUMNS_HINT,
    ColumnMap,
    Row,
    columns_read,
    has_column,
    header_of,
    no_rows,
    read_table,
    refuse_nines,
    role_name,
    stated_unit,
)
from rig.compare.recordings.neo_file import neo_format
from rig.compare.recordings.number_cells import label_key
from rig.compare.recordings.nwb_file import is_nwb
from rig.compare.recordings.recording import (
    SAME_PLACE_DECIMALS,
    Recording,
    ShapeKey,
    recording,
    shape_key,
    with_enough_positions,
)
from rig.compare.recordings.spikes import SPIKES, SPIKES_IN_NEO, SPIKES_IN_NWB, rates_in_run, read_spike_times
from rig.compare.recordings.summary_rows import (
    ROUNDED,
    decimals_of,
    is_summary,
    refuse_summary_labels,
    refuse_total_rows,
)
from rig.compare.recordings.table_cells import SameInAllRows, file_and_sheet
from rig.data import Run
from rig_shared.user_files import sha256_of
from sim.contact.shapes import shape_name

# Rates, or counts of spikes, against position, from a user's CSV.
#
# Columns `position_mm,rate[,sd][,repeat]` or `position_mm,count,window_s[,repeat]`, by these names or as `--columns`
# says: the indentor's reference point from the receptive field's center in the finger's frame, and the discharge rate
# (any unit, ≥ 0) or the spikes that were counted in a window. Rows of one position need a `repeat`.

_MOST_SIGNS = 20
"""Maximum number of equals signs in a shape, or of # before a unit, at which a name is split."""

Array = NDArray[np.float64]
Roles = tuple[tuple[str, ...], tuple[str, ...]]

RATES: Roles = (("position", "rate"), ("sd", "repeat"))
COUNTS: Roles = (("position", "count", "window"), ("repeat",))
"""Roles of required and of optional columns."""


def holds_counts(header: Sequence[str], columns: ColumnMap) -> bool:
    """Return whether a table has counts instead of rates, by its header."""
    return "rate" not in columns.named and ("count" in columns.named or has_column(header, "count", {}))


def read_srp(path: Path, columns: ColumnMap | None = None) -> Recording:
    """Read a table of rates or of counts. Raises RecordingError with row (the header is 1) and column."""
    columns = columns or ColumnMap()
    counted = holds_counts(header_of(path), columns)
    required, optional = COUNTS if counted else RATES
    in_table = [role for role in required if role != "window" or columns.window_s is None]
    names = columns.split(in_table, optional)
    rows = read_table(path, *names, given=columns.by_name, hint=COLUMNS_HINT)
    placed = list(_placed(rows))
    found = _counts(path, placed, columns) if counted else _rates(path, placed)
    refuse_nines([row for row, _ in placed], "count" if counted else "rate", role_name("position"))
    _refuse_totals(placed, "count" if counted else "rate")
    by_chance = _refuse_a_repeat_of_totals(placed, "count" if counted else "rate")
    changes = tuple(
        dict.fromkeys([*columns.changes(*required, *optional), *header_changes(rows, required, optional)])
    )
    read_as = columns_read(rows, columns.window_s if counted else None) + _close_positions(placed)
    read_as += _named_repeats(rows) + by_chance
    found = replace(found, changes=changes, read_as=read_as)
    return _of_a_finger(path, with_enough_positions(path, found), rows)


def header_changes(rows: Sequence[Row], *roles: Sequence[str]) -> tuple[str, ...]:
    """Return notes on the roles that were converted from the units of a header, for captions."""
    columns = rows[0].columns if rows else {}
    each = [(role, columns.get(role_name(role))) for some in roles for role in some]
    return tuple(f"{role} from {column.unit}" for role, column in each if column is not None and column.changed)


def _of_a_finger(path: Path, found: Recording, rows: Sequence[Row]) -> Recording:
    """Return a recording whose positions and counted rates are of a finger and an afferent. Raises RecordingError."""
    _of_an_afferent(path, found)
    span_mm = float(np.ptp(found.position_mm))
    if span_mm < LEAST_PROFILE_MM:
        column = rows[0].columns[role_name("position")]
        likely = "mm" if span_mm / column.factor >= LEAST_PROFILE_MM else "m"
        remedy = stated_unit(role_name("position"), column.name, likely)
        raise RecordingError(
            f"{path}, column {column.name}: all positions lie within {span_mm:g} mm, at least "
            f"{LEAST_PROFILE_MM:g} mm are required; if the unit is another, state it: {remedy}",
            "beyond_a_finger",
        )
    return found


def _of_an_afferent(path: Path, found: Recording) -> None:
    most = max(float(rates.max()) for rates in found.repeats)
    if found.window_s is not None and most > MOST_RATE:
        raise RecordingError(
            f"{path}: {most * found.window_s:g} spikes in {found.window_s:g} s are {most:g} in 1 s, at most "
            f"{MOST_RATE:g} are possible; check the unit of time",
            "beyond_a_finger",
        )


def _placed(rows: list[Row]) -> Iterator[tuple[Row, float]]:
    """Yield rows with their positions (mm), rounded to those that count as one.

    Raises RecordingError if a position occurs twice in the same repeat, or if a repeat has no number or name.
    """
    seen: dict[tuple[float, str | float], Row] = {}
    name, repeat = role_name("position"), role_name("repeat")
    repeats = [row.cells.get(repeat, "") for row in rows]
    refuse_summary_labels(rows)
    if any(repeats):
        _refuse_summaries(rows, repeats)
    for row, said in zip(rows, repeats, strict=True):
        position = round(row.number(name), SAME_PLACE_DECIMALS) + 0.0
        place = (position, label_key(said))
        if place in seen:
            raise RecordingError(
                f"{row.path}, row {row.row}, column {row.columns[name].name}: position {row.cells[name]} is repeated "
                f"(first in row {seen[place].row}); {_numbered(row)}",
                "place_twice",
            )
        seen[place] = row
        yield row, position


def _numbered(row: Row) -> str:
    """Return how to tell repeated presses apart, and why a column of repeats that is there does not."""
    repeat = role_name("repeat")
    if repeat not in row.columns:
        return f"number repeated presses in a column {repeat}"
    column, said = row.columns[repeat].name, row.cells[repeat]
    if isinstance(said, SameInAllRows):
        return (
            f"the column {column} is there, but has one value for all rows, {said!r}: it must be a vector, a column "
            "of letters (N × 1) or a cell array, with a number for each row"
        )
    return f"both have {said!r} in the column {column}: give each press at one position a number of its own"


def _refuse_summaries(rows: Sequence[Row], repeats: Sequence[str]) -> None:
    """Refuse a repeat that is empty, that means a summary, or that is no number, or has none, as others are or do."""
    rules: list[tuple[Callable[[str], bool], str]] = [
        (lambda said: said != "" and not is_summary(said), "the number or name of a press at this position")
    ]
    rules += [(_is_number, "a number, as others are")] if any(map(_is_number, repeats)) else []
    rules += [(_is_no_fraction, "a whole number, as others are")] if any(map(_is_whole, repeats)) else []
    rules += [(_has_digit, "a name with a number, as others are")] if any(map(_has_digit, repeats)) else []
    for fits, expected in rules:
        for row, said in zip(rows, repeats, strict=True):
            if not fits(said):
                problem = f"{expected}; delete rows with sums, means and the like"
                raise row.wrong(role_name("repeat"), "no_repeat", problem)


def _named_repeats(rows: Sequence[Row]) -> str:
    """Return a sentence on the repeats that are names, of which one may be that of sums or means; "" for numbers."""
    said = [row.cells.get(role_name("repeat"), "") for row in rows]
    names = [name for name in dict.fromkeys(said) if name and not _is_number(name)]
    if not names:
        return ""
    listed = ", ".join(names[:_MOST_LISTED]) + f" and {len(names) - _MOST_LISTED} more" * (len(names) > _MOST_LISTED)
    are = "The repeat {} is counted as a press" if len(names) == 1 else "The repeats {} are counted as presses"
    return f" {are.format(listed)}: delete rows of sums and means."


_MOST_LISTED = 20


def _is_number(label: str) -> bool:
    return isinstance(label_key(label), float)


def _is_whole(label: str) -> bool:
    key = label_key(label)
    return isinstance(key, float) and key.is_integer()


def _is_no_fraction(label: str) -> bool:
    return _is_whole(label) or not _is_number(label)


def _has_digit(text: str) -> bool:
    return any(map(str.isdigit, text))


def _refuse_totals(rows: list[tuple[Row, float]], name: str) -> None:
    """Refuse one of the first or last rows whose numbers are all the sums, means and the like of the other rows."""
    if not rows:
        return
    columns = [name, role_name("position")]
    repeats = [row.format.number(row.cells.get(role_name("repeat"), "")) for row, _ in rows]
    values = np.array([[row.number(name), place, repeat] for (row, place), repeat in zip(rows, repeats, strict=True)])
    columns += [] if any(map(math.isnan, repeats)) else [role_name("repeat")]
    refuse_total_rows([row for row, _ in rows], columns, values[:, : len(columns)], "press")


def _refuse_a_repeat_of_totals(rows: list[tuple[Row, float]], name: str) -> str:
    """Refuse a repeat that has what the others are together at every position at which these differ.

    Return a sentence on one that may have it by chance, as the smallest of a few presses that are often equal.
    """
    at: dict[float, dict[str, tuple[Row, float]]] = {}
    for row, place in rows:
        at.setdefault(place, {})[row.cells.get(role_name("repeat"), "")] = row, row.number(name)
    every = [some for some in at.values() if len(some) > _FEWEST_OTHERS]
    said, digits = "", _half_digits(rows, name)
    for label in every[0] if every else ():
        differ = [some for some in every if label in some and len({value for _, value in _others(some, label)}) > 1]
        for word, summary in _SUMMARIES_OF.items():
            if len(differ) < _FEWEST_TOTALS or not all(_has(summary, some, label, digits) for some in differ):
                continue
            has = f"it has the {word} of the other repeats at each of {len(differ)} positions"
            chance = 0.0 if summary.exact else _chance(summary, differ, digits)
            if chance < _UNLIKELY:
                raise every[0][label][0].wrong(role_name("repeat"), "totals", f"a press, but {has}; delete its rows")
            if chance < 1:
                said = said or f" The repeat {label} is counted as a press, but {has}: delete its rows if it is none."
    return said


class _Summary(NamedTuple):
    """Statistic of several presses; `exact`: no press equals it by chance, unless it is rounded to a whole number."""

    of: Callable[[list[float]], float]
    exact: bool = False


class _HalfDigit(NamedTuple):
    """Half of the last digit of a repeat's values, in the program's unit, and whether all are whole numbers."""

    half: float
    whole: bool


_SUMMARIES_OF = {
    "mean": _Summary(lambda others: float(np.mean(others)), exact=True),
    "sum": _Summary(sum, exact=True),
    "rounded mean": _Summary(lambda others: float(np.mean(others))),
    "median": _Summary(lambda others: float(np.median(others))),
    "minimum": _Summary(min),
    "maximum": _Summary(max),
    "sd": _Summary(lambda others: float(np.std(others, ddof=1))),
    "sd (of n)": _Summary(lambda others: float(np.std(others))),
    "standard error": _Summary(lambda others: float(np.std(others, ddof=1)) / math.sqrt(len(others))),
}
_Presses = Mapping[str, tuple[Row, float]]


def _others(some: _Presses, label: str) -> list[tuple[Row, float]]:
    return [pair for other, pair in some.items() if other != label]


def _has(summary: _Summary, some: _Presses, label: str, half_digits: Mapping[str, _HalfDigit]) -> bool:
    """Return whether a repeat has what the others at its position are together, as exactly as its values are."""
    _, mine = some[label]
    others = [value for _, value in _others(some, label)]
    half, whole = half_digits[label]
    return abs(summary.of(others) - mine) <= max(ROUNDED * max(others), 0.0 if summary.exact and whole else half)


def _chance(summary: _Summary, positions: Sequence[_Presses], half_digits: Mapping[str, _HalfDigit]) -> float:
    """Return how probable it is at most that some repeat has it everywhere, if all repeats are alike."""
    shares = [np.mean([_has(summary, some, label, half_digits) for label in some]) for some in positions]
    return float(np.prod(shares)) * max(map(len, positions))


def _half_digits(rows: list[tuple[Row, float]], name: str) -> dict[str, _HalfDigit]:
    """Return by how much the values of each repeat may be rounded; 39.0 is as exact as 39."""
    digits: dict[str, int] = {}
    for row, _ in rows:
        repeat = row.cells.get(role_name("repeat"), "")
        digits[repeat] = max(digits.get(repeat, 0), decimals_of(row, name))
    factor = rows[0][0].columns[name].factor if rows else 1.0
    return {repeat: _HalfDigit(0.51 * 10.0**-most * factor, most == 0) for repeat, most in digits.items()}


_FEWEST_OTHERS, _FEWEST_TOTALS = 2, 4  # three presses of few spikes may be one another's mean by chance
_UNLIKELY = 0.05
_NEAR_MM = 0.01  # closer positions may be one, read from a stage


def _close_positions(rows: list[tuple[Row, float]]) -> str:
    """Return a sentence on positions that are nearly equal. Raises RecordingError if they are of several repeats."""
    repeat = role_name("repeat")
    placed = sorted(rows, key=lambda one: one[1])
    close = [(one, other) for one, other in pairwise(placed) if _TICK_MM < other[1] - one[1] < _NEAR_MM - _TICK_MM]
    for (one, _), (other, _) in close:
        if label_key(one.cells.get(repeat, "")) != label_key(other.cells.get(repeat, "")):
            column = role_name("position")
            raise other.wrong(
                column,
                "close_positions",
                f"the position of row {one.row}, {one.cells[column]}, or {_NEAR_MM:g} mm or more from it: presses at "
                "one position are repeats only if it is the same number; round the positions",
            )
    if not close:
        return ""
    (_, at_mm), (_, near_mm) = close[0]
    return (
        f" The positions {at_mm:g} and {near_mm:g} mm lie within {_NEAR_MM:g} mm of one another and count as two; if "
        "they are one, round them and number the presses in a column repeat."
    )


_TICK_MM = 1e-6


def _rates(path: Path, rows: list[tuple[Row, float]]) -> Recording:
    _refuse_unclear_sd(path, rows)
    found = recording(path.name, [(place, row.number("rate", 0.0), _sd(row)) for row, place in rows])
    unit = rows[0][0].columns["rate"].unit if rows else ""
    return replace(found, rate_unit=unit) if is_own_unit(unit) else found


_NO_SD = "; fill it in, or delete the column"


def _refuse_unclear_sd(path: Path, rows: list[tuple[Row, float]]) -> None:
    """Refuse an sd that some rows lack, and one beside repeats, which have their own: it would not count."""
    stated = [row for row, _ in rows if row.cells.get("sd")]
    for row, _ in rows if stated else []:
        if not row.cells["sd"]:
            raise row.wrong("sd", "no_number", "a number of 0 or more, since other rows have an sd" + _NO_SD)
    if stated and len({place for _, place in rows}) < len(rows):
        raise RecordingError(
            f"{path}, column {stated[0].columns['sd'].name}: an sd cannot be stated beside repeats, over which it "
            "is computed; delete the column, or keep one row of each position, with the mean and its sd",
            "sd_and_repeats",
        )


def _sd(row: Row) -> float:
    """Return the sd of a row, NaN without one; an sd without a unit has that of the rates. Raises RecordingError."""
    if not row.cells.get("sd"):
        return math.nan
    unit, of_rates = row.columns["sd"].unit, row.columns["rate"].unit
    if unit and (is_own_unit(unit) or is_own_unit(of_rates)) and unit.casefold() != of_rates.casefold():
        raise row.wrong("sd", "other_unit", f"in the unit of the rates, not in {unit}; convert it")
    sd = row.number("sd", 0.0, no_data=_NO_SD)
    return sd if row.columns["sd"].unit else sd * row.columns["rate"].factor


def _counts(path: Path, rows: list[tuple[Row, float]], columns: ColumnMap) -> Recording:
    window_s = columns.window_s or _one_window(path, rows)
    return recording(path.name, [(place, _whole(row) / window_s, math.nan) for row, place in rows], window_s)


def _whole(row: Row) -> float:
    value = row.number("count", least=0.0)
    if value != round(value):
        raise row.wrong("count", "not_whole", "a whole number")
    return value


def _one_window(path: Path, rows: list[tuple[Row, float]]) -> float:
    """Return the window (s), which must be the same in all rows, since one noise model applies to all rates."""
    name = role_name("window")
    found = [(row, row.number(name)) for row, _ in rows]
    for row, seconds in found:
        if seconds <= 0:
            raise row.wrong(name, "not_above_0", "a number above 0")
        if seconds != found[0][1]:
            raise row.wrong(name, "another_window", f"the window of all rows, {found[0][0].cells[name]}")
    if not found:
        raise no_rows(path, "counts")
    return found[0][1]


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


def are_copies(found: Recording, file: str, other: Recording, other_file: str) -> bool:
    """Return whether two recordings are one: of one file and unit or sheet, or with the same spikes or rates.

    Spike times have all presses of a run, so their file may be named for several stimuli.
    """
    if found.sha256 == other.sha256 and _part_of(found, file) == _part_of(other, other_file):
        return True
    if found.spikes is not None and other.spikes is not None:
        return _are_same_spikes(found.spikes.spike_s, other.spikes.spike_s)
    return _are_same_rates(found, other)


def _part_of(found: Recording, file: str) -> str:
    return unit_of(file) if found.spikes is not None else file_and_sheet(Path(file))[1]


def _are_same_spikes(spike_s: Array, other_s: Array) -> bool:
    """Return whether nearly all spikes of one unit are those of the other, which may be cut shorter or rounded."""
    few, many = sorted((spike_s, other_s), key=len)
    if not len(few) or (len(few) < _FEWEST_SPIKES and len(few) != len(many)):
        return False
    after = np.clip(np.searchsorted(many, few), 1, max(len(many) - 1, 1))
    apart_s = np.minimum(np.abs(many[after - 1] - few), np.abs(many[np.minimum(after, len(many) - 1)] - few))
    return float(np.mean(apart_s <= _SAME_SPIKE_S)) >= _MOST_OF_SPIKES


def _are_same_rates(found: Recording, other: Recording) -> bool:
    """Return whether the rates of all presses are the same, as exactly as a table may have them.

    They are compared if at least three of them differ and are above 0: two stimuli may leave an afferent silent.
    """
    pairs = list(zip(found.repeats, other.repeats, strict=False))
    tell = len({rate for some in found.repeats for rate in some.tolist()} - {0.0}) >= _FEWEST_RATES
    return (
        tell
        and np.array_equal(found.position_mm, other.position_mm)
        and all(len(some) == len(others) for some, others in pairs)
        and all(np.allclose(np.sort(some), np.sort(others), rtol=ROUNDED, atol=0.0) for some, others in pairs)
    )


_FEWEST_SPIKES, _SAME_SPIKE_S, _MOST_OF_SPIKES = 10, 5e-4, 0.9
_FEWEST_RATES = 3


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
        if are_copies(tables[key], files[key], tables[other], files[other]):
            raise RecordingError(
                f"--recorded {key}={files[key]}: the recording of {other} already, in {files[other]}, with the same "
                "rates; those of one stimulus are not those of another: name a file of its own for each",
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


def unit_of(text: str) -> str:
    """Return the unit that is named after a file, "" for none."""
    return _file_and_unit(text)[1]


def _may_have_units(path: Path) -> bool:
    return is_nwb(path) or neo_format(path) is not None or file_and_sheet(path)[0].is_file()


def _roles(path: Path, columns: ColumnMap) -> Roles:
    """Return the required and the optional roles of a file's columns, by its kind."""
    if is_nwb(path):
        return SPIKES_IN_NWB
    if neo_format(path) is not None:
        return SPIKES_IN_NEO
    header = header_of(path)
    if "time" in columns.named or has_column(header, role_name("time"), {}):
        of_presses = any(
            has_column(header, role_name(role), columns.by_name) for role in ("position", "rate", "count")
        )
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
        _of_an_afferent(path, found)
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
