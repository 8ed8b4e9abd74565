"""Tables of a journal, summaries of runs, and the time spent on each activity."""

import heapq
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

from rig.data.events import OF_THE_PRESS, PRESS_STREAMS, READING, WAITED_FOR, units_of
from rig.data.folder import RunFolder
from rig.data.presses import PressRecord, presses_table
from rig.data.run import Run, RunError, read_run
from rig.data.run_status import RunStatus
from rig_shared.errors import CodedError

PRESSES, SUPERSEDED = "presses", "_superseded"
_START = "indentation_start"

TableRow = Mapping[str, Any]


@dataclass(frozen=True)
class Table:
    """Events of one stream: columns with units, and rows, which may lack some of them."""

    units: Mapping[str, str]
    events: Sequence[TableRow]
    starts: Mapping[int, TableRow] | None = None  # of the presses that the events belong to

    @property
    def rows(self) -> Iterator[TableRow]:
        """Events with the columns of their press, one by one."""
        if self.starts is None:
            yield from self.events
            return
        for event in self.events:
            yield {**event, **_press(self.starts.get(event["index"]), event)}


def tables(run: Run) -> dict[str, Table]:
    """Return the tables of all streams with events, by name; repeated indentations have separate ones."""
    found = {name: table(run, name) for name, events in run.events.items() if events}
    if rows := presses_table(run):
        found = {PRESSES: Table(units_of(PressRecord), rows)} | found
    return found | {name + SUPERSEDED: _table(run, name, events) for name, events in run.superseded.items()}


def table(run: Run, stream: str) -> Table:
    """Return the table of a stream with events."""
    return _table(run, stream, run.stream(stream))


def _table(run: Run, stream: str, events: Sequence[TableRow]) -> Table:
    units = {"t_s": "s", **run.units[stream]}
    name = next((name for name in PRESS_STREAMS if stream.endswith(name)), None)
    if name is None:
        return Table(units, events)
    starts = _starts(run, stream.removesuffix(name) + _START)
    own = {column: unit for column, unit in units.items() if column not in OF_THE_PRESS}
    return Table(own | OF_THE_PRESS, events, starts)


def _starts(run: Run, stream: str) -> dict[int, TableRow]:
    events: Iterable[TableRow] = [*run.superseded.get(stream, []), *run.stream(stream)]
    return {event["index"]: event for event in events}


def _press(start: TableRow | None, event: TableRow) -> dict[str, Any]:
    """Return the columns of the press that an event belongs to, with the hold's own target."""
    if start is None:
        return {}
    columns = {name: start[name] for name in ("indentor", "block", "repeat", "condition") if name in start}
    return {**columns, f"target_{start['target']}": event.get("commanded", start["value"])}


_LEADS_TO = {
    **dict.fromkeys(WAITED_FOR, "waiting for a person"),
    **dict.fromkeys(("home", "zero", "note", "checkpoint", "trip"), "homing, zero and notes"),
    **dict.fromkeys(("clearance", "move", "moving"), "lateral moves"),
    **dict.fromkeys(("rest", "choice", "indentation_start"), "rest"),
    "approach": "approach",
    "back off": "touch-off",
    "touch": "touch-off",
    **dict.fromkeys(("press", "ramp"), "press and seek"),
    "hold": "hold",
    "retract": "lift",
}
_INSTANT = ("note", "checkpoint")
"""Events that take no time: at the same instant, the time before belongs to the other one."""
_UNTIL_THEN = "paused"  # The time before a pause belongs to the interrupted activity.


@dataclass(frozen=True)
class Span:
    """Interval of the run (`t_s`), and its activity."""

    begin_s: float
    end_s: float
    what: str


def spans(run: Run) -> list[Span]:
    """Return the intervals before the events, for all presses; together they cover the run, without its stops."""
    found, paused = list[Span](), list[tuple[float, float]]()
    last_s = run.start["t_s"]
    for t_s, kind in _stamps(run):
        gone, last_s = _running(run, last_s, t_s), t_s
        if kind == _UNTIL_THEN:
            paused += gone
            continue
        _add(found, gone, _LEADS_TO[kind])
        if kind not in WAITED_FOR:
            _add(found, paused, _LEADS_TO[kind])
            paused = []
    return found


def _add(found: list[Span], intervals: Iterable[tuple[float, float]], what: str) -> None:
    """Add intervals of an activity, the first as a part of the last one if they meet."""
    for begin_s, end_s in intervals:
        if found and found[-1].what == what and found[-1].end_s == begin_s:
            begin_s = found.pop().begin_s
        found.append(Span(begin_s, end_s, what))


def _running(run: Run, begin_s: float, end_s: float) -> list[tuple[float, float]]:
    """Return an interval without the time between the parts of the run."""
    found = [(begin_s, end_s)]
    for (_, stopped_s), (resumed_s, _) in pairwise(run.parts):
        if begin_s <= stopped_s < resumed_s <= end_s:
            found[-1:] = [(found[-1][0], stopped_s), (resumed_s, end_s)]
    return found


def booked_s(run: Run) -> dict[str, float]:
    """Return the duration of each activity (s)."""
    totals = dict.fromkeys(_LEADS_TO.values(), 0.0)
    for span in spans(run):
        totals[span.what] += span.end_s - span.begin_s
    return totals


