"""What a list says of one run, and its holds as rows of one table of many runs."""

import os
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rig.data.folder import RunFolder
from rig.data.reader import Run, RunError, read_run
from rig.data.run_tables import table

RUNNING, KILLED, SHORT = "running", "killed", "incomplete"
STATES = ("done", SHORT, "aborted", "tripped", "limited", "failed", KILLED, RUNNING)
"""How a run ended: its journal's words, and for what has none: not all done, without an end, not ended yet."""

RUN_COLUMNS = ("run", "date_utc", "protocol", "subject", "virtual", "state")
HOLD_COLUMNS = (
    *("index", "hold", "block", "repeat", "condition", "indentor", "x_mm", "target_doi_mm", "target_force_gwt"),
    *("t_s", "hold_s", "doi_mm", "doi_sd_mm", "force_gwt", "force_sd_gwt", "peak_gwt", "readings"),
    "contact_height_mm",
)
"""Of the table of many runs, after those of the run: one row for each hold that ended; names end in their units."""

LISTED = ("indentation_start", "touch", "hold_end")
"""Streams that a list and a table of many runs are made of."""

FOREIGN = (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError)
"""What a journal leads to that another program wrote."""

Row = list[Any]


@dataclass(frozen=True)
class Summary:
    """One run folder, by its name. problem: why it cannot be read; then nothing else is known."""

    name: str
    problem: str = ""
    date_utc: str = ""  # of its first document, ISO 8601
    protocol: str = ""
    title: str = ""
    subject: str = ""
    shapes: tuple[str, ...] = ()
    state: str = ""
    virtual: bool = False
    planned: int = 0
    done: int = 0
    duration_s: float = 0.0

    @property
    def of_the_run(self) -> Row:
        """In the order of RUN_COLUMNS."""
        return [self.name, self.date_utc, self.protocol, self.subject, self.virtual, self.state]


def summarised(path: Path) -> tuple[Summary, list[Row]]:
    """A run folder and its holds in the order of HOLD_COLUMNS; whatever lies there, nothing is raised."""
    try:
        run = read_run(path, only=LISTED)
        found = summary_of(run)
        return found, _holds(run)
    except RunError as error:
        problem = str(error).removeprefix(f"run {path}: ").replace(f"{path}{os.sep}", "")
    except FOREIGN as error:
        problem = foreign(error)
    return Summary(path.name, problem=" ".join(problem.split())), []


def foreign(error: Exception) -> str:
    """What is said of such a journal."""
    return f"no journal that this version can read: {type(error).__name__}: {error}"


def alive(found: Summary, runs: Path) -> Summary:
    """The same; what has no end yet is running where another process writes to it."""
    return replace(found, state=RUNNING) if found.state == KILLED and RunFolder(runs / found.name).busy else found


def summary_of(run: Run) -> Summary:
    """Of a run that was read; raises what a foreign journal leads to."""
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
    )


def state_of(run: Run) -> str:
    """How it ended, by its journal alone."""
    if run.stop is None:
        return KILLED
    return SHORT if run.stop["status"] == "done" and run.missing else str(run.stop["status"])


def _holds(run: Run) -> list[Row]:
    contacts = {touch["index"]: touch["contact_height_mm"] for touch in run.stream("touch")}
    ended = table(run, "hold_end").rows if run.stream("hold_end") else []
    rows = [{**hold, "contact_height_mm": contacts.get(hold["index"])} for hold in ended]
    return [[row.get(name) for name in HOLD_COLUMNS] for row in rows]
