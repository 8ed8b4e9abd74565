"""A run's journal as tables: what was recorded, and with each reading the press that it belongs to."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rig.data.reader import Run
from rig.engine.streams import PRESS_STREAMS

OF_THE_PRESS = {
    "indentor": "", "target_doi_mm": "mm", "target_force_gwt": "gwt", "block": "", "repeat": "", "condition": "",
}  # fmt: skip
"""Columns that every table of a press ends with, and their units: what was pressed, how far, and why."""

SUPERSEDED = "_superseded"
_START = "indentation_start"

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Table:
    """Events of one stream: their columns with units, and a row for each, which may lack some of them."""

    units: Mapping[str, str]
    rows: list[dict[str, Any]]

    @property
    def columns(self) -> dict[str, list[Any]]:
        """By name, None where a row has nothing."""
        return {name: [row.get(name) for row in self.rows] for name in self.units}


def tables(run: Run) -> dict[str, Table]:
    """One for each stream that has events, by its name; what was begun anew has tables of its own."""
    found = {name: table(run, name) for name, events in run.events.items() if events}
    return found | {name + SUPERSEDED: _table(run, name, events) for name, events in run.superseded.items()}


def table(run: Run, stream: str) -> Table:
    """Of one stream that has events."""
    return _table(run, stream, run.stream(stream))


def _table(run: Run, stream: str, events: list[dict[str, Any]]) -> Table:
    units = {"t_s": "s", **run.units[stream]}
    name = next((name for name in PRESS_STREAMS if stream.endswith(name)), None)
    if name is None:
        return Table(units, events)
    starts = _starts(run, stream.removesuffix(name) + _START)
    own = {column: unit for column, unit in units.items() if column not in OF_THE_PRESS}
    return Table(own | OF_THE_PRESS, [{**event, **_press(starts.get(event["index"]), event)} for event in events])


def _starts(run: Run, stream: str) -> dict[int, Row]:
    events: Iterable[Row] = [*run.superseded.get(stream, []), *run.stream(stream)]
    return {event["index"]: event for event in events}


def _press(start: Row | None, event: Row) -> dict[str, Any]:
    """Of the press that an event belongs to; a hold's own target where it has one."""
    if start is None:
        return {}
    told = {name: start[name] for name in ("indentor", "block", "repeat", "condition") if name in start}
    return {**told, f"target_{start['target']}": event.get("commanded", start["value"])}