def motions_in_contact(run: Run) -> list[tuple[str, str]]:
    """Return the ramps of a run by command, with their force limits, in words."""
    found: dict[str, list[TableRow]] = {}
    for event in run.stream("ramp"):
        found.setdefault(f"ramps at {event['speed_mm_s']:g} mm/s", []).append(event)
    return [
        (
            what,
            f"{len(some)}, tripped from {min(one['trip_gwt'] for one in some):.2f} gwt on, at rest within "
            f"{max(one['stop_mm'] for one in some):.2g} mm and below {max(one['bound_gwt'] for one in some):.2f} gwt",
        )
        for what, some in found.items()
    ]


def _stamps(run: Run) -> Iterator[tuple[float, str]]:
    """Yield the time of each event and its kind, in order of time."""
    streams = [*run.events.items(), *run.superseded.items()]
    readings = [_times(found, None) for stream, found in streams if stream.endswith(READING)]
    others = [_times(found, stream) for stream, found in streams if stream in _LEADS_TO or stream == _UNTIL_THEN]
    return heapq.merge(*readings, *others, key=lambda one: (one[0], one[1] in _INSTANT, one[1]))


def _times(events: Iterable[TableRow], kind: str | None) -> Iterator[tuple[float, str]]:
    return ((event["t_s"], event["phase"] if kind is None else kind) for event in events)


RUN_COLUMNS = ("run", "date_utc", "protocol", "subject", "virtual", "state")
HOLD_COLUMNS = (
    *("index", "hold", "block", "repeat", "condition", "indentor", "x_mm", "target_doi_mm", "target_force_gwt"),
    *("t_s", "hold_s", "doi_mm", "doi_sd_mm", "force_gwt", "force_sd_gwt", "peak_gwt", "readings"),
    "contact_height_mm",
)
"""Columns of the table of many runs, after RUN_COLUMNS: one row for each finished hold."""

LISTED = ("indentation_start", "touch", "hold_end", "choice")
"""Streams for lists and tables of many runs."""

FOREIGN = (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, RecursionError)
"""Errors from a journal of another program."""


@contextmanager
def foreign_in_one_line(path: Path) -> Iterator[None]:
    """Raise RunError for any error that a damaged journal, or one of another program, causes."""
    try:
        yield
    except FOREIGN as error:
        if isinstance(error, CodedError):
            raise
        raise RunError(f"run folder {path}: {foreign(error)}", "foreign_run") from None


Row = list[Any]


@dataclass(frozen=True)
class Summary:
    """Summary of one run folder. problem: why it cannot be read; the other fields are then unknown."""

    name: str
    problem: str = ""
    date_utc: str = ""  # of the first document, ISO 8601
    protocol: str = ""
    title: str = ""
    subject: str = ""
    shapes: tuple[str, ...] = ()
    state: str = ""
    virtual: bool = False
    planned: int = 0
    done: int = 0
    duration_s: float = 0.0
    uid: str = ""  # of the run, which a copy of its folder shares
    damage: str = ""  # of the journal: what is damaged and left out

    @property
    def of_the_run(self) -> Row:
        """Values in the order of RUN_COLUMNS."""
        return [self.name, self.date_utc, self.protocol, self.subject, self.virtual, self.state]


def summarised(path: Path) -> tuple[Summary, list[Row]]:
    """Return the summary of a run folder and its holds in the order of HOLD_COLUMNS; raise nothing."""
    try:
        run = read_run(path, only=LISTED)
        found = summary_of(run)
        return found, _holds(run)
    except RunError as error:
        problem = str(error).removeprefix(f"run folder {path}: ").replace(f"{path}{os.sep}", "")
    except FOREIGN as error:
        problem = foreign(error)
    return Summary(path.name, problem=" ".join(problem.split())), []


def foreign(error: Exception) -> str:
    """Return the problem of a journal of another program."""
    return f"the journal is damaged or of another program: {type(error).__name__}: {error}"


def alive(found: Summary, runs: Path) -> Summary:
    """Return the summary as running if another process writes to a run without an end."""
    return (
        replace(found, state=RunStatus.RUNNING)
        if found.state == RunStatus.KILLED and RunFolder(runs / found.name).busy
        else found
    )


def summary_of(run: Run) -> Summary:
    """Return the summary of a run. Raises the errors in `FOREIGN` for a journal of another program."""
    start = run.start
    return Summary(
        name=run.folder.path.name,
        date_utc=datetime.fromtimestamp(start["unix_s"], UTC).isoformat(timespec="seconds"),
        protocol=str(start["protocol"]),
        title=str(start["title"]),
        subject=str(start.get("subject") or ""),
        shapes=tuple(dict.fromkeys(str(event["indentor"]) for event in run.stream("indentation_start"))),
        state=state_of(run),
        virtual=bool(start["virtual"]),
        planned=int(start["planned_indentations"]),
        done=len(run.done),
        duration_s=run.duration_s,
        uid=str(start.get("uid", "")),
        damage=(run.warning or "").removeprefix(f"run folder {run.folder.path}: "),
    )


def state_of(run: Run) -> RunStatus:
    """Return the final state, from the journal alone."""
    return RunStatus.of_journal(run.stop, run.missing)


def _holds(run: Run) -> list[Row]:
    contacts = {touch["index"]: touch["contact_height_mm"] for touch in run.stream("touch")}
    ended = table(run, "hold_end").rows if run.stream("hold_end") else []
    rows = [{**hold, "contact_height_mm": contacts.get(hold["index"])} for hold in ended]
    return [[row.get(name) for name in HOLD_COLUMNS] for row in rows]
