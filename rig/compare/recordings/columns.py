"""Columns that `--columns` names: their roles, and the units that are stated of them."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import (
    MOST_HOLD_S,
    ROLES,
    Dimension,
    column_kind,
    contradicts,
    header_name,
    renamed,
    same_name,
)
from rig_shared.number_text import read_number


class RecordingColumn(NamedTuple):
    """Column of a file, with its unit and the factor that converts its numbers to mm, s or 1/s."""

    name: str
    unit: str = ""
    factor: float = 1.0
    stated: bool = False
    """Whether the unit is stated after a colon."""

    @property
    def changed(self) -> bool:
        """Whether the numbers are converted."""
        return self.factor != 1.0


def role_name(role: str) -> str:
    """Return the program's own name for the column of a role, e.g. "position_mm"."""
    return ROLES[role].name


def stated_unit(name: str, column: str, unit: str) -> str:
    """Return how to state the unit of a column: in its name if that states one, or without a role; by --columns."""
    kind = column_kind(name)
    if not kind.role or contradicts(column, unit, kind.units):
        return f"call the column {renamed(column, unit, kind.units)!r}"
    return f"--columns {shlex.quote(f'{kind.role}={column}:{unit}')}"


_THROUGHOUT = "throughout"


@dataclass(frozen=True)
class ColumnMap:
    """Columns that `--columns` names, by role; the other roles have the names of docs/comparison.md.

    `window_s` is the window of the counts if it was given as a number instead of a column, else None.
    """

    named: Mapping[str, RecordingColumn] = field(default_factory=dict)
    window_s: float | None = None

    def __getitem__(self, role: str) -> RecordingColumn:
        """Return the column of a role."""
        return self.named.get(role, RecordingColumn(role_name(role)))

    @property
    def observed_throughout(self) -> bool:
        """Whether the user states that the unit was observed throughout the run."""
        return "observed" in self.named and self.named["observed"].name == _THROUGHOUT

    def split(self, required: Sequence[str], optional: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the program's names of required and optional columns; a column named by `--columns` is required."""
        asked = [role for role in optional if role in self.named]
        others = [role for role in optional if role not in asked]
        return [role_name(role) for role in (*required, *asked)], [role_name(role) for role in others]

    @property
    def by_name(self) -> dict[str, RecordingColumn]:
        """The columns that `--columns` names, by the program's own names."""
        return {role_name(role): column for role, column in self.named.items()}

    def changes(self, *roles: str) -> tuple[str, ...]:
        """Return notes on the converted roles, for captions."""
        return tuple(f"{role} from {self[role].unit}" for role in roles if self[role].changed)


def column_map(texts: Sequence[str]) -> ColumnMap:
    """Parse the values of `--columns`, "ROLE=COLUMN[:UNIT],…". Raises RecordingError.

    Without a unit, the unit at the end of the column's name applies, as in "x (um)" or "x_um"; an sd without a unit
    has the unit of the rates.
    """
    given: dict[str, RecordingColumn] = {}
    for text in map(same_name, texts):
        for part in _roles_in(text):
            role, equals, name = (word.strip() for word in part.partition("="))
            if role not in ROLES or not (equals and name):
                raise RecordingError(
                    f"--columns {part!r}: must be ROLE=COLUMN[:UNIT], with ROLE one of {', '.join(ROLES)}", "no_role"
                )
            if role in given:
                raise RecordingError(
                    f"--columns {part!r}: the role {role} is given twice; give it once", "role_twice"
                )
            given[role] = _column(part, name, ROLES[role].units)
    _refuse_what_cannot_be(given)
    if "sd" in given and "rate" in given and not given["sd"].unit:
        given["sd"] = given["rate"]._replace(name=given["sd"].name)
    return ColumnMap(given, _stated_window(given))


def _roles_in(text: str) -> list[str]:
    """Split "position=x, left:mm,rate=FR" at the commas that are before a role."""
    parts: list[str] = []
    for part in text.split(","):
        if parts and "=" not in part:
            parts[-1] += f",{part}"
        else:
            parts.append(part)
    return parts


def _stated_window(given: dict[str, RecordingColumn]) -> float | None:
    """Return the window in s if it is a number instead of a column, else None. Raises RecordingError."""
    try:
        seconds = read_number(given["window"].name) * given["window"].factor
    except (KeyError, ValueError):
        return None
    if MOST_HOLD_S < seconds < math.inf:
        raise RecordingError(
            f"--columns window={given['window'].name}: at most {MOST_HOLD_S:g} s; if it is in ms, use "
            f"window={given['window'].name}:ms",
            "beyond_a_finger",
        )
    if not 0 < seconds < math.inf:
        raise RecordingError(
            f"--columns window={given['window'].name}: must be a number of seconds above 0", "window_not_above_0"
        )
    return seconds


def _refuse_what_cannot_be(given: Mapping[str, RecordingColumn]) -> None:
    names = [column.name for column in given.values()]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise RecordingError(f"--columns: the column {twice[0]!r} has two roles; give it one", "column_twice")
    if "count" in given and ("rate" in given or "sd" in given):
        raise RecordingError(
            "--columns: count cannot be combined with rate or sd; use counts with a window, or rates with an sd",
            "counts_and_rates",
        )


def _column(part: str, name: str, of: Dimension) -> RecordingColumn:
    before, colon, unit = name.rpartition(":")
    if colon:
        factor = of.known(unit) if of.usual else None
        if not before or factor is None:
            expected = f"one of {', '.join(of.listed)}" if of.usual else "omitted for this role"
            if colon in before:
                expected += "; if the colon belongs to the name, add the unit after another one"
            raise RecordingError(f"--columns {part!r}: the unit {unit!r} must be {expected}", "unknown_unit")
        if named := contradicts(before.strip(), unit, of):
            raise RecordingError(
                f"--columns {part!r}: the column's name states {named}, the option {unit.strip()}; correct the "
                "wrong one",
                "two_units",
            )
        return RecordingColumn(before.strip(), unit.strip(), factor, True)
    said = header_name(name, of)
    if said.factor is None and of.listed:
        remedy = f"state it as {part.strip()}:UNIT"
        if contradicts(name, "", of):
            remedy = f"call the column {renamed(name, 'UNIT', of)!r}"
        raise RecordingError(
            f"--columns {part!r}: the unit {said.unit!r} is unknown; it must be one of {', '.join(of.listed)}: "
            f"convert the numbers, or, if they are in one of these, {remedy}",
            "unknown_unit",
        )
    return RecordingColumn(name, said.unit, said.factor or 1.0)
